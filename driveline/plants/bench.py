"""Small plants from the same elements: a dynamometer's motor and load, and a carriage on a guide.

    motor - shaft with inline torque sensor - load
    drive force - carriage - guide

Their parameters bear the names of the full-order plant where the meaning is the same, so that whatever is
said of a vehicle's inertia, shaft or drag holds for theirs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..elements.asymmetric_friction import DirectionalDrag
from ..elements.coulomb_drag import CoulombDrag
from ..elements.motor import LinearDrive, Motor
from ..elements.shaft import Shaft
from ..kernels import layout as k
from ..quantities import quantity
from .assembly import GROUND, Assembly, Network, Term
from .full_order import Solver, input_variable, output_variable
from .plant import Plant


@dataclass(frozen=True)
class Load:
    """What turns behind the inline sensor, as the hub of a wheel does."""

    inertia: float = quantity("kg.m2", "what turns behind the inline sensor", minimum=1e-9, nominal=1e-4)


@dataclass(frozen=True)
class MotorBearing:
    """The bearings and seals of the motor."""

    friction: float = quantity("N.m", "dry friction of the motor's bearings and seals", start=0.0, minimum=0.0)
    damping: float = quantity("N.m.s/rad", "viscous friction of the motor's bearings", start=0.0, minimum=0.0)


@dataclass(frozen=True)
class LoadBearing:
    """The bearings of what turns behind the inline sensor; their dry friction is the ``coulomb_drag``."""

    damping: float = quantity("N.m.s/rad", "viscous friction of the load's bearings", start=0.0, minimum=0.0)


@dataclass(frozen=True)
class BenchStart:
    """State at the start: turning at this speed, the shaft without twist."""

    motor_speed: float = quantity("rad/s", "speed of motor and load at the start", start=0.0, nominal=10.0)


@dataclass(frozen=True)
class BenchParameters:
    """Every number of the dynamometer; the tables of its vehicle file bear these names."""

    engine: Motor
    motor_bearing: MotorBearing
    propeller_shaft: Shaft
    hub: Load
    load_bearing: LoadBearing
    coulomb_drag: CoulombDrag
    start: BenchStart
    solver: Solver


@dataclass(frozen=True)
class Carriage:
    """What moves along the guide."""

    mass: float = quantity("kg", "moving mass, with what turns with it", minimum=1e-3, nominal=100.0)


@dataclass(frozen=True)
class Guide:
    """Friction of guide, screw and bearings, referred to the carriage."""

    friction: float = quantity("N", "dry friction", start=0.0, minimum=0.0, nominal=10.0)
    damping: float = quantity("N.s/m", "viscous friction, moving forward", start=0.0, minimum=0.0)


@dataclass(frozen=True)
class CarriageStart:
    """State at the start."""

    speed: float = quantity("m/s", "speed at the start", start=0.0)


@dataclass(frozen=True)
class SingleMassParameters:
    """Every number of the carriage; the tables of its vehicle file bear these names."""

    drive: LinearDrive
    vehicle: Carriage
    guide: Guide
    asymmetric_friction: DirectionalDrag
    start: CarriageStart
    solver: Solver


class SmallPlant(Plant):
    """A plant without gears whose vehicle file holds its parameters under their own names."""

    @classmethod
    def defaults_from(cls, vehicle, gear: int = 0) -> dict[str, float]:
        """Start values from a vehicle file; there are no gears.

        Raises:
            InputError: The file lacks a number, or has one that is no parameter, or out of range.
        """
        vehicle.parameters(cls.Parameters)
        return dict(vehicle.values)

    def coasting(self, speed: np.ndarray) -> np.ndarray:
        """What each node would do if nothing but the input drove it and nothing held it to the others.

        For inverse dynamics: multiplied by its inertia, what is missing to a measured acceleration is the
        torque that must reach the node.

        Args:
            speed: Of all nodes [rad/s or m/s], shape (n,); dry friction slips, also at standstill.

        Returns:
            Accelerations, shape (nodes, n). The model must be initialised; its state does not change.
        """
        net = self.network
        nodes = len(net.nodes)
        rubbing = [net.modes.start + b for b, row in enumerate(self._branch_rows()) if row[k.LAW] == k.FRICTION]
        states = np.tile(self.state[:net.modes.stop], (speed.size, 1))
        states[:, :net.modes.start] = 0.0
        states[:, :nodes] = speed[:, None]
        states[:, rubbing] = np.where(speed < 0.0, -1.0, 1.0)[:, None]
        return self.rates_at(states)[0][:, :nodes].T

    @property
    def inertias(self) -> np.ndarray:
        """Of all nodes [kg.m2 or kg]."""
        start = self.network.plan[k.INERTIA]
        return self.network.constants[start:start + len(self.network.nodes)].copy()


class BenchPlant(SmallPlant):
    """A motor drives a load through a shaft in which an inline sensor measures the torque."""

    name = "plant_bench"
    description = "Dynamometer: motor, shaft with inline torque sensor, load"
    Parameters = BenchParameters
    body = "load"
    inputs = (input_variable("motor_torque", "N.m", "estimated torque of the motor", nominal=1.0),)
    output_variables = (
        output_variable("motor_speed", "rad/s", "speed of the motor", 100.0),
        output_variable("motor_position", "rad", "angle of the motor since the start", 100.0),
        output_variable("load_speed", "rad/s", "speed of the load", 100.0),
        output_variable("inline_torque", "N.m", "torque at the inline sensor", 1.0),
        output_variable("energy_stored", "J", "kinetic and elastic energy in the plant", 1.0),
        output_variable("energy_supplied", "J", "work done on the plant since the start", 1.0),
        output_variable("energy_dissipated", "J", "heat made since the start", 1.0),
    )

    def assemble(self, p: BenchParameters) -> Network:
        """The network of the dynamometer; one line an element."""
        net = Assembly(inputs=tuple(v.name for v in self.inputs))
        motor = net.node("motor", p.engine.inertia, "rad/s", "rotor")
        load = net.node("load", p.hub.inertia, "rad/s", "what turns behind the inline sensor")
        net.integral(motor, "motor_angle", "rad", "angle of the motor since the start")
        net.source("motor_torque", motor, p.engine.torque_gain, k.DELAYED)
        net.source("motor_torque_offset", motor, p.engine.torque_offset, k.ONE)
        net.friction("motor_friction", motor, GROUND, p.motor_bearing.friction, drag=p.motor_bearing.damping)
        shaft = net.shaft("propeller_shaft", motor, load, p.propeller_shaft.stiffness, p.propeller_shaft.damping)
        net.friction("load_friction", load, GROUND, p.coulomb_drag.torque, drag=p.load_bearing.damping)
        net.output("motor_speed", Term(k.SPEED, motor))
        net.output("motor_position", Term(k.LEVEL, net.place("motor_angle")))
        net.output("load_speed", Term(k.SPEED, load))
        net.output("inline_torque", Term(k.TORQUE, shaft))
        return _built(net, p.engine.air_delay, p.solver)

    def start_speeds(self, p: BenchParameters, network: Network) -> tuple[np.ndarray, bool]:
        """Motor and load turn together."""
        return np.full(len(network.nodes), p.start.motor_speed), False


class SingleMassPlant(SmallPlant):
    """A carriage on a guide, driven by a force, against dry and viscous friction."""

    name = "plant_single_mass"
    description = "Carriage on a guide: one mass, dry and viscous friction"
    Parameters = SingleMassParameters
    body = "carriage"
    inputs = (input_variable("force", "N", "estimated force of the drive", nominal=100.0),)
    output_variables = (
        output_variable("position", "m", "position of the carriage since the start", 1.0),
        output_variable("speed", "m/s", "speed of the carriage", 1.0),
        output_variable("energy_stored", "J", "kinetic energy", 1.0),
        output_variable("energy_supplied", "J", "work done by the drive since the start", 1.0),
        output_variable("energy_dissipated", "J", "heat made since the start", 1.0),
    )

    def assemble(self, p: SingleMassParameters) -> Network:
        """The network of the carriage; one line an element."""
        net = Assembly(inputs=tuple(v.name for v in self.inputs))
        carriage = net.node("carriage", p.vehicle.mass, "m/s", "carriage, with what turns with it")
        net.integral(carriage, "carriage_position", "m", "position since the start")
        net.source("force", carriage, p.drive.force_gain, k.DELAYED)
        net.source("force_offset", carriage, p.drive.force_offset, k.ONE)
        net.friction("guide", carriage, GROUND, p.guide.friction, drag=p.guide.damping,
                     backward=p.asymmetric_friction.backward_damping)
        net.output("position", Term(k.LEVEL, net.place("carriage_position")))
        net.output("speed", Term(k.SPEED, carriage))
        return _built(net, p.drive.delay, p.solver)

    def start_speeds(self, p: SingleMassParameters, network: Network) -> tuple[np.ndarray, bool]:
        """As given."""
        return np.array([p.start.speed]), False


def _built(net: Assembly, delay: float, solver: Solver) -> Network:
    """With the energy ledger, the delay of the only input, and the solver's step."""
    net.output("energy_stored", Term(k.STORED, 0))
    net.output("energy_supplied", Term(k.LEVEL, net.place("energy_supplied")))
    net.output("energy_dissipated", Term(k.LEVEL, net.place("energy_dissipated")))
    net.settings |= {k.DELAY: delay, k.SUBSTEP: solver.maximum_substep}
    net.roles = {k.DELAYED_INPUT: 0}
    return net.build()
