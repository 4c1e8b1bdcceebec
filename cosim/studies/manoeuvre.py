"""The validation tip-in, run through a model or its FMU, and what is read off it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from cosim.master import Master, Ramp
from cosim.master.clock import PER_SECOND, step_length
from cosim.master.parameters import find_fmu
from cosim.result import Result
from cosim.signals import Signal
from driveline.models import MODELS
from driveline.plants.plant import Plant
from driveline.quantities import InputError
from driveline.vehicles import Vehicle

FULL_ORDER = "plant_fom"


class Manoeuvre(Protocol):
    """What it takes to drive a model: torque over time, gear, speed at the start, end of the run, step."""

    @property
    def torque(self) -> Signal: ...
    gear: int
    vehicle_speed: float
    stop: float
    step: float


@dataclass(frozen=True)
class TipIn:
    """A ramp of the crankshaft torque from overrun to drive at constant gear, converter locked.

    The values are those of figure 2.4 as far as it can be read: the thesis prints none but the
    gear and the 130 ms of lash crossing, which fixes the rate.

    Attributes:
        before, after: Crankshaft torque [N.m].
        rate: Slope of the ramp [N.m/s].
        start, stop: Begin of the ramp and end of the run [s].
        vehicle_speed: At the start [m/s].
        gear: Engaged gear.
        step: Communication step [s].
    """

    before: float = -30.0
    after: float = 200.0
    rate: float = 250.0
    start: float = 1.0
    stop: float = 4.0
    vehicle_speed: float = 12.0
    gear: int = 5
    step: float = 1e-3

    @property
    def torque(self) -> Ramp:
        """The crankshaft torque over time."""
        return Ramp(before=self.before, after=self.after, time=self.start,
                    duration=(self.after - self.before) / self.rate)

    def less(self, torque: float) -> TipIn:
        """The same with ``torque`` [N.m] taken off the crankshaft all the time."""
        return replace(self, before=self.before - torque, after=self.after - torque)

    @property
    def end(self) -> float:
        """When the ramp is over [s]."""
        return self.start + self.torque.duration


def parameters(model: str, vehicle: Vehicle, gear: int = 5,
               changes: Mapping[str, float] | None = None) -> dict[str, float]:
    """Parameters of a model for a vehicle whose torque input *is* the crankshaft torque.

    The thesis feeds the crankshaft torque of the control unit to the driveline: the air path is left
    out; accessories, which that torque does not know, stay in the full-order model.
    """
    values = dict(MODELS[model].defaults_from(vehicle, gear))
    if model == FULL_ORDER:
        values |= {"engine.air_lag": 0.0, "engine.air_delay": 0.0}
    return values | dict(changes or {})


def prepare(model: str, values: Mapping[str, float], tip_in: Manoeuvre) -> tuple[Plant, np.ndarray]:
    """A plant in its steady state before the tip-in, and its inputs, a row a step."""
    plant = MODELS[model](values)
    plant["start.vehicle_speed"] = tip_in.vehicle_speed
    torque = tip_in.torque.values(instants(tip_in)[:-1])
    plant["engine_torque"] = torque[0]
    if model == FULL_ORDER:
        plant["gear"] = tip_in.gear
    plant.initialize()
    names = [variable.name for variable in plant.inputs]
    inputs = np.tile([plant[name] for name in names], (torque.size, 1))
    inputs[:, names.index("engine_torque")] = torque
    return plant, inputs


def instants(tip_in: Manoeuvre) -> np.ndarray:
    """The communication points [s], to the bit those of the master's clock."""
    return np.arange(round(tip_in.stop / tip_in.step) + 1) * step_length(tip_in.step, "step") / PER_SECOND


def drive(model: str, values: Mapping[str, float], tip_in: Manoeuvre) -> Result:
    """The tip-in through a model in process; signals at every communication point from 0 on."""
    plant, inputs = prepare(model, values, tip_in)
    names = [variable.name for variable in plant.output_variables]
    outputs = slice(len(plant.inputs), len(plant.inputs) + len(names))
    time = instants(tip_in)
    table = np.empty((time.size, len(names)))
    table[0] = plant.values[outputs]
    # step by step at the master's instants: `simulate` counts its own, which differ in the last bit
    for k, (now, row) in enumerate(zip(time.tolist(), inputs), start=1):
        plant.values[:row.size] = row
        plant.step(now, tip_in.step)
        table[k] = plant.values[outputs]
    signals = {name: table[:, i] for i, name in enumerate(names)}
    units = {variable.name: variable.unit for variable in plant.output_variables}
    signals["engine_torque"], units["engine_torque"] = tip_in.torque.values(time), "N.m"
    return Result(time, signals, units)


def drive_fmu(model: str, values: Mapping[str, float], tip_in: TipIn) -> Result | None:
    """The same through the model's FMU and the master; None where the FMU is not built."""
    try:
        find_fmu(model)
    except InputError:
        return None
    declared = {v.name for v in MODELS[model](values).variables if v.causality == "parameter"}
    start = {name: value for name, value in values.items() if name in declared}
    master = (Master(step=tip_in.step)
              .add("plant", model, parameters=start | {"start.vehicle_speed": tip_in.vehicle_speed})
              .signal("engine_torque", tip_in.torque).connect("engine_torque", "plant.engine_torque"))
    if model == FULL_ORDER:
        master.connect(tip_in.gear, "plant.gear")
    result = master.run(tip_in.stop)
    bare = {name: name.removeprefix("plant.") for name in result.names}
    return Result(result.time, {bare[name]: result[name] for name in bare},
                  {bare[name]: result.units[name] for name in bare}, result.provenance, result.complete)


