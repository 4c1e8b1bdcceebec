"""What is left when a model is right: noise that is coloured, and larger where the driveline is touchy.

Two things make it. Sensors: noise and resolution, white, read off the recordings. And the engine torque,
which a control unit estimates and which wanders about that estimate: a newton metre more or less while the
lash is crossed gently moves the landing by tens of milliseconds, and everything after it. How much, and
where, is simulated: an ensemble of runs with such torques gives every channel's scale over time and its
colour before anything is fitted, the same for every supposition. Only a factor on each channel then comes
from what the best model leaves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from cosim.diagnosis.plants import Run

TEMPERATURE = 2.0  # residuals of a plant of another structure are more alike than any colour says
WANDER, WANDER_TIME = 1.0, 0.1  # of the true torque about its estimate: N.m, s
_ORDERS = 6
_WINDOW = 0.25  # s: over which scales are averaged


@dataclass(frozen=True)
class Colour:
    """The noise of one channel.

    Attributes:
        floor: Standard deviation of what changes from sample to sample, in the channel's unit.
        taps: Autoregressive whitening filter, the first 1.
        innovation: Standard deviation of its output, where the scale is 1.
        factor: On all of it, from what the best model leaves; at least 1.
    """

    floor: float
    taps: np.ndarray = field(repr=False)
    innovation: float
    factor: float = 1.0

    def white(self, standard: np.ndarray) -> np.ndarray:
        """Values in units of the scale, whitened; what starts the filter becomes 0."""
        white = lfilter(self.taps, [1.0], standard, axis=0) / (self.innovation * self.factor)
        white[:self.taps.size - 1] = 0.0
        return white

    @property
    def sample_share(self) -> float:
        """News a sample brings on the mean: effective sample size over number of samples."""
        return float(min(1.0, np.sum(self.taps) ** 2 / self.innovation**2))


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
    """The noise of every channel of every run.

    Args:
        runs: The runs; their measured values say the floors.
        ensembles: For every run, several stacked deviations of its channels with wandering torques from the
            one without.
    """

    def __init__(self, runs: Sequence[Run], ensembles: Sequence[Sequence[np.ndarray]]) -> None:
        self.runs, self.temperature = list(runs), TEMPERATURE
        self._scales: list[dict[str, np.ndarray]] = [{} for _ in runs]
        names = dict.fromkeys(name for run in runs for name in run.clocks)
        self.colours = {name: self._colour(name, ensembles) for name in names}

    def _colour(self, name: str, ensembles: Sequence[Sequence[np.ndarray]]) -> Colour:
        random = np.random.default_rng(len(name))
        there = [i for i, run in enumerate(self.runs) if name in run.clocks]
        white = float(np.median([floor(self.runs[i].measured[name]) for i in there]))
        standard = []
        for i in there:
            clock, place = self.runs[i].clocks[name], self.runs[i].slices[name]
            deviations = np.array([deviation[place] for deviation in ensembles[i]])
            count = max(3, round(_WINDOW / float(np.median(np.diff(clock)))))
            square = uniform_filter1d(np.mean(deviations**2, axis=0), count, mode="nearest")
            scale = self._scales[i][name] = np.sqrt(white**2 + np.maximum(square, 0.0))
            standard += [(d + white * random.standard_normal(d.size)) / scale for d in deviations]
        return Colour(white, *_autoregression(standard))

    def fitted(self, residuals: Sequence[np.ndarray]) -> Noise:
        """The same noise, as much larger in each channel as the residuals of a model ask for."""
        squares: dict[str, list[np.ndarray]] = {}
        plain = {name: replace(colour, factor=1.0) for name, colour in self.colours.items()}
        for i, (run, residual) in enumerate(zip(self.runs, residuals)):
            for name, place in run.slices.items():
                squares.setdefault(name, []).append(
                    plain[name].white(residual[place] / self._scales[i][name]) ** 2)
        result = object.__new__(Noise)
        result.runs, result._scales, result.temperature = self.runs, self._scales, self.temperature
        result.colours = {}
        for name, found in squares.items():
            values = np.concatenate(found)
            # the mean without the largest hundredth: a gap in the torque's log is no noise
            mean = float(np.mean(np.minimum(values, np.percentile(values, 99.0))))
            result.colours[name] = replace(self.colours[name], factor=max(1.0, np.sqrt(mean)))
        return result

    @property
    def size(self) -> float:
        """Logarithm of the noise's determinant: the less a model leaves unexplained, the smaller."""
        return sum(clock.size * np.log(self.colours[name].factor)
                   for run in self.runs for name, clock in run.clocks.items())

    def scale(self, run: int, name: str) -> np.ndarray:
        """Standard deviation of a channel's noise over the samples of a run, in its unit."""
        return self._scales[run][name] * self.colours[name].factor

    def whiten(self, run: int, stacked: np.ndarray) -> np.ndarray:
        """Stacked values of one run, or columns of them, made unit white noise if they are noise."""
        result = np.zeros_like(stacked, dtype=np.float64)
        columns = (slice(None), *(None,) * (stacked.ndim - 1))
        for name, place in self.runs[run].slices.items():
            result[place] = self.colours[name].white(stacked[place] / self._scales[run][name][columns])
        return result

    def drawn(self, run: int, random: np.random.Generator) -> np.ndarray:
        """Stacked noise of one run."""
        result = np.zeros(sum(clock.size for clock in self.runs[run].clocks.values()))
        for name, place in self.runs[run].slices.items():
            colour = self.colours[name]
            white = colour.innovation * random.standard_normal(place.stop - place.start)
            result[place] = self.scale(run, name) * lfilter([1.0], colour.taps, white)
        return result

    def floors(self) -> Mapping[str, float]:
        """The noise floor of each channel, in its unit: sensors, and what the wandering torque adds."""
        return {name: float(np.sqrt(np.mean(np.concatenate(
            [self._scales[i][name] for i, run in enumerate(self.runs) if name in run.clocks]) ** 2)))
            for name in self.colours}


def _autoregression(pieces: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Whitening taps and innovation of pooled series, the order by BIC."""
    count = sum(piece.size for piece in pieces)
    lags = np.array([sum(float(piece[:piece.size - lag] @ piece[lag:]) for piece in pieces) / count
                     for lag in range(_ORDERS + 1)])
    lags[0] *= 1.0 + 1e-6
    best = (count * np.log(lags[0]), np.ones(1), np.sqrt(lags[0]))
    for order in range(1, _ORDERS + 1):
        ahead = solve_toeplitz(lags[:order], lags[1:order + 1])
        variance = max(float(lags[0] - ahead @ lags[1:order + 1]), 1e-9 * lags[0])
        score = count * np.log(variance) + order * np.log(count)
        if score < best[0]:
            best = (score, np.concatenate([[1.0], -ahead]), np.sqrt(variance))
    return best[1], float(best[2])
