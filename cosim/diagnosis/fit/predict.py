"""Predictions and their sensitivities over all runs, for any mixture of effects and nuisances.

Everything that may be estimated is a ``Coordinate``; a vector of them is what fits and evidence work on, and 0
everywhere is the vehicle file. Some belong to all runs: the parameters of the catalogue's effects, and the
other numbers of the file, which are known to some per cent only. Some belong to one run: its start speed,
slope and torque bias, what its torque was where frames are lost, and the two components of what swings with an
angle whose phase nobody knows.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.interpolate import CubicSpline
from threadpoolctl import threadpool_limits

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import Effect, EffectParameter, Values, factor, scaled, shift
from cosim.diagnosis.fit.noise import WANDER, bends, floor, wander
from cosim.diagnosis.plants import STEP, FullOrderCar, Nuisance, Run
from cosim.diagnosis.plants.hats import MEMORY, comb, fast, hats, lasting, parted, teeth
from cosim.measured import CANONICAL
from cosim.workers import pool
from driveline.quantities import InputError

Job, Result = TypeVar("Job"), TypeVar("Result")

# What differs from run to run: standard deviation, step of the differences.
RUN_NUISANCES = {"start_speed": (0.3, 0.006), "grade": (0.001, 1.5e-4), "torque": (1.0, 0.15)}
SLOPES = 0.03  # of roads that nobody measured, standard deviation: of a proving ground they are known to a thousandth
WANDERS = "torque_wander"  # the name of the heights of the hats that the engine torque wanders by
FILLED = "torque_filled"  # and of what it was in gaps
HEALTHY = 0.04  # by how much other numbers of the file are wrong, one sigma of the logarithm
# An accelerometer shows the part of gravity along it, 0.17 m/s2 where it, or the road, is off by a degree: so what it
# shows at rest is no better known, and says nothing of the car.
ZERO = 0.2  # m/s2
# What the catalogue can name is right in a healthy car but for this share of what shows.
TOLERANCE = 0.2
# Of differences, in detection limits. With three times as much crossings of a lash are not on a line any more, with a
# third single samples that jump weigh too much.
_STEP = 0.08
_KEPT = 4  # simulations without instruments
# Numbers of the file that no effect of the catalogue moves alone, but that are no better known.
_FILE = ("converter.impeller_inertia", "converter.turbine_inertia", "lockup_clutch.plate_inertia",
         "transmission.inertia[*]", "propeller_shaft.inertia", "final_drive.ring_inertia",
         "damper.stiffness", "transmission.stiffness", "final_drive.mesh_stiffness", "axle_shaft.inertia",
         "tyre.relaxation_length", "seat.mass", "seat.stiffness", "seat.damping",
         "differential_case.inertia", "differential_case.stiffness", "differential_case.damping",
         "differential_case.lever_arm", "suspension.damping", "transmission.input_inertia", "engine.air_lag",
         "engine.accessory_torque", "engine.friction_constant", "engine.friction_viscous", "final_drive.loss_constant",
         "transmission.output_inertia", "tyre.friction_coefficient")
_KNOWN = tuple(factor(name, name, unit="1", meaning="known to some per cent only", spread=HEALTHY, limits=(0.8, 1.25),
                      detection=2.0 * HEALTHY) for name in _FILE)
# What the damper of a lock-up clutch loses is one viscous number in a vehicle file, in place of friction that loses the
# same at any speed: it stands for that at one amplitude and frequency, and elsewhere for half of it or for twice. Of
# shuffle, 5 Hz and 25 mrad at the damper, 5 N.m.s/rad are worth 3 N.m.
_DAMPER = (factor("damper.damping", "damper.damping", unit="1", meaning="what the damper loses in proportion to speed",
                  spread=math.log(2.0), limits=(0.1, 10.0), detection=2.0 * math.log(2.0)),
           shift("damper_friction.torque", "damper_friction.torque", unit="N.m",
                 meaning="what it loses whatever the speed", spread=3.0, limits=(0.0, 30.0), detection=6.0))


@dataclass(frozen=True)
class Coordinate:
    """One number that may be estimated; it is 0 at the vehicle file.

    Attributes:
        name: Of the effect's parameter, of the file's number, or of the nuisance.
        effect: The effect it belongs to; empty for a nuisance.
        cause: What may be supposed to be wrong: the effect, or ``EFFECT:PARAMETER`` where it has several that
            mean something alone.
        run: The run it belongs to, or None for all.
        parameter: What it does; None for nuisances of a run.
        tolerance: Standard deviation in a healthy car.
        spread: Standard deviation where it is the cause.
        step: For finite differences.
        low, high: From where to where it is plausible, and the vehicle can have it.
        phase: Value that holds the phase, for a component of a swing.
        part: Which: 0 the cosine's, 1 the sine's; of a row of hats or waves, its place.
    """

    name: str
    effect: str
    cause: str
    run: int | None
    parameter: EffectParameter | None
    tolerance: float
    spread: float
    step: float
    low: float = -np.inf
    high: float = np.inf
    phase: str = ""
    part: int = 0

    def plausible(self, x: float) -> bool:
        """Whether a cause may be as large as this: at no end of what is plausible, as far as healthy cars differ.

        All that there is of something may be gone; what is at another end would have to be beyond.
        """
        low, high = (self.low, self.high) if self.phase else map(self.parameter.coordinate, self.parameter.limits)
        if self.parameter.one_sided and not self.phase:
            low = -np.inf
        return low + self.tolerance < x < high - self.tolerance or abs(x) < self.tolerance

    @property
    def nuisance(self) -> bool:
        """Whether it is a run's own and no effect's."""
        return self.run is not None and not self.effect


def coordinates(car: FullOrderCar, runs: Sequence[Run],
                effects: Mapping[str, Effect] = CATALOGUE) -> list[Coordinate]:
    """All coordinates that can do anything to these runs: effects first, then the file, then nuisances."""
    found = []
    channels = {name for run in runs for name in run.clocks}
    for effect in effects.values():
        if not all(car.knows(name) for name in effect.changes({}, car.values)):
            continue
        for p in effect.parameters:
            if not _visible(p, channels) or _idle(p, car.values):
                continue
            healthy = TOLERANCE * p.detection
            alone = len(effect.parameters) > 1 and not effect.joint
            cause = f"{effect.name}:{p.name}" if alone else effect.name
            if p.name in effect.swings:
                for r, run in enumerate(runs):
                    if not _visible(p, set(run.clocks)):
                        continue
                    found += [Coordinate(p.name, effect.name, cause, r, p, healthy, p.spread, p.detection,
                                         -p.limits[1], p.limits[1], effect.swings[p.name], part) for part in (0, 1)]
                continue
            low, high = map(p.coordinate, p.range(car.values))
            found.append(Coordinate(p.name, effect.name, cause, None, p, healthy, p.spread, _STEP * p.detection,
                                    low, high))
    for p in (*_KNOWN, *(_DAMPER if car.values.get("damper.stiffness") else ())):
        if p.one_sided or any(car.values.get(n, 0.0) for n in _entries(p.name, car.values)):
            low, high = map(p.coordinate, p.range(car.values))
            found.append(Coordinate(p.name, "", "", None, p, p.spread, p.spread, _STEP * p.detection, low, high))
    for channel in sorted(channels):
        if CANONICAL[channel].unit == "m/s2":
            p = shift(zero_of(channel), f"observe.{channel}.offset", unit="m/s2", meaning="shown at rest",
                      spread=ZERO, limits=(-np.inf, np.inf), detection=2.0 * ZERO)
            found.append(Coordinate(p.name, "", "", None, p, ZERO, ZERO, _STEP * p.detection))
    for r, run in enumerate(runs):
        found += [Coordinate(name, "", "", r, None, spread, spread, step)
                  for name, (spread, step) in _nuisances(run).items()]
        waves = [height for gap in run.gaps for height in gap.waves]
        found += [Coordinate(FILLED, "", "", r, None, height, height, WANDER, part=k) for k, height in enumerate(waves)]
    for r, run in enumerate(runs):
        found += [Coordinate(WANDERS, "", "", r, None, WANDER, WANDER, WANDER, part=k) for k in range(hats(run).size)]
    return found


def zero_of(channel: str) -> str:
    """The name of what an accelerometer shows at rest, among the coordinates."""
    return f"{channel}.zero"


def _nuisances(run: Run) -> dict[str, tuple[float, float]]:
    found = dict(RUN_NUISANCES)
    if run.unknown_road:
        found["grade"] = SLOPES, found["grade"][1]
    return found


def _entries(name: str, values: Mapping[str, float]) -> list[str]:
    return [n for n in values if n.startswith(name[:-2])] if name.endswith("[*]") else [name]


def _idle(parameter: EffectParameter, values: Values) -> bool:
    """Whether it does nothing in this vehicle: a factor on what is not there, or what cannot be more or less."""
    entries = [name for target in parameter.targets for name in _entries(target, values)]
    nothing = parameter.scale == "log" and not any(values.get(name, parameter.neutral) for name in entries)
    low, high = parameter.range(values)
    return nothing or low >= high


def _visible(parameter: EffectParameter, channels: set[str]) -> bool:
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
        self._raw: OrderedDict[tuple, dict[str, np.ndarray]] = OrderedDict()
        self._pool: ProcessPoolExecutor | None = None
        self._shown = sorted({name for run in runs for name in run.clocks})

    def __enter__(self) -> Predictor:
        if self.workers > 1:
            self._pool = pool(self.workers, _take, (self.car, self.runs, self.coordinates), copied=True)
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    @property
    def tried(self) -> int:
        """How many effects could be found."""
        return len({c.effect for c in self.coordinates if c.effect})

    @property
    def repeats(self) -> list[int]:
        """Of each run, how many are of its manoeuvre, itself among them."""
        driven = [run.manoeuvre for run in self.runs]
        return [driven.count(manoeuvre) if manoeuvre else 1 for manoeuvre in driven]

    def index(self, cause: str) -> list[int]:
        """Where the parameters of a cause are among the coordinates."""
        return [i for i, c in enumerate(self.coordinates) if c.cause == cause]

    def values(self, u: np.ndarray, run: int) -> tuple[dict[str, float], Nuisance]:
        """The values and nuisances that a vector of coordinates stands for in one run."""
        sizes: dict[str, dict[str, float]] = {}
        swings: dict[tuple[str, str, str], complex] = {}
        own: dict[str, float] = {}
        heights: dict[str, list[float]] = {WANDERS: [], FILLED: []}
        values = dict(self.car.values)
        for c, x in zip(self.coordinates, u):
            if c.run is not None and c.run != run:
                continue
            if c.name in heights:
                heights[c.name].append(float(x))
            elif c.parameter is None:
                own[c.name] = float(x)
            elif x == 0.0:
                continue
            elif not c.effect:
                size = c.parameter.size(float(np.clip(x, c.low, c.high)))
                values |= scaled((c.parameter,), {c.name: size}, values)
            elif c.phase:
                key = (c.effect, c.name, c.phase)
                swings[key] = swings.get(key, 0.0) + float(x) * (1.0, 1.0j)[c.part]
            else:
                size = c.parameter.size(float(np.clip(x, c.low, c.high)))
                sizes.setdefault(c.effect, {})[c.name] = size
        for (effect, name, phase), swing in swings.items():
            sizes.setdefault(effect, {})[name] = abs(swing)
            values[phase] = float(np.angle(swing))
        for name, given in sizes.items():
            values |= CATALOGUE[name].changes(given, values)
        return values, Nuisance(**own, wander=tuple(heights[WANDERS]), filled=tuple(heights[FILLED]))

    def predict(self, u: np.ndarray, run: int, change: int | tuple[str, np.ndarray] | None = None) -> np.ndarray | None:
        """What the channels of a run should read, stacked; None where the plant refuses these values.

        Args:
            u: Coordinates.
            run: Which run.
            change: A seed: the engine torque wanders about its estimate faster than hats can follow, and what leads
                the simulation has as much noise again, in a way of its own for every seed. A balance of the driveline
                and a torque at every step: that acts on it.
        """
        values, nuisance = self.values(u, run)
        here = self.runs[run]
        try:
            raw = (self.car.pushed(values, here, nuisance, *change) if isinstance(change, tuple)
                   else self._simulated(values, nuisance, run, change))
            return self.car.instruments(raw, values, here)
        except (ArithmeticError, InputError):
            return None

    def _simulated(self, values: Mapping[str, float], nuisance: Nuisance, run: int,
                   seed: int | None = None) -> dict[str, np.ndarray]:
        """What the plant does in a run, without instruments; errors as ``FullOrderCar.raw``."""
        here = self.runs[run]
        key = (run, seed, nuisance, self._led(values, here),
               tuple(v for name, v in values.items() if not name.startswith("observe.")))
        raw = self._raw.get(key)
        if raw is None:
            torque = 0.0
            if seed is not None:
                random = np.random.default_rng([seed, run])
                torque = fast(here, wander(len(here.inputs), STEP, random))
                here = replace(here, anchors={name: _shaken(shown, random) for name, shown in here.anchors.items()})
            found = self.car.raw(values, here, nuisance, torque)
            raw = self._raw[key] = {name: found[name] for name in self._shown}
            # one a run at least: what only instruments feel is asked of all runs before the next of it is
            while len(self._raw) > max(_KEPT, len(self.runs)):
                self._raw.popitem(last=False)
        return raw

    @staticmethod
    def _led(values: Mapping[str, float], run: Run) -> tuple[float, ...]:
        """What the instruments that lead the simulation make of it."""
        return tuple(v for name, v in values.items()
                     if name.startswith("observe.") and name.split(".")[1] in run.anchors)

    def many(self, jobs: Iterable[tuple]) -> list[np.ndarray | None]:
        """``predict`` for many of its arguments, in their order."""
        return [self.predict(*job) for job in jobs] if self._pool is None else self.each(_predict, jobs)

    def each(self, function: Callable[[Job], Result], jobs: Iterable[Job]) -> list[Result]:
        """What a function makes of each of some jobs, in their order; in the processes, where there are any."""
        jobs = list(jobs)
        if self._pool is None:
            return [function(job) for job in jobs]
        chunk = max(1, len(jobs) // (6 * self.workers))
        return list(self._pool.map(function, jobs, chunksize=chunk))

    def at_once(self, tasks: Sequence[Callable[[], Result]]) -> list[Result]:
        """What tasks return that know nothing of each other, in their order; several at once where there are processes.

        A fit asks for a few simulations at a time and thinks between them: alone it would have processes wait.
        """
        if self._pool is None or len(tasks) < 2:
            return [task() for task in tasks]
        with ThreadPoolExecutor(self.workers) as threads:
            return list(threads.map(lambda task: task(), tasks))

    def all_runs(self, points: Sequence[np.ndarray]) -> list[np.ndarray] | None:
        """The predictions of every run, each at its own vector of coordinates; None where one fails."""
        found = self.many([(u, run) for run, u in enumerate(points)])
        return None if any(y is None for y in found) else found

    def jacobian(self, points: Sequence[np.ndarray], predicted: Sequence[np.ndarray],
                 columns: Mapping[int, Sequence[int]]) -> list[np.ndarray]:
        """Derivatives of the stacked predictions of some runs by some coordinates (samples x columns).

        One-sided differences, away from a limit of the plausible range.

        Args:
            points, predicted: Of all runs.
            columns: Which coordinates for which run; of the hats of a row all or none.
        """
        jobs: list[tuple[np.ndarray, int]] = []
        places: list[tuple[int, int, float]] = []
        result = {run: np.zeros((predicted[run].size, len(wanted)), dtype=np.float32)
                  for run, wanted in columns.items()}
        for run, wanted in columns.items():
            u = points[run]
            # what only instruments feel needs no new simulation: side by side they share one
            for place in sorted(range(len(wanted)), key=lambda k: not _instrument(self.coordinates[wanted[k]])):
                c = self.coordinates[wanted[place]]
                if c.run not in (None, run) or c.name == WANDERS:
                    continue
                step = c.step if u[wanted[place]] + c.step <= c.high else -c.step
                moved = u.copy()
                moved[wanted[place]] += step
                jobs.append((moved, run))
                places.append((run, place, step))
        for (run, place, step), y in zip(places, self.many(jobs)):
            if y is not None:
                result[run][:, place] = (y - predicted[run]) / step
        rows = {run: [k for k, i in enumerate(wanted) if self.coordinates[i].name == WANDERS]
                for run, wanted in columns.items()}

        def wandered(run: int, heights: np.ndarray) -> tuple[np.ndarray, int]:
            moved = points[run].copy()
            moved[[columns[run][k] for k in rows[run]]] += WANDER * heights
            return moved, run

        by_hats = self.by_hats([run for run, row in rows.items() if row], predicted, wandered, WANDER, MEMORY)
        for run, moved in by_hats.items():
            result[run][:, rows[run]] = moved
        return list(result.values())

    def by_hats(self, runs: Iterable[int], predicted: Sequence[np.ndarray],
                job: Callable[[int, np.ndarray], tuple], unit: float, memory: float) -> dict[int, np.ndarray]:
        """Derivatives of the stacked predictions of some runs by the heights of a row of hats (samples x hats).

        Args:
            runs: Which.
            predicted: Of all runs, without that row.
            job: What ``many`` takes, of a run and the heights of its hats over ``unit``.
            unit: How high hats are simulated.
            memory: After which a hat does nothing any more [s], in runs that are led along the vehicle's speed.
        """
        counts = {run: hats(self.runs[run]).size for run in runs}
        lasts = {run: lasting(self.runs[run], memory) for run in counts}
        result = {run: np.zeros((predicted[run].size, count), dtype=np.float32) for run, count in counts.items()}
        combs = [(run, first) for run, count in counts.items() for first in range(min(teeth(lasts[run]), count))]
        found = self.many([job(run, comb(counts[run], first, lasts[run])) for run, first in combs])
        for (run, first), y in zip(combs, found):
            if y is not None:
                result[run] += parted(self.runs[run], first, lasts[run], (y - predicted[run]) / unit)
        return result

    def strays(self, points: Sequence[np.ndarray], predicted: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
        """Of each run, how far every sample strays for what is random and not estimated: draws x samples."""
        jobs = [(u, run, seed) for run, u in enumerate(points) for seed in range(count)]
        found = self.many(jobs)
        return [np.array([y - predicted[run] for y in found[run * count:(run + 1) * count] if y is not None])
                for run in range(len(points))]

    def bent(self, points: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Of each run, how much its channels bend near every sample (``noise.bends``), stacked.

        Raises:
            ArithmeticError, InputError: One cannot be simulated.
        """
        found = []
        for r, (run, u) in enumerate(zip(self.runs, points)):
            values, nuisance = self.values(u, r)
            steps = replace(run, clocks=dict.fromkeys(run.clocks, run.time))
            shown = self.car.instruments(self._simulated(values, nuisance, r), values, steps)
            found.append(np.concatenate([np.interp(clock, run.time, bends(shown[steps.slices[name]]))
                                         for name, clock in run.clocks.items()]))
        return found