@dataclass(frozen=True)
class Shuffle:
    """A damped sinusoid fitted to an oscillation.

    Attributes:
        frequency: Damped frequency [Hz].
        decay: Rate of decay [1/s].
        damping_ratio: Decay over the undamped angular frequency.
        phase: Of the cosine at the instant the fit begins [rad].
        amplitude: At that instant, in the unit of the signal.
        residual: Root mean square of what the fit leaves, in the unit of the signal.
    """

    frequency: float
    decay: float
    damping_ratio: float
    phase: float
    amplitude: float
    residual: float


def shuffle(time: np.ndarray, signal: np.ndarray, begin: float, end: float) -> Shuffle:
    """Fit offset, trend and one damped sinusoid to a stretch of a signal, by variable projection.

    Frequency and decay are searched; for each pair offset, trend, sine and cosine are linear and solved
    for. Several starts, as neighbouring minima lie a fraction of a period apart.

    Args:
        time: Instants [s].
        signal: Values at these.
        begin, end: The stretch [s].

    Raises:
        ValueError: The stretch has less than 20 samples.
    """
    inside = (time >= begin) & (time <= end)
    if inside.sum() < 20:
        raise ValueError(f"{inside.sum()} samples from {begin:g} to {end:g} s: at least 20 are needed")
    t, y = time[inside] - begin, signal[inside]

    def basis(p: np.ndarray) -> np.ndarray:
        envelope = np.exp(-p[1] * t)
        angle = 2.0 * np.pi * p[0] * t
        return np.column_stack([np.ones_like(t), t, envelope * np.cos(angle), envelope * np.sin(angle)])

    def residual(p: np.ndarray) -> np.ndarray:
        columns = basis(p)
        return columns @ np.linalg.lstsq(columns, y, rcond=None)[0] - y

    fits = [least_squares(residual, [frequency, 3.0], bounds=([0.2, -5.0], [40.0, 60.0]), x_scale=[1.0, 1.0])
            for frequency in (2.5, 4.5, 6.0, 7.5, 10.0)]
    best = min(fits, key=lambda fit: fit.cost)
    _, _, cosine, sine = np.linalg.lstsq(basis(best.x), y, rcond=None)[0]
    frequency, decay = map(float, best.x)
    return Shuffle(
        frequency=frequency, decay=decay,
        damping_ratio=decay / float(np.hypot(decay, 2.0 * np.pi * frequency)),
        phase=float(np.arctan2(-sine, cosine)), amplitude=float(np.hypot(cosine, sine)),
        residual=float(np.sqrt(2.0 * best.cost / t.size)))


@dataclass(frozen=True)
class Crossing:
    """From leaving one flank to first touching the other [s]."""

    start: float
    end: float

    @property
    def duration(self) -> float:
        return self.end - self.start


def lash_crossing(time: np.ndarray, position: np.ndarray) -> Crossing:
    """When a lash position leaves the flank it lies on at first, and first reaches the other.

    Both between the samples. A flank is left without relative speed (its torque passes zero): the position
    grows with the square of time at first, for about damping over stiffness of the shaft (some 1 ms), then
    linearly. The other flank is met with speed. So the start is good to a few tenths of a sample, the end to
    much less.

    Args:
        time: Instants [s].
        position: Lash position [rad], on a flank at the first sample.

    Raises:
        ValueError: The lash is not crossed.
    """
    travel = position - position[0]
    gap = 2.0 * abs(position[0])
    travel = travel if position[0] < 0.0 else -travel
    tolerance = 1e-9 * gap
    moving, there = travel > tolerance, travel >= gap - tolerance
    if gap == 0.0 or not there.any():
        raise ValueError(f"the lash is not crossed: its position moves by {travel.max():g} of {gap:g} rad")
    i, j = int(np.argmax(moving)), int(np.argmax(there))
    start, end = float(time[i]), float(time[j])
    if i + 1 < j:
        low, high = np.sqrt(travel[i]), np.sqrt(travel[i + 1])
        start = float(np.clip(time[i] - low * (time[i + 1] - time[i]) / (high - low), time[i - 1], time[i]))
    if j - 2 >= i:
        speed = (travel[j - 1] - travel[j - 2]) / (time[j - 1] - time[j - 2])
        end = float(np.clip(time[j - 1] + (gap - travel[j - 1]) / speed, time[j - 1], time[j]))
    return Crossing(start, end)


def shuffle_after(result: Result, tip_in: TipIn, signal: str = "propeller_shaft_torque") -> Shuffle:
    """The shuffle in a tip-in: from 0.1 s after the lash is crossed and the ramp is over to the end."""
    crossed = lash_crossing(result.time, result["lash_position"]).end
    return shuffle(result.time, result[signal], settled(crossed, tip_in), tip_in.stop)


def settled(crossed: float, tip_in: TipIn) -> float:
    """When only shuffle is left [s]: impacts have rung down and the torque stands."""
    return max(crossed + 0.1, tip_in.end + 0.02)
