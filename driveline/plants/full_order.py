"""The full-order rear-wheel-drive driveline of thesis section 2.1.1.

    engine - (dual-mass flywheel) - converter | lock-up clutch - damper - turbine
      - shift element - planetary sets ~lash~ output, (transfer case) - propeller shaft
      ~lash~ final drive - two axle shafts - hubs - tyres - road - vehicle (- suspension), seat
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..elements.asymmetric_friction import AsymmetricFriction
from ..elements.converter import Converter
from ..elements.coulomb_drag import CoulombDrag
from ..elements.damper_friction import DamperFriction
from ..elements.driveline_parts import (
    DifferentialCase,
    DualMassFlywheel,
    EngineMount,
    FinalDrive,
    Hub,
    Seat,
    Suspension,
    TransferCase,
    Transmission,
    in_gear,
)
from ..elements.engine_torque import EngineTorque
from ..elements.friction import Brake, LockupClutch
from ..elements.road_load import GRAVITY, RoadLoad
from ..elements.shaft import MassiveShaft, Shaft
from ..elements.slip_control import SlipControl
from ..elements.torque_ripple import TorqueRipple
from ..elements.two_stage_stiffness import FirstStage
from ..elements.tyre import Tyre
from ..kernels import layout as k
from ..quantities import InputError, Variable, parameter_variables, quantity
from ..sensors.can_signal import CanSignal, CanVehicleSpeed
from ..sensors.torque_meter import TorqueMeter
from .assembly import GROUND, Assembly, ByGear, Network, Term
from .plant import Plant


@dataclass(frozen=True)
class Start:
    """State at the start: rolling steadily at the torque and gear the inputs have then."""

    vehicle_speed: float = quantity("m/s", "vehicle speed at the start", start=0.0, nominal=10.0)
    engine_speed: float = quantity(
        "rad/s", "engine speed at the start with an open lock-up clutch; 0: idle, or the turbine's if that is faster",
        start=0.0, minimum=0.0, nominal=100.0)


@dataclass(frozen=True)
class Solver:
    """How finely a communication step is integrated."""

    maximum_substep: float = quantity(
        "s", "longest Runge-Kutta sub-step; refused where it would be unstable", start=2e-4,
        minimum=1e-7, maximum=5e-3, nominal=1e-4)


@dataclass(frozen=True)
class FullOrderParameters:
    """Every number of the full-order plant; the tables of a vehicle file bear these names."""

    engine: EngineTorque
    dual_mass_flywheel: DualMassFlywheel
    converter: Converter
    lockup_clutch: LockupClutch
    damper: Shaft
    transmission: Transmission
    transfer_case: TransferCase
    propeller_shaft: MassiveShaft
    final_drive: FinalDrive
    axle_shaft: MassiveShaft
    suspension: Suspension
    hub: Hub
    tyre: Tyre
    vehicle: RoadLoad
    brake: Brake
    seat: Seat
    differential_case: DifferentialCase
    engine_mount: EngineMount
    torque_meter: TorqueMeter
    engine_speed_sensor: CanSignal
    turbine_speed_sensor: CanSignal
    transmission_output_speed_sensor: CanSignal
    wheel_speed_sensor: CanSignal
    vehicle_speed_sensor: CanVehicleSpeed
    start: Start
    solver: Solver
    # what a vehicle file need not mention: absent unless a value puts it in
    torque_ripple: TorqueRipple
    asymmetric_friction: AsymmetricFriction
    axle_first_stage: FirstStage
    coulomb_drag: CoulombDrag
    slip_control: SlipControl
    damper_friction: DamperFriction


def input_variable(name: str, unit: str, meaning: str, **more) -> Variable:
    """An input of a plant; continuous unless said otherwise."""
    return Variable(name, unit, meaning, causality="input", **{"variability": "continuous", **more})


def output_variable(name: str, unit: str, meaning: str, nominal: float | None = None) -> Variable:
    """An output of a plant."""
    return Variable(name, unit, meaning, causality="output", variability="continuous", nominal=nominal)


BRAKE_TORQUE = input_variable(
    "brake_torque", "N.m", "total brake torque at the driven wheels", minimum=0.0, nominal=1000.0)
ROAD_GRADE = input_variable(
    "road_grade", "rad", "slope angle of the road, uphill positive", minimum=-1.0, maximum=1.0)

# Speeds that arrive by CAN, and whose jitter they have: the powertrain's or the brake control's.
# The parameters of <speed> are <speed>_sensor, its output is <speed>_measured.
MEASURED_SPEEDS = {
    "engine_speed": "engine", "turbine_speed": "engine", "transmission_output_speed": "engine",
    "wheel_speed": "wheel", "vehicle_speed": "wheel",
}


def tyre_force_limit(p: FullOrderParameters) -> float:
    """Largest longitudinal force of one driven tyre [N]: friction times its static load."""
    weight = p.vehicle.mass * GRAVITY
    return 0.5 * p.tyre.friction_coefficient * p.vehicle.driven_load_fraction * weight


class FullOrderPlant(Plant):
    """The full-order plant as a model."""

    name = "plant_fom"
    description = "Full-order rear-wheel-drive driveline with backlash (engine to vehicle)"
    Parameters = FullOrderParameters
    body = "vehicle"

    inputs = (
        input_variable("engine_torque", "N.m", "requested crankshaft torque, brake", nominal=100.0),
        input_variable("spark_efficiency", "1", "share of the air path's torque the spark path lets through",
               start=1.0, minimum=0.0, maximum=1.0),
        input_variable("gear", "1", "engaged gear: -1 reverse, 0 neutral, 1 to 10", kind="integer",
               variability="discrete", start=5, minimum=-1, maximum=10),
        input_variable("lockup_command", "1", "lock-up clutch: 0 open to 1 full capacity", start=1.0,
               minimum=0.0, maximum=1.0),
        BRAKE_TORQUE,
        ROAD_GRADE,
    )
    output_variables = (
        output_variable("engine_speed", "rad/s", "crankshaft speed", 100.0),
        output_variable("turbine_speed", "rad/s", "turbine and transmission input speed", 100.0),
        output_variable("transmission_output_speed", "rad/s", "transmission output speed", 100.0),
        output_variable("wheel_speed", "rad/s", "mean speed of the driven wheels (hubs)", 30.0),
        output_variable("vehicle_speed", "m/s", "vehicle speed", 10.0),
        output_variable("crankshaft_torque", "N.m", "torque delivered to the crankshaft", 100.0),
        output_variable("transmission_input_torque", "N.m", "torque carried at the planetary sets' input", 100.0),
        output_variable("propeller_shaft_torque", "N.m", "torque in the propeller shaft", 200.0),
        output_variable("axle_shaft_torque", "N.m", "sum of the torques in both axle shafts", 1000.0),
        output_variable("lockup_clutch_torque", "N.m", "torque through the lock-up clutch", 100.0),
        output_variable("converter_slip", "rad/s", "speed of the impeller less that of the turbine", 10.0),
        output_variable("lockup_clutch_sticks", "1", "0 while the lock-up clutch sticks, -1 or 1 while it slips"),
        output_variable("transmission_lash", "rad", "position in the transmission lash, at its input", 0.01),
        output_variable("final_drive_lash", "rad", "position in the final drive lash, at the propeller shaft", 0.01),
        output_variable("lash_position", "rad", "both lashes lumped at the propeller shaft (thesis 2.2.2.2)", 0.01),
        output_variable("transmission_contact", "1", "flank in contact in the transmission: -1, 0 none, 1"),
        output_variable("final_drive_contact", "1", "flank in contact in the final drive: -1, 0 none, 1"),
        output_variable("vehicle_acceleration", "m/s2", "longitudinal acceleration of the body", 1.0),
        output_variable("seat_acceleration", "m/s2", "longitudinal acceleration at the seat track", 1.0),
        output_variable("differential_acceleration", "m/s2", "vertical acceleration of the differential's nose", 1.0),
        output_variable("engine_roll_speed", "rad/s", "roll rate of engine and transmission on their mounts", 0.1),
        output_variable("travelled_distance", "m", "distance since the start", 100.0),
        output_variable("crank_angle", "rad", "crankshaft angle since the start", 1000.0),
        output_variable("energy_stored", "J", "kinetic and elastic energy in the plant", 1e5),
        output_variable("energy_supplied", "J", "work done on the plant since the start", 1e5),
        output_variable("energy_dissipated", "J", "heat made since the start", 1e5),
        output_variable(
            "propeller_shaft_torque_measured", "N.m", "propeller shaft torque as the torque meter gives it", 200.0),
        output_variable("engine_speed_measured", "rad/s", "engine speed as it arrives by CAN", 100.0),
        output_variable("turbine_speed_measured", "rad/s", "turbine speed as it arrives by CAN", 100.0),
        output_variable(
            "transmission_output_speed_measured", "rad/s", "transmission output speed as it arrives by CAN", 100.0),
        output_variable("wheel_speed_measured", "rad/s", "mean driven wheel speed as it arrives by CAN", 30.0),
        output_variable("vehicle_speed_measured", "m/s", "vehicle speed as it arrives by CAN", 10.0),
    )

    @classmethod
    def defaults_from(cls, vehicle, gear: int = 5) -> dict[str, float]:
        """Start values from a vehicle file; the gear is an input of this plant.

        What the file need not say is there as well, or an FMU would keep what it was built with: another vehicle's.

        Raises:
            InputError: The file lacks a number, or has one that is no parameter, or out of range.
        """
        declared = parameter_variables(vehicle.parameters(cls.Parameters))
        values = {v.name: v.start for v in declared if not v.name.startswith(("start.", "solver."))}
        return {**values, **vehicle.values, "gear": float(gear)}

    def _gear_exists(self, gear: int) -> bool:
        name = in_gear("ratio", gear)
        return name in self.index and self.values[self.index[name]] != 0.0

    def assemble(self, p: FullOrderParameters) -> Network:
        """The network of the full-order plant; one line an element."""
        net = Assembly(inputs=tuple(v.name for v in self.inputs), gears=len(p.transmission.ratio))
        ratio = ByGear(tuple(r if r != 0.0 else 1.0 for r in p.transmission.ratio))
        rad_s, m_s = "rad/s", "m/s"
        ring_ratio = p.final_drive.ratio
        weight = p.vehicle.mass * GRAVITY
        tyre = p.tyre
        if p.final_drive.loss_fraction + p.asymmetric_friction.coast_loss_fraction < 0.0:
            raise InputError(
                f"asymmetric_friction.coast_loss_fraction is {p.asymmetric_friction.coast_loss_fraction:g}: with "
                f"final_drive.loss_fraction, {p.final_drive.loss_fraction:g}, it must not be below 0")
        driven = ("left", "right")

        # inertias
        flywheel = p.dual_mass_flywheel
        if flywheel.enabled:
            crank = net.node("crankshaft", p.engine.inertia, rad_s, "crankshaft and primary flywheel")
            impeller = net.node("impeller", p.converter.impeller_inertia + flywheel.secondary_inertia, rad_s,
                                "secondary flywheel and impeller")
        else:
            crank = impeller = net.node("crankshaft", p.engine.inertia + p.converter.impeller_inertia, rad_s,
                                        "crankshaft, flexplate and impeller")
        plate = net.node("damper_plate", p.lockup_clutch.plate_inertia, rad_s, "lock-up clutch piston and damper plate")
        turbine = net.node("turbine", p.converter.turbine_inertia + p.transmission.input_inertia, rad_s,
                           "turbine and transmission input shaft")
        gearset = net.node("planetary_sets", ByGear(p.transmission.inertia), rad_s, "planetary sets, at their input")
        shaft_end = p.propeller_shaft.inertia / 4.0
        transfer = p.transfer_case
        output = net.node(
            "transmission_output",
            p.transmission.output_inertia + shaft_end + (transfer.inertia if transfer.enabled else 0.0),
            rad_s, "transmission output, transfer case and front end of the propeller shaft")
        middle = net.node("propeller_shaft", 2.0 * shaft_end, rad_s, "middle of the propeller shaft")
        pinion = net.node("pinion", p.final_drive.pinion_inertia + shaft_end, rad_s,
                          "pinion and rear end of the propeller shaft")
        differential = net.node("differential", p.final_drive.ring_inertia + p.axle_shaft.inertia, rad_s,
                                "ring gear, differential and inner halves of the axle shafts")
        hubs = [net.node(f"{side}_hub", p.hub.inertia + p.axle_shaft.inertia / 2.0, rad_s,
                         f"{side} hub, brake disc, rim and outer half of the axle shaft") for side in driven]
        belts = [net.node(f"{side}_belt", tyre.belt_inertia, rad_s, f"{side} tyre belt") for side in driven]
        front_wheels = 2.0 * (p.hub.inertia + tyre.belt_inertia) / tyre.radius**2
        body_mass = p.vehicle.mass + front_wheels - p.seat.mass
        if p.suspension.enabled:
            axle = net.node("axle", p.suspension.unsprung_mass, m_s, "driven axle, fore and aft")
            body_mass -= p.suspension.unsprung_mass
        body = net.node("vehicle", body_mass, m_s, "vehicle body with the rolling front wheels")
        if not p.suspension.enabled:
            axle = body
        seat = net.node("seat", p.seat.mass, m_s, "driver and seat")
        case = net.node("differential_case", p.differential_case.inertia, rad_s, "pitch of the axle housing")
        mounts = net.node("powertrain_roll", p.engine_mount.inertia, rad_s, "roll of engine and transmission")

        # what lags behind its command
        net.lag("lockup_clutch_pressure", net.signal("lockup_command"), p.lockup_clutch.lag,
                "lock-up clutch capacity over its full one")
        net.lag("shift_clutch_engagement", k.IN_GEAR, p.transmission.shift_lag,
                "shift element capacity over its full one")
        net.lag("brake_torque_level", net.signal("brake_torque"), p.brake.lag, "brake torque at the wheels", "N.m")

        net.integral(body, "travelled_distance", "m", "distance since the start")
        crank_angle = net.integral(crank, "crank_angle", "rad", "crankshaft angle since the start")

        # branches, engine to road
        e = p.engine
        net.engine("engine", crank, (
            e.torque_gain, e.torque_offset, e.torque_noise, e.friction_constant, e.friction_viscous,
            e.accessory_torque, e.maximum_torque, e.idle_speed, e.idle_gain, e.air_lag),
            net.signal("spark_efficiency"))
        if p.torque_ripple.amplitude > 0.0:
            net.ripple("torque_ripple", crank, p.torque_ripple, crank_angle)
        if flywheel.enabled:
            net.shaft("dual_mass_flywheel", crank, impeller, flywheel.stiffness, flywheel.damping)
        net.converter("converter", impeller, turbine,
                      (*p.converter.speed_ratio, *p.converter.torque_ratio, *p.converter.capacity))
        lockup = net.friction("lockup_clutch", impeller, plate, p.lockup_clutch.capacity, p.lockup_clutch.static_ratio,
                              p.lockup_clutch.drag, lag="lockup_clutch_pressure", control=p.slip_control)
        net.shaft("damper", plate, turbine, p.damper.stiffness, p.damper.damping)
        if p.damper_friction.torque > 0.0:
            net.rubbing("damper_friction", plate, turbine, p.damper_friction)
        net.friction("shift_clutch", turbine, gearset, p.transmission.shift_capacity, lag="shift_clutch_engagement")
        gears = net.lash("transmission", gearset, output, p.transmission.stiffness, p.transmission.damping,
                         p.transmission.half_gap, ratio_b=ratio)
        net.loss("transmission_loss", turbine, gears, ByGear(p.transmission.loss_constant),
                 ByGear(p.transmission.loss_viscous), ByGear(p.transmission.loss_fraction))
        if transfer.enabled:
            net.friction("transfer_case_drag", output, GROUND, 0.0, drag=transfer.drag_viscous)
        shaft = p.propeller_shaft
        front = net.shaft("propeller_shaft_front", output, middle, 2.0 * shaft.stiffness, 2.0 * shaft.damping)
        net.shaft("propeller_shaft_rear", middle, pinion, 2.0 * shaft.stiffness, 2.0 * shaft.damping)
        hypoid = net.lash("final_drive", pinion, differential, p.final_drive.mesh_stiffness,
                          p.final_drive.mesh_damping, p.final_drive.half_gap, ratio_b=ring_ratio)
        net.loss("final_drive_loss", pinion, hypoid, p.final_drive.loss_constant, 0.0, p.final_drive.loss_fraction,
                 p.asymmetric_friction.coast_loss_fraction)
        axle_shafts = []
        for side, hub, belt in zip(driven, hubs, belts, strict=True):
            axle_shafts.append(net.staged_shaft(
                f"{side}_axle_shaft", differential, hub, p.axle_shaft.stiffness, p.axle_shaft.damping,
                p.axle_first_stage))
            net.friction(f"{side}_brake", hub, GROUND, 0.5, lag="brake_torque_level")
            net.shaft(f"{side}_tyre", hub, belt, tyre.stiffness, tyre.damping)
            net.contact(f"{side}_contact", belt, axle, tyre.slip_stiffness, tyre.relaxation_length,
                        tyre_force_limit(p), tyre.radius)
        if p.coulomb_drag.torque > 0.0:
            net.friction("coulomb_drag", differential, GROUND, p.coulomb_drag.torque)
        if p.suspension.enabled:
            net.shaft("suspension", axle, body, p.suspension.stiffness, p.suspension.damping, unit="m")
        net.aerodynamic("aerodynamic_drag", body,
                        0.5 * p.vehicle.air_density * p.vehicle.drag_coefficient * p.vehicle.frontal_area)
        net.friction("rolling_resistance", body, GROUND, 0.0, base=tyre.rolling_resistance * weight)
        net.source("grade", body, -weight, k.SIN_GRADE)
        net.shaft("seat", body, seat, p.seat.stiffness, p.seat.damping, unit="m")
        net.shaft("differential_case", case, GROUND, p.differential_case.stiffness, p.differential_case.damping)
        net.shaft("engine_mount", mounts, GROUND, p.engine_mount.stiffness, p.engine_mount.damping)
        net.reaction("axle_reaction", case, hypoid, -ring_ratio)
        net.reaction("output_reaction", mounts, front, -1.0)

        half, arm = 0.5, p.differential_case.lever_arm
        at_shaft = ByGear(tuple(1.0 / r for r in ratio.values))
        net.output("engine_speed", Term(k.SPEED, crank))
        net.output("turbine_speed", Term(k.SPEED, turbine))
        net.output("transmission_output_speed", Term(k.SPEED, output))
        net.output("wheel_speed", *(Term(k.SPEED, hub, half) for hub in hubs))
        net.output("vehicle_speed", Term(k.SPEED, body))
        net.output("crankshaft_torque", Term(k.TORQUE, 0, -1.0))
        net.output("transmission_input_torque", Term(k.TORQUE, gears))
        net.output("propeller_shaft_torque", Term(k.TORQUE, front))
        net.output("axle_shaft_torque", *(Term(k.TORQUE, b) for b in axle_shafts))
        net.output("lockup_clutch_torque", Term(k.TORQUE, lockup))
        net.output("converter_slip", Term(k.SPEED, impeller), Term(k.SPEED, turbine, -1.0))
        net.output("lockup_clutch_sticks", Term(k.CONTACT_MODE, lockup))
        net.output("transmission_lash", Term(k.LASH_ANGLE, gears))
        net.output("final_drive_lash", Term(k.LASH_ANGLE, hypoid))
        net.output("lash_position", Term(k.LASH_ANGLE, gears, at_shaft), Term(k.LASH_ANGLE, hypoid))
        net.output("transmission_contact", Term(k.CONTACT_MODE, gears))
        net.output("final_drive_contact", Term(k.CONTACT_MODE, hypoid))
        net.output("vehicle_acceleration", Term(k.ACCELERATION, body))
        net.output("seat_acceleration", Term(k.ACCELERATION, seat))
        net.output("differential_acceleration", Term(k.ACCELERATION, case, arm))
        net.output("engine_roll_speed", Term(k.SPEED, mounts))
        net.output("travelled_distance", Term(k.LEVEL, net.place("travelled_distance")))
        net.output("crank_angle", Term(k.LEVEL, net.place("crank_angle")))
        net.output("energy_stored", Term(k.STORED, 0))
        net.output("energy_supplied", Term(k.LEVEL, net.place("energy_supplied")))
        net.output("energy_dissipated", Term(k.LEVEL, net.place("energy_dissipated")))
        net.settings |= {k.DELAY: e.air_delay, k.SUBSTEP: p.solver.maximum_substep}
        if e.torque_noise > 0.0:
            net.settings[k.NOISE_PERIOD] = e.noise_period
        names = net.inputs
        net.roles = {k.GEAR_INPUT: names.index("gear"), k.DELAYED_INPUT: names.index("engine_torque"),
                     k.GRADE_INPUT: names.index("road_grade"), k.GEARSET_NODE: gearset,
                     k.GEARSET_BRANCH: gears, k.SEED: e.noise_seed}
        self.attach(net, p)
        return net.build()

    def attach(self, net: Assembly, p: FullOrderParameters) -> None:
        """What is attached to the driveline: its sensors here; other things in plants that are this and more."""
        net.meter("propeller_shaft_torque", "propeller_shaft_torque_measured", p.torque_meter)
        for speed, jitter_source in MEASURED_SPEEDS.items():
            net.sensor(speed, f"{speed}_measured", getattr(p, f"{speed}_sensor"), jitter_source)

    def start_speeds(self, p: FullOrderParameters, network: Network) -> tuple[np.ndarray, bool]:
        """Rolling speeds; the engine turns with the turbine where the lock-up clutch is closed."""
        gear = int(self["gear"])
        speed = p.start.vehicle_speed
        wheel = speed / p.tyre.radius
        output = wheel * p.final_drive.ratio
        turbine = output * p.transmission.ratio[gear + 1]
        locked = self["lockup_command"] > 0.0 and gear != 0
        engine = turbine if locked else p.start.engine_speed or max(p.engine.idle_speed, turbine)
        values = {
            "crankshaft": engine, "impeller": engine, "damper_plate": turbine, "turbine": turbine,
            "planetary_sets": turbine, "transmission_output": output, "propeller_shaft": output,
            "pinion": output, "differential": wheel, "left_hub": wheel, "right_hub": wheel,
            "left_belt": wheel, "right_belt": wheel, "axle": speed, "vehicle": speed, "seat": speed,
            "differential_case": 0.0, "powertrain_roll": 0.0,
        }
        return np.array([values[name] for name in network.nodes]), locked and speed != 0.0
