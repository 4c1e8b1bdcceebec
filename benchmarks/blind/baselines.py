"""What simpler methods make of the same cases.

- *fit all*: least squares over every parameter of the catalogue at once, from the vehicle file on; the one that
  ends farthest from it, in detection limits, is the cause.
- *BIC*: every effect alone fitted by least squares, errors taken as white; the lowest Bayesian information
  criterion is the cause.
- *sparse regression*: what the nominal simulation leaves of each channel, regressed by ``pysindy`` on a library
  of torques, speeds and their rates; the term that explains most is translated into the nearest effect.

They get all recordings; least squares also fit start speed, slope and torque bias of each run, with the prior
deviations of the diagnosis, as without any a slope could not be told from that of a run. Their findings have the
form of its own, so the same scores are taken.
"""

from __future__ import annotations

import json
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from benchmarks.blind import reading
from benchmarks.blind import run as blind
from benchmarks.blind.cases import BlindCase
from benchmarks.blind.figures import median, rate
from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.fit.predict import RUN_NUISANCES, Predictor, coordinates
from cosim.diagnosis.plants import FullOrderCar, Run
from cosim.measured import load
from cosim.studies.sweep import Case
from driveline.quantities import InputError

LINES = "baselines.jsonl"
ITERATIONS = 4  # of least squares over all parameters
FINALISTS = 5  # effects that are fitted out; the others are screened, one step from the file and from far off
_FAR = 3.0  # detection limits
_DAMPING = (0.0, 1e-3, 1e-1, 10.0)  # Marquardt's, as far as a step does not lower the cost
HEADS = ("method", "single: right first", "pair: both first", "false alarms", "stiffness for inertia",
         "outside: confidently wrong", "single: error of parameters", "single: intervals hold the truth", "time [s]")


def run(cases: Sequence[BlindCase], out: Path, workers: int, cluster: str | None,
        progress: blind.Progress | None = None) -> list[dict[str, Any]]:
    """The findings of all methods in all cases; kept, spread and started again as ``blind.run`` does."""
    try:
        import pysindy  # noqa: F401
    except ImportError as error:
        raise InputError("the baselines need pysindy: pip install -e '.[blind]', or give --no-baselines") from error
    jobs = [Case(case.name, compared, {"case": case}) for case in cases]
    return blind.spread(jobs, out, LINES, workers, cluster, progress)


def compared(case: BlindCase) -> dict[str, Any]:
    """The findings of every method in one case."""
    result = {**asdict(case), "code": blind.fingerprint(), "truth": None, "finding": None, "error": None,
              "seconds": None, "gain": None, "shuffle": None, "again": None, "methods": {}}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "measurement"
        result["truth"] = blind.truth(blind.hide_case(case, case.manoeuvres, path))
        measurement = load(path)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs = [run.free for run in car.runs(measurement)]
    with Predictor(car, runs, coordinates(car, runs), 1) as predictor:
        squares = Squares(predictor)
        for name, method in METHODS.items():
            began = time.perf_counter()
            try:
                finding, error = method(squares), None
                json.dumps(finding, allow_nan=False)
            except Exception as failure:
                finding, error = None, f"{type(failure).__name__}: {failure}\n{traceback.format_exc(limit=-3)}"
            result["methods"][name] = {"finding": finding, "error": error, "seconds": time.perf_counter() - began}
    return result


def rows(results: Sequence[dict[str, Any]], compared: Sequence[dict[str, Any]]) -> list[list[str]]:
    """A line of text a method, over the cases that all have with the same truth."""
    truths = {r["name"]: r["truth"] for r in results if r["truth"]}
    common = {r["name"] for r in compared if truths.get(r["name"]) == r["truth"]}
    if not common:
        return []
    methods = {"diagnosis": [r for r in results if r["name"] in common]}
    for name in METHODS:
        methods[name] = [{**r, **r["methods"][name]} for r in compared if r["name"] in common]
    return [[name, *_figures(some)] for name, some in methods.items()]


