"""The thesis's reduced models: 2DOF, 3DOF with lumped lash, 3DOF with split lash (section 2.2).

All take their numbers from the full-order vehicle file by ``reduce``. Signs and products follow
from the physics, not from the printed equations: docs/errata.md lists where those differ.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..elements.driveline_parts import FINAL_DRIVE_RATIO, GEAR_RATIO
from ..elements.road_load import GRAVITY
from ..kernels import layout as k
from ..quantities import InputError, parameter_variables, quantity
from .assembly import GROUND, Assembly, Network, Term
from .full_order import (
    BRAKE_TORQUE,
    ROAD_GRADE,
    FullOrderParameters,
    Solver,
    input_variable,
    output_variable,
    tyre_force_limit,
)
from .plant import Plant


@dataclass(frozen=True)
class Vehicle:
    """What the road sees, common to all reduced models."""

    mass: float = quantity("kg", "mass of the vehicle with its rolling front wheels (M)", minimum=1.0)
    tyre_radius: float = quantity("m", "dynamic rolling radius (r_t)", minimum=0.05)
    aerodynamic_factor: float = quantity("kg/m", "half air density times drag area", minimum=0.0)
    rolling_resistance_force: float = quantity("N", "rolling resistance on the level (R_x)", minimum=0.0)


@dataclass(frozen=True)
class RoadVehicle(Vehicle):
    """And what of its mass does not weigh on a slope."""

    rolling_mass: float = quantity("kg", "of the mass, what its front wheels are for turning; it does not weigh",
                                   minimum=0.0)

    def __post_init__(self) -> None:
        if self.rolling_mass >= self.mass:
            raise InputError(f"vehicle.rolling_mass is {self.rolling_mass:g} kg: less than vehicle.mass, "
                             f"{self.mass:g} kg, is needed")

    @property
    def weight(self) -> float:
        """On the level [N]."""
        return (self.mass - self.rolling_mass) * GRAVITY


@dataclass(frozen=True)
class Gear:
    """Ratios of the fixed gear, and its losses, taken off the engine torque at the input."""

    transmission_ratio: float = quantity("1", "transmission ratio (i_tr)", **GEAR_RATIO)
    final_drive_ratio: float = quantity("1", "final drive ratio (i_fdr)", **FINAL_DRIVE_RATIO)
    loss_constant: float = quantity("N.m", "gear-train drag at the engine", minimum=0.0)
    loss_viscous: float = quantity("N.m.s/rad", "gear-train drag over engine speed", minimum=0.0)
    loss_fraction: float = quantity("1", "gear-train loss over the torque at the propeller shaft", minimum=0.0)

    def __post_init__(self) -> None:
        if self.transmission_ratio == 0.0:
            raise InputError("gear.transmission_ratio is 0: a gear is needed, forward or reverse")


@dataclass(frozen=True)
class ReducedStart:
    """State at the start: rolling steadily at the torque the inputs have then."""

    vehicle_speed: float = quantity("m/s", "vehicle speed at the start", start=0.0, nominal=10.0)


@dataclass(frozen=True)
class LashShaft:
    """A lumped shaft with lash, at the propeller shaft."""

    stiffness: float = quantity("N.m/rad", "lumped stiffness (k_s)", minimum=1.0)
    damping: float = quantity("N.m.s/rad", "lumped damping (c_s)", minimum=0.0)
    half_gap: float = quantity("rad", "half the lumped lash (alpha)", minimum=0.0, maximum=1.0)


@dataclass(frozen=True)
class WheelShaft:
    """A lumped shaft at the wheels."""

    stiffness: float = quantity("N.m/rad", "lumped stiffness (k_w)", minimum=1.0)
    damping: float = quantity("N.m.s/rad", "lumped damping (c_w)", minimum=0.0)


@dataclass(frozen=True)
class TwoMassParameters:
    """2DOF: everything up to the pinion against everything behind it (eq. 2.4 to 2.10)."""

    engine_inertia: float = quantity("kg.m2", "engine to pinion, at the engine (J_1)", minimum=1e-4)
    wheel_inertia: float = quantity("kg.m2", "differential to tyres, at the wheels (J_2)", minimum=1e-4)
    shaft: LashShaft
    gear: Gear
    vehicle: RoadVehicle
    start: ReducedStart = field(default_factory=ReducedStart)
    solver: Solver = field(default_factory=Solver)


@dataclass(frozen=True)
class ThreeMassDriveline:
    """The 3DOF driveline itself (eq. 2.11 to 2.22); plants and estimators stand on it."""

    engine_inertia: float = quantity("kg.m2", "engine to pinion, at the engine (J_1)", minimum=1e-4)
    final_drive_inertia: float = quantity(
        "kg.m2", "final drive, axle shafts and wheels, at the wheels (J_2)", minimum=1e-4)
    wheel_inertia: float = quantity("kg.m2", "tyres, at the wheels (J_3)", minimum=1e-4)
    shaft: LashShaft
    wheel_shaft: WheelShaft
    gear: Gear
    vehicle: Vehicle


@dataclass(frozen=True)
class ThreeMassParameters(ThreeMassDriveline):
    """3DOF plant with lumped lash."""

    vehicle: RoadVehicle
    start: ReducedStart = field(default_factory=ReducedStart)
    solver: Solver = field(default_factory=Solver)


@dataclass(frozen=True)
class SplitLashParameters:
    """3DOF with split lash (figure 2.14): a light inertia between the two lashes."""

    engine_inertia: float = quantity("kg.m2", "engine to planetary sets, at the engine (J_1)", minimum=1e-4)
    output_inertia: float = quantity("kg.m2", "transmission output to pinion, between the lashes", minimum=1e-5)
    final_drive_inertia: float = quantity(
        "kg.m2", "final drive, axle shafts and wheels, at the wheels (J_2)", minimum=1e-4)
    wheel_inertia: float = quantity("kg.m2", "tyres, at the wheels (J_3)", minimum=1e-4)
    transmission_shaft: LashShaft
    shaft: LashShaft
    wheel_shaft: WheelShaft
    gear: Gear
    vehicle: RoadVehicle
    start: ReducedStart = field(default_factory=ReducedStart)
    solver: Solver = field(default_factory=Solver)


# -- from the full-order vehicle -------------------------------------------------------------------


@dataclass(frozen=True)
class Lumps:
    """The full-order driveline in one gear, element by element, referred to where it acts.

    Shafts are complex stiffnesses k + c s at the complex frequency ``s`` [1/s] of a decaying
    vibration. ``output`` and ``propeller`` are at the propeller shaft, ``ring`` and what follows at
    the wheels. ``transmission`` is so stiff as it is to the vibration, ``transmission_twist`` as its ends twist against
    one another: they differ where a flywheel lies within the engine's inertia.
    """

    s: complex
    ratio: float
    engine: float
    output: float
    ring: float
    hubs: float
    belts: float
    transmission: complex
    transmission_twist: complex
    propeller: complex
    axle: complex
    tyre: complex


def lumps(p: FullOrderParameters, gear: int, s: complex, speed: float, torque: float) -> Lumps:
    """Inertias [kg.m2] and complex stiffnesses [N.m/rad] of the full-order driveline.

    Args:
        gear: Engaged gear.
        s: Complex frequency at which shafts are compared [1/s].
        speed: Vehicle speed [m/s].
        torque: Engine torque [N.m]. At both, the tyre's contact patch is linearised: to first order
            a damper slip_stiffness / speed behind the spring of its relaxation length, both softer
            by the share of the friction limit that is used.
    """
    i = p.transmission.ratio[gear + 1]
    tyre, axle, prop, final = p.tyre, p.axle_shaft, p.propeller_shaft, p.final_drive
    engine = (p.engine.inertia + p.converter.impeller_inertia + p.lockup_clutch.plate_inertia
              + p.converter.turbine_inertia + p.transmission.input_inertia + p.transmission.inertia[gear + 1]
              + (p.dual_mass_flywheel.secondary_inertia if p.dual_mass_flywheel.enabled else 0.0))
    output = (p.transmission.output_inertia + prop.inertia + final.pinion_inertia
              + (p.transfer_case.inertia if p.transfer_case.enabled else 0.0))
    ring = final.ring_inertia + axle.inertia
    hubs, belts = 2.0 * p.hub.inertia + axle.inertia, 2.0 * tyre.belt_inertia
    # The tyres carry what the inertias before them leave of the torque while all accelerate alike.
    turning = (engine * i**2 + output) * final.ratio**2 + ring + hubs + belts
    vehicle = p.vehicle.mass * tyre.radius**2
    axle_torque = abs(torque * i) * final.ratio * vehicle / (vehicle + turning)
    used = axle_torque / (2.0 * tyre.radius) / tyre_force_limit(p)
    if used > 0.9:
        raise InputError(f"torque is {torque:g} N.m: in gear {gear} that is more than the tyres can transmit")
    patch = (1.0 - used) * tyre.slip_stiffness / tyre.relaxation_length * s / (
        s + abs(speed) / (tyre.relaxation_length * (1.0 - used)))
    transmission = twist = series(*(shaft.stiffness + s * shaft.damping for shaft in (p.damper, p.transmission))) * i**2
    if p.dual_mass_flywheel.enabled:
        # all inertia of the engine is lumped behind it, and of that it carries what turns before it: so much of the
        # torque, and the square of that of the elastic energy
        share = p.engine.inertia / engine
        flywheel = (p.dual_mass_flywheel.stiffness + s * p.dual_mass_flywheel.damping) * i**2
        transmission, twist = series(transmission, flywheel / share**2), series(twist, flywheel)
    return Lumps(
        s=s, ratio=i, engine=engine, output=output, ring=ring, hubs=hubs, belts=belts,
        transmission=transmission, transmission_twist=twist,
        propeller=series(prop.stiffness + s * prop.damping, final.mesh_stiffness + s * final.mesh_damping),
        axle=2.0 * (axle.stiffness + s * axle.damping),
        tyre=2.0 * series(tyre.stiffness + s * tyre.damping, patch * tyre.radius**2),
    )


def series(*stiffnesses: complex) -> complex:
    """Stiffness of shafts in series."""
    return 1.0 / sum(1.0 / stiffness for stiffness in stiffnesses)


def _shaft(stiffness: complex, s: complex) -> dict[str, float]:
    """The k and c with k + c s equal to a complex stiffness."""
    damping = stiffness.imag / s.imag
    return {"stiffness": stiffness.real - damping * s.real, "damping": damping}


@dataclass(frozen=True)
class Reduction:
    """The three reduced models of one vehicle in one gear."""

    two_mass: TwoMassParameters
    three_mass: ThreeMassParameters
    split_lash: SplitLashParameters


def at_shuffle(p: FullOrderParameters, gear: int, speed: float, torque: float) -> Lumps:
    """The lumps at the shuffle vibration: the two-mass model's own, s = sqrt(-K(s) / J), by iteration.

    Raises:
        InputError: The vehicle has no such gear.
    """
    if not -1 <= gear <= len(p.transmission.ratio) - 2 or p.transmission.ratio[gear + 1] == 0.0 or gear == 0:
        raise InputError(f"gear is {gear}: the ratio table has no such gear")
    s = complex(-3.0, 40.0)
    for _ in range(200):
        parts = lumps(p, gear, s, speed, torque)
        i, i_fd = parts.ratio, p.final_drive.ratio
        driving = (parts.engine + parts.output / i**2) * (i * i_fd) ** 2
        total = series(parts.transmission * i_fd**2, parts.propeller * i_fd**2, parts.axle, parts.tyre)
        mass = p.vehicle.mass * p.tyre.radius**2
        new = 1j * np.sqrt(total * (1.0 / driving + 1.0 / mass))
        change, s = abs(new - s), complex(0.5 * (s + new))
        if change < 1e-12 * abs(s):
            break
    return parts


def _front_wheels(p: FullOrderParameters) -> float:
    """What the vehicle's inertia is larger by, as they turn [kg]."""
    return 2.0 * (p.hub.inertia + p.tyre.belt_inertia) / p.tyre.radius**2


