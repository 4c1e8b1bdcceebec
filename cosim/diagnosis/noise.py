"""What is left when a model is right: the sensors' noise, and an engine torque that wanders.

Sensors: noise and resolution, white, read off the recordings. The engine torque is what a control unit
estimates; the true one wanders about it. What that does to each channel, and where, is simulated; it is largest
where the lash is crossed gently.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from cosim.diagnosis.plants import Run

WANDER, WANDER_TIME = 1.0, 0.1  # of the true torque about its estimate: N.m, s
_LOST = 3.0  # times the usual distance: from there on samples hardly count
_TAIL = 2.0  # times the usual scale: from there on errors are no more surprising than their logarithm
_WINDOW = 0.3  # s: over which scales are averaged


def floor(values: np.ndarray) -> float:
    """Standard deviation of what changes from sample to sample [unit of values]: noise, resolution.

    From third differences, in the middle two thirds of their distribution, so that a few real jumps do not
    count.
    """
    if values.size < 8:
        return float(np.std(values)) or 1e-9
    third = np.diff(values, 3) / np.sqrt(20.0)
    low, high = np.percentile(third, [16.0, 84.0])
    steps = np.abs(np.diff(values))
    resolution = steps[steps > 1e-9 * (1.0 + np.abs(values).max())].min(initial=np.inf)
    least = resolution / np.sqrt(12.0) if np.isfinite(resolution) else 1e-9
    return float(max(0.5 * (high - low), min(least, float(np.std(values)) + 1e-12)))


def wander(count: int, step: float, random: np.random.Generator) -> np.ndarray:
    """An error of the torque estimate [N.m]: an Ornstein-Uhlenbeck process, ``count`` samples."""
    keep = np.exp(-step / WANDER_TIME)
    kicks = WANDER * np.sqrt(1.0 - keep**2) * random.standard_normal(count)
    kicks[0] = WANDER * random.standard_normal()
    return lfilter([1.0], [1.0, -keep], kicks)


class Noise:
    """How large the residuals of a good model are, sample by sample.

    The sensors' floor, and what the best model at hand leaves beyond it: locally, because a plant of another
    structure errs where flanks meet. Where that is alike from sample to sample, fewer of them count.

    Args:
        runs: The runs; their measured values say the floors.
        residuals: Stacked, what the best model leaves in each.
        swayed: Stacked, how far every sample strays because the torque wanders.
    """

    def __init__(self, runs: Sequence[Run], residuals: Sequence[np.ndarray],
                 swayed: Sequence[np.ndarray]) -> None:
        self.runs = list(runs)
        self.floors = floors(runs)
        self.least = least = [
            np.concatenate([np.hypot(self.floors[name], sway[place]) for name, place in run.slices.items()])
            for run, sway in zip(runs, swayed)]
        local = [_local(run, residual) for run, residual in zip(runs, residuals)]
        self._base = [np.maximum(a, b) for a, b in zip(local, least)]
        lost = _lost(runs, [a / b for a, b in zip(local, least)])
        self.excess = [{name: float(np.mean(np.log(base[place] / low[place]))) for name, place in run.slices.items()}
                       for run, base, low in zip(runs, self._base, least)]
        standard = [e / scale for e, scale in zip(residuals, self._base)]
        alike = {name: np.sqrt(_correlation_time([standard[r][run.slices[name]] for r, run in enumerate(runs)
                                                  if name in run.clocks])) for name in self.floors}
        # by how much more a sample's error may be for what it tells
        self._vague = [factor * np.concatenate([np.full(clock.size, alike[name]) for name, clock in run.clocks.items()])
                       for run, factor in zip(runs, lost)]

    @property
    def scales(self) -> list[np.ndarray]:
        """Standard deviation of every sample of each run, for a sum of squares."""
        return [a * b for a, b in zip(self._base, self._vague)]

    def heavy(self, residuals: Sequence[np.ndarray]) -> tuple[Noise, float]:
        """This noise as it is for a supposition that leaves other residuals: with a heavy tail.

        Where they are locally more than ``_TAIL`` times as large as they should be, the scale is as much larger,
        at the price of its logarithm: one flank that meets at another time does not decide alone.

        Returns:
            The noise, and what it costs of the log likelihood.
        """
        result, cost = object.__new__(Noise), 0.0
        result.runs, result.floors, result._vague, result._base = self.runs, self.floors, self._vague, []
        for run, residual, base, vague in zip(self.runs, residuals, self._base, self._vague):
            factor = np.maximum(1.0, _local(run, residual) / (_TAIL * base))
            result._base.append(base * factor)
            cost += float(np.sum(np.log(factor) / vague**2))
        return result, cost

    @property
    def size(self) -> float:
        """Logarithm of the noise's determinant: the less a model leaves unexplained, the smaller."""
        return float(sum(np.sum(np.log(base)) for base in self._base))

    def whiten(self, run: int, stacked: np.ndarray) -> np.ndarray:
        """Stacked values of a run, or columns of them, in units of the noise."""
        scale = self._base[run] * self._vague[run]
        return stacked / (scale[:, None] if stacked.ndim == 2 else scale)


def _local(run: Run, residual: np.ndarray) -> np.ndarray:
    """Root mean square of a stacked residual around every sample."""
    found = np.empty(residual.size)
    for name, place in run.slices.items():
        count = max(3, round(_WINDOW / float(np.median(np.diff(run.clocks[name])))))
        found[place] = np.sqrt(uniform_filter1d(residual[place] ** 2, count, mode="nearest"))
    return found


def _lost(runs: Sequence[Run], ratios: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Factors on the scale of every sample, large where measured and simulated became different stories.

    A flank that meets too late, a lash that is crossed in the one and not in the other: from there on a run
    tells nothing until they agree again. That is where all channels together are much farther apart than they
    usually are.
    """
    grids = [np.arange(run.start, run.time[-1] + _WINDOW, _WINDOW / 3.0) for run in runs]
    apart = []
    for run, ratio, grid in zip(runs, ratios, grids):
        rows = [np.interp(grid, clock, ratio[run.slices[name]]) for name, clock in run.clocks.items()]
        apart.append(np.sqrt(np.mean(np.square(rows), axis=0)))
    usual = max(1.0, float(np.median(np.concatenate(apart))))
    factors = []
    for run, grid, rho in zip(runs, grids, apart):
        factor = np.sqrt(1.0 + (rho / (_LOST * usual)) ** 8)
        factors.append(np.concatenate([np.interp(clock, grid, factor) for clock in run.clocks.values()]))
    return factors


def floors(runs: Sequence[Run]) -> dict[str, float]:
    """Standard deviation of each channel's white noise [its unit]."""
    names = dict.fromkeys(name for run in runs for name in run.clocks)
    return {name: float(np.median([floor(run.measured[name]) for run in runs if name in run.clocks]))
            for name in names}


def _correlation_time(pieces: Sequence[np.ndarray]) -> float:
    """How many samples say what one independent sample would, at least 1."""
    length = min(piece.size for piece in pieces) // 3
    power = sum(float(piece @ piece) for piece in pieces)
    total = 1.0
    for lag in range(1, length):
        share = sum(float(piece[:-lag] @ piece[lag:]) for piece in pieces) / power
        if share < 0.05:
            break
        total += 2.0 * share
    return total