def _figures(results: Sequence[dict[str, Any]]) -> list[str]:
    def of(*names: str) -> list[dict[str, Any]]:
        return [r for r in results if r["category"] in names]

    def share(hits: list[bool]) -> str:
        row = rate("", "", hits)
        return "" if row.here is None else f"{100 * row.here:.0f} % ({100 * row.low:.0f} to {100 * row.high:.0f})"

    errors = median("", "", (e for r in of("single") for e in reading.size_errors(r)))
    held = [hit for r in of("single") for hit in reading.covered(r)]
    times = [r["seconds"] for r in results if r["seconds"] is not None]
    return [share([reading.right_first(r) for r in of("single")]), share([reading.right_first(r) for r in of("pair")]),
            share([reading.verdict(r) != "none" for r in of(*reading.NOTHING)]),
            str(sum(reading.stiffness_for_inertia(r) for r in of(*reading.CATALOGUED))),
            share([reading.confidently_wrong(r) for r in of("outside")]),
            "" if errors.here is None else f"{100 * errors.here:.1f} %", share(held),
            f"{np.median(times):.0f}" if times else ""]


# -- least squares --------------------------------------------------------------------------------

@dataclass(frozen=True)
class Fit:
    """A point, its covariance for white errors over ``columns``, and what the errors cost there."""

    point: np.ndarray
    columns: list[int]
    covariance: np.ndarray
    cost: float