def effect_of(cause: str) -> str:
    """The effect of the catalogue that a cause belongs to: it is that, or one of its parameters that acts alone."""
    return cause.partition(":")[0]


def amplitude(parts: Sequence[float], deviations: Sequence[float] = (0.0,)) -> float:
    """Of a swing, by both of its components in every run: root mean square over the runs.

    Args:
        parts: The components.
        deviations: Of them, standard; what they add on average is taken off.
    """
    return float(np.sqrt(2.0 * max(np.mean(np.square(parts)) - np.mean(np.square(deviations)), 0.0)))


def _shaken(shown: CubicSpline, random: np.random.Generator) -> CubicSpline:
    """A channel with as much noise again as it has."""
    values = shown(shown.x)
    return CubicSpline(shown.x, values + floor(values) * random.standard_normal(values.size))


def _instrument(coordinate: Coordinate) -> bool:
    return coordinate.parameter is not None and all(
        name.startswith("observe.") for name in coordinate.parameter.targets)


_OWN: Predictor | None = None  # of a worker process


def _take(car: FullOrderCar, runs: Sequence[Run], coordinates: Sequence[Coordinate]) -> None:
    global _OWN
    threadpool_limits(1)  # as in the process that a copy is of
    _OWN = Predictor(car, runs, coordinates)


def _predict(job: tuple) -> np.ndarray | None:
    return _OWN.predict(*job)
