"""Where a torque is missing that no effect of the catalogue explains, and what it goes with.

At each place in turn, on a balance or within a shaft, a disturbance torque is supposed, of every kind in ``torques``.
The place with the most evidence is where it is. It goes with the variable that it follows, or, if it follows none and
just lasts, with the one over which its picture is a curve.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cosim.diagnosis.fit.evidence import Layout
from cosim.diagnosis.fit.fitting import Fit
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.fit.predict import Predictor
from cosim.diagnosis.judge.finding import NOTHING
from cosim.diagnosis.judge.mounts import SUPPOSED, words
from cosim.diagnosis.judge.torques import (
    BENDS,
    CONSTANT,
    ENGINE_TORQUE,
    HEIGHTS,
    LASTING,
    QUICK,
    ROLL,
    SHAFT_TORQUE,
    Healthy,
    Torque,
    bent,
    housings,
    knots_of,
    likeliest,
    pieces,
    quick_at,
    signals_of,
    slopes_of,
)
from cosim.diagnosis.plants import Run
from cosim.diagnosis.plants.hats import hats
from cosim.diagnosis.plants.led import PLACES
from cosim.diagnosis.search.identification import APART, separation

_SIZES = np.geomspace(0.05, 30.0, 10)  # of the torque looked for, in units of the place's
_BINS = 12
_MIXED, _PIECES = 8, 9  # orders of a torque's pieces, which are as many a run
_TURNS = 0.3  # share of its range by which a curve has to go back to turn
_LEAST = 0.1  # share of its variance: what goes with less of it than that, it does not go with
_OWN = 1.0  # log evidence by which a variable is preferred that a place has to do with: others may go with it exactly
_ALIKE = 0.01  # share of the evidence, which is that of one linear step, within which places are not told apart
_MORE = 5.0  # log evidence by which a torque that follows a variable has to be more evident than one that need not
# Over these a torque may swing any number of times: orders of what turns, waves of the road.
_PERIODIC = {"wheel angle": (2.0 * np.pi,), "distance": tuple(np.geomspace(4.0, 60.0, 40))}


@dataclass(frozen=True)
class Disturbance:
    """The torque missing at one place.

    Attributes:
        place: Which, of ``PLACES``.
        gain: Log evidence over that of no torque.
        alone: Of each recording as if it were the only one.
        table: Torque, its standard deviation, and what it may go with, at all hats of all runs.
        follows: The variable it follows as fast as that moves; empty where it is no more than a torque over time.
        shape: How it does, in words, where that is known by a law.
    """

    place: str
    gain: float
    alone: np.ndarray
    table: dict[str, np.ndarray] = field(repr=False)
    follows: str = ""
    shape: str = ""

    @property
    def size(self) -> float:
        """Standard deviation of the torque [N.m; N on the vehicle]."""
        return float(np.std(self.table["torque"]))


def sampled(run: Run, signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What a torque may go with, at the hats of a run."""
    return {name: np.interp(hats(run), run.time, signal) for name, signal in signals.items()}


