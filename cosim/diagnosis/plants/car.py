"""The full-order plant as a car on the road with the instruments of a test car."""

from __future__ import annotations

import dataclasses
import itertools
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import median_filter

from cosim.diagnosis.plants.base import SHORTEST, InstrumentedPlant, Stretches, compared
from cosim.diagnosis.plants.calm import calm_parts
from cosim.diagnosis.plants.frozen import frozen
from cosim.diagnosis.plants.gaps import gaps, known
from cosim.diagnosis.plants.held import updates
from cosim.diagnosis.plants.observation import CHANNELS, Errors
from cosim.diagnosis.plants.ripple import beyond_samples, swing
from cosim.diagnosis.plants.run import STEP, Nuisance, Run, ends
from cosim.measured import Channel, Manoeuvre, Measurement
from driveline.elements.driveline_parts import in_gear
from driveline.kernels import layout as k
from driveline.plants.assembly import Assembly, Term
from driveline.plants.full_order import FullOrderParameters, FullOrderPlant, input_variable, output_variable
from driveline.quantities import InputError

log = logging.getLogger("cosim")

SETTLE = 0.3  # what is not compared after the start [s]: the plant starts rolling steadily, the car need not
LONGEST = 15.0  # a longer recording is cut [s]: start speed and grade are constant within a run
RUNS = 6  # at most so many stretches of one long recording
_MOVES = 0.5  # of what the torque moves by in its liveliest part: where it moves by less the manoeuvre is not driven
_IMPULSE = 0.1  # N.m.s: a gap in which less may have been lost is no more than the torque wanders by
_GAPS = 6  # of a run that are estimated; a slow logger has one after the other, and each takes simulations
_ENDED = 0.4  # s from its first or last sample: beyond, which no delay of a sensor is, nothing leads along a channel
_WALKING = 1.0  # m/s
_FINE = 0.02  # s: how finely the gear, and whether clutch and brake let it be compared, are looked at in a drive
# By how much the ratio of speeds may be off its gear's, by slip of tyres and clutch, and by how much that of all gears,
# by what a vehicle file may have wrong; the closest gears are 8 % apart.
_IN_GEAR, _COMMON = 0.04, 0.08
LOCKED = 8.0  # rad/s: a lock-up clutch that is closed slips less, by its control, through a step of torque too

# Outputs of the plant that are computed: what sensors show (of an accelerometer, what it is made of), and the torques
# that shafts twist by and that the engine gives.
_COMPUTED = {*CHANNELS, "axle_shaft_torque", "crankshaft_torque"} - {"differential_acceleration"}


@dataclass(frozen=True)
class Anchor:
    """How a simulation is led along a channel: a torque or force in proportion to what it differs.

    Attributes:
        node: On which it acts.
        unit: Of the channel.
        gain: Torque or force over difference [N.m.s/rad or N.s/m].
    """

    node: str
    unit: str
    gain: float


# A driveline left to itself forgets nothing: a newton metre while the lash is crossed gently, and all that follows
# comes earlier or later. Led along the speeds of its two large inertias, as an observer is, it forgets within
# some tenths of a second, and what is left to compare is news. Strong enough that the engine in the lash (0.5 kg.m2)
# keeps to the measured speed, weak enough that a wrong mass or torque still shows, and that noise in what leads it is
# small beside that of the channels it moves: at 4 kN.s/m the vehicle speed's was a third of the seat's acceleration,
# slow enough to be taken for parameters.
ANCHORS = {"engine_speed": Anchor("crankshaft", "rad/s", 6.0), "vehicle_speed": Anchor("vehicle", "m/s", 1000.0)}


@dataclass(frozen=True)
class Place:
    """Where a torque may be missing, or a twist.

    Attributes:
        balance: The torque balance it is told as.
        nodes: What share of it acts on which: on one end alone it comes from without; what acts on both ends of a
            shaft against one another is wrong within it.
        size: What moves the channels by about their noise, in its unit.
        unit: Of what is missing.
        turned: The lash that turns by as much, where it is no torque that is missing but a twist.
    """

    balance: str
    nodes: Mapping[str, float]
    size: float
    unit: str = "N.m"
    turned: str = ""

    @property
    def shaft(self) -> bool:
        """Whether it is a torque within a shaft."""
        return any(share < 0.0 for share in self.nodes.values())


