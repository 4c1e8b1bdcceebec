"""The full-order plant as a car on the road with the instruments of a test car."""

from __future__ import annotations

import dataclasses
import itertools
import logging
from collections.abc import Mapping, Sequence

import numpy as np

from cosim.diagnosis.plants.base import SHORTEST, InstrumentedPlant, Stretches, compared
from cosim.diagnosis.plants.calm import calm_parts, pauses
from cosim.diagnosis.plants.frozen import frozen
from cosim.diagnosis.plants.gaps import gaps
from cosim.diagnosis.plants.gearing import Gearing, coupled
from cosim.diagnosis.plants.held import updates
from cosim.diagnosis.plants.led import ANCHORS, PLACES, LedPlant, anchors_of, leading
from cosim.diagnosis.plants.observation import CHANNELS, Errors
from cosim.diagnosis.plants.ripple import beyond_samples, swing
from cosim.diagnosis.plants.run import STEP, Nuisance, Run
from cosim.measured import Channel, Manoeuvre, Measurement
from driveline.quantities import InputError

log = logging.getLogger("cosim")

SETTLE = 0.3  # what is not compared after the start [s]: the plant starts rolling steadily, the car need not
LONGEST = 15.0  # a longer recording is cut [s]: start speed and grade are constant within a run
RUNS = 6  # at most so many stretches of one long recording
_MOVES = 0.5  # of what the torque moves by in its liveliest part: where it moves by less the manoeuvre is not driven
_IMPULSE = 0.1  # N.m.s: a gap in which less may have been lost is no more than the torque wanders by
_GAPS = 6  # of a run that are estimated; a slow logger has one after the other, and each takes simulations
_WALKING = 1.0  # m/s
# Speeds that are 0 where the car stands; that of the turbine only in gear.
_STANDING = ("turbine_speed", "transmission_output_speed", "wheel_speed", "vehicle_speed")