def _vehicle(p: FullOrderParameters) -> Vehicle:
    """What the road sees; the front wheels roll along, and dry drag of the axle is one more resistance."""
    return Vehicle(
        mass=p.vehicle.mass + _front_wheels(p), tyre_radius=p.tyre.radius,
        aerodynamic_factor=0.5 * p.vehicle.air_density * p.vehicle.drag_coefficient * p.vehicle.frontal_area,
        rolling_resistance_force=(p.tyre.rolling_resistance * p.vehicle.mass * GRAVITY
                                  + p.coulomb_drag.torque / p.tyre.radius))


def _transfer_drag(p: FullOrderParameters) -> float:
    """Drag of the transfer case over the propeller shaft's speed [N.m.s/rad]."""
    return p.transfer_case.drag_viscous if p.transfer_case.enabled else 0.0


def _half_gap(p: FullOrderParameters, ratio: float) -> float:
    """Half of all lash, at the propeller shaft (section 2.2.2.2)."""
    return p.transmission.half_gap / abs(ratio) + p.final_drive.half_gap


def reduce(p: FullOrderParameters, gear: int = 5, speed: float = 12.0, torque: float = 120.0) -> Reduction:
    """Lump the full-order driveline.

    Inertias are referred by the squares of the ratios. Shafts in series are lumped by their complex
    stiffness k + c s at the shuffle vibration s, at ``speed`` [m/s] and engine ``torque`` [N.m]: so
    the tyres' slip, a damper in series, is in the lumps with what it does to shuffle.

    The 3DOF model keeps the two places where the compliance sits, shafts and tyres, apart: k_s is
    transmission, propeller shaft, hypoid mesh and axle shafts at the propeller shaft, J_2 what
    turns with the wheels' rims, k_w the tyres. (The thesis's text puts the axle shafts into k_w as
    well as into J_2; see docs/errata.md.)

    Raises:
        InputError: The vehicle has no such gear.
    """
    parts = at_shuffle(p, gear, speed, torque)
    s, i, i_fd = parts.s, parts.ratio, p.final_drive.ratio
    loss, half_gap = p.transmission, _half_gap(p, i)
    vehicle = RoadVehicle(**vars(_vehicle(p)), rolling_mass=_front_wheels(p))
    ratios = Gear(
        transmission_ratio=i, final_drive_ratio=i_fd,
        loss_constant=loss.loss_constant[gear + 1] + p.final_drive.loss_constant / abs(i),
        loss_viscous=loss.loss_viscous[gear + 1] + _transfer_drag(p) / i**2,
        loss_fraction=(loss.loss_fraction[gear + 1] + p.final_drive.loss_fraction) / abs(i))
    shafts = series(parts.transmission, parts.propeller, parts.axle / i_fd**2)
    engine = parts.engine + parts.output / i**2
    wheels = parts.ring + parts.hubs
    start, solver = ReducedStart(), Solver()
    wheel_shaft = WheelShaft(**_shaft(parts.tyre, s))
    three = ThreeMassParameters(
        engine, wheels, parts.belts, LashShaft(**_shaft(shafts, s), half_gap=half_gap),
        wheel_shaft, ratios, vehicle, start, solver)
    return Reduction(
        two_mass=TwoMassParameters(
            engine, wheels + parts.belts,
            LashShaft(**_shaft(series(shafts, parts.tyre / i_fd**2), s), half_gap=half_gap),
            ratios, vehicle, start, solver),
        three_mass=three,
        split_lash=SplitLashParameters(
            parts.engine, parts.output, wheels, parts.belts,
            LashShaft(**_shaft(parts.transmission, s), half_gap=p.transmission.half_gap / abs(i)),
            LashShaft(**_shaft(series(parts.propeller, parts.axle / i_fd**2), s),
                      half_gap=p.final_drive.half_gap),
            wheel_shaft, ratios, vehicle, start, solver))


