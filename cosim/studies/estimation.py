"""The full-order plant drives the estimators: what studies of chapters 3 and 4 have in common.

The plant runs once for a torque, a gear, a lash and a state of the bus; every estimator at every sampling time
then takes the same recorded frames. The bus is that of figures 3.17 and 4.22: speeds are sampled every
millisecond, delayed and jittered there, and what arrives is sampled again by the estimator. The torque is
known in the control unit without delay. The truth is the plant's lash, both lumped (section 2.2.2.2).
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cosim.master import Master
from cosim.master.parameters import find_fmu
from cosim.result import Result
from cosim.signals import FirstOrder, Ramp
from cosim.studies.manoeuvre import FULL_ORDER, Crossing, lash_crossing, parameters
from cosim.studies.manoeuvre import drive as drive_model
from cosim.studies.torque_profiles import RATE, TorqueProfile, ramp
from driveline import vehicles
from driveline.estimators import ESTIMATORS
from driveline.estimators.estimator import Estimator
from driveline.plants.full_order import FullOrderParameters
from driveline.plants.reduced import reduce
from driveline.quantities import InputError
from driveline.vehicles import Vehicle

PERIODS = (0.01, 0.005, 0.001)  # sampling times of the thesis [s]
SOURCES = {  # of an estimator's inputs
    "engine_torque": "crankshaft_torque", "engine_speed": "engine_speed_measured",
    "wheel_speed": "wheel_speed_measured",
}
THESIS_TKBSE = "tkbse of the thesis"
# no delay found, the twist as the filter predicts it, no mean of tip-ins
AS_IN_THESIS = (("delay.wheel_speed_deviation", 0.0), ("trigger.measured_twist", 0.0), ("trigger.tip_ins", 1.0))
INTERVAL = ("low90", "high90")  # what an estimate's name ends in where its estimator gives an interval
MISSED = 100.0  # error of a traversal that is not found, or of a size that is never estimated [%]


@dataclass(frozen=True)
class Bus:
    """How the two speeds reach the control unit: delays [s], data sets of jitter (1 is none), their seed."""

    engine_delay: float = 0.0
    wheel_delay: float = 0.0
    engine_jitter: int = 1
    wheel_jitter: int = 1
    seed: int = 1

    def parameters(self) -> dict[str, float]:
        """Of the full-order plant's sensors."""
        values: dict[str, float] = {}
        for speed, delay, jitter in (("engine_speed", self.engine_delay, self.engine_jitter),
                                     ("wheel_speed", self.wheel_delay, self.wheel_jitter)):
            values |= {f"{speed}_sensor.{name}": float(value) for name, value in (
                ("period", 1e-3), ("resolution", 0.0), ("delay", delay), ("jitter_set", jitter),
                ("seed", self.seed + 1000 * (speed == "wheel_speed")))}
        return values


@dataclass(frozen=True)
class Drive:
    """One run of the plant.

    Attributes:
        torque: At the crankshaft [N.m].
        stop: End of the run [s].
        gear: Engaged gear; the converter is locked.
        vehicle_speed: At the start [m/s].
        lash: Factor on both gaps of the plant; the estimators are not told.
        bus: How the speeds arrive.
        step: Communication step [s].
    """

    torque: Ramp | FirstOrder | TorqueProfile = field(default_factory=lambda: ramp(RATE))
    stop: float = 4.0
    gear: int = 5
    vehicle_speed: float = 12.0
    lash: float = 1.0
    bus: Bus = Bus()
    step: float = 1e-3

    def with_bus(self, **how: Any) -> Drive:
        """The same over another bus."""
        return replace(self, bus=replace(self.bus, **how))

    @property
    def tip_ins(self) -> tuple[float, ...]:
        """When the torque begins to rise [s], within the run."""
        begins = self.torque.tip_ins if isinstance(self.torque, TorqueProfile) else (self.torque.time,)
        return tuple(begin for begin in begins if begin < self.stop)

    def parameters(self) -> dict[str, float]:
        """Of the full-order plant."""
        changes = {name: self.lash * vehicle().values[name]
                   for name in ("transmission.half_gap", "final_drive.half_gap")}
        changes["engine.maximum_torque"] = 1000.0  # the thesis's steps go to 700 N.m, this engine does not
        return parameters(FULL_ORDER, vehicle(), self.gear, changes | self.bus.parameters())

    def lash_size(self) -> float:
        """Both gaps at the propeller shaft [rad], what a size estimator should find."""
        full = vehicle().parameters(FullOrderParameters)
        return 2.0 * self.lash * reduce(full, self.gear).three_mass.shaft.half_gap