class FullOrderCar(InstrumentedPlant):
    """The full-order plant with the instruments of a test car."""

    name = "plant_fom"
    plant = LedPlant
    driver = "engine_torque"
    channels = CHANNELS

    def _named(self, table: np.ndarray) -> dict[str, np.ndarray]:
        """Outputs by name; the differential's acceleration as an accelerometer shows it, a mean over two steps.

        An impact is shorter than a step: of the acceleration itself a step shows it or does not, by chance.
        """
        found = super()._named(table)
        speed = self._plant["differential_case.lever_arm"] * found["differential_speed"]
        return found | {"differential_acceleration": np.gradient(speed, STEP)}

    def _start(self, run: Run, nuisance: Nuisance) -> None:
        self._plant["start.vehicle_speed"] = run.start_speed + nuisance.start_speed

    def _arriving(self, drive: np.ndarray) -> np.ndarray:
        """Delayed already, by the mean over every step: in the plant what arrives within a step cuts it in two.

        All delays begin alike then, too.
        """
        delay, steps = self._plant["engine.air_delay"], np.arange(len(drive))
        if delay <= 0.0:  # earlier than asked for: the plant refuses that
            return drive
        self._plant["engine.air_delay"] = 0.0
        return np.interp(steps - delay / STEP, steps, drive)

    def _attached(self) -> tuple:
        return self._plant.led, self._plant.pushed

    def pushed(self, values: Mapping[str, float], run: Run, nuisance: Nuisance, place: str,
               push: np.ndarray) -> dict[str, np.ndarray]:
        """As ``raw``, with a torque, force or twist at every step, in the unit of its place of ``PLACES``."""
        self._plant.pushed = place
        try:
            inputs = self._prepared(values, run, nuisance, 0.0)
            inputs[:, self.columns["push"]] = np.gradient(push, STEP) if PLACES[place].turned else push
            return self._simulated(inputs, run)
        finally:
            self._plant.pushed = ""

    def _anchor(self, inputs: np.ndarray, values: Mapping[str, float], run: Run) -> None:
        """What leads the plant, as it was before its sensor was late; where frames are lost nothing does."""
        self._plant.led = tuple(run.anchors)
        for name, shown in run.anchors.items():
            along, leads = leading(shown, Errors.of(name, values), run.start, len(inputs))
            inputs[:, self.columns[f"led_{name}"]] = along
            # it starts led, as the equilibrium there and what is asked of it are
            inputs[1:, self.columns[f"leads_{name}"]] = leads[1:]

    def _prepared(self, values: Mapping[str, float], run: Run, nuisance: Nuisance,
                  torque: np.ndarray | float) -> np.ndarray:
        """As the base's; the engine speed that leads swings with the ripple, not with what its samples make of that."""
        inputs = super()._prepared(values, run, nuisance, torque)
        if "engine_speed" in run.anchors and values["torque_ripple.amplitude"] > 0.0:
            anchor, lead = ANCHORS["engine_speed"], inputs[:, self.columns["led_engine_speed"]]
            swings = swing(self._plant, "led_engine_speed", anchor.node, anchor.gain, lead)
            lead += beyond_samples(swings, run.time - 0.5 * STEP, run.anchors["engine_speed"],
                                   Errors.of("engine_speed", values))
        return inputs

    def runs(self, measurement: Measurement) -> list[Run]:
        """The manoeuvres of a measurement; of long ones the liveliest stretches of one gear.

        Raises:
            InputError: The engine torque or every output is missing, or the gear cannot be told.
        """
        return self.stretches(measurement).runs

    def stretches(self, measurement: Measurement) -> Stretches:
        # loggers drift from when they began, and that is when their clocks were set
        cut = [self._cut(manoeuvre.from_zero()) for manoeuvre in measurement.manoeuvres]
        for manoeuvre, parts in zip(measurement.manoeuvres, cut):
            if manoeuvre.gear is None and "gear" not in manoeuvre:
                for run in itertools.chain(parts.runs, parts.further):
                    log.info("%s: the speeds say gear %d", run.name, run.gear)
        found = Stretches(*(list(itertools.chain(*parts)) for parts in zip(*cut)))
        if not found.runs:
            raise InputError(f"measurement '{measurement.name}': no stretch of at least {SHORTEST:g} s in one forward "
                             "gear above walking pace in which anything changes, so there is nothing to compare"
                             + "".join(f"; {why}" for why in found.left_out))
        return found

    def _cut(self, manoeuvre: Manoeuvre) -> Stretches:
        """Its liveliest stretches and the others, each in order of time."""
        self._driven(manoeuvre)
        dead = self._dead(manoeuvre)
        left_out = [f"{manoeuvre.name}: {name} always reads {manoeuvre[name].values[0]:g}, so it is left out"
                    for name in dead]
        manoeuvre = self.updated(manoeuvre.without(dead))
        present = [name for name in self.channels if name in manoeuvre]
        if not any(name.endswith("speed") for name in present):
            raise InputError(f"manoeuvre '{manoeuvre.name}' has no speed: at least one of "
                             f"{', '.join(self.channels[:5])} is needed" + "".join(f"; {why}" for why in left_out))
        self._check_forward(manoeuvre)
        start, stop = self._span(manoeuvre)
        manoeuvre = self._alive(manoeuvre)
        silent = pauses(manoeuvre[self.driver], start, stop)
        whole = stop - start <= LONGEST and not silent and "gear" not in manoeuvre and manoeuvre.kind != "drive"
        spans = [(start, stop, None)] if whole else self._spans(manoeuvre, start, stop)
        runs: list[Run] = []
        lost: dict[str, list[str]] = {}
        for i, (begin, end, gear) in enumerate(spans, start=1):
            name = manoeuvre.name if len(spans) == 1 else f"{manoeuvre.name}_{i}"
            run = self._run(manoeuvre, present, name, begin, end, gear)
            if isinstance(run, Run):
                runs.append(run)
            elif manoeuvre.kind != "drive":  # in which the car stands now and then
                lost.setdefault(run, []).append(f"{begin:.3g} to {end:.3g} s")
        if silent:
            lost[f"{self.driver} was not recorded"] = [f"{begin:.3g} to {end:.3g} s" for begin, end in silent]
        left_out += [f"{manoeuvre.name}: nothing is compared from {' and '.join(times)}: {why}"
                     for why, times in lost.items()]
        most = max((run.swing for run in runs), default=0.0)
        runs = [run if manoeuvre.kind == "drive" or run.swing >= _MOVES * most else dataclasses.replace(run, kind="")
                for run in runs]
        lively = sorted(runs, key=lambda run: -float(np.std(run.inputs[:, 0])))
        chosen, others = (sorted(some, key=lambda run: run.start) for some in (lively[:RUNS], lively[RUNS:]))
        return Stretches(chosen, others, left_out)

    def _dead(self, manoeuvre: Manoeuvre) -> list[str]:
        """What always reads the same: such a sensor was not there. But where the engine turns, and no speed behind it
        ever reads anything else than 0, and there are several, the car stands."""
        still = [name for name in self.channels if name in manoeuvre and np.ptp(manoeuvre[name].values) == 0.0]
        zero = [name for name in still if name in _STANDING and manoeuvre[name].values[0] == 0.0]
        rolls = any(name in manoeuvre and name not in zero for name in _STANDING if name != "turbine_speed")
        idles = "engine_speed" in manoeuvre and "engine_speed" not in still
        return [name for name in still if name not in zero or rolls or len(zero) < 2 or not idles]

    def updated(self, manoeuvre: Manoeuvre) -> Manoeuvre:
        """The same with the samples that were measured of channels that were held in between."""
        held = {name: _where(manoeuvre[name], places) for name in (*self.channels, self.driver) if name in manoeuvre
                and (places := updates(manoeuvre[name].values, stays=name == self.driver)) is not None}
        return dataclasses.replace(manoeuvre, channels={**manoeuvre.channels, **held}) if held else manoeuvre

    def hanging(self, manoeuvre: Manoeuvre) -> dict[str, Channel]:
        """Of every channel that reads the same number again and again, which no sensor does that measures, the samples
        that do."""
        manoeuvre = self.updated(manoeuvre)
        return {name: of for name in self.channels if name in manoeuvre
                and (of := _where(manoeuvre[name], frozen(manoeuvre[name].values))).time.size}

    def _alive(self, manoeuvre: Manoeuvre) -> Manoeuvre:
        """The same without these samples."""
        alive = {name: _where(manoeuvre[name], ~np.isin(manoeuvre[name].time, hanging.time))
                 for name, hanging in self.hanging(manoeuvre).items()}
        return dataclasses.replace(manoeuvre, channels={**manoeuvre.channels, **alive}) if alive else manoeuvre

    def whole(self, manoeuvre: Manoeuvre) -> Run | None:
        """A recording from the first to the last of its torque, whatever else is there then, led by nothing.

        None of a drive, or through several gears, or with a pause in which nobody knows what drove.
        """
        manoeuvre = manoeuvre.from_zero()
        manoeuvre = self.updated(manoeuvre.without(self._dead(manoeuvre)))
        if manoeuvre.kind == "drive" or "gear" in manoeuvre and np.ptp(manoeuvre["gear"].values) > 0.0:
            return None
        present, time = [name for name in self.channels if name in manoeuvre], manoeuvre[self.driver].time
        if np.diff(time).max(initial=0.0) > LONGEST:
            return None
        run = self._run(manoeuvre, present, manoeuvre.name, float(time[0]), float(time[-1]))
        return run.free if isinstance(run, Run) else None

    def _check_forward(self, manoeuvre: Manoeuvre) -> None:
        """Raise InputError where a speed is negative most of the time: only driving forward is looked at."""
        for name in self.channels:
            if name.endswith("speed") and name in manoeuvre and np.median(manoeuvre[name].values) < 0.0:
                raise InputError(f"manoeuvre '{manoeuvre.name}': {name} is negative most of the time, and only driving "
                                 "forward is looked at: is its sign right?")

    def _spans(self, manoeuvre: Manoeuvre, start: float, stop: float) -> list[tuple[float, float, int | None]]:
        """Stretches of constant gear, none with a pause or longer than ``LONGEST``; the gear as ``Gearing.parts``."""
        spans, driver = [], manoeuvre[self.driver]
        for begin, end, gear in self.gearing.parts(manoeuvre, start, stop):
            # what a shift shakes up rings down first; the clutches of the next shift begin before its flag
            begin, end = begin + 0.8 * (begin != start), end - 0.3 * (end != stop)
            for first, last in coupled(manoeuvre, begin, end):
                bounds = [first, *itertools.chain(*pauses(driver, first, last)), last]
                for known in zip(bounds[::2], bounds[1::2]):
                    spans += [(a, b, gear) for a, b in calm_parts(driver, *known, LONGEST) if b - a >= SHORTEST]
        return spans

    def _run(self, manoeuvre: Manoeuvre, present: Sequence[str], name: str, start: float, stop: float,
             gear: int | None = None) -> Run | str:
        """A stretch, in the gear that is told or the manoeuvre has; or, in words, why it is none."""
        inputs, columns = self._inputs(manoeuvre, start, stop), self.columns
        if gear is None:
            gear = int(inputs[0, columns["gear"]]) if "gear" in manoeuvre else manoeuvre.gear
        if gear is None:
            gear = self.gearing.most(manoeuvre, start, stop)
        try:
            self._plant.inputs[columns["gear"]].check(gear)
        except InputError as error:
            raise InputError(f"manoeuvre '{manoeuvre.name}': {error}") from error
        inputs[:, columns["gear"]] = gear
        speed = self._start_speed(manoeuvre, gear, start)
        if gear < 1:
            return "it is in no forward gear"
        if not speed > _WALKING:
            return ("it begins at a standstill or walking pace; where it rolls later, write start = \"... s\" in its "
                    "[[manoeuvre]]")
        clocks, measured = compared(manoeuvre, present, start + SETTLE, start + STEP * (len(inputs) - 1))
        # of what stays one number for as long as this nobody knows how finely it is read
        clocks, measured = ({n: of[n] for n in measured if np.ptp(measured[n]) > 0.0} for of in (clocks, measured))
        if not clocks:
            return "nothing changes"
        # a sensor that is not level shows the same offset either way
        graded = "road_grade" in manoeuvre
        lost = sorted(gaps(manoeuvre[self.driver], start, stop, _IMPULSE), key=lambda gap: -gap.impulse)[:_GAPS]
        return Run(name, manoeuvre.kind, gear, start, inputs, speed, clocks, measured, graded,
                   manoeuvre.back and not graded, anchors_of(manoeuvre), tuple(lost))

    @property
    def gearing(self) -> Gearing:
        """What the speeds have to do with one another."""
        return Gearing.of(self.values)

    def _start_speed(self, manoeuvre: Manoeuvre, gear: int, start: float) -> float:
        """Vehicle speed at the start from the first 0.6 s of the best channel there is [m/s]."""
        known = [(manoeuvre[name], factor) for name, factor in self.gearing.rolling(gear).items() if name in manoeuvre]
        for channel, factor in known:
            first = (channel.time >= start) & (channel.time <= start + 0.6)
            if first.sum() >= 2:
                _, level = np.polyfit(channel.time[first] - start, channel.values[first], 1)
                return float(level * factor)
        return float(known[0][0].at(start) * known[0][1]) if known else 0.0


def _where(channel: Channel, which: np.ndarray) -> Channel:
    """Some samples of a channel."""
    return dataclasses.replace(channel, time=channel.time[which], values=channel.values[which])
