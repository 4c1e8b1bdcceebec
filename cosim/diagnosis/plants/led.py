"""The full-order plant led along measured speeds, and pushed where a torque may be missing."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from cosim.diagnosis.plants.gaps import known
from cosim.diagnosis.plants.observation import CHANNELS, Errors
from cosim.diagnosis.plants.run import STEP, Run, ends
from cosim.measured import Manoeuvre
from driveline.kernels import layout as k
from driveline.plants.assembly import Assembly, Term
from driveline.plants.full_order import FullOrderParameters, FullOrderPlant, input_variable, output_variable

_ENDED = 0.4  # s from its first or last sample: beyond, which no delay of a sensor is, nothing leads along a channel

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


def led_by(run: Run, raw: Mapping[str, np.ndarray]) -> Run:
    """A run led along what a simulation shows, as if that had been measured, by sensors without errors."""
    return dataclasses.replace(run, gaps=(), anchors={name: CubicSpline(run.time, raw[name]) for name in ANCHORS
                                                      if name in run.clocks})


@lru_cache(maxsize=64)  # most of what is varied does nothing to a sensor that leads
def leading(shown: CubicSpline, errors: Errors, start: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """What a channel was at every step before its sensor erred, and whether it is known there."""
    stamps = errors.stamps(ends(start, steps) - 0.5 * STEP)
    inside = np.clip(stamps, shown.x[0], shown.x[-1])
    there = known(shown.x, inside) & (np.abs(stamps - inside) < _ENDED)
    return (shown(inside) - errors.offset) / errors.gain, there


def anchors_of(manoeuvre: Manoeuvre) -> dict[str, CubicSpline]:
    """The channel at either end of the driveline, as far as there is one."""
    return {name: CubicSpline(manoeuvre[name].time, manoeuvre[name].values) for name in ANCHORS if name in manoeuvre}