@dataclass(frozen=True)
class Reading:
    """One estimator listening.

    Attributes:
        estimator: A name of ``ESTIMATORS``.
        period: Its sampling time [s].
        factors: On its own parameters, to make it wrong on purpose: name and factor.
        settings: Its parameters that are not as it ships: name and value.
        label: What it is called then.
    """

    estimator: str
    period: float = 0.01
    factors: tuple[tuple[str, float], ...] = ()
    settings: tuple[tuple[str, float], ...] = ()
    label: str = ""

    @property
    def name(self) -> str:
        """Of the estimator, or what it is called with its settings."""
        return self.label or self.estimator

    def told(self, bus: Bus) -> Reading:
        """The same knowing how late both speeds are."""
        delays = (("delay.engine_speed", bus.engine_delay), ("delay.wheel_speed", bus.wheel_delay))
        return replace(self, settings=(*self.settings, *delays), label=f"{self.name}, told")

    def parameters(self, gear: int) -> dict[str, float]:
        """Computed from the vehicle file, then multiplied, then set."""
        values = dict(ESTIMATORS[self.estimator].defaults_from(vehicle(), gear))
        model = ESTIMATORS[self.estimator](values)
        values["sampling.period"] = self.period
        for name, factor in self.factors:
            values[name] = factor * model[name]
        return values | dict(self.settings)


@functools.cache
def vehicle() -> Vehicle:
    """The validated vehicle."""
    return vehicles.load("pickup_10r80", "modified")


def position_estimators() -> list[str]:
    """The estimators that say where the lash is; the thesis's first."""
    return _that_give("lash_position", "contact", "traversal_start", "traversal_end")


def size_estimators() -> list[str]:
    """The estimators that say how large the lash is; the thesis's first."""
    return _that_give("lash_size")


def size_readings() -> list[Reading]:
    """Every size estimator at every sampling time; TKBSE also without what goes beyond the thesis."""
    return [*every(size_estimators()),
            *(Reading("tkbse", period, settings=AS_IN_THESIS, label=THESIS_TKBSE) for period in PERIODS)]


def names(readings: Iterable[Reading]) -> list[str]:
    """Of the readings, each once."""
    return list(dict.fromkeys(reading.name for reading in readings))


def _that_give(*outputs: str) -> list[str]:
    return [name for name, estimator in ESTIMATORS.items()
            if set(outputs) <= {variable.name for variable in estimator.output_variables}]


def has_parameter(estimator: str, name: str) -> bool:
    """Whether an estimator knows a parameter."""
    model = ESTIMATORS[estimator](ESTIMATORS[estimator].defaults_from(vehicle()))
    return any(v.name == name and v.causality == "parameter" for v in model.variables)


def run_plant(drive: Drive) -> Result:
    """The full-order plant in process."""
    return drive_model(FULL_ORDER, drive.parameters(), drive)


