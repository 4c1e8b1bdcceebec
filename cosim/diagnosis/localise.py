"""Where a torque is missing that no effect of the catalogue explains, and what it goes with.

At each place in turn, on a balance or within a shaft, a disturbance torque is supposed: a row of hats whose heights
belong to an Ornstein-Uhlenbeck process. What each does to all channels is simulated, and the most probable torque and
its evidence follow. The place with the most evidence is where it is; over which variable its torque lies on a curve
says what it goes with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from cosim.diagnosis.fitting import Fit
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.plants import STEP, Run
from cosim.diagnosis.plants.car import PLACES
from cosim.diagnosis.plants.hats import correlation, hats, row
from cosim.diagnosis.predict import Predictor

LASTS = 0.3  # s: how long the torque stays alike
_SIZES = np.geomspace(0.05, 30.0, 10)  # of the torque looked for, in units of the place's
_BINS = 12
_MIXED, _PIECES = 8, 9  # orders of a torque's pieces, which are as many a run
_LEAST = 0.1  # share of its variance: what goes with less of it than that, it does not go with
NOTHING = "nothing"  # for what a torque goes with
SHAFT_TORQUE = "shaft torque"  # what the propeller shaft carries, beside the torque that is missing
# Over these a torque may swing any number of times: orders of what turns, waves of the road.
_PERIODIC = {"wheel angle": (2.0 * np.pi,), "distance": tuple(np.geomspace(4.0, 60.0, 40))}


@dataclass(frozen=True)
class Disturbance:
    """The torque missing at one place.

    Attributes:
        place: Which, of ``PLACES``.
        gain: Log evidence over that of no torque.
        size: Standard deviation of the torque [N.m; N on the vehicle].
        table: Torque, its standard deviation, and what it may go with, at all hats of all runs.
    """

    place: str
    gain: float
    size: float
    table: dict[str, np.ndarray] = field(repr=False)


def disturbances(predictor: Predictor, fit: Fit, noise: Noise) -> list[Disturbance]:
    """The torque missing at every place beside a fitted supposition, the most evident first.

    Args:
        predictor: Of the runs.
        fit: What is known to be wrong.
        noise: Of the channels.
    """
    residuals = [(run.stacked - y) / scale for run, y, scale in zip(predictor.runs, fit.predicted, noise.least)]
    supposed = {place: [_Run(e, h / scale[:, None]) for e, h, scale in zip(
        residuals, _slopes(predictor, fit, place), noise.least)] for place in PLACES}
    # a plant of another structure is never right to the noise: errors count as what the best place leaves
    left = [float(np.mean(e**2)) for e in residuals]
    for _ in range(2):
        sizes = {name: max(_SIZES * PLACES[name].size, key=lambda size, runs=runs: _gain(runs, size, left))
                 for name, runs in supposed.items()}
        left = [max(1.0, min(runs[r].left(sizes[name], left[r]) for name, runs in supposed.items()))
                for r in range(len(residuals))]
    found = []
    for name, runs in supposed.items():
        tables = []
        for r, (run, one) in enumerate(zip(predictor.runs, runs)):
            answer = one.solve(sizes[name], left[r])
            tables.append({"torque": answer.mean, "std": answer.deviation} | _variables(predictor, fit, r, run))
        table = {column: np.concatenate([t[column] for t in tables]) for column in tables[0]}
        found.append(Disturbance(name, _gain(runs, sizes[name], left), float(np.std(table["torque"])), table))
    return sorted(found, key=lambda d: -d.gain)


def _gain(runs: Sequence[_Run], size: float, left: Sequence[float]) -> float:
    return sum(run.solve(size, temperature).evidence for run, temperature in zip(runs, left))


def goes_with(table: Mapping[str, np.ndarray]) -> tuple[str, str, float]:
    """What the torque of a table goes with: variable, shape, share of its variance (predicted across stretches).

    ``NOTHING`` where it goes with none of the variables.

    Over some variables many curves are tried. So what counts is how much more they predict than of the same torque
    in another order, which goes with nothing.
    """
    random = np.random.default_rng(1)
    torque, weight = table["torque"], 1.0 / table["std"] ** 2
    runs = [np.flatnonzero(table["run"] == r) for r in np.unique(table["run"])]
    mixed = []
    for _ in range(_MIXED):
        one = torque.copy()
        for own in runs:
            pieces = np.array_split(own, _PIECES)
            one[own] = torque[np.concatenate([pieces[k] for k in random.permutation(_PIECES)])]
        mixed.append(one)
    scores = {}
    for name, values in table.items():
        if name in ("torque", "std", "run") or np.ptp(values) <= 0.0:
            continue
        curves = [_waves(values, length) for length in _PERIODIC[name]] if name in _PERIODIC else [_binned(values)]
        own, *chance = (max(_predicted(one, weight, curve, table["run"]) for curve in curves)
                        for one in (torque, *mixed))
        scores[name] = (own - max(float(np.mean(chance)), 0.0), own)
    best = max(scores, key=scores.__getitem__, default=NOTHING)
    if best == NOTHING or scores[best][0] < _LEAST:
        return NOTHING, "no shape", 0.0
    return best, _shape(table[best], torque, best), float(scores[best][1])


def _binned(values: np.ndarray) -> np.ndarray:
    """Indicators of bins with as many samples each."""
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _BINS + 1)[1:-1]))
    return np.eye(edges.size + 1)[np.searchsorted(edges, values)]


def _waves(values: np.ndarray, length: float) -> np.ndarray:
    angle = 2.0 * np.pi * values / length
    return np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])


def _predicted(torque: np.ndarray, weight: np.ndarray, curve: np.ndarray, run: np.ndarray) -> float:
    """Share of the variance that a curve predicts in each stretch from the others.

    Waves have a phase of their own in every run, so stretches are quarters of each run, in turn.
    """
    explained = total = 0.0
    waves = curve.shape[1] == 3
    for own in (run == r for r in np.unique(run)) if waves else (np.ones(run.size, dtype=bool),):
        fold = np.arange(int(own.sum())) * 8 // max(int(own.sum()), 1) % 4
        c, t, w = curve[own], torque[own], weight[own]
        for k in range(4):
            rest = fold != k
            if not rest.any() or rest.all():
                continue
            matrix = c[rest].T @ (c[rest] * w[rest, None]) + 1e-3 * np.median(w) * np.eye(c.shape[1])
            level = np.linalg.solve(matrix, c[rest].T @ (w[rest] * t[rest]))
            mean = np.average(t[rest], weights=w[rest])
            explained += float(np.sum(w[~rest] * (t[~rest] - c[~rest] @ level) ** 2))
            total += float(np.sum(w[~rest] * (t[~rest] - mean) ** 2))
    return 1.0 - explained / total if total else 0.0


def _shape(values: np.ndarray, torque: np.ndarray, name: str) -> str:
    """The curve in words."""
    if name in _PERIODIC:
        lengths = _PERIODIC[name]
        power = [float(np.abs(np.mean(torque * np.exp(-2j * np.pi * values / length)))) for length in lengths]
        best = lengths[int(np.argmax(power))]
        return "a wave once a revolution" if name == "wheel angle" else f"a wave every {best:.0f} m"
    x = (values - values.mean()) / (np.std(values) or 1.0)
    line, cube = (np.corrcoef(x**n, torque)[0, 1] for n in (1, 3))
    odd = abs(cube) > abs(line) + 0.02
    if max(abs(line), abs(cube)) < 0.3:
        return "no straight line"
    return f"{'rises' if (cube if odd else line) > 0 else 'falls'}, {'steeper at the ends' if odd else 'evenly'}"


def _slopes(predictor: Predictor, fit: Fit, place: str) -> list[np.ndarray]:
    """Per run, what a unit hat does to all channels: samples x hats."""
    runs, push = predictor.runs, PLACES[place].size

    def pushed(run: int, heights: np.ndarray) -> tuple[np.ndarray, int, tuple[str, np.ndarray]]:
        return fit.points[run], run, (place, push * row(runs[run], heights))

    return list(predictor.by_hats(range(len(runs)), fit.predicted, pushed, push).values())


@dataclass(frozen=True)
class _Answer:
    mean: np.ndarray
    deviation: np.ndarray
    evidence: float


class _Run:
    """One run's linear estimate of the torque; residual and slopes in units of the noise."""

    def __init__(self, residual: np.ndarray, slopes: np.ndarray) -> None:
        self.residual, self.slopes = residual, slopes
        self.square, self.product = slopes.T @ slopes, slopes.T @ residual

    def left(self, size: float, temperature: float) -> float:
        """Mean square of what the torque does not explain, in units of the noise."""
        return float(np.mean((self.residual - self.slopes @ self.solve(size, temperature).mean) ** 2))

    def solve(self, size: float, temperature: float) -> _Answer:
        """Most probable torque if it is of some size, and the noise's variance ``temperature`` times as large."""
        n = len(self.product)
        root = size * np.linalg.cholesky(correlation(n, LASTS))
        matrix = cho_factor(np.eye(n) + root.T @ self.square @ root / temperature, lower=True)
        inner = root.T @ self.product / temperature
        mean = root @ cho_solve(matrix, inner)
        covariance = root @ cho_solve(matrix, root.T)
        evidence = 0.5 * float(inner @ cho_solve(matrix, inner)) - float(np.sum(np.log(np.diag(matrix[0]))))
        return _Answer(mean, np.sqrt(np.diag(covariance)), evidence)


def _variables(predictor: Predictor, fit: Fit, r: int, run: Run) -> dict[str, np.ndarray]:
    """What a torque could go with, at the hats."""
    values, nuisance = predictor.values(fit.points[r], r)
    raw = predictor.car.raw(values, run, nuisance)
    at = hats(run)
    wheel = raw["wheel_speed"]
    signals = {
        "speed": raw["vehicle_speed"], SHAFT_TORQUE: raw["propeller_shaft_torque"],
        "twist": raw["axle_shaft_torque"] / (2.0 * values["axle_shaft.stiffness"]),
        "time": run.time - run.start, "distance": np.cumsum(raw["vehicle_speed"]) * STEP,
        "wheel angle": np.cumsum(wheel) * STEP}
    return {name: np.interp(at, run.time, signal) for name, signal in signals.items()} | {
        "run": np.full(at.size, float(r))}