def pictured(run: int, shown: np.ndarray, mean: np.ndarray, covariance: np.ndarray,
             at: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A torque at the hats of a run, its standard deviation, and what it may go with.

    Args:
        run: Which.
        shown: What each of its pieces is there: hats x pieces.
        mean, covariance: Of their heights.
        at: ``sampled``.
    """
    deviation = np.sqrt(np.einsum("ij,jk,ik->i", shown, covariance, shown))
    return {"torque": shown @ mean, "std": deviation, "run": np.full(len(shown), float(run)), **at}


def joined(tables: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """One table of all runs."""
    return {column: np.concatenate([table[column] for table in tables]) for column in tables[0]}


def disturbances(predictor: Predictor, fit: Fit, noise: Noise, places: Collection[str] = PLACES,
                 loaded: bool = False) -> list[Disturbance]:
    """The torque missing at some places beside a fitted supposition, the most evident first.

    Args:
        predictor: Of the runs.
        fit: What is known to be wrong.
        noise: Of the channels.
        places: Of ``PLACES``.
        loaded: Whether healthy shafts may be bent by more the more they carry. That says whether a torque is missing;
            where it is, it hides.
    """
    return Supposed(predictor, fit, noise, places, loaded).listed()


class Supposed:
    """Every torque that may be missing at some places, as large as is most evident; arguments as ``disturbances``.

    Attributes:
        predictor, runs, fit, noise, places: Of what.
        scales: Of each run, standard deviation of every sample.
        healthy: Each run as healthy cars may drive it.
        torques: By place and what they go with.
        left: Of each run, by what the noise's variance is larger than ``scales`` say.
    """

    def __init__(self, predictor: Predictor, fit: Fit, noise: Noise, places: Collection[str] = PLACES,
                 loaded: bool = False) -> None:
        self.predictor, self.runs, self.fit, self.noise, self.places = predictor, predictor.runs, fit, noise, places
        # as large as a sum of squares has it: what wanders is alike from sample to sample, and no torque that is
        # missing; and whether a run is doubtful is not asked here
        scales = self.scales = noise.undoubted.scales
        self.signals = [signals_of(predictor, fit, r) for r in range(len(self.runs))]
        self.followed = {name: [pieces(name, own, self.signals) for own in self.signals] for name in QUICK}
        self.followed[ROLL] = housings(predictor, self.signals)
        moved = {(place, name): [h / scale[:, None] for h, scale in zip(slopes, scales)]
                 for place in dict.fromkeys((*places, *(place for place, _ in BENDS)))
                 for name, slopes in slopes_of(predictor, fit, place, {
                     name: self.followed[name] for name in quick_at(place)}).items()}
        bends = {(place, name): bent(place, name, knots_of(name, self.signals), loaded) for place, name in BENDS}
        layout = Layout(predictor.coordinates, predictor.repeats)
        healthy = self.healthy = [Healthy(layout, r, fit, (run.stacked - fit.predicted[r]) / scale, scale,
                           [sizes * moved[which][r] for which, sizes in bends.items()])
                   for r, (run, scale) in enumerate(zip(self.runs, scales))]
        # of what may be supposed of the mounts only what explains most goes on
        self.mounts = {place: likeliest(healthy, moved[place, ROLL], _SIZES * PLACES[place].size)
                       for place in places if ROLL in quick_at(place)}
        for place, one in self.mounts.items():
            moved[place, ROLL] = [h[:, [one]] for h in moved[place, ROLL]]
        self.torques = {(place, name): Torque(healthy, slopes, *HEIGHTS[name])
                        for (place, name), slopes in moved.items() if place in places}
        # a plant of another structure is never right to the noise: errors count as what the best supposition leaves
        self.left = [own.leaves for own in healthy]
        for _ in range(2):
            self.sizes = {which: max(_SIZES * PLACES[which[0]].size,
                                     key=lambda size, torque=torque: torque.gain(size, self.left))
                          for which, torque in self.torques.items()}
            leaves = zip(*(torque.left(self.sizes[which], self.left) for which, torque in self.torques.items()))
            self.left = [max(1.0, min(own)) for own in leaves]
        self.gains = {which: torque.gain(self.sizes[which], self.left) - _price(which[1])
                      for which, torque in self.torques.items()}

    def listed(self) -> list[Disturbance]:
        """The likeliest at each of these places, the most evident first."""
        return sorted((self.missing(place) for place in self.places), key=lambda d: -d.gain)

    def missing(self, place: str) -> Disturbance:
        """The likeliest at one of these places."""
        # a curve has to be more than a constant, and more than what goes with nothing
        least = max(self.gains[place, LASTING], self.gains[place, CONSTANT]) + _MORE
        quick = max(quick_at(place), key=lambda name: self.gains[place, name] + _OWN * _is_own(name, place))
        name = quick if self.gains[place, quick] > least else LASTING
        torque, size = self.torques[place, name], self.sizes[place, name]
        tables = []
        for r, (mean, covariance) in enumerate(torque.solve(size, self.left)):
            at = sampled(self.runs[r], self.signals[r])
            tables.append(pictured(r, self._shown(place, name, r, at), mean, covariance, at))
        follows = {LASTING: "", ROLL: ENGINE_TORQUE}.get(name, name)
        shape = words(self.mounts[place]) if name == ROLL else ""
        return Disturbance(place, self.gains[place, name], torque.alone(size, self.left) - _price(name),
                           joined(tables), follows, shape)

    def _shown(self, place: str, name: str, r: int, at: Mapping[str, np.ndarray]) -> np.ndarray:
        """What the pieces of a torque are at the hats of a run, where its signals are ``at``: hats x pieces."""
        run = self.runs[r]
        if name == LASTING:
            return np.eye(hats(run).size)
        if name == ROLL:
            turned = self.followed[ROLL][r][:, self.mounts[place]]
            return np.interp(hats(run), run.time, turned)[:, None]
        return pieces(name, at, self.signals)


def _price(name: str) -> float:
    """Of the choice among what is supposed of the mounts [log evidence]."""
    return math.log(len(SUPPOSED)) if name == ROLL else 0.0


def tied(found: Sequence[Disturbance]) -> list[Disturbance]:
    """Of disturbances, the most evident first, those that cannot be told from the first, and that.

    Behind a torque meter what is slow is the same on the propeller shaft, the axle, the wheels and, but for how its
    tyres slip, the vehicle.
    """
    return [d for d in found if not clearer(found[0].gain, d.gain)]


def clearer(gain: float, other: float) -> bool:
    """Whether what has so much log evidence is told from what has less."""
    return separation(gain - other) >= APART and gain - other >= _ALIKE * gain


def _is_own(variable: str, place: str) -> bool:
    """Whether a torque at a place goes with a variable rather than with another that does the same."""
    return variable == ("twist" if PLACES[place].shaft else SHAFT_TORQUE)


def goes_with(table: Mapping[str, np.ndarray], follows: str = "", shape: str = "") -> tuple[str, str, float]:
    """What the torque of a table goes with: variable, shape, share of its variance (predicted across stretches).

    ``NOTHING`` where it goes with none of the variables; ``follows`` and ``shape`` where that was found out already.

    Over some variables many curves are tried. So what counts is how much more they predict than of the same torque
    in another order, which goes with nothing.
    """
    if follows:
        return follows, shape or _shapes(table, follows), 1.0
    random = np.random.default_rng(1)
    torque, weight = table["torque"], 1.0 / table["std"] ** 2
    runs = [np.flatnonzero(table["run"] == r) for r in np.unique(table["run"])]
    mixed = []
    for _ in range(_MIXED):
        one = torque.copy()
        for own in runs:
            parts = np.array_split(own, _PIECES)
            one[own] = torque[np.concatenate([parts[k] for k in random.permutation(_PIECES)])]
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


def each_its_own(follows: str) -> bool:
    """Whether a torque that follows a variable does so in every recording in a way of its own."""
    return bool(follows) and not HEIGHTS[follows][1] and follows not in _PERIODIC


def _shapes(table: Mapping[str, np.ndarray], follows: str) -> str:
    """The curve in words; the curves, where every recording has its own."""
    runs = np.unique(table["run"]) if each_its_own(follows) else [None]
    inside = [slice(None) if run is None else table["run"] == run for run in runs]
    found = list(dict.fromkeys(_shape(table[follows][part], table["torque"][part], follows) for part in inside))
    return found[0] if len(found) == 1 else f"in each recording its own way: {'; '.join(found)}"


def _shape(values: np.ndarray, torque: np.ndarray, name: str) -> str:
    """The curve in words."""
    if name in _PERIODIC:
        lengths = _PERIODIC[name]
        power = [float(np.abs(np.mean(torque * np.exp(-2j * np.pi * values / length)))) for length in lengths]
        best = lengths[int(np.argmax(power))]
        return "a wave once a revolution" if name == "wheel angle" else f"a wave every {best:.0f} m"
    steps = np.digitize(values, np.linspace(*np.quantile(values, (0.01, 0.99)), _BINS - 3))
    means = [float(np.mean(torque[steps == k])) for k in np.unique(steps) if np.sum(steps == k) >= 3]
    for way, level in (("falls, then rises", np.array(means)), ("rises, then falls", -np.array(means))):
        if min(level[0], level[-1]) - level.min() > _TURNS * np.ptp(level):
            return way
    x = (values - values.mean()) / (np.std(values) or 1.0)
    line, cube = (np.corrcoef(x**n, torque)[0, 1] for n in (1, 3))
    odd = abs(cube) > abs(line) + 0.02
    if max(abs(line), abs(cube)) < 0.3:
        return "no straight line"
    return f"{'rises' if (cube if odd else line) > 0 else 'falls'}, {'steeper at the ends' if odd else 'evenly'}"
