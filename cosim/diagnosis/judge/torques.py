"""Torques that may be missing at a place of the driveline, and how evident each is.

A torque may be anything that lasts: a row of hats over time whose heights belong to an Ornstein-Uhlenbeck process. Or
it follows a variable of the driveline as fast as that moves: a curve over it, the same in all runs (``FOLLOWED``) or
in each its own (the engine's torque), or a wave once a revolution of the wheels. What turns the gears may be a housing
that rolls on its mounts (``mounts``). What each piece does to all channels is simulated; the most probable torque and
its evidence follow in closed form, beside everything that healthy cars may differ by.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve

from cosim.diagnosis.fit.evidence import Layout, prior
from cosim.diagnosis.fit.fitting import Fit
from cosim.diagnosis.fit.predict import Predictor
from cosim.diagnosis.judge.mounts import turned
from cosim.diagnosis.plants import STEP
from cosim.diagnosis.plants.hats import LONG_MEMORY, correlation, row
from cosim.diagnosis.plants.led import PLACES

SHAFT_TORQUE = "shaft torque"  # what the propeller shaft carries, beside the torque that is missing
ENGINE_TORQUE = "engine torque"  # what housings bear before a shaft carries any: no shaft does while a lash is crossed
FOLLOWED = ("speed", SHAFT_TORQUE, "twist", "time")
QUICK = ("wheel angle", ENGINE_TORQUE, *FOLLOWED)
ROLL = "roll"  # of the housing on its mounts, by one of what ``mounts`` supposes
LASTING, CONSTANT = "lasting", "constant"
LASTS = 0.3  # s: how long a torque that lasts stays alike
_KNOTS = 7  # of a curve
# What healthy cars have of it, by place and variable, one sigma: so much [unit of the place], and so much more for
# the square of the variable at 1. Axle shafts and the tyres behind them carry a little beside what is in proportion
# to their twist, over the engine's torque or that; more the nearer tyres are to their grip. Gears and shafts of a
# transmission give a little beside what is to their torque or twist. And the propeller shaft is resisted as the file
# says but for some half a newton metre, over what it carries, the twist behind it or the engine's torque. Judgements;
# healthy plants of the other structure have as much.
BENDS = {("within the axle shafts", "twist"): (4.0, 1500.0), ("within the axle shafts", ENGINE_TORQUE): (4.0, 0.0),
         ("within the transmission", SHAFT_TORQUE): (5e-4, 0.0), ("within the transmission", "twist"): (5e-4, 0.0),
         ("propeller shaft", SHAFT_TORQUE): (0.7, 0.0), ("propeller shaft", "twist"): (0.7, 0.0),
         ("propeller shaft", ENGINE_TORQUE): (0.7, 0.0)}


def signals_of(predictor: Predictor, fit: Fit, r: int) -> dict[str, np.ndarray]:
    """What a torque could go with, at every step of a run."""
    run = predictor.runs[r]
    values, nuisance = predictor.values(fit.points[r], r)
    raw = predictor.car.raw(values, run, nuisance)
    return {
        "speed": raw["vehicle_speed"], SHAFT_TORQUE: raw["propeller_shaft_torque"],
        ENGINE_TORQUE: raw["crankshaft_torque"],
        "twist": raw["axle_shaft_torque"] / (2.0 * values["axle_shaft.stiffness"]),
        "time": run.time - run.start, "distance": np.cumsum(raw["vehicle_speed"]) * STEP,
        "wheel angle": np.cumsum(raw["wheel_speed"]) * STEP}


def quick_at(place: str) -> tuple[str, ...]:
    """What a torque at a place may follow as fast as that moves."""
    return (*QUICK, ROLL) if PLACES[place].turned else QUICK


def housings(predictor: Predictor, signals: Sequence[Mapping[str, np.ndarray]]) -> list[np.ndarray]:
    """Of each run, by how much its housing may turn the gears as it rolls on its mounts: steps x suppositions."""
    ratios = [predictor.car.gearing.ratios[run.gear] for run in predictor.runs]
    # it bears the engine's torque, and what the gears add to that
    borne = [own[ENGINE_TORQUE] + (ratio - 1.0) / ratio * own[SHAFT_TORQUE] for ratio, own in zip(ratios, signals)]
    return turned(borne, ratios, STEP)


def _alike(count: int) -> np.ndarray:
    """Of the heights of a curve's knots."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return np.exp(-apart / count) + 1e-9 * np.eye(count)


