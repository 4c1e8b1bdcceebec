"""How much of what is hidden shows in the recordings of a case, whatever a diagnosis makes of it.

Of an effect outside the catalogue the same case is hidden once more without it: same nuisances, same noise, same
loggers. A healthy car is fitted to either; the log evidence that it lacks where the effect is there is how much of it
shows. What the diagnosis found lacks less of it; what still is lacking nothing that was found imitates.

Effects of the catalogue that were not found are fitted from the truth. What gets there by more than the search did was
missed by the search; what does not, these recordings do not show.
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


def missed(diagnosis: Any, sizes: Mapping[str, Mapping[str, float]]) -> float | None:
    """By how much fits that begin at the truth are more evident than the best the search had [log evidence].

    Args:
        diagnosis: Of the case.
        sizes: What was hidden: effect to the sizes of its parameters.

    Returns:
        Negative where what is true is less evident than what was found; None where no recording could show it, or the
        diagnosis's model cannot be simulated with it.
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
    ends = [fitter.settle(fitter.assess(fit, found.noise), found.noise).score for fit in ways]
    return max(ends) - max(fit.score for fit in found.alternatives)


def _there(declared: Sequence[Coordinate],
           sizes: Mapping[str, Mapping[str, float]]) -> tuple[np.ndarray, tuple[str, ...]]:
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