def three_mass_at_hub(p: FullOrderParameters, gear: int = 5, speed: float = 12.0, torque: float = 120.0,
                      flank: float = 0.0) -> ThreeMassDriveline:
    """The 3DOF driveline cut where the estimators' questions and sensors are.

    ``reduce`` shares things out for the vibration of the whole; between two measured speeds it
    matters on which side of the lash and of the wheel sensor each part is:

    - The first lash to leave its flank is the transmission's, when the torque in it is zero. So J_1 is
      what turns before it, only the losses before it are taken off the engine torque, and what turns
      between transmission and final drive belongs to J_2.
    - The sensor is at the rim. So J_2 reaches to the rim (final drive, axle shafts, hubs), k_s is
      everything between engine and rim, and k_w is the tyre with its slip, behind the sensor: a
      wheel speed that had the vehicle's mass tied to it rigidly would take slip for torque.
    - The drags of transfer case (at ``speed``) and final drive act behind the lash: their constant parts are
      counted with the rolling resistance. Of the torque in front, the axle shafts carry (1 - loss fraction) while
      driving and (1 + loss fraction) while coasting, and so twist less or more.

    Args:
        flank: 1: stiffness while driving, -1: while coasting, 0: in between.

    Raises:
        InputError: The vehicle has no such gear.
    """
    parts = at_shuffle(p, gear, speed, torque)
    s, i, i_fd = parts.s, parts.ratio, p.final_drive.ratio
    loss, vehicle = p.transmission, _vehicle(p)
    carried = 1.0 - flank * p.final_drive.loss_fraction
    behind = i_fd / p.tyre.radius
    drag = (p.final_drive.loss_constant + _transfer_drag(p) * behind * speed) * behind
    shafts = series(parts.transmission_twist, parts.propeller, parts.axle / (carried * i_fd**2))
    return ThreeMassDriveline(
        engine_inertia=parts.engine,
        final_drive_inertia=parts.ring + parts.hubs + parts.output * i_fd**2,
        wheel_inertia=parts.belts,
        shaft=LashShaft(**_shaft(shafts, s), half_gap=_half_gap(p, i)),
        wheel_shaft=WheelShaft(**_shaft(parts.tyre, s)),
        gear=Gear(
            transmission_ratio=i, final_drive_ratio=i_fd,
            loss_constant=loss.loss_constant[gear + 1], loss_viscous=loss.loss_viscous[gear + 1],
            loss_fraction=loss.loss_fraction[gear + 1] / abs(i)),
        vehicle=replace(vehicle, rolling_resistance_force=vehicle.rolling_resistance_force + drag))