@dataclass(frozen=True)
class Estimates:
    """What an estimator said: at its frames, by name of its outputs."""

    time: np.ndarray
    outputs: Mapping[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.outputs[name]

    def __contains__(self, name: str) -> bool:
        return name in self.outputs


def listen(plant: Result, reading: Reading, gear: int, step: float = 1e-3) -> Estimates:
    """An estimator in process on recorded frames."""
    every = round(reading.period / step)
    if every < 1 or abs(every * step - reading.period) > 1e-12:
        raise InputError(f"period is {reading.period:g} s: a multiple of the plant's {step:g} s is needed")
    model = _estimator(reading, gear)
    for name, source in SOURCES.items():
        model[name] = plant[source][0]
    model.initialize()
    rows = np.arange(every, plant.time.size, every)
    inputs = np.tile([model[variable.name] for variable in model.inputs], (rows.size, 1))
    names = [variable.name for variable in model.inputs]
    for name, source in SOURCES.items():
        inputs[:, names.index(name)] = plant[source][rows]
    table = model.simulate(inputs)
    return Estimates(plant.time[rows], {
        variable.name: table[:, i] for i, variable in enumerate(model.output_variables)})


def _estimator(reading: Reading, gear: int) -> Estimator:
    values = reading.parameters(gear)
    model = ESTIMATORS[reading.estimator](values)
    for name, value in values.items():
        model[name] = value
    return model


def is_built(name: str) -> bool:
    """Whether there is an FMU of this name."""
    try:
        find_fmu(name)
    except InputError:
        return False
    return True


def through_master(drive: Drive, readings: Sequence[Reading]) -> dict[Reading, Estimates] | None:
    """The same through the FMUs and the master; None where not all of them are built."""
    if not all(is_built(name) for name in (FULL_ORDER, *(reading.estimator for reading in readings))):
        return None
    # the estimator reads the frame that arrives at its own instant, not the one before: Gauss-Seidel
    master = Master(step=drive.step, order="gauss-seidel")
    master.add("plant", FULL_ORDER, parameters=_set(FULL_ORDER, drive.parameters()) | {
        "start.vehicle_speed": drive.vehicle_speed})
    master.connect(drive.torque, "plant.engine_torque").connect(drive.gear, "plant.gear")
    names = {reading: f"estimator_{i}" for i, reading in enumerate(readings)}
    for reading, name in names.items():
        master.add(name, reading.estimator, step=reading.period, parameters=reading.parameters(drive.gear))
        for target, source in SOURCES.items():
            master.connect(f"plant.{source}", f"{name}.{target}")
    result = master.record("estimator_*.*", step=drive.step).run(drive.stop)
    found = {}
    for reading, name in names.items():
        every = round(reading.period / drive.step)
        rows = np.arange(every, result.time.size, every)
        outputs = {v.name: result[f"{name}.{v.name}"][rows]
                   for v in ESTIMATORS[reading.estimator].output_variables}
        found[reading] = Estimates(result.time[rows], outputs)
    return found


def _set(model: str, values: Mapping[str, float]) -> dict[str, float]:
    """Those of the values that are parameters; the gear is an input."""
    return {name: value for name, value in values.items() if name != "gear"}


def largest_difference(ours: Estimates, theirs: Estimates) -> float:
    """Between two runs of one estimator, over all outputs."""
    return max(float(np.abs(ours[name] - theirs[name]).max()) for name in ours.outputs)


# -- position ---------------------------------------------------------------------------------------


def true_traversal(plant: Result, drive: Drive) -> Crossing:
    """The first complete traversal from the coast to the drive flank after the first tip-in.

    It starts when the lumped lash leaves the coast flank for the last time before it arrives, which is
    when the first of both lashes opens; both between the samples.
    """
    half = 0.5 * drive.lash_size()
    position = plant["lash_position"]
    tolerance = 1e-9 * half
    there = np.flatnonzero((plant.time >= drive.tip_ins[0]) & (position >= half - tolerance))
    if not there.size:
        raise ValueError("the lash is not crossed: a torque that turns positive is needed")
    rest = np.flatnonzero(position[:there[0]] <= -half + tolerance)
    if not rest.size:
        raise ValueError("the lash does not rest on its coast flank first: a torque that begins negative is "
                         "needed")
    part = slice(int(rest[-1]), int(there[0]) + 2)
    return lash_crossing(plant.time[part], position[part])


def estimated_traversal(estimates: Estimates, begin: float) -> Crossing | None:
    """The first traversal after ``begin`` [s] that an estimator reports to end on the drive flank."""
    row = _reported(estimates, begin)
    if row is None:
        return None
    return Crossing(float(estimates["traversal_start"][row]), float(estimates["traversal_end"][row]))


def _reported(estimates: Estimates, begin: float) -> int | None:
    """The frame in which that traversal is last reported.

    That is while its contact holds, but no longer than 0.1 s: an estimator may look back and correct itself.
    """
    time, driving = estimates.time, estimates["contact"] > 0.5
    arrivals = np.flatnonzero((time[1:] >= begin) & driving[1:] & ~driving[:-1]) + 1
    if not arrivals.size:
        return None
    row = int(arrivals[0])
    while row + 1 < time.size and driving[row + 1] and time[row + 1] <= time[arrivals[0]] + 0.1:
        row += 1
    return row


def traversal_interval(estimates: Estimates, begin: float) -> list[float] | None:
    """The 90 % interval of that traversal's time [s]; None where the estimator gives none."""
    row = _reported(estimates, begin)
    names = [f"traversal_time_{end}" for end in INTERVAL]
    if row is None or names[0] not in estimates:
        return None
    return [float(estimates[name][row]) for name in names]


def measure_position(drive: Drive, readings: Sequence[Reading]) -> dict[str, Any]:
    """A case of a sweep: start and end [s] of the traversal, true and as every reading has them.

    With the 90 % interval of its time where the estimator gives one.
    """
    plant = run_plant(drive)
    truth = true_traversal(plant, drive)
    found, intervals = [], []
    for reading in readings:
        estimates = listen(plant, reading, drive.gear, drive.step)
        crossing = estimated_traversal(estimates, drive.tip_ins[0])
        found.append(crossing and [crossing.start, crossing.end])
        intervals.append(traversal_interval(estimates, drive.tip_ins[0]))
    return {"truth": [truth.start, truth.end], "readings": found, "intervals": intervals}


def traversal_error(case: Mapping[str, Any], number: int) -> float:
    """Error of a reading's traversal time [%], with sign; ``MISSED`` where it found none."""
    if case["readings"][number] is None:
        return MISSED
    start, end = case["truth"]
    ours, theirs = case["readings"][number]
    return 100.0 * ((theirs - ours) / (end - start) - 1.0)


# -- size -------------------------------------------------------------------------------------------


def sizes_after(estimates: Estimates, drive: Drive, name: str = "lash_size") -> list[float]:
    """An output as it stands after each tip-in, just before the next."""
    ends = [*drive.tip_ins[1:], drive.stop + drive.step]
    rows = np.searchsorted(estimates.time, np.array(ends) - 1e-9) - 1
    return [float(value) for value in estimates[name][rows]]


def measure_size(drive: Drive, readings: Sequence[Reading]) -> dict[str, Any]:
    """A case of a sweep: the size [rad], true and as every reading has it after each tip-in.

    With ``low`` and ``high`` where the estimator gives an interval.
    """
    plant = run_plant(drive)
    found = []
    for reading in readings:
        estimates = listen(plant, reading, drive.gear, drive.step)
        entry = {"size": sizes_after(estimates, drive)}
        for side, end in zip(("low", "high"), INTERVAL):
            if f"lash_size_{end}" in estimates:
                entry[side] = sizes_after(estimates, drive, f"lash_size_{end}")
        found.append(entry)
    return {"truth": drive.lash_size(), "readings": found}


def size_errors(case: Mapping[str, Any], number: int) -> list[float]:
    """Error of a reading's size after each tip-in [%], with sign."""
    return [100.0 * (size / case["truth"] - 1.0) for size in case["readings"][number]["size"]]


# -- names and summaries ----------------------------------------------------------------------------


def every(estimators: Iterable[str], periods: Sequence[float] = PERIODS) -> list[Reading]:
    """Every estimator at every sampling time."""
    return [Reading(estimator, period) for estimator in estimators for period in periods]


def in_ms(seconds: float) -> str:
    """``10 ms``."""
    return f"{1e3 * seconds:g} ms"