# Within the propeller shaft or the tyres would do the same to all speeds: one after the other, they twist alike. What
# a torque within the transmission does depends on which flank its teeth are; what turns the gears, as a housing that
# rolls on its mounts, does it on either.
PLACES = {
    "engine": Place("engine", {"crankshaft": 1.0}, 4.0),
    "transmission": Place("transmission", {"transmission_output": 1.0}, 6.0),
    "within the transmission": Place("transmission", {}, 0.002, "rad", turned="transmission"),
    "propeller shaft": Place("propeller shaft", {"pinion": 1.0}, 6.0),
    "axle": Place("axle", {"differential": 1.0}, 20.0),
    "within the axle shafts": Place("axle", {"differential": -1.0, "left_hub": 0.5, "right_hub": 0.5}, 20.0),
    "wheel": Place("wheel", {"left_hub": 0.5, "right_hub": 0.5}, 20.0),
    "vehicle": Place("vehicle", {"vehicle": 1.0}, 60.0, "N"),
}


class LedPlant(FullOrderPlant):
    """The full-order plant, led along measured speeds where ``led`` names them, pushed at the place ``pushed``."""

    inputs = (*FullOrderPlant.inputs,
              *(input_variable(f"led_{name}", anchor.unit, f"measured {name.replace('_', ' ')}")
                for name, anchor in ANCHORS.items()),
              *(input_variable(f"leads_{name}", "1", f"1 where the measured {name.replace('_', ' ')} is known, else 0",
                               start=1.0) for name in ANCHORS),
              input_variable("push", "N.m", "disturbance torque; force [N] on the vehicle, turning [rad/s] of a lash"))
    output_variables = (*(v for v in FullOrderPlant.output_variables if v.name in _COMPUTED),
                        output_variable("differential_speed", "rad/s", "pitch rate of the axle housing"))
    led: tuple[str, ...] = ()
    pushed: str = ""

    def possible_gears(self) -> list[int | None]:
        return [None]  # a run has one gear, and a diagnosis simulates thousands

    def attach(self, net: Assembly, p: FullOrderParameters) -> None:
        """The forces that lead it, and what an accelerometer needs; the test car has other sensors."""
        net.outputs = {name: terms for name, terms in net.outputs.items() if name in _COMPUTED}
        net.output("differential_speed", Term(k.SPEED, list(net.nodes).index("differential_case")))
        for name in self.led:
            anchor = ANCHORS[name]
            node = list(net.nodes).index(anchor.node)
            net.leading(f"led_{name}", node, anchor.gain, net.signal(f"led_{name}"), net.signal(f"leads_{name}"))
        if not self.pushed:
            return
        place = PLACES[self.pushed]
        for name, share in place.nodes.items():
            net.source(f"push_{name}", list(net.nodes).index(name), share, net.signal("push"))
        if place.turned:
            net.turned(place.turned, net.signal("push"))


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
            along, leads = _leading(shown, Errors.of(name, values), run.start, len(inputs))
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
        whole = stop - start <= LONGEST and "gear" not in manoeuvre and manoeuvre.kind != "drive"
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
        left_out += [f"{manoeuvre.name}: nothing is compared from {' and '.join(times)}: {why}"
                     for why, times in lost.items()]
        most = max((_moves(run) for run in runs), default=0.0)
        runs = [run if manoeuvre.kind == "drive" or _moves(run) >= _MOVES * most else dataclasses.replace(run, kind="")
                for run in runs]
        lively = sorted(runs, key=lambda run: -float(np.std(run.inputs[:, 0])))
        chosen, others = (sorted(some, key=lambda run: run.start) for some in (lively[:RUNS], lively[RUNS:]))
        return Stretches(chosen, others, left_out)

    def _dead(self, manoeuvre: Manoeuvre) -> list[str]:
        """What always reads the same: such a sensor was not there."""
        return [name for name in self.channels if name in manoeuvre and np.ptp(manoeuvre[name].values) == 0.0]

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

    def _in_gear(self, manoeuvre: Manoeuvre, start: float, stop: float) -> list[tuple[float, float, int | None]]:
        """Parts of one gear each, and which where the speeds tell it: of a drive where nobody else does.

        Raises:
            InputError: The speeds have the ratio of no gear.
        """
        if "gear" in manoeuvre:
            gear = manoeuvre["gear"]
            change = np.flatnonzero(np.diff(gear.values)) + 1
            inside = (gear.time[change] > start) & (gear.time[change] < stop)
            edges = [start, *gear.time[change][inside].tolist(), stop]
            return [(begin, end, None) for begin, end in zip(edges, edges[1:])]
        if manoeuvre.kind != "drive" or manoeuvre.gear is not None:
            return [(start, stop, None)]
        times = np.arange(start, stop, _FINE)
        ratios = self._ratio(manoeuvre, times)
        gears = self._gears_at(ratios)
        if not gears.any():
            known = ", ".join(f"{self.values['final_drive.ratio'] * ratio:.3g}" for ratio in self.gears.values())
            raise InputError(f"manoeuvre '{manoeuvre.name}': before the gears it turns {np.median(ratios):.3g} times "
                             f"as fast as the wheels, in gear {known} times: write gear = N in its [[manoeuvre]]")
        edges = np.flatnonzero(np.diff(gears, prepend=-1, append=-1))
        ends = [*times.tolist(), stop]
        return [(ends[a], ends[b], int(gears[a])) for a, b in zip(edges, edges[1:]) if gears[a]]

    def _spans(self, manoeuvre: Manoeuvre, start: float, stop: float) -> list[tuple[float, float, int | None]]:
        """Stretches of constant gear, none longer than ``LONGEST``, with the gear as ``_in_gear``."""
        spans = []
        for begin, end, gear in self._in_gear(manoeuvre, start, stop):
            # what a shift shakes up rings down first; the clutches of the next shift begin before its flag
            begin, end = begin + 0.8 * (begin != start), end - 0.3 * (end != stop)
            for first, last in _coupled(manoeuvre, begin, end):
                spans += [(a, b, gear) for a, b in calm_parts(manoeuvre[self.driver], first, last, LONGEST)
                          if b - a >= SHORTEST]
        return spans

    def _run(self, manoeuvre: Manoeuvre, present: Sequence[str], name: str, start: float, stop: float,
             gear: int | None = None) -> Run | str:
        """A stretch, in the gear that is told or the manoeuvre has; or, in words, why it is none."""
        inputs, columns = self._inputs(manoeuvre, start, stop), self.columns
        if gear is None:
            gear = int(inputs[0, columns["gear"]]) if "gear" in manoeuvre else manoeuvre.gear
        if gear is None:
            gear = self._gear(manoeuvre, start, stop)
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
                   manoeuvre.back and not graded, _anchors(manoeuvre), tuple(lost))

    @property
    def gears(self) -> dict[int, float]:
        """Ratio of every forward gear there is."""
        return {gear: ratio for gear in range(1, 11)
                if (ratio := self.values.get(in_gear("ratio", gear), 0.0)) > 0.0}

    def gear_of(self, ratio: float) -> int:
        """The gear in which the turbine turns most nearly so many times as fast as the wheels."""
        gears, final = self.gears, self.values["final_drive.ratio"]
        return min(gears, key=lambda gear: abs(np.log(final * gears[gear] / max(ratio, 1e-3))))

    def rolling(self, gear: int) -> dict[str, float]:
        """The vehicle's speed [m/s] over every other, without slip; the nearest to it first.

        Args:
            gear: Engaged; what turns before the gears is left out where that is no forward gear of the vehicle.
        """
        radius, final = self.values["tyre.radius"], self.values["final_drive.ratio"]
        behind = {"vehicle_speed": 1.0, "wheel_speed": radius, "transmission_output_speed": radius / final}
        ratio = self.gears.get(gear)
        return behind | (dict.fromkeys(("turbine_speed", "engine_speed"), radius / (final * ratio)) if ratio else {})

    def _gear(self, manoeuvre: Manoeuvre, start: float, stop: float) -> int:
        """The gear whose ratio the measured speeds have."""
        return self.gear_of(float(np.median(self._ratio(manoeuvre, np.linspace(start, stop, 200)))))

    def _gears_at(self, ratios: np.ndarray) -> np.ndarray:
        """The gear at every instant of a drive by its ratios; 0 where it is none, as in a shift.

        By their median over a second, which a lash that is crossed does not reach, and less what all have in common:
        a radius or a ratio that is not the file's.
        """
        gears = np.array(sorted(self.gears))
        known = np.log([self.values["final_drive.ratio"] * self.gears[gear] for gear in gears])
        seen = np.log(np.maximum(median_filter(ratios, round(1.0 / _FINE) + 1, mode="nearest"), 1e-3))
        nearest = np.abs(seen[:, None] - known).argmin(axis=1)
        common = float(np.median(seen - known[nearest]))
        if abs(common) < _COMMON:
            seen = seen - common
        off = np.abs(seen[:, None] - known)
        return np.where(off.min(axis=1) < _IN_GEAR, gears[off.argmin(axis=1)], 0)

    def _ratio(self, manoeuvre: Manoeuvre, times: np.ndarray) -> np.ndarray:
        """How many times as fast as the wheels the turbine turns, or the engine where nobody recorded it."""
        over = next((name for name in ("turbine_speed", "engine_speed") if name in manoeuvre), None)
        if over is None or not ("wheel_speed" in manoeuvre or "vehicle_speed" in manoeuvre):
            raise InputError(f"manoeuvre '{manoeuvre.name}': neither a gear nor the speeds that show it; write "
                             "gear = N in its [[manoeuvre]]")
        wheel = (manoeuvre["wheel_speed"].at(times) if "wheel_speed" in manoeuvre
                 else manoeuvre["vehicle_speed"].at(times) / self.values["tyre.radius"])
        return manoeuvre[over].at(times) / np.maximum(wheel, 0.1)

    def _start_speed(self, manoeuvre: Manoeuvre, gear: int, start: float) -> float:
        """Vehicle speed at the start from the first second of the best channel there is [m/s]."""
        known = [(manoeuvre[name], factor) for name, factor in self.rolling(gear).items() if name in manoeuvre]
        for channel, factor in known:
            first = (channel.time >= start) & (channel.time <= start + 0.6)
            if first.sum() >= 2:
                _, level = np.polyfit(channel.time[first] - start, channel.values[first], 1)
                return float(level * factor)
        return float(known[0][0].at(start) * known[0][1]) if known else 0.0