# -- the models --------------------------------------------------------------------------------------


class ReducedPlant(Plant):
    """What the three reduced models share: inputs, outputs, road, start."""

    body = "wheel"
    kind: str = ""

    inputs = (
        input_variable("engine_torque", "N.m", "torque at the crankshaft, brake (T_e)", nominal=100.0),
        BRAKE_TORQUE,
        ROAD_GRADE,
    )
    output_variables = (
        output_variable("engine_speed", "rad/s", "engine speed", 100.0),
        output_variable("wheel_speed", "rad/s", "speed of the driven wheels", 30.0),
        output_variable("vehicle_speed", "m/s", "vehicle speed", 10.0),
        output_variable("propeller_shaft_torque", "N.m", "torque in the lumped propeller shaft (T_s)", 200.0),
        output_variable("lash_position", "rad", "position in the lash at the propeller shaft (theta_b)", 0.01),
        output_variable("contact", "1", "flank in contact: -1, 0 none, 1"),
        output_variable("vehicle_acceleration", "m/s2", "longitudinal acceleration", 1.0),
        output_variable("energy_stored", "J", "kinetic and elastic energy", 1e5),
        output_variable("energy_supplied", "J", "work done since the start", 1e5),
        output_variable("energy_dissipated", "J", "heat made since the start", 1e5),
    )

    @classmethod
    def defaults_from(cls, vehicle, gear: int = 5) -> dict[str, float]:
        """Parameters lumped from a vehicle file, for one gear."""
        reduced = getattr(reduce(vehicle.parameters(FullOrderParameters), gear), cls.kind)
        return {v.name: v.start for v in parameter_variables(reduced)}

    def _road(self, net: Assembly, wheel: int, vehicle: RoadVehicle) -> None:
        """Drag, rolling resistance, brake and grade on the wheel node (eq. 2.22)."""
        radius = vehicle.tyre_radius
        net.aerodynamic("aerodynamic_drag", wheel, vehicle.aerodynamic_factor, ratio=radius)
        net.friction("brake_and_rolling_resistance", wheel, GROUND, 1.0, signal=net.signal("brake_torque"),
                     base=vehicle.rolling_resistance_force * radius)
        net.source("grade", wheel, -vehicle.weight, k.SIN_GRADE, ratio=radius)

    def _outputs_of(self, net: Assembly, engine: int, wheel: int, shaft: int, lashes: list[int],
                    radius: float) -> None:
        net.output("engine_speed", Term(k.SPEED, engine))
        net.output("wheel_speed", Term(k.SPEED, wheel))
        net.output("vehicle_speed", Term(k.SPEED, wheel, radius))
        net.output("propeller_shaft_torque", Term(k.TORQUE, shaft))
        net.output("lash_position", *(Term(k.LASH_ANGLE, lash) for lash in lashes))
        net.output("contact", Term(k.CONTACT_MODE, lashes[-1]))
        net.output("vehicle_acceleration", Term(k.ACCELERATION, wheel, radius))
        net.output("energy_stored", Term(k.STORED, 0))
        net.output("energy_supplied", Term(k.LEVEL, net.place("energy_supplied")))
        net.output("energy_dissipated", Term(k.LEVEL, net.place("energy_dissipated")))

    def _finish(self, net: Assembly, solver: Solver) -> Network:
        net.settings = {k.SUBSTEP: solver.maximum_substep}
        net.roles = {k.GRADE_INPUT: net.inputs.index("road_grade")}
        return net.build()

    def start_speeds(self, parameters, network: Network) -> tuple[np.ndarray, bool]:
        """Every inertia turns with the wheels."""
        wheel = parameters.start.vehicle_speed / parameters.vehicle.tyre_radius
        output = wheel * parameters.gear.final_drive_ratio
        speeds = {"engine": output * parameters.gear.transmission_ratio, "output": output,
                  "final_drive": wheel, "wheel": wheel}
        return np.array([speeds[name] for name in network.nodes]), wheel != 0.0