class Squares:
    """Least squares over some of the coordinates; each channel has white errors of a size of its own.

    Args:
        predictor: Of all runs.
    """

    def __init__(self, predictor: Predictor) -> None:
        self.predictor = predictor
        self.measured = np.concatenate([run.stacked for run in predictor.runs])
        channels = sorted({name for run in predictor.runs for name in run.clocks})
        self._channel = np.concatenate([np.full(run.clocks[name].size, channels.index(name))
                                        for run in predictor.runs for name in run.clocks])
        self._counts = np.bincount(self._channel)
        self.origin = np.zeros(len(predictor.coordinates))
        self.nominal = self._predicted(self.origin)
        self.nuisances = [i for i, c in enumerate(predictor.coordinates) if c.nuisance and c.name in RUN_NUISANCES]
        self.effects = {name: predictor.index(name) for name in CATALOGUE if predictor.index(name)}
        self._all = self.everything
        self._prior = np.array([predictor.coordinates[i].tolerance for i in self.nuisances])
        self._jacobian: np.ndarray | None = None

    @property
    def everything(self) -> list[int]:
        """Every parameter of the effects, and the nuisances."""
        return [i for columns in self.effects.values() for i in columns] + self.nuisances

    def _variances(self, errors: np.ndarray) -> np.ndarray:
        return np.maximum(np.bincount(self._channel, errors**2) / self._counts, 1e-12)

    def _cost(self, u: np.ndarray, predicted: list[np.ndarray] | None) -> float:
        """Twice the negative logarithm of the likelihood and the nuisances' prior, less a constant."""
        if predicted is None:
            return np.inf
        fit = self._counts @ np.log(self._variances(self.measured - np.concatenate(predicted)))
        return float(fit + np.sum((u[self.nuisances] / self._prior)**2))

    def _predicted(self, u: np.ndarray) -> list[np.ndarray] | None:
        return self.predictor.all_runs([u] * len(self.predictor.runs))

    def _derivatives(self, u: np.ndarray, predicted: list[np.ndarray], columns: list[int]) -> np.ndarray:
        if u.any():
            return self._slopes(u, predicted, columns)
        if self._jacobian is None:  # at the vehicle file, for all methods
            self._jacobian = self._slopes(u, predicted, self._all)
        return self._jacobian[:, [self._all.index(column) for column in columns]]

    def _slopes(self, u: np.ndarray, predicted: list[np.ndarray], columns: list[int]) -> np.ndarray:
        runs = range(len(predicted))
        return np.concatenate(self.predictor.jacobian([u] * len(runs), predicted, dict.fromkeys(runs, columns)))

    def fit(self, columns: list[int], start: np.ndarray, iterations: int) -> Fit:
        """The best point in so many steps of Levenberg and Marquardt, within what is plausible."""
        found = [self.predictor.coordinates[i] for i in columns]
        spread, tolerance, low, high = (np.array([getattr(c, name) for c in found])
                                        for name in ("spread", "tolerance", "low", "high"))
        own = np.array([c.nuisance for c in found], dtype=np.float64)  # only these have a prior
        u, predicted = start.copy(), self.nominal if not start.any() else self._predicted(start)
        if predicted is None:
            return Fit(u, columns, np.zeros((len(columns),) * 2), np.inf)
        cost = self._cost(u, predicted)
        for _ in range(iterations):
            errors = self.measured - np.concatenate(predicted)
            weights = self._variances(errors)[self._channel]**-0.5
            scaled = self._derivatives(u, predicted, columns) * spread * weights[:, None]
            normal = scaled.T @ scaled + np.diag(own * (spread / tolerance)**2)
            inverse = np.linalg.pinv(normal, 1e-10, hermitian=True)
            downhill = scaled.T @ (errors * weights) - own * spread / tolerance**2 * u[columns]
            for damping in _DAMPING:
                damped = np.linalg.pinv(normal + damping * np.diag(np.diag(normal)), 1e-10, hermitian=True)
                trial = u.copy()
                trial[columns] = np.clip(u[columns] + spread * (damped @ downhill), low, high)
                tried = self._predicted(trial)
                if (now := self._cost(trial, tried)) < cost:
                    break
            else:
                break
            u, predicted, cost = trial, tried, now
        return Fit(u, columns, inverse * np.outer(spread, spread), cost)

    def starts(self, effect: str) -> list[np.ndarray]:
        """The vehicle file with usual sizes of what does nothing while it is small; and every parameter far off."""
        usual = self.origin.copy()
        for i in self.effects[effect]:
            c = self.predictor.coordinates[i]
            if c.run is None and c.parameter.probes:
                usual[i] = c.parameter.coordinate(c.parameter.probes[0])
        found = [usual]
        for i in self.effects[effect]:
            c = self.predictor.coordinates[i]
            for away in (-_FAR * c.parameter.detection, _FAR * c.parameter.detection):
                if c.run is None and c.low <= away <= c.high:
                    found.append(usual.copy())
                    found[-1][i] = away
        return found

    def settled(self, start: np.ndarray) -> tuple[float, np.ndarray]:
        """The cost at a point with the nuisances fitted, as if they added up, and that point."""
        predicted = self._predicted(start)
        if predicted is None:
            return np.inf, start
        errors = self.measured - np.concatenate(predicted)
        derivatives = self._derivatives(self.origin, self.nominal, self.nuisances)
        for _ in range(2):  # the sizes of the errors follow what is left of them
            weights = self._variances(errors)[self._channel]**-0.5
            scaled = derivatives * weights[:, None]
            fitted = np.linalg.solve(scaled.T @ scaled + np.diag(self._prior**-2), scaled.T @ (errors * weights))
        point = start.copy()
        point[self.nuisances] = fitted
        cost = self._counts @ np.log(self._variances(errors - derivatives @ fitted)) + np.sum((fitted / self._prior)**2)
        return float(cost), point

    def strength(self, effect: str, u: np.ndarray) -> float:
        """The farthest parameter of an effect from the vehicle file, in detection limits."""
        return max(abs(x) / p.detection for p, x, _ in self._sizes(effect, u))

    def cause(self, effect: str, fit: Fit) -> dict[str, Any]:
        """An entry of a finding."""
        parameters = {}
        for p, x, place in self._sizes(effect, fit.point):
            deviation = np.sqrt(max(fit.covariance[fit.columns.index(place), fit.columns.index(place)], 0.0))
            ends = (p.size(float(x + d * deviation)) for d in (0.0, -1.645, 1.645))
            parameters[p.name] = p.found(*ends, self.predictor.car.values)
        return {"effect": effect, "probability": 1.0, "parameters": parameters}

    def _sizes(self, effect: str, u: np.ndarray) -> list[tuple[Any, float, int]]:
        """Parameter, coordinate and a place of it; the mean swing over the runs where the phase is unknown."""
        found = []
        for p in CATALOGUE[effect].parameters:
            places = [i for i in self.effects[effect] if self.predictor.coordinates[i].name == p.name]
            if places:
                swings = self.predictor.coordinates[places[0]].run is not None
                found.append((p, float(np.sqrt(2.0 * np.mean(u[places]**2))) if swings else u[places[0]], places[0]))
        return found


