"""Predictions and their sensitivities over all runs, for any mixture of effects and nuisances.

Everything that may be estimated is a ``Coordinate``: the parameters of every effect of the catalogue, and
of every run what differs from run to run. A vector of coordinates is what fits and evidence work on; 0
everywhere is the vehicle file.
"""

from __future__ import annotations

import multiprocessing
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import Effect, EffectParameter, factor, scaled
from cosim.diagnosis.noise import wander
from cosim.diagnosis.plants import STEP, FullOrderCar, Nuisance, Run
from driveline.quantities import InputError

# What differs from run to run: standard deviation, step of the differences.
RUN_NUISANCES = {"start_speed": (0.3, 0.02), "grade": (0.001, 5e-4), "torque": (1.0, 0.5)}
_PHASE = (2.0, 0.2)
_HEALTHY = 0.04  # by how much other numbers of the file are wrong, one sigma of the logarithm
# Numbers of the file that no effect of the catalogue moves alone, but that are no better known.
_FILE = ("converter.impeller_inertia", "converter.turbine_inertia", "lockup_clutch.plate_inertia",
         "transmission.inertia[*]", "propeller_shaft.inertia", "final_drive.ring_inertia",
         "damper.stiffness", "transmission.stiffness", "final_drive.mesh_stiffness", "axle_shaft.inertia",
         "tyre.relaxation_length", "seat.mass", "seat.stiffness", "seat.damping",
         "differential_case.inertia", "differential_case.stiffness", "differential_case.damping",
         "suspension.damping", "engine.air_lag", "engine.accessory_torque", "engine.friction_constant",
         "final_drive.loss_constant")


@dataclass(frozen=True)
class Coordinate:
    """One number that may be estimated; it is 0 at the vehicle file.

    Attributes:
        name: Of the effect's parameter, or of the nuisance.
        effect: The effect it belongs to; empty for a nuisance.
        run: The run it belongs to, or None for all.
        parameter: What it does; None for nuisances of a run.
        tolerance: Standard deviation in a healthy car.
        spread: Standard deviation where it is the cause.
        step: For finite differences.
        low, high: Plausible range.
    """

    name: str
    effect: str
    run: int | None
    parameter: EffectParameter | None
    tolerance: float
    spread: float
    step: float
    low: float = -np.inf
    high: float = np.inf


def tolerance(parameter: EffectParameter) -> float:
    """By how much a parameter of a healthy car differs from its vehicle file (one sigma).

    What the catalogue can name is right in the file but for what cannot be noticed.
    """
    return parameter.detection / 5.0


def coordinates(car: FullOrderCar, runs: Sequence[Run],
                effects: Mapping[str, Effect] = CATALOGUE) -> list[Coordinate]:
    """All coordinates that can do anything to these runs: effects first, then nuisances."""
    found = []
    channels = {name for run in runs for name in run.clocks}
    inputs = {f"input.{name}." for name in ("engine_torque", "road_grade", "brake_torque")}
    for effect in effects.values():
        if not all(car.knows(name) for name in effect.changes({}, car.values)):
            continue
        for p in effect.parameters:
            if not _visible(p, channels, inputs):
                continue
            low, high = (np.log(max(x, 1e-3)) if p.scale == "log" else x for x in p.limits)
            found.append(Coordinate(p.name, effect.name, None, p, tolerance(p), p.spread,
                                    0.1 * p.detection, float(low), float(high)))
    for name in _FILE:
        if any(car.values.get(n, 0.0) for n in _entries(name, car.values)):
            p = factor(name, name, unit="1", meaning="known to some per cent only", spread=_HEALTHY,
                       limits=(0.8, 1.25), detection=2.0 * _HEALTHY)
            found.append(Coordinate(name, "", None, p, _HEALTHY, _HEALTHY, 0.01, -0.2, 0.2))
    for i in range(len(runs)):
        for name, (spread, step) in RUN_NUISANCES.items():
            found.append(Coordinate(name, "", i, None, spread, spread, step))
        for effect in effects.values():
            for name in effect.nuisances:
                if any(c.effect == effect.name for c in found):
                    found.append(Coordinate(name, effect.name, i, None, 0.0, *_PHASE))
    return found


def _entries(name: str, values: Mapping[str, float]) -> list[str]:
    return [n for n in values if n.startswith(name[:-2])] if name.endswith("[*]") else [name]


def _instrument(coordinate: Coordinate) -> bool:
    return coordinate.parameter is not None and all(
        name.startswith("observe.") for name in coordinate.parameter.targets)


def _visible(parameter: EffectParameter, channels: set[str], inputs: set[str]) -> bool:
    """Whether a parameter of sensors has a sensor that was recorded."""
    shown = [t.split(".")[1] for t in parameter.targets if t.startswith("observe.")]
    return not shown or bool(channels & set(shown))