class TwoMassPlant(ReducedPlant):
    """2DOF (thesis section 2.2.1)."""

    name = "plant_rom_2dof"
    description = "Reduced driveline, 2DOF: engine and vehicle with lumped lash"
    Parameters = TwoMassParameters
    kind = "two_mass"

    def assemble(self, p: TwoMassParameters) -> Network:
        net = Assembly(inputs=tuple(v.name for v in self.inputs))
        radius = p.vehicle.tyre_radius
        engine = net.node("engine", p.engine_inertia, "rad/s", "engine to pinion (J_1)")
        wheel = net.node("wheel", p.wheel_inertia + p.vehicle.mass * radius**2, "rad/s", "wheels and vehicle (J_2, M)")
        net.source("engine_torque", engine, 1.0, net.signal("engine_torque"))
        shaft = net.lash("shaft", engine, wheel, p.shaft.stiffness, p.shaft.damping, p.shaft.half_gap,
                         ratio_a=1.0 / p.gear.transmission_ratio, ratio_b=p.gear.final_drive_ratio)
        net.loss("gear_train_loss", engine, shaft, p.gear.loss_constant, p.gear.loss_viscous, p.gear.loss_fraction)
        self._road(net, wheel, p.vehicle)
        self._outputs_of(net, engine, wheel, shaft, [shaft], radius)
        return self._finish(net, p.solver)


