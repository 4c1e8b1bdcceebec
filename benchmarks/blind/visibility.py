"""How much of what is hidden shows in the recordings of a case, whatever a diagnosis makes of it.

Of an effect outside the catalogue the same case is hidden once more without it: same nuisances, same noise, same
loggers. A healthy car is fitted to either; the log evidence that it lacks where the effect is there is how much of it
shows. What the diagnosis found lacks less of it; what still is lacking nothing that was found imitates.

Effects of the catalogue that were not found are fitted from the truth. What gets there by more than the search did was
missed by the search; what does not, these recordings do not show. Two that were hidden show beside each other where
both are more evident than either.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cosim.diagnosis.fit.fitting import Fit, Fitter
from cosim.diagnosis.fit.predict import Coordinate, Predictor, coordinates, effect_of
from cosim.diagnosis.plants import Run
from cosim.diagnosis.search.scan import key

Sizes = Mapping[str, Mapping[str, float]]  # effect to the sizes of its parameters


def visibility(diagnosis: Any, without: Iterable[Run]) -> dict[str, float]:
    """Log evidence that an effect takes from a healthy car, and from what was found.

    Args:
        diagnosis: Of the case with the effect.
        without: The recordings of the same case without it.

    Returns:
        ``healthy`` and ``found``.

    Raises:
        ArithmeticError: One cannot be simulated.
    """
    car, runs, found = diagnosis.car, diagnosis.runs, diagnosis.identification
    others = {run.name: run for run in without}
    declared = coordinates(car, runs)
    noise = found.noise.undoubted  # a run that nothing explains shows what it shows

    def settled(fitter: Fitter, fit: Fit) -> float:
        return fitter.settle(fitter.assess(fitter.refine(fit, noise), noise), noise).score

    there, gone = (Fitter(Predictor(car, some, declared)) for some in (runs, [_like(run, others) for run in runs]))
    best = settled(gone, gone.nominal())
    return {"healthy": best - settled(there, replace(found.healthy, near=False, settled=False)),
            "found": best - there.assess(replace(found.best), noise).score}


def evident(diagnosis: Any, sizes: Sizes) -> float | None:
    """How evident what is true is: the better of two fits that begin there [log evidence].

    Args:
        diagnosis: Of the case.
        sizes: What was hidden, or a part of it.

    Returns:
        None where no recording could show it, or the diagnosis's model cannot be simulated with it.
    """
    found = diagnosis.identification
    point, causes = _there(found.coordinates, sizes)
    if not set(sizes) <= set(map(effect_of, causes)):
        return None
    fitter = Fitter(Predictor(diagnosis.car, diagnosis.runs, found.coordinates))
    try:
        start = fitter.assess(replace(fitter.at(point), causes=causes), found.noise)
    except ArithmeticError:
        return None
    ways = fitter.refine(start, found.noise, 3), fitter.cooled(start, found.noise)
    return max(fitter.settle(fitter.assess(fit, found.noise), found.noise).score for fit in ways)


def missed(diagnosis: Any, true: float | None) -> float | None:
    """By how much what is true is more evident than the best the search had [log evidence]; negative where it is less.

    Args:
        diagnosis: Of the case.
        true: As ``evident`` says.
    """
    return None if true is None else true - max(fit.score for fit in diagnosis.identification.alternatives)


def beside(diagnosis: Any, sizes: Sizes, true: float | None) -> float | None:
    """How much the effect that shows least shows beside the others that were hidden [log evidence].

    Each may show alone, and not beside another that does the same, or makes up for it.

    Args:
        diagnosis: Of the case.
        sizes: What was hidden, two effects at least.
        true: All of it, as ``evident`` says.

    Returns:
        All over what is true but for one effect, each as the better of a fit that begins at the truth and of what the
        search had; not above 0 where the recordings do not show all. None as ``evident``.
    """
    parts = [{name: of for name, of in sizes.items() if name != gone} for gone in sizes]
    reached = [_best(diagnosis, part, evident(diagnosis, part)) for part in parts]
    whole = _best(diagnosis, sizes, true)
    if whole is None or None in reached:
        return None
    return whole - max(reached)


def _best(diagnosis: Any, sizes: Sizes, true: float | None) -> float | None:
    """The highest of what is true and of what the search had of these effects [log evidence]; None where neither is."""
    had = [fit.score for fit in diagnosis.identification.alternatives if set(fit.effects) == set(sizes)]
    return max([*had, *([] if true is None else [true])], default=None)


def _there(declared: Sequence[Coordinate], sizes: Sizes) -> tuple[np.ndarray, tuple[str, ...]]:
    """Coordinates with these sizes and nothing else, and which causes that are; swings at no phase of their own."""
    point, causes = np.zeros(len(declared)), []
    for i, c in enumerate(declared):
        size = sizes.get(c.effect, {}).get(c.name)
        x = 0.0 if size is None else c.parameter.coordinate(size)
        if x != 0.0:
            point[i] = np.clip(x, c.low, c.high) if c.part == 0 else 0.0
            causes.append(c.cause)
    return point, key(dict.fromkeys(causes))


def _like(run: Run, others: dict[str, Run]) -> Run:
    """The recording of that name, on the clocks of this one."""
    other = others[run.name]
    measured = {name: np.interp(clock, other.clocks[name], other.measured[name]) for name, clock in run.clocks.items()}
    return replace(other, clocks=run.clocks, measured=measured)