# By what a torque goes: how the heights of its pieces correlate, and whether all runs have them in common.
HEIGHTS: dict[str, tuple[Callable[[int], np.ndarray], bool]] = {
    LASTING: (lambda count: correlation(count, LASTS), False), CONSTANT: (np.eye, True),
    "wheel angle": (np.eye, False), ENGINE_TORQUE: (_alike, False),  # what it does to a gear depends on which it is
    ROLL: (np.eye, True),
    **dict.fromkeys(FOLLOWED, (_alike, True))}


def pieces(name: str, values: Mapping[str, np.ndarray], signals: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
    """What each piece of a torque that follows a variable is where it has some values: values x pieces.

    Args:
        name: The variable.
        values: Of all variables.
        signals: The same of every run, at every step; they say where the knots are.
    """
    x = values[name]
    if name == "wheel angle":
        return np.column_stack([np.cos(x), np.sin(x)])
    knots = knots_of(name, signals)
    return np.column_stack([np.interp(x, knots, heights) for heights in np.eye(_KNOTS)])


def knots_of(name: str, signals: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
    """Where a curve over a variable has its knots."""
    return np.linspace(*np.quantile(np.concatenate([s[name] for s in signals]), (0.005, 0.995)), _KNOTS)


def bent(place: str, name: str, knots: np.ndarray, loaded: bool = True) -> np.ndarray:
    """What healthy cars have of a torque at the knots of its curve, one sigma; none of most.

    Args:
        place, name: Where, and the variable it follows.
        knots: Of the curve.
        loaded: Whether they have more the more they carry.
    """
    size, more = BENDS.get((place, name), (0.0, 0.0))
    return size + loaded * more * knots**2


def slopes_of(predictor: Predictor, fit: Fit, place: str,
              followed: Mapping[str, Sequence[np.ndarray]]) -> dict[str, list[np.ndarray]]:
    """Of everything that is supposed at a place, per run, what a piece of unit height does to all channels.

    Args:
        predictor: Of the runs.
        fit: What is known to be wrong.
        place: Of ``PLACES``.
        followed: For every variable that counts there, of each run, the pieces of a torque that follows it, at every
            step.
    """
    runs, push = predictor.runs, PLACES[place].size

    def pushed(run: int, heights: np.ndarray) -> tuple[np.ndarray, int, tuple[str, np.ndarray]]:
        return fit.points[run], run, (place, push * row(runs[run], heights))

    by_hats = predictor.by_hats(range(len(runs)), fit.predicted, pushed, push, LONG_MEMORY)
    slopes: dict[str, list[np.ndarray]] = {LASTING: list(by_hats.values())}
    moved = iter(predictor.many([(fit.points[r], r, (place, push * torque)) for per_run in followed.values()
                                 for r, shown in enumerate(per_run) for torque in shown.T]))
    for name, per_run in followed.items():
        slopes[name] = [np.column_stack([
            np.zeros_like(predicted) if y is None else (y - predicted) / push
            for y in itertools.islice(moved, shown.shape[1])]) for predicted, shown in zip(fit.predicted, per_run)]
    slopes[CONSTANT] = [own.sum(axis=1, keepdims=True) for own in slopes[FOLLOWED[0]]]
    return slopes


class Healthy:
    """One run as healthy cars may drive it, linearised: their numbers, slope, torque bias and wandering torque.

    Args:
        layout: Of the coordinates.
        run: Which run.
        fit: What is known to be wrong, with its derivatives.
        residual: What it leaves, in units of the noise.
        scale: The noise.
        bends: What pieces of every torque do to it that healthy cars have some of, ``BENDS``: of one sigma, in units of
            the noise.

    Attributes:
        leaves: Mean square of the residual.
        slopes: By the coordinates of the run and these pieces, in units of the noise.
        residual: What would be left with all coordinates 0.
    """

    def __init__(self, layout: Layout, run: int, fit: Fit, residual: np.ndarray, scale: np.ndarray,
                 bends: Sequence[np.ndarray]) -> None:
        columns = layout.columns[run]
        self.leaves = float(np.mean(residual**2))
        slopes = fit.tangents[run].jacobian / scale[:, None]
        self.residual = residual + slopes @ fit.points[run][columns]
        self.slopes = np.hstack([slopes, *bends])
        spread = prior(layout.coordinates, fit.causes)[layout.shared]
        self.precision = block_diag(np.diag(1.0 / spread**2), layout.precision[run],
                                    *(np.linalg.inv(_alike(pieces.shape[1])) for pieces in bends))
        self.square, self.product = self.slopes.T @ self.slopes, self.slopes.T @ self.residual

    def explain(self, left: float, product: np.ndarray) -> np.ndarray:
        """The most probable coordinates for what has this product with the slopes."""
        return cho_solve(cho_factor(self.square + left * self.precision), product)


def likeliest(healthy: Sequence[Healthy], slopes: Sequence[np.ndarray], sizes: Sequence[float]) -> int:
    """Which column of what some suppositions do to each run explains most, in all of them.

    Args:
        healthy: Each run.
        slopes: What a torque as each supposition has it does to it, in units of the noise.
        sizes: That such a torque may have.
    """
    left = [own.leaves for own in healthy]
    supposed = [Torque(healthy, [own[:, [i]] for own in slopes], np.eye, True) for i in range(slopes[0].shape[1])]
    return int(np.argmax([max(torque.gain(size, left) for size in sizes) for torque in supposed]))


class Torque:
    """A torque that is supposed somewhere, in cars healthy otherwise; the heights of its pieces are normally
    distributed.

    Args:
        healthy: Each run.
        slopes: What the pieces do to it, in units of the noise.
        alike: Number of pieces to the correlation of their heights.
        shared: Whether all runs have the heights in common.
    """

    def __init__(self, healthy: Sequence[Healthy], slopes: Sequence[np.ndarray],
                 alike: Callable[[int], np.ndarray], shared: bool) -> None:
        self.healthy, self.slopes = healthy, slopes
        self.square = [h.T @ h for h in slopes]
        self.product = [h.T @ own.residual for h, own in zip(slopes, healthy)]
        self.cross = [own.slopes.T @ h for h, own in zip(slopes, healthy)]
        runs = range(len(slopes))
        self.groups = [list(runs)] if shared else [[r] for r in runs]
        self.roots = [np.linalg.cholesky(alike(slopes[group[0]].shape[1])) for group in self.groups]
        self._told: tuple[tuple[float, ...], list[tuple[np.ndarray, np.ndarray]]] = ((), [])

    def information(self, left: Sequence[float]) -> list[tuple[np.ndarray, np.ndarray]]:
        """What each run says of the heights, whatever its coordinates are: information matrix and vector.

        Args:
            left: Of each run, by what the noise's variance is larger.
        """
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
        told = self.information(left)
        return [posterior([told[r] for r in group], size * root) for group, root in zip(self.groups, self.roots)]

    def gain(self, size: float, left: Sequence[float]) -> float:
        """Log evidence over no torque if its pieces are of some size.

        Args:
            size: Standard deviation of the heights.
            left: Of each run, by what the noise's variance is larger.
        """
        return sum(evidence for _, _, evidence in self._solved(size, left))

    def alone(self, size: float, left: Sequence[float]) -> np.ndarray:
        """The same of each run as if it were the only one."""
        told = self.information(left)
        return np.array([evidence for group, root in zip(self.groups, self.roots)
                         for _, _, evidence in (posterior([told[r]], size * root) for r in group)])

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


def posterior(told: Sequence[tuple[np.ndarray, np.ndarray]],
               root: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance of heights, and log evidence, from what some runs say of them together.

    Args:
        told: Information matrix and vector of each run.
        root: Of the heights' prior covariance.
    """
    inner = root.T @ sum(vector for _, vector in told)
    factor = cho_factor(np.eye(inner.size) + root.T @ sum(matrix for matrix, _ in told) @ root, lower=True)
    evidence = 0.5 * float(inner @ cho_solve(factor, inner)) - float(np.sum(np.log(np.diag(factor[0]))))
    return root @ cho_solve(factor, inner), root @ cho_solve(factor, root.T), evidence