class ThreeMassPlant(ReducedPlant):
    """3DOF with lumped lash (thesis section 2.2.2)."""

    name = "plant_rom_3dof"
    description = "Reduced driveline, 3DOF: engine, final drive and vehicle with lumped lash"
    Parameters = ThreeMassParameters
    kind = "three_mass"

    def assemble(self, p: ThreeMassParameters) -> Network:
        net = Assembly(inputs=tuple(v.name for v in self.inputs))
        radius = p.vehicle.tyre_radius
        engine = net.node("engine", p.engine_inertia, "rad/s", "engine to pinion (J_1)")
        final_drive = net.node("final_drive", p.final_drive_inertia, "rad/s", "final drive to rims (J_2)")
        wheel = net.node("wheel", p.wheel_inertia + p.vehicle.mass * radius**2, "rad/s", "tyres and vehicle (J_3, M)")
        net.source("engine_torque", engine, 1.0, net.signal("engine_torque"))
        shaft = net.lash("shaft", engine, final_drive, p.shaft.stiffness, p.shaft.damping, p.shaft.half_gap,
                         ratio_a=1.0 / p.gear.transmission_ratio, ratio_b=p.gear.final_drive_ratio)
        net.loss("gear_train_loss", engine, shaft, p.gear.loss_constant, p.gear.loss_viscous, p.gear.loss_fraction)
        net.shaft("wheel_shaft", final_drive, wheel, p.wheel_shaft.stiffness, p.wheel_shaft.damping)
        self._road(net, wheel, p.vehicle)
        self._outputs_of(net, engine, wheel, shaft, [shaft], radius)
        return self._finish(net, p.solver)