def led_by(run: Run, raw: Mapping[str, np.ndarray]) -> Run:
    """A run led along what a simulation shows, as if that had been measured, by sensors without errors."""
    return dataclasses.replace(run, gaps=(), anchors={name: CubicSpline(run.time, raw[name]) for name in ANCHORS
                                                      if name in run.clocks})


def _moves(run: Run) -> float:
    """By how much what drives a run moves [N.m]."""
    return float(np.ptp(run.inputs[:, 0]))


def _where(channel: Channel, which: np.ndarray) -> Channel:
    """Some samples of a channel."""
    return dataclasses.replace(channel, time=channel.time[which], values=channel.values[which])


@lru_cache(maxsize=64)  # most of what is varied does nothing to a sensor that leads
def _leading(shown: CubicSpline, errors: Errors, start: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """What a channel was at every step before its sensor erred, and whether it is known there."""
    stamps = errors.stamps(ends(start, steps) - 0.5 * STEP)
    inside = np.clip(stamps, shown.x[0], shown.x[-1])
    there = known(shown.x, inside) & (np.abs(stamps - inside) < _ENDED)
    return (shown(inside) - errors.offset) / errors.gain, there


def _anchors(manoeuvre: Manoeuvre) -> dict[str, CubicSpline]:
    """The channel at either end of the driveline, as far as there is one."""
    return {name: CubicSpline(manoeuvre[name].time, manoeuvre[name].values) for name in ANCHORS if name in manoeuvre}


def _coupled(manoeuvre: Manoeuvre, begin: float, end: float) -> list[tuple[float, float]]:
    """Parts of a drive with the lock-up clutch closed and the brakes released, as far as that was recorded.

    Of a drive nobody knows what the converter was told, and what a brake pedal does to undriven wheels is no
    business of the driveline. All other manoeuvres are taken whole: a clutch that slips there is a finding.
    """
    if manoeuvre.kind != "drive":
        return [(begin, end)]
    times = np.arange(begin, end, _FINE)
    good = np.ones(times.size, dtype=bool)
    if "engine_speed" in manoeuvre and "turbine_speed" in manoeuvre:
        good &= np.abs(manoeuvre["engine_speed"].at(times) - manoeuvre["turbine_speed"].at(times)) < LOCKED
    if "brake_torque" in manoeuvre:
        good &= manoeuvre["brake_torque"].at(times) < 1.0
    change = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
    # the last half a second of an opening clutch and the first of a closed one are neither
    return [(float(times[a]) + 0.5 * (a > 0), float(times[b - 1]) - 0.5 * (b < times.size))
            for a, b in zip(change[::2], change[1::2])]
