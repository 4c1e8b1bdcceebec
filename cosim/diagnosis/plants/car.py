"""The full-order plant as a car on the road with the instruments of a test car."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping, Sequence

import numpy as np

from cosim.diagnosis.observation import observe
from cosim.diagnosis.plants.run import NONE, STEP, Nuisance, Run
from cosim.measured import Manoeuvre, Measurement
from driveline import vehicles
from driveline.plants.full_order import FullOrderPlant
from driveline.quantities import InputError

log = logging.getLogger("cosim")

SETTLE = 0.3  # what is not compared after the start [s]: the plant starts rolling steadily, the car need not
LONGEST = 15.0  # a longer recording is cut [s]: start speed and grade are constant within a run
RUNS = 6  # at most so many stretches of one long recording
CHANNELS = ("engine_speed", "turbine_speed", "transmission_output_speed", "wheel_speed", "vehicle_speed",
            "propeller_shaft_torque", "seat_acceleration", "differential_acceleration")
_RATE = 500.0  # Hz: channels that are sampled faster are thinned, as the driveline does nothing up there


class FullOrderCar:
    """The full-order plant with the instruments of a test car.

    Args:
        vehicle: Name or path of the vehicle file.
        variant: Variant of it, or None.
        changes: Values that replace those of the file.
    """

    name = "plant_fom"

    def __init__(self, vehicle: str, variant: str | None = None,
                 changes: Mapping[str, float] | None = None) -> None:
        self.vehicle, self.variant = vehicle, variant
        self.source = vehicles.load(vehicle, variant)
        self.values: dict[str, float] = FullOrderPlant.defaults_from(self.source) | dict(changes or {})
        # three sub-steps in a step: what the driveline does up to 100 Hz does not change by it
        self.values["solver.maximum_substep"] = STEP / 3.0
        self._plant = FullOrderPlant(self.values)
        self._names = [variable.name for variable in self._plant.output_variables]
        self._parameters = {v.name for v in self._plant.variables if v.causality == "parameter"}
        # as built: defaults of parameters the file need not give
        self.values = {v.name: v.start for v in self._plant.variables if v.causality == "parameter"} | self.values

    def __reduce__(self) -> tuple:
        return FullOrderCar, (self.vehicle, self.variant, self.values)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every parameter of the plant."""
        return {v.name: v.unit for v in self._plant.variables if v.causality == "parameter"}

    @property
    def idle_inputs(self) -> np.ndarray:
        """Every input at its start value."""
        return np.array([variable.start for variable in self._plant.inputs])

    def knows(self, name: str) -> bool:
        """Whether a value of this name does anything here: of the plant, an input or an instrument."""
        return name in self._parameters or name.startswith(("input.", "observe."))

    def raw(self, values: Mapping[str, float], run: Run, nuisance: Nuisance = NONE,
            torque: np.ndarray | float = 0.0) -> dict[str, np.ndarray]:
        """All outputs of the plant over ``run.time``, without instruments.

        Args:
            torque: Added to the engine torque at every step [N.m].

        Raises:
            ArithmeticError: The simulation left the finite numbers.
            InputError: A value the plant refuses.
        """
        plant = self._plant
        for name in self._parameters:
            plant.values[plant.index[name]] = values[name]
        inputs = run.inputs.copy()
        columns = {variable.name: i for i, variable in enumerate(plant.inputs)}
        for name, i in columns.items():
            inputs[:, i] = (inputs[:, i] * values.get(f"input.{name}.gain", 1.0)
                            + values.get(f"input.{name}.offset", 0.0))
        inputs[:, columns["engine_torque"]] += nuisance.torque + torque
        inputs[:, columns["road_grade"]] += nuisance.grade
        plant["start.vehicle_speed"] = run.start_speed + nuisance.start_speed
        for name, i in columns.items():
            plant[name] = inputs[0, i]
        plant.initialize()
        table = plant.simulate(inputs, STEP, run.start)
        return {name: table[:, i] for i, name in enumerate(self._names)}

    def instruments(self, raw: Mapping[str, np.ndarray], values: Mapping[str, float], run: Run) -> np.ndarray:
        """What the channels of ``run`` read of the plant's outputs, stacked as ``run.stacked``."""
        time = run.time
        return np.concatenate([observe(raw, time, values, name, clock)
                               for name, clock in run.clocks.items()])

    def predict(self, values: Mapping[str, float], run: Run, nuisance: Nuisance = NONE) -> np.ndarray:
        """What the channels of ``run`` should read, stacked as ``run.stacked``; errors as ``raw``."""
        return self.instruments(self.raw(values, run, nuisance), values, run)

    def runs(self, measurement: Measurement) -> list[Run]:
        """The manoeuvres of a measurement, long ones cut into stretches of one gear.

        Raises:
            InputError: The engine torque or every output is missing, or the gear cannot be told.
        """
        found = [run for manoeuvre in measurement.manoeuvres for run in self._cut(manoeuvre)]
        if not found:
            raise InputError(f"measurement '{measurement.name}': no stretch of at least 2 s in one forward gear "
                             "above walking pace, so there is nothing to compare")
        return found

    def _cut(self, manoeuvre: Manoeuvre) -> list[Run]:
        if "engine_torque" not in manoeuvre:
            raise InputError(f"manoeuvre '{manoeuvre.name}' has no channel 'engine_torque': without what drives "
                             "the plant nothing can be simulated")
        present = [name for name in CHANNELS if name in manoeuvre]
        if not any(name.endswith("speed") for name in present):
            raise InputError(f"manoeuvre '{manoeuvre.name}' has no speed: at least one of "
                             f"{', '.join(CHANNELS[:5])} is needed")
        start, stop = manoeuvre.start, manoeuvre.stop
        if stop - start < 2.0:
            raise InputError(f"manoeuvre '{manoeuvre.name}': all channels together are there for "
                             f"{max(stop - start, 0.0):.2g} s; at least 2 s are needed")
        if stop - start <= LONGEST and "gear" not in manoeuvre:
            run = self._run(manoeuvre, present, manoeuvre.name, start, stop)
            return [run] if run else []
        spans = self._spans(manoeuvre, start, stop)
        runs = [run for i, (begin, end) in enumerate(spans, start=1)
                if (run := self._run(manoeuvre, present, f"{manoeuvre.name}_{i}", begin, end))]
        if len(spans) == 1 and runs:
            return [dataclasses.replace(runs[0], name=manoeuvre.name)]
        lively = sorted(runs, key=lambda run: -float(np.std(run.inputs[:, 0])))[:RUNS]
        return sorted(lively, key=lambda run: run.start)

    def _spans(self, manoeuvre: Manoeuvre, start: float, stop: float) -> list[tuple[float, float]]:
        """Stretches of constant gear, none longer than ``LONGEST``."""
        edges = [start, stop]
        if "gear" in manoeuvre:
            gear = manoeuvre["gear"]
            change = np.flatnonzero(np.diff(gear.values)) + 1
            inside = (gear.time[change] > start) & (gear.time[change] < stop)
            edges = [start, *gear.time[change][inside].tolist(), stop]
        spans = []
        for begin, end in zip(edges, edges[1:]):
            # what a shift shakes up rings down first; the clutches of the next shift begin before its flag
            begin, end = begin + 0.8 * (begin != start), end - 0.3 * (end != stop)
            count = max(1, int(np.ceil((end - begin) / LONGEST)))
            bounds = np.linspace(begin, end, count + 1)
            spans += [(float(a), float(b)) for a, b in zip(bounds, bounds[1:]) if b - a >= 2.0]
        return spans

    def _run(self, manoeuvre: Manoeuvre, present: Sequence[str], name: str, start: float,
             stop: float) -> Run | None:
        time = start + STEP * np.arange(int((stop - start) / STEP))
        inputs = np.tile(self.idle_inputs, (time.size, 1))
        for i, variable in enumerate(self._plant.inputs):
            if variable.name in manoeuvre:
                inputs[:, i] = manoeuvre[variable.name].at(time)
        columns = [variable.name for variable in self._plant.inputs]
        gear = int(inputs[0, columns.index("gear")]) if "gear" in manoeuvre else manoeuvre.gear
        if gear is None:
            gear = self._gear(manoeuvre, start, stop)
        inputs[:, columns.index("gear")] = gear
        speed = self._start_speed(manoeuvre, gear, start)
        if gear < 1 or not speed > 1.0:
            return None
        clocks, measured = {}, {}
        for channel_name in present:
            channel = manoeuvre[channel_name]
            inside = np.flatnonzero((channel.time >= start + SETTLE) & (channel.time <= time[-1]))
            if inside.size < 10:
                continue
            rate = (inside.size - 1) / max(np.ptp(channel.time[inside]), 1e-9)
            inside = inside[::max(1, round(rate / _RATE))]
            clocks[channel_name], measured[channel_name] = channel.time[inside], channel.values[inside]
        return Run(name, manoeuvre.kind, gear, start, inputs, speed, clocks, measured)

    def _overall(self, gear: int) -> float:
        return self.values["final_drive.ratio"] * self.values[f"transmission.ratio[{gear + 2}]"]

    def _gear(self, manoeuvre: Manoeuvre, start: float, stop: float) -> int:
        """The gear whose ratio the measured speeds have."""
        times = np.linspace(start, stop, 200)
        over = next((name for name in ("turbine_speed", "engine_speed") if name in manoeuvre), None)
        if over is None or not ("wheel_speed" in manoeuvre or "vehicle_speed" in manoeuvre):
            raise InputError(f"manoeuvre '{manoeuvre.name}': neither a gear nor the speeds that show it; write "
                             "gear = N in its [[manoeuvre]]")
        wheel = (manoeuvre["wheel_speed"].at(times) if "wheel_speed" in manoeuvre
                 else manoeuvre["vehicle_speed"].at(times) / self.values["tyre.radius"])
        ratio = float(np.median(manoeuvre[over].at(times) / np.maximum(wheel, 0.1)))
        gears = {g: abs(np.log(self._overall(g) / ratio)) for g in range(1, 11)
                 if self.values.get(f"transmission.ratio[{g + 2}]", 0.0) > 0.0}
        best = min(gears, key=gears.__getitem__)
        log.info("%s: the speeds say gear %d", manoeuvre.name, best)
        return best

    def _start_speed(self, manoeuvre: Manoeuvre, gear: int, start: float) -> float:
        """Vehicle speed at the start from the first second of the best channel there is [m/s]."""
        radius = self.values["tyre.radius"]
        ratio = self._overall(gear) if f"transmission.ratio[{gear + 2}]" in self.values else 0.0
        for name, factor in (("vehicle_speed", 1.0), ("wheel_speed", radius),
                             ("transmission_output_speed", radius / self.values["final_drive.ratio"]),
                             ("turbine_speed", radius / ratio if ratio else 0.0),
                             ("engine_speed", radius / ratio if ratio else 0.0)):
            if name in manoeuvre:
                channel = manoeuvre[name]
                first = (channel.time >= start) & (channel.time <= start + 0.6)
                if first.sum() < 2:
                    continue
                slope, level = np.polyfit(channel.time[first] - start, channel.values[first], 1)
                return float(level * factor)
        return 0.0