class SplitLashPlant(ReducedPlant):
    """3DOF with the lash split between transmission and final drive (thesis figure 2.14)."""

    name = "plant_rom_3dof_split"
    description = "Reduced driveline, 3DOF with the lash split between transmission and final drive"
    Parameters = SplitLashParameters
    kind = "split_lash"

    def assemble(self, p: SplitLashParameters) -> Network:
        net = Assembly(inputs=tuple(v.name for v in self.inputs))
        radius = p.vehicle.tyre_radius
        engine = net.node("engine", p.engine_inertia, "rad/s", "engine to planetary sets (J_1)")
        output = net.node("output", p.output_inertia, "rad/s", "transmission output to pinion")
        final_drive = net.node("final_drive", p.final_drive_inertia, "rad/s", "final drive to rims (J_2)")
        wheel = net.node("wheel", p.wheel_inertia + p.vehicle.mass * radius**2, "rad/s", "tyres and vehicle (J_3, M)")
        net.source("engine_torque", engine, 1.0, net.signal("engine_torque"))
        first = net.lash("transmission", engine, output, p.transmission_shaft.stiffness,
                         p.transmission_shaft.damping, p.transmission_shaft.half_gap,
                         ratio_a=1.0 / p.gear.transmission_ratio)
        second = net.lash("shaft", output, final_drive, p.shaft.stiffness, p.shaft.damping, p.shaft.half_gap,
                          ratio_b=p.gear.final_drive_ratio)
        net.loss("gear_train_loss", engine, first, p.gear.loss_constant, p.gear.loss_viscous, p.gear.loss_fraction)
        net.shaft("wheel_shaft", final_drive, wheel, p.wheel_shaft.stiffness, p.wheel_shaft.damping)
        self._road(net, wheel, p.vehicle)
        self._outputs_of(net, engine, wheel, second, [first, second], radius)
        return self._finish(net, p.solver)
