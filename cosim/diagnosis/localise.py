"""Where a torque is missing that no effect of the catalogue explains, and what it goes with.

At each place in turn, on a balance or within a shaft, a disturbance torque is supposed: a row of hats whose heights
belong to an Ornstein-Uhlenbeck process. What each does to all channels is simulated, and the most probable torque and
its evidence follow. The place with the most evidence is where it is; over which variable its torque lies on a curve
says what it goes with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from cosim.diagnosis.evidence import Layout, prior
from cosim.diagnosis.finding import NOTHING
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
SHAFT_TORQUE = "shaft torque"  # what the propeller shaft carries, beside the torque that is missing
FOLLOWED = ("speed", SHAFT_TORQUE, "twist", "time")
_KNOTS = 7  # of a curve over one of these
_MORE = 5.0  # log evidence by which a torque that follows a variable has to be more evident than one that need not
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
        follows: The variable it follows as fast as that moves; empty where it is no more than a torque over time.
    """

    place: str
    gain: float
    size: float
    table: dict[str, np.ndarray] = field(repr=False)
    follows: str = ""


def disturbances(predictor: Predictor, fit: Fit, noise: Noise) -> list[Disturbance]:
    """The torque missing at every place beside a fitted supposition, the most evident first.

    Args:
        predictor: Of the runs.
        fit: What is known to be wrong.
        noise: Of the channels.
    """
    runs, layout = predictor.runs, Layout(predictor.coordinates, len(predictor.runs))
    healthy = [_Healthy(layout, r, fit, (run.stacked - fit.predicted[r]) / noise.least[r], noise.least[r])
               for r, run in enumerate(runs)]
    signals = [_signals(predictor, fit, r) for r in range(len(runs))]
    supposed = {(place, name): _Torque(healthy, [h / scale[:, None] for h, scale in zip(slopes, noise.least)],
                                       *_HEIGHTS[name])
                for place in PLACES for name, slopes in _slopes(predictor, fit, place, signals).items()}
    # a plant of another structure is never right to the noise: errors count as what the best supposition leaves
    left = [own.leaves for own in healthy]
    for _ in range(2):
        sizes = {which: max(_SIZES * PLACES[which[0]].size, key=lambda size, torque=torque: torque.gain(size, left))
                 for which, torque in supposed.items()}
        left = [max(1.0, min(leaves)) for leaves in zip(*(t.left(sizes[which], left) for which, t in supposed.items()))]
    gains = {which: torque.gain(sizes[which], left) for which, torque in supposed.items()}
    found = []
    for place in PLACES:
        # a curve has to be more than a constant, and more than what goes with nothing
        least = max(gains[place, "lasting"], gains[place, "constant"]) + _MORE
        quick = max(_QUICK, key=lambda name, place=place: gains[place, name])
        best = quick if gains[place, quick] > least else "lasting"
        heights = supposed[place, best].solve(sizes[place, best], left)
        tables = []
        for r, (run, (mean, covariance)) in enumerate(zip(runs, heights)):
            at = _at_hats(run, signals[r])
            pieces = np.eye(mean.size) if best == "lasting" else _pieces(best, at, signals)
            deviation = np.sqrt(np.einsum("ij,jk,ik->i", pieces, covariance, pieces))
            tables.append({"torque": pieces @ mean, "std": deviation, "run": np.full(len(pieces), float(r))} | at)
        table = {column: np.concatenate([t[column] for t in tables]) for column in tables[0]}
        found.append(Disturbance(place, gains[place, best], float(np.std(table["torque"])), table,
                                 "" if best == "lasting" else best))
    return sorted(found, key=lambda d: -d.gain)


def goes_with(table: Mapping[str, np.ndarray], follows: str = "") -> tuple[str, str, float]:
    """What the torque of a table goes with: variable, shape, share of its variance (predicted across stretches).

    ``NOTHING`` where it goes with none of the variables; ``follows`` where that was found out already.

    Over some variables many curves are tried. So what counts is how much more they predict than of the same torque
    in another order, which goes with nothing.
    """
    if follows:
        return follows, _shape(table[follows], table["torque"], follows), 1.0
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


