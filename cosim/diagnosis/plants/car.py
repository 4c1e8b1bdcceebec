"""The full-order plant as a car on the road with the instruments of a test car."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence

import numpy as np

from cosim.diagnosis.plants.base import InstrumentedPlant, compared
from cosim.diagnosis.plants.run import STEP, Nuisance, Run
from cosim.measured import Manoeuvre, Measurement
from driveline.plants.full_order import FullOrderPlant
from driveline.quantities import InputError

log = logging.getLogger("cosim")

SETTLE = 0.3  # what is not compared after the start [s]: the plant starts rolling steadily, the car need not
LONGEST = 15.0  # a longer recording is cut [s]: start speed and grade are constant within a run
RUNS = 6  # at most so many stretches of one long recording
LOCKED = 8.0  # rad/s: a lock-up clutch that is closed slips less, by its control, through a step of torque too


class FullOrderCar(InstrumentedPlant):
    """The full-order plant with the instruments of a test car."""

    name = "plant_fom"
    plant = FullOrderPlant
    driver = "engine_torque"
    channels = ("engine_speed", "turbine_speed", "transmission_output_speed", "wheel_speed", "vehicle_speed",
                "propeller_shaft_torque", "seat_acceleration", "differential_acceleration")

    def _start(self, run: Run, nuisance: Nuisance) -> None:
        self._plant["start.vehicle_speed"] = run.start_speed + nuisance.start_speed

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
        self._driven(manoeuvre)
        present = [name for name in self.channels if name in manoeuvre]
        if not any(name.endswith("speed") for name in present):
            raise InputError(f"manoeuvre '{manoeuvre.name}' has no speed: at least one of "
                             f"{', '.join(self.channels[:5])} is needed")
        start, stop = self._span(manoeuvre)
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
            for first, last in _coupled(manoeuvre, begin, end):
                count = max(1, int(np.ceil((last - first) / LONGEST)))
                bounds = np.linspace(first, last, count + 1)
                spans += [(float(a), float(b)) for a, b in zip(bounds, bounds[1:]) if b - a >= 2.0]
        return spans

    def _run(self, manoeuvre: Manoeuvre, present: Sequence[str], name: str, start: float,
             stop: float) -> Run | None:
        inputs, columns = self._inputs(manoeuvre, start, stop), self.columns
        gear = int(inputs[0, columns["gear"]]) if "gear" in manoeuvre else manoeuvre.gear
        if gear is None:
            gear = self._gear(manoeuvre, start, stop)
        inputs[:, columns["gear"]] = gear
        speed = self._start_speed(manoeuvre, gear, start)
        if gear < 1 or not speed > 1.0:
            return None
        clocks, measured = compared(manoeuvre, present, start + SETTLE, start + STEP * (len(inputs) - 1))
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


def _coupled(manoeuvre: Manoeuvre, begin: float, end: float) -> list[tuple[float, float]]:
    """Parts of a drive with the lock-up clutch closed and the brakes released, as far as that was recorded.

    Of a drive nobody knows what the converter was told, and what a brake pedal does to undriven wheels is no
    business of the driveline. All other manoeuvres are taken whole: a clutch that slips there is a finding.
    """
    if manoeuvre.kind != "drive":
        return [(begin, end)]
    times = np.arange(begin, end, 0.02)
    good = np.ones(times.size, dtype=bool)
    if "engine_speed" in manoeuvre and "turbine_speed" in manoeuvre:
        good &= np.abs(manoeuvre["engine_speed"].at(times) - manoeuvre["turbine_speed"].at(times)) < LOCKED
    if "brake_torque" in manoeuvre:
        good &= manoeuvre["brake_torque"].at(times) < 1.0
    change = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
    # the last half a second of an opening clutch and the first of a closed one are neither
    return [(float(times[a]) + 0.5 * (a > 0), float(times[b - 1]) - 0.5 * (b < times.size))
            for a, b in zip(change[::2], change[1::2])]