def _finding(causes: list[dict[str, Any]]) -> dict[str, Any]:
    return {"verdict": "cause" if causes else "none", "causes": causes, "ambiguous_with": []}


def fit_all(squares: Squares) -> dict[str, Any]:
    """Everything at once; those beyond their detection limit, farthest first."""
    fit = squares.fit(squares.everything, squares.origin, ITERATIONS)
    far = {name: squares.strength(name, fit.point) for name in squares.effects}
    chosen = [name for name in sorted(far, key=far.__getitem__, reverse=True) if far[name] > 1.0]
    return _finding([squares.cause(name, fit) for name in chosen[:2]])


def bic(squares: Squares) -> dict[str, Any]:
    """One effect at a time; the runner-up is second."""
    price = np.log(squares.measured.size)
    none = squares.fit(squares.nuisances, squares.origin, 2)

    def judged(name: str, start: np.ndarray, iterations: int) -> tuple[float, Fit]:
        columns = squares.effects[name] + squares.nuisances
        fit = squares.fit(columns, start, iterations)
        return fit.cost + price * len(columns), fit

    screened = {}
    for name in squares.effects:
        points = [squares.settled(start) for start in squares.starts(name)]
        near = judged(name, squares.origin, 1)[1]
        screened[name] = min([*points, (near.cost, near.point)], key=lambda pair: pair[0])
    finalists = sorted(screened, key=lambda name: screened[name][0] + price * len(squares.effects[name]))[:FINALISTS]
    fits = {name: judged(name, screened[name][1], 2) for name in finalists}
    best = sorted(fits, key=lambda name: fits[name][0])
    better = [name for name in best if fits[name][0] < none.cost + price * len(squares.nuisances)]
    return _finding([squares.cause(name, fits[name][1]) for name in better[:2]])


# -- sparse regression ----------------------------------------------------------------------------

STEP, THRESHOLD = 0.01, 0.01  # [s]; share of a signal's deviation below which a term is dropped
# What is left of a channel, or of its rate, against the term it goes with: the nearest effect.
TERMS = {
    ("engine_acceleration", "engine_torque"): "engine_torque_gain",
    ("engine_acceleration", "constant"): "engine_torque_offset",
    ("engine_acceleration", "engine_acceleration"): "engine_inertia",
    ("engine_acceleration", "torque_rate"): "shaft_stiffness",
    ("engine_acceleration", "torque_sign"): "backlash_size",
    ("engine_acceleration", "torque"): "mesh_loss",
    ("vehicle_acceleration", "constant"): "rolling_resistance",
    ("vehicle_acceleration", "speed_squared"): "aerodynamic_drag",
    ("vehicle_acceleration", "torque"): "vehicle_mass",
    ("vehicle_acceleration", "torque_sign"): "asymmetric_friction",
    ("vehicle_acceleration", "torque_rate"): "suspension_mode",
    ("torque", "constant"): "torque_meter_offset",
    ("torque", "torque"): "torque_meter_gain",
    ("torque", "torque_rate"): "torque_meter_filter",
    ("torque", "engine_acceleration"): "engine_inertia",
    ("wheel_speed", "speed"): "effective_radius",
    ("wheel_speed", "torque"): "tyre_slip",
    ("wheel_speed", "wheel_acceleration"): "wheel_speed_delay",
    ("engine_speed", "engine_acceleration"): "engine_speed_delay",
    ("engine_speed", "torque"): "converter_slip",
}