# -- what is supposed ------------------------------------------------------------------------------


def _alike(count: int) -> np.ndarray:
    """Of the heights of a curve's knots."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return np.exp(-apart / count) + 1e-9 * np.eye(count)


# By what a torque goes: how the heights of its pieces correlate, and whether all runs have them in common.
_HEIGHTS: dict[str, tuple[Callable[[int], np.ndarray], bool]] = {
    "lasting": (lambda count: correlation(count, LASTS), False), "constant": (np.eye, True),
    "wheel angle": (np.eye, False), **dict.fromkeys(FOLLOWED, (_alike, True))}
_QUICK = ("wheel angle", *FOLLOWED)


def _pieces(name: str, values: Mapping[str, np.ndarray], signals: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
    """What each piece of a torque that follows a variable is where it has some values: values x pieces.

    Args:
        name: The variable.
        values: Of all variables.
        signals: The same of every run, at every step; they say where the knots are.
    """
    x = values[name]
    if name == "wheel angle":
        return np.column_stack([np.cos(x), np.sin(x)])
    low, high = np.quantile(np.concatenate([s[name] for s in signals]), (0.005, 0.995))
    knots = np.linspace(low, high, _KNOTS)
    return np.column_stack([np.interp(x, knots, row) for row in np.eye(_KNOTS)])


def _slopes(predictor: Predictor, fit: Fit, place: str,
            signals: Sequence[Mapping[str, np.ndarray]]) -> dict[str, list[np.ndarray]]:
    """Of everything that is supposed at a place, per run, what a piece of unit height does to all channels."""
    runs, push = predictor.runs, PLACES[place].size

    def pushed(run: int, heights: np.ndarray) -> tuple[np.ndarray, int, tuple[str, np.ndarray]]:
        return fit.points[run], run, (place, push * row(runs[run], heights))

    slopes = {"lasting": list(predictor.by_hats(range(len(runs)), fit.predicted, pushed, push).values())}
    jobs = [(name, r, torque) for name in _QUICK for r, own in enumerate(signals)
            for torque in _pieces(name, own, signals).T]
    found = predictor.many([(fit.points[r], r, (place, push * torque)) for _, r, torque in jobs])
    for wanted in _QUICK:
        slopes[wanted] = [np.column_stack([
            np.zeros_like(fit.predicted[r]) if y is None else (y - fit.predicted[r]) / push
            for (name, run, _), y in zip(jobs, found) if (name, run) == (wanted, r)]) for r in range(len(runs))]
    slopes["constant"] = [own.sum(axis=1, keepdims=True) for own in slopes[FOLLOWED[0]]]
    return slopes


class _Healthy:
    """One run as healthy cars may drive it, linearised: their numbers, slope, torque bias and wandering torque.

    Args:
        layout: Of the coordinates.
        run: Which run.
        fit: What is known to be wrong, with its derivatives.
        residual: What it leaves, in units of the noise.
        scale: The noise.

    Attributes:
        leaves: Mean square of the residual.
        slopes: By the coordinates of the run, in units of the noise.
        residual: What would be left with all coordinates 0.
    """

    def __init__(self, layout: Layout, run: int, fit: Fit, residual: np.ndarray, scale: np.ndarray) -> None:
        columns = layout.columns[run]
        self.leaves = float(np.mean(residual**2))
        self.slopes = fit.tangents[run].jacobian / scale[:, None]
        self.residual = residual + self.slopes @ fit.points[run][columns]
        spread = prior(layout.coordinates, fit.causes)[layout.shared]
        self.precision = block_diag(np.diag(1.0 / spread**2), layout.precision[run])
        self.square, self.product = self.slopes.T @ self.slopes, self.slopes.T @ self.residual

    def explain(self, left: float, product: np.ndarray) -> np.ndarray:
        """The most probable coordinates for what has this product with the slopes."""
        return cho_solve(cho_factor(self.square + left * self.precision), product)


class _Torque:
    """A torque that is supposed somewhere, in cars healthy otherwise; the heights of its pieces are normally
    distributed.

    Args:
        healthy: Each run.
        slopes: What the pieces do to it, in units of the noise.
        alike: Number of pieces to the correlation of their heights.
        shared: Whether all runs have the heights in common.
    """

    def __init__(self, healthy: Sequence[_Healthy], slopes: Sequence[np.ndarray],
                 alike: Callable[[int], np.ndarray], shared: bool) -> None:
        self.healthy, self.slopes = healthy, slopes
        self.square = [h.T @ h for h in slopes]
        self.product = [h.T @ own.residual for h, own in zip(slopes, healthy)]
        self.cross = [own.slopes.T @ h for h, own in zip(slopes, healthy)]
        runs = range(len(slopes))
        self.groups = [list(runs)] if shared else [[r] for r in runs]
        self.roots = [np.linalg.cholesky(alike(slopes[group[0]].shape[1])) for group in self.groups]
        self._told: tuple[tuple[float, ...], list[tuple[np.ndarray, np.ndarray]]] = ((), [])

    def _information(self, left: Sequence[float]) -> list[tuple[np.ndarray, np.ndarray]]:
        """What each run says of the heights, whatever its coordinates are."""
        if self._told[0] != tuple(left):
            told = []
            for r, (own, cross) in enumerate(zip(self.healthy, self.cross)):
                explained = own.explain(left[r], np.column_stack([cross, own.product]))
                told.append(((self.square[r] - cross.T @ explained[:, :-1]) / left[r],
                             (self.product[r] - cross.T @ explained[:, -1]) / left[r]))
            self._told = tuple(left), told
        return self._told[1]

    def _solved(self, size: float, left: Sequence[float]) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """Of each group of runs, mean and covariance of the heights, and log evidence."""
        solved, told = [], self._information(left)
        for group, root in zip(self.groups, self.roots):
            root = size * root
            inner = root.T @ sum(told[r][1] for r in group)
            factor = cho_factor(np.eye(inner.size) + root.T @ sum(told[r][0] for r in group) @ root, lower=True)
            evidence = 0.5 * float(inner @ cho_solve(factor, inner)) - float(np.sum(np.log(np.diag(factor[0]))))
            solved.append((root @ cho_solve(factor, inner), root @ cho_solve(factor, root.T), evidence))
        return solved

    def gain(self, size: float, left: Sequence[float]) -> float:
        """Log evidence over no torque if its pieces are of some size.

        Args:
            size: Standard deviation of the heights.
            left: Of each run, by what the noise's variance is larger.
        """
        return sum(evidence for _, _, evidence in self._solved(size, left))

    def solve(self, size: float, left: Sequence[float]) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each run, most probable heights and their covariance."""
        solved = [(mean, covariance) for mean, covariance, _ in self._solved(size, left)]
        return [heights for heights, group in zip(solved, self.groups) for _ in group]

    def left(self, size: float, left: Sequence[float]) -> list[float]:
        """Of each run, mean square of what is not explained, in units of the noise."""
        found = []
        for r, (own, (mean, _)) in enumerate(zip(self.healthy, self.solve(size, left))):
            there = own.explain(left[r], own.product - self.cross[r] @ mean)
            found.append(float(np.mean((own.residual - self.slopes[r] @ mean - own.slopes @ there) ** 2)))
        return found


def _signals(predictor: Predictor, fit: Fit, r: int) -> dict[str, np.ndarray]:
    """What a torque could go with, at every step of a run."""
    run = predictor.runs[r]
    values, nuisance = predictor.values(fit.points[r], r)
    raw = predictor.car.raw(values, run, nuisance)
    return {
        "speed": raw["vehicle_speed"], SHAFT_TORQUE: raw["propeller_shaft_torque"],
        "twist": raw["axle_shaft_torque"] / (2.0 * values["axle_shaft.stiffness"]),
        "time": run.time - run.start, "distance": np.cumsum(raw["vehicle_speed"]) * STEP,
        "wheel angle": np.cumsum(raw["wheel_speed"]) * STEP}


def _at_hats(run: Run, signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: np.interp(hats(run), run.time, signal) for name, signal in signals.items()}
