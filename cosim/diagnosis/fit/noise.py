"""What is left when a model is right: the sensors' noise, a torque that wanders too fast, impacts a little off.

Sensors: noise and resolution, white, read off the recordings. The engine torque is what a control unit
estimates; the true one wanders about it. Most of that is estimated with the parameters (``plants.hats``); what
is too fast for it is simulated, with the noise of the speeds that lead the plant: how much that moves each
channel, and where. And no simulation knows to the millisecond when teeth meet; where a signal jumps then, a
sample is on one side of the jump or on the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d
from scipy.signal import lfilter

from cosim.diagnosis.plants import STEP, Run

WANDER, WANDER_TIME = 1.0, 0.1  # of the true torque about its estimate: N.m, s
_OFF = 4e-3  # s: by which an impact may come earlier or later than simulated
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


def bends(values: np.ndarray) -> np.ndarray:
    """By how much a signal at every step jumps or bends within a step, somewhere near each instant [unit of values].

    Its second difference: next to nothing for shuffle, the whole of it for a jump.
    """
    bend = np.zeros(values.size)
    bend[1:-1] = np.abs(np.diff(values, 2))
    return maximum_filter1d(bend, 2 * round(_OFF / STEP) + 1)


class Noise:
    """How large the residuals of a good model are, sample by sample: the sensors' floor, and what wanders.

    It does not depend on what any model leaves: a residual that is there for a cause not yet found would count
    as noise, and hide the cause. Where more is left than there should be, ``heavy`` says what that costs.

    Args:
        runs: The runs; their measured values say the floors.
        strays: Of each run, how far every sample strays for what is random and not estimated: draws x stacked samples.
        bent: Of each run, how much the channels bend near every sample (``bends``), stacked.

    Attributes:
        floors: Standard deviation of each channel's white noise [its unit].
        least: Of each run, standard deviation of every sample.
        scales: The same for a sum of squares: samples that stray alike count as fewer.
        temperatures: Of each run, by what minus the log likelihood is divided.
    """

    def __init__(self, runs: Sequence[Run], strays: Sequence[np.ndarray], bent: Sequence[np.ndarray]) -> None:
        self.runs = list(runs)
        self.floors = floors(runs)
        sways = [np.sqrt(np.mean(np.square(s), axis=0)) for s in strays]
        alike = {name: _correlation_time(
            [row / np.maximum(sways[r][run.slices[name]], 1e-12) for r, run in enumerate(runs) if name in run.clocks
             for row in strays[r][:, run.slices[name]]]) for name in self.floors}
        self.temperatures = np.ones(len(self.runs))
        self.least, self.scales = [], []
        for run, sway, bend in zip(runs, sways, bent):
            floor = np.hypot(run.stack(self.floors), bend)
            self.least.append(np.hypot(floor, sway))
            self.scales.append(np.hypot(floor, np.sqrt(run.stack(alike)) * sway))

    @property
    def undoubted(self) -> Noise:
        """This noise where every run says what it says."""
        return self.tempered(1.0 / self.temperatures)

    def tempered(self, temperatures: Sequence[float]) -> Noise:
        """This noise, larger: of each run, minus the log likelihood is divided by a temperature."""
        result = copy(self)
        result.temperatures = self.temperatures * np.array(temperatures)
        result.scales = [scale * np.sqrt(t) for scale, t in zip(self.scales, temperatures)]
        return result

    def heavy(self, residuals: Sequence[np.ndarray], power: float = 1.0) -> tuple[Noise, np.ndarray]:
        """This noise as it is for a supposition that leaves these residuals: with a heavy tail.

        Where they are locally more than ``_TAIL`` times as large as they should be, the scale is larger by a
        power of that, at the price of its logarithm: one flank that meets at another time does not decide alone.

        Args:
            residuals: Stacked, of every run.
            power: 1 pulls a fit towards what it misses; with 2 samples that are missed say hardly anything more.

        Returns:
            The noise, and what it costs of each run's log likelihood.
        """
        result, costs = copy(self), []
        result.scales = []
        for run, residual, least, scale in zip(self.runs, residuals, self.least, self.scales):
            factor = np.maximum(1.0, _local(run, residual) / (_TAIL * least))
            result.scales.append(scale * factor**power)
            # with either power what is missed costs as much: a factor that lets a square shrink below what it was
            # where the tail begins would reward a miss
            price = np.log(factor) + 0.5 * _TAIL**2 * (1.0 - factor ** (2.0 - 2.0 * power))
            costs.append(float(np.sum(price * (least / scale) ** 2)))
        return result, np.array(costs)

    def excess(self, residuals: Sequence[np.ndarray]) -> list[dict[str, float]]:
        """Of each run and channel, mean logarithm of what is left over what should be, where it is more."""
        return [{name: float(np.mean(np.log(np.maximum(1.0, _local(run, residual)[place] / least[place]))))
                 for name, place in run.slices.items()}
                for run, residual, least in zip(self.runs, residuals, self.least)]

    def whiten(self, run: int, stacked: np.ndarray) -> np.ndarray:
        """Stacked values of a run, or columns of them, in units of the noise."""
        scale = self.scales[run]
        return stacked * (1.0 / scale).astype(stacked.dtype)[:, None] if stacked.ndim == 2 else stacked / scale


def _local(run: Run, residual: np.ndarray) -> np.ndarray:
    """Root mean square of a stacked residual around every sample."""
    found = np.empty(residual.size)
    for name, place in run.slices.items():
        count = max(3, round(_WINDOW / float(np.median(np.diff(run.clocks[name])))))
        found[place] = np.sqrt(uniform_filter1d(residual[place] ** 2, count, mode="nearest"))
    return found


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
    if power == 0.0:
        return total
    for lag in range(1, length):
        share = sum(float(piece[:-lag] @ piece[lag:]) for piece in pieces) / power
        if share < 0.05:
            break
        total += 2.0 * share
    return total