def sparse_regression(squares: Squares) -> dict[str, Any]:
    """The terms of the library that explain most of what the nominal simulation leaves."""
    import pysindy

    parts = [_library(run, y) for run, y in zip(squares.predictor.runs, squares.nominal)]
    left, terms = ({name: np.concatenate([part[i][name] for part in parts]) for name in parts[0][i]} for i in (0, 1))
    shown = {"engine_acceleration": "engine_acceleration", "vehicle_acceleration": "wheel_acceleration",
             "torque": "torque", "wheel_speed": "speed", "engine_speed": "engine_speed"}
    names = [name for name in terms if name != "engine_speed"]
    library = np.column_stack([terms[name] / _reach(terms[name]) for name in names])
    targets = np.column_stack([left[name] / _reach(terms[shown[name]]) for name in left])
    model = pysindy.SINDy(feature_library=pysindy.IdentityLibrary(),
                          optimizer=pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-3))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sparsity parameter is too big")  # nothing left to explain: right so
        # the library is given as a control, and what is to be explained in place of a state's rate
        model.fit(np.zeros_like(targets), t=STEP, x_dot=targets, u=library)
    weights = model.coefficients()[:, targets.shape[1]:]
    found: dict[str, float] = {}
    for target, row in zip(left, weights):
        for name, weight in zip(names, row):
            if weight and (target, name) in TERMS:
                effect = TERMS[target, name]
                found[effect] = max(found.get(effect, 0.0), abs(float(weight)))
    return _finding([{"effect": name, "probability": 1.0, "parameters": {}}
                     for name in sorted(found, key=found.__getitem__, reverse=True)[:2]])


def _reach(signal: np.ndarray) -> float:
    """Deviation of a signal; the constant's is its value."""
    return float(np.std(signal)) or float(np.abs(signal).max()) or 1.0


def _library(run: Run, nominal: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """What is left of each channel on an even clock, and the terms of the library."""
    start = max(clock[0] for clock in run.clocks.values())
    grid = np.arange(start, min(clock[-1] for clock in run.clocks.values()), STEP)

    def smooth(values: np.ndarray, order: int = 0) -> np.ndarray:
        return savgol_filter(values, 11, 3, deriv=order, delta=STEP)

    def even(values: Mapping[str, np.ndarray] | np.ndarray, name: str) -> np.ndarray:
        column = values[name] if isinstance(values, Mapping) else values[run.slices[name]]
        return np.interp(grid, run.clocks[name], column)

    shown = {name: even(run.measured, name) for name in run.clocks}
    error = {name: shown[name] - even(nominal, name) for name in run.clocks}
    torque = smooth(shown["propeller_shaft_torque"])
    left = {"engine_acceleration": smooth(error["engine_speed"], 1),
            "vehicle_acceleration": smooth(error["wheel_speed"], 1),
            "torque": smooth(error["propeller_shaft_torque"]),
            "wheel_speed": smooth(error["wheel_speed"]), "engine_speed": smooth(error["engine_speed"])}
    terms = {"constant": np.ones(grid.size), "engine_torque": np.interp(grid, run.time, run.inputs[:, 0]),
             "engine_speed": shown["engine_speed"], "engine_acceleration": smooth(shown["engine_speed"], 1),
             "wheel_acceleration": smooth(shown["wheel_speed"], 1), "speed": shown["wheel_speed"],
             "speed_squared": shown["wheel_speed"]**2, "torque": torque, "torque_sign": np.sign(torque),
             "torque_rate": smooth(shown["propeller_shaft_torque"], 1)}
    return left, terms


METHODS: dict[str, Callable[[Squares], dict[str, Any]]] = {
    "fit all": fit_all, "BIC": bic, "sparse regression": sparse_regression}