class Predictor:
    """Predictions of all runs, in this process or spread over several.

    Args:
        car: The plant with its instruments.
        runs: What is simulated.
        coordinates: What a vector of coordinates means.
        workers: Processes; 1 for none but this.
    """

    def __init__(self, car: FullOrderCar, runs: Sequence[Run], coordinates: Sequence[Coordinate],
                 workers: int = 1) -> None:
        self.car, self.runs, self.coordinates = car, list(runs), list(coordinates)
        self.workers = workers
        self.simulations = 0
        self._raw: OrderedDict[tuple, dict[str, np.ndarray]] = OrderedDict()
        self._pool: ProcessPoolExecutor | None = None
        self._shown = sorted({name for run in runs for name in run.clocks})

    def __enter__(self) -> Predictor:
        if self.workers > 1:
            self._pool = ProcessPoolExecutor(self.workers, multiprocessing.get_context("fork"),
                                             _take, (self.car, self.runs, self.coordinates))
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def index(self, effect: str) -> list[int]:
        """Where the parameters of an effect are among the coordinates."""
        return [i for i, c in enumerate(self.coordinates) if c.effect == effect and c.parameter is not None]

    def values(self, u: np.ndarray, run: int) -> tuple[dict[str, float], Nuisance]:
        """The values and nuisances that a vector of coordinates stands for in one run."""
        sizes: dict[str, dict[str, float]] = {}
        own: dict[str, float] = {}
        phases: dict[str, float] = {}
        values = dict(self.car.values)
        for c, x in zip(self.coordinates, u):
            if c.parameter is not None and not c.effect:
                if x != 0.0:
                    values |= scaled((c.parameter,), {c.name: c.parameter.size(float(x))}, values)
            elif c.parameter is not None:
                if x != 0.0:
                    sizes.setdefault(c.effect, {})[c.parameter.name] = c.parameter.size(
                        float(np.clip(x, c.low, c.high)))
            elif c.run == run:
                (phases if c.effect else own)[c.name] = float(x)
        for name, given in sizes.items():
            values |= CATALOGUE[name].changes(given, values)
        for name, x in phases.items():
            values[name] = values.get(name, 0.0) + x
        return values, Nuisance(**own)

    def predict(self, u: np.ndarray, run: int, seed: int | None = None) -> np.ndarray | None:
        """What the channels of a run should read, stacked; None where the plant refuses these values.

        With a seed the engine torque wanders about its estimate, in a way of its own for every seed.
        """
        values, nuisance = self.values(u, run)
        key = (run, nuisance, tuple(v for name, v in values.items() if not name.startswith("observe.")))
        raw = self._raw.get(key) if seed is None else None
        if raw is None:
            self.simulations += 1
            try:
                torque = 0.0 if seed is None else wander(
                    len(self.runs[run].inputs), STEP, np.random.default_rng([seed, run]))
                found = self.car.raw(values, self.runs[run], nuisance, torque)
            except (ArithmeticError, InputError):
                return None
            raw = {name: found[name] for name in self._shown}
            if seed is None:
                self._raw[key] = raw
            while len(self._raw) > 4 * len(self.runs):
                self._raw.popitem(last=False)
        return self.car.instruments(raw, values, self.runs[run])

    def many(self, jobs: Iterable[tuple]) -> list[np.ndarray | None]:
        """``predict`` for many of its arguments, in their order."""
        jobs = list(jobs)
        if self._pool is None:
            return [self.predict(*job) for job in jobs]
        chunk = max(1, len(jobs) // (3 * self.workers))
        return list(self._pool.map(_predict, jobs, chunksize=chunk))

    def all_runs(self, u: np.ndarray) -> list[np.ndarray] | None:
        """The predictions of every run; None where one fails."""
        found = self.many([(u, run) for run in range(len(self.runs))])
        return None if any(y is None for y in found) else found

    def ensembles(self, u: np.ndarray, predicted: Sequence[np.ndarray], count: int) -> list[list[np.ndarray]]:
        """For every run, deviations from ``predicted`` where the torque wanders about its estimate."""
        runs = range(len(self.runs))
        found = self.many([(u, run, seed) for run in runs for seed in range(count)])
        return [[y - predicted[run] for y in found[run * count:(run + 1) * count] if y is not None]
                for run in runs]

    def jacobian(self, u: np.ndarray, predicted: Sequence[np.ndarray],
                 columns: Sequence[int] | None = None) -> list[np.ndarray]:
        """Derivatives of the stacked predictions of every run by the coordinates (samples x columns).

        One-sided differences, away from a limit of the plausible range.
        """
        columns = range(len(self.coordinates)) if columns is None else columns
        jobs, places = [], []
        # what only instruments feel needs no new simulation: side by side they share one
        order = sorted(range(len(columns)), key=lambda k: not _instrument(self.coordinates[columns[k]]))
        result = [np.zeros((y.size, len(columns))) for y in predicted]
        for place in order:
            column = columns[place]
            c = self.coordinates[column]
            step = c.step if u[column] + c.step <= c.high else -c.step
            moved = u.copy()
            moved[column] += step
            for run in range(len(self.runs)) if c.run is None else (c.run,):
                jobs.append((moved, run))
                places.append((run, place, step))
        for (run, place, step), y in zip(places, self.many(jobs)):
            if y is not None:
                result[run][:, place] = (y - predicted[run]) / step
        return result


_OWN: Predictor | None = None  # of a worker process


def _take(car: FullOrderCar, runs: Sequence[Run], coordinates: Sequence[Coordinate]) -> None:
    global _OWN
    _OWN = Predictor(car, runs, coordinates)


def _predict(job: tuple) -> np.ndarray | None:
    return _OWN.predict(*job)
