"""How large causes have to be for given recordings to show them, by the evidence that names them.

Data that are as a cause of some size says have, on average, so much log evidence for it; where that makes up for the
prior, the cause is more likely found than not. So the same search that says "none" says what it would have found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cosim.diagnosis.fit.evidence import Evidence, prior
from cosim.diagnosis.fit.predict import Coordinate, amplitude

Simulate = Callable[[Sequence[np.ndarray]], Sequence[list[np.ndarray] | None]]
_SIDES = (-1.0, 1.0)  # smaller, larger
_TURNS = 8  # simulations of a size that is not enough yet
_STEP = (1.05, 1.5)  # by which it is enlarged, at least and at most
_ENOUGH = 0.95  # share of what is needed that counts as that


class Shown(NamedTuple):
    """The smallest size of a parameter that runs would show.

    Attributes:
        below, above: Distances from 0 of what is searched, downwards and upwards; for a swing its amplitude in all
            runs. Infinite where the runs do not show it while it is plausible.
        price: Log evidence that it costs to suppose the cause, whatever its size.
    """

    below: float
    above: float
    price: float


def detectable(evidence: Evidence, coordinates: Sequence[Coordinate], needed: float,
               simulate: Simulate) -> dict[int, Shown]:
    """The smallest size of each cause's parameter that the runs would show, of nothing else wrong.

    Derivatives say where to look, simulations there whether it is enough: a loss that is a tenth of another has little
    more to take away than one that is half of it.

    Args:
        evidence: What the runs say near the vehicle file.
        coordinates: Of which.
        needed: Log evidence over the healthy car that names a cause.
        simulate: What changes of the coordinates change in every run, whitened; None where that cannot be simulated.

    Returns:
        By the place of its first coordinate. Without causes that do nothing while they are small: derivatives do not
        say when these show.
    """
    healthy, units = prior(coordinates, ()), _units(coordinates)
    trials, prices = [], {}
    for i, unit in units.items():
        wide = prior(coordinates, (coordinates[i].cause,))
        apart, imitated = (evidence.separation(unit, spread) ** 2 for spread in (healthy, wide))
        price = prices[i] = evidence.occam(wide) - evidence.occam(healthy)
        size = float(np.sqrt(2.0 * (needed + price) / (apart - imitated))) if apart > imitated else np.inf
        trials += [_Trial(i, side, size, imitated, price) for side in _SIDES]
    sizes: dict[tuple[int, float], float] = {}
    for _ in range(_TURNS):
        trials = [trial for trial in trials if _plausible(coordinates[trial.place], trial.change)]
        shown = simulate([trial.change * units[trial.place] for trial in trials])
        for trial, changes in zip(trials, shown):
            told = _lead(evidence, healthy, trial, changes) if changes else -np.inf
            if told > _ENOUGH * needed:
                sizes[trial.place, trial.side] = trial.size
            larger = np.sqrt((needed + trial.price) / max(told + trial.price, 1e-9))
            trial.size *= float(np.clip(larger, *_STEP))
        trials = [trial for trial in trials if (trial.place, trial.side) not in sizes]
    return {i: Shown(*(sizes.get((i, side), np.inf) for side in _SIDES), prices[i]) for i in units}


@dataclass
class _Trial:
    """A size that may be enough: of which coordinate and which way; and for its cause what is left of the squared
    distance of a change by 1, and what its wide prior costs."""

    place: int
    side: float
    size: float
    imitated: float
    price: float

    @property
    def change(self) -> float:
        """Of the coordinate."""
        return self.side * self.size


def _lead(evidence: Evidence, healthy: np.ndarray, trial: _Trial, changes: Sequence[np.ndarray]) -> float:
    """Log evidence for a trial's cause over the healthy car, of data that show just these changes."""
    shown = Evidence([seen.slopes.seen(z, np.zeros(healthy.size)) for seen, z in zip(evidence.seen, changes)])
    return 0.5 * (shown.posterior(healthy).least - trial.imitated * trial.size**2) - trial.price


def _units(coordinates: Sequence[Coordinate]) -> dict[int, np.ndarray]:
    """A change by 1 of each cause's parameter, by the place of its first coordinate; of a swing in all runs."""
    found, parameters = {}, set()
    for i, c in enumerate(coordinates):
        nothing_yet = bool(c.cause) and c.run is None and bool(c.parameter.probes)  # while it is small
        if c.cause and not nothing_yet and (c.cause, c.name) not in parameters:
            parameters.add((c.cause, c.name))
            found[i] = np.array([float((other.cause, other.name, other.part) == (c.cause, c.name, 0))
                                 for other in coordinates])
    return found


def _plausible(c: Coordinate, x: float) -> bool:
    return (0.0 if c.phase else c.low) <= x <= c.high


def told(smallest: Mapping[int, Shown], coordinates: Sequence[Coordinate], point: np.ndarray, cause: str,
         needed: float) -> float:
    """Log evidence over the healthy car that data which show a cause as large as that have, on average.

    It grows with the square of the size, by its parameter that shows most; infinite where nobody knows.

    Args:
        smallest: Sizes, as ``detectable`` gives them.
        coordinates: Of these.
        point: Coordinates, as they were found.
        cause: Which.
        needed: Log evidence that these sizes have.
    """
    found = []
    for i, shown in smallest.items():
        if coordinates[i].cause == cause:
            size = _size(coordinates, point, i)
            share = size / (shown.above if size > 0.0 else -shown.below)
            found.append((needed + shown.price) * share**2 - shown.price)
    return max(found, default=np.inf)


def _size(coordinates: Sequence[Coordinate], point: np.ndarray, place: int) -> float:
    """Where a parameter is; of a swing its amplitude."""
    c = coordinates[place]
    if not c.phase:
        return float(point[place])
    return amplitude([point[i] for i, other in enumerate(coordinates)
                      if (other.cause, other.name) == (c.cause, c.name)])


def would_show(smallest: Mapping[int, Shown], coordinates: Sequence[Coordinate],
               values: Mapping[str, float]) -> list[dict[str, Any]]:
    """The same as ``finding.json`` has it: below and above which value each parameter would have been named.

    None where that would be an implausible value.

    Args:
        smallest: Sizes, as ``detectable`` gives them.
        coordinates: Of these.
        values: Of the vehicle file.
    """
    rows = []
    for i, (down, up, _) in smallest.items():
        c = coordinates[i]
        nominal, _, unit = c.parameter.physical(c.parameter.neutral, values)
        below, above = (c.parameter.physical(c.parameter.size(x), values)[1] if _plausible(c, x) else None
                        for x in (-down, up))
        rows.append({"effect": c.effect, "parameter": c.name, "nominal": nominal, "below": below, "above": above,
                     "unit": unit})
    return rows
