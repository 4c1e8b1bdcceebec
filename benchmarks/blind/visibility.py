"""How much of an effect shows in the recordings of a case, whatever a diagnosis makes of it.

The same case is hidden once more without the effect: same nuisances, same noise, same loggers. A healthy car is fitted
to either; the log evidence that it lacks where the effect is there is how much of it shows. What the diagnosis found
lacks less of it; what still is lacking nothing that was found imitates.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from cosim.diagnosis.fit.fitting import Fit, Fitter
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.plants import Run


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


def _like(run: Run, others: dict[str, Run]) -> Run:
    """The recording of that name, on the clocks of this one."""
    other = others[run.name]
    measured = {name: np.interp(clock, other.clocks[name], other.measured[name]) for name, clock in run.clocks.items()}
    return replace(other, clocks=run.clocks, measured=measured)
