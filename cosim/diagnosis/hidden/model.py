"""A driveline of its own for measurements with hidden effects, on one page, that shares no code with the plants.

Made so that a diagnosis cannot succeed by inverting its own model: other coordinates (both sides lumped, the
engaged gearbox rigid), other laws where contacts and clutches are concerned (dead zones, smooth friction), and
SciPy's LSODA with its own choice of step. ``other`` changes the structure as well: axle shafts with inertia
along their length, a tyre of three rings whose force saturates behind its relaxation length and not within,
Bouc-Wen hysteresis in damper and lock-up clutch, flanks whose damping grows with the penetration. Its static
stiffness, slip and total inertia stay those of the vehicle file. It simulates driving forward in one gear.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numba
import numpy as np
from scipy.integrate import odeint

from driveline.quantities import InputError

GRAVITY = 9.80665
POINTS = 11  # of the converter's tables
CHAIN = 9  # most nodes from the differential to the tread
PRE_ROLL = 2.0  # s before the recording: the driveline winds up and settles
SOFT_END = 0.1  # N.m: as close to an end of the lock-up clutch's capacity its control slows down

# Places in the state. The chain follows: its speeds, then the twists between its nodes.
(AIR, CRANK, PLATE, TURBINE, OUTPUT, SHAFT, PINION, BODY, SEAT, AXLE, CASE, ROLL,
 DAMPER, GEARS, FRONT, REAR, HYPOID, TREAD, SEAT_TRACK, SUSPENSION, CASE_SPRING, MOUNT,
 LOCKUP_Z, LOCKUP_HELD, DAMPER_Z, CRANK_ANGLE, DISTANCE, WHEEL_ANGLE, OUTPUT_ANGLE) = range(29)
FIXED = 29

_SCALARS = """
engine_inertia air_lag air_delay torque_gain torque_offset friction_constant friction_viscous accessories idle_speed
idle_gain maximum_torque ripple ripple_order ripple_phase plate_inertia lockup_capacity lockup_static lockup_drag
slip_target slip_torque slip_reset_time
damper_stiffness damper_damping turbine_inertia gear_stiffness gear_damping gear_gap ratio gear_loss_constant
gear_loss_viscous gear_loss_fraction output_inertia output_drag shaft_inertia shaft_stiffness shaft_damping
pinion_inertia final_ratio mesh_stiffness mesh_damping mesh_gap mesh_loss_constant mesh_loss_fraction
mesh_loss_coast axle_drag stage_ratio stage_twist radius slip_stiffness relaxation_length tyre_limit body_mass
seat_mass seat_stiffness seat_damping axle_mass suspension_stiffness suspension_damping drag rolling weight grade
case_inertia case_stiffness case_damping lever_arm mount_compliance mount_inertia mount_stiffness mount_damping
axle_hardening oil_drag oil_time road_amplitude road_length out_of_round
""".split()
PARAMETERS = np.dtype(
    [(name, float) for name in _SCALARS]
    + [(name, np.int64) for name in ("other", "nodes", "hub", "suspended")]
    + [(name, float, (POINTS,)) for name in ("speed_ratio", "torque_ratio", "capacity")]
    + [(name, float, (CHAIN,)) for name in ("chain_inertia", "chain_stiffness", "chain_damping")])

OUTPUTS = ("engine_speed", "turbine_speed", "transmission_output_speed", "wheel_speed", "vehicle_speed",
           "propeller_shaft_torque", "seat_acceleration", "differential_acceleration", "crank_angle", "wheel_angle",
           "output_angle")


@dataclass(frozen=True)
class Recorded:
    """What happened, on an even clock that begins before the recording.

    Attributes:
        time: [s]; the recording begins at 0.
        signals: By name, SI; with the angles [rad] that sensors on a toothed wheel need.
    """

    time: np.ndarray
    signals: dict[str, np.ndarray]


def simulate(values: Mapping[str, float], gear: int, speed: float, torque_times: np.ndarray,
             torque: np.ndarray, duration: float, grade: float = 0.0, other: bool = False,
             step: float = 5e-4) -> Recorded:
    """Drive in one gear.

    Args:
        values: Parameters by structured name, as a vehicle file has them; ``outside.NAME`` beside them.
        gear: Forward gear, engaged throughout; the lock-up clutch is commanded closed.
        speed: Vehicle speed before the pre-roll [m/s].
        torque_times, torque: Requested crankshaft torque [N.m], linear between these instants [s].
        duration: Of the recording [s].
        grade: Slope of the road [rad].
        other: Whether the plant has the other structure.
        step: Distance of the recorded instants [s]; the solver chooses its own.

    Raises:
        InputError: No such gear, or something this model does not have.
        ArithmeticError: The solver gave up.
    """
    p = packed(values, gear, grade, other)
    time = np.arange(-PRE_ROLL, duration + 0.1, step)
    start = _start(p[0], speed, float(np.interp(-PRE_ROLL, torque_times, torque)))
    states, info = odeint(_rates, start, time, args=(p, torque_times, torque), tfirst=True, rtol=1e-7,
                          atol=1e-8, mxstep=20000, hmax=0.01, full_output=True)
    if info["message"] != "Integration successful." or not np.isfinite(states).all():
        raise ArithmeticError(f"the hidden plant in gear {gear}: {info['message']}")
    table = _outputs(time, states, p, torque_times, torque)
    return Recorded(time, {name: table[:, i] for i, name in enumerate(OUTPUTS)})


def packed(values: Mapping[str, float], gear: int, grade: float, other: bool) -> np.ndarray:
    """The numbers of the model from those of the full-order vehicle file."""
    v = dict(values)
    if v.get("dual_mass_flywheel.enabled"):
        raise InputError("a hidden plant with a dual-mass flywheel is not available")
    entry = f"[{gear + 2}]"
    if gear < 1 or not v.get("transmission.ratio" + entry):
        raise InputError(f"a hidden plant cannot drive in gear {gear}")
    get = v.get
    p = np.zeros(1, PARAMETERS)
    q = p[0]
    weight = v["vehicle.mass"] * GRAVITY
    radius = v["tyre.radius"]
    wheels = 2.0 * (v["hub.inertia"] + v["tyre.belt_inertia"])
    transfer = bool(v["transfer_case.enabled"])
    suspended = bool(v["suspension.enabled"])
    numbers = {
        "engine_inertia": v["engine.inertia"] + v["converter.impeller_inertia"],
        "air_lag": v["engine.air_lag"], "air_delay": v["engine.air_delay"],
        "torque_gain": v["engine.torque_gain"], "torque_offset": v["engine.torque_offset"],
        "friction_constant": v["engine.friction_constant"], "friction_viscous": v["engine.friction_viscous"],
        "accessories": v["engine.accessory_torque"], "idle_speed": v["engine.idle_speed"],
        "idle_gain": v["engine.idle_gain"], "maximum_torque": v["engine.maximum_torque"],
        "ripple": get("torque_ripple.amplitude", 0.0), "ripple_order": get("torque_ripple.order", 3.0),
        "ripple_phase": get("torque_ripple.phase", 0.0),
        "plate_inertia": v["lockup_clutch.plate_inertia"], "lockup_capacity": v["lockup_clutch.capacity"],
        "lockup_static": v["lockup_clutch.static_ratio"], "lockup_drag": v["lockup_clutch.drag"],
        "slip_target": get("slip_control.target", 0.0), "slip_torque": get("slip_control.torque", 20.0),
        "slip_reset_time": get("slip_control.reset_time", 0.2),
        "damper_stiffness": v["damper.stiffness"], "damper_damping": v["damper.damping"],
        "turbine_inertia": (v["converter.turbine_inertia"] + v["transmission.input_inertia"]
                            + v["transmission.inertia" + entry]),
        "gear_stiffness": v["transmission.stiffness"], "gear_damping": v["transmission.damping"],
        "gear_gap": v["transmission.half_gap"], "ratio": v["transmission.ratio" + entry],
        "gear_loss_constant": v["transmission.loss_constant" + entry],
        "gear_loss_viscous": v["transmission.loss_viscous" + entry],
        "gear_loss_fraction": v["transmission.loss_fraction" + entry],
        "output_inertia": (v["transmission.output_inertia"] + v["propeller_shaft.inertia"] / 4.0
                           + transfer * v["transfer_case.inertia"]),
        "output_drag": transfer * v["transfer_case.drag_viscous"],
        "shaft_inertia": v["propeller_shaft.inertia"] / 2.0, "shaft_stiffness": v["propeller_shaft.stiffness"],
        "shaft_damping": v["propeller_shaft.damping"],
        "pinion_inertia": v["final_drive.pinion_inertia"] + v["propeller_shaft.inertia"] / 4.0,
        "final_ratio": v["final_drive.ratio"], "mesh_stiffness": v["final_drive.mesh_stiffness"],
        "mesh_damping": v["final_drive.mesh_damping"], "mesh_gap": v["final_drive.half_gap"],
        "mesh_loss_constant": v["final_drive.loss_constant"], "mesh_loss_fraction": v["final_drive.loss_fraction"],
        "mesh_loss_coast": get("asymmetric_friction.coast_loss_fraction", 0.0),
        "axle_drag": get("coulomb_drag.torque", 0.0),
        "radius": radius, "slip_stiffness": 2.0 * v["tyre.slip_stiffness"],
        "relaxation_length": v["tyre.relaxation_length"],
        "tyre_limit": v["tyre.friction_coefficient"] * v["vehicle.driven_load_fraction"] * weight,
        "body_mass": (v["vehicle.mass"] + wheels / radius**2 - v["seat.mass"]
                      - suspended * v["suspension.unsprung_mass"]),
        "seat_mass": v["seat.mass"], "seat_stiffness": v["seat.stiffness"], "seat_damping": v["seat.damping"],
        "axle_mass": v["suspension.unsprung_mass"], "suspension_stiffness": v["suspension.stiffness"],
        "suspension_damping": v["suspension.damping"],
        "drag": 0.5 * v["vehicle.air_density"] * v["vehicle.drag_coefficient"] * v["vehicle.frontal_area"],
        "rolling": v["tyre.rolling_resistance"] * weight, "weight": weight,
        "grade": grade + get("input.road_grade.offset", 0.0),
        "case_inertia": v["differential_case.inertia"], "case_stiffness": v["differential_case.stiffness"],
        "case_damping": v["differential_case.damping"], "lever_arm": v["differential_case.lever_arm"],
        "mount_compliance": get("outside.engine_mount_coupling", 0.0), "mount_inertia": v["engine_mount.inertia"],
        "mount_stiffness": v["engine_mount.stiffness"], "mount_damping": v["engine_mount.damping"],
        "axle_hardening": get("outside.hardening_axle_shafts", 0.0),
        "oil_drag": get("outside.warming_oil", 0.0), "oil_time": 4.0,
        "road_amplitude": get("outside.wavy_road", 0.0), "road_length": 14.0,
        "out_of_round": get("outside.tyre_out_of_round", 0.0),
        "other": other, "suspended": suspended,
    }
    for name, number in numbers.items():
        q[name] = number
    for name in ("speed_ratio", "torque_ratio", "capacity"):
        q[name][:] = [v[f"converter.{name}[{i}]"] for i in range(1, POINTS + 1)]
    _chain(q, v, other)
    return p


def _chain(q: np.void, v: Mapping[str, float], other: bool) -> None:
    """Differential, axle shafts, hubs, tyres: both sides in one row of inertias, springs and dampers."""
    shaft, hub, belt = 2.0 * v["axle_shaft.inertia"], 2.0 * v["hub.inertia"], 2.0 * v["tyre.belt_inertia"]
    k_axle, c_axle = 2.0 * v["axle_shaft.stiffness"], 2.0 * v["axle_shaft.damping"]
    k_tyre, c_tyre = 2.0 * v["tyre.stiffness"], 2.0 * v["tyre.damping"]
    ratio, twist = v.get("axle_first_stage.stiffness_ratio", 1.0), v.get("axle_first_stage.twist", 0.0)
    if not other:
        inertia = [v["final_drive.ring_inertia"] + 0.5 * shaft, hub + 0.5 * shaft, belt]
        stiffness, damping, q["hub"] = [k_axle, k_tyre], [c_axle, c_tyre], 1
    else:
        parts = 4  # of the shaft, with as much inertia along its length
        inertia = [v["final_drive.ring_inertia"] + shaft / (2 * parts), *[shaft / parts] * (parts - 1),
                   hub + shaft / (2 * parts), 0.30 * belt, 0.40 * belt, 0.30 * belt]
        # three rings: most of the compliance in the sidewall, the rest in belt and tread
        shares = np.array([0.80, 0.12, 0.08])
        stiffness = [parts * k_axle] * parts + list(k_tyre / shares)
        damping = [parts * c_axle] * parts + list(c_tyre / shares)
        q["hub"] = parts
        twist /= parts  # every part has its stages
    q["nodes"] = len(inertia)
    q["chain_inertia"][:len(inertia)] = inertia
    q["chain_stiffness"][:len(stiffness)] = stiffness
    q["chain_damping"][:len(damping)] = damping
    q["stage_ratio"], q["stage_twist"] = ratio, twist


def _start(q: np.void, speed: float, torque: float) -> np.ndarray:
    """Rolling, wound up on the flank of the torque; the pre-roll does the rest."""
    n = int(q["nodes"])
    y = np.zeros(FIXED + 2 * n - 1)
    wheel = speed / q["radius"]
    output = wheel * q["final_ratio"]
    turbine = output * q["ratio"]
    y[[CRANK, PLATE, TURBINE]] = turbine
    y[[OUTPUT, SHAFT, PINION]] = output
    y[[BODY, SEAT, AXLE]] = speed
    y[FIXED:FIXED + n] = wheel
    side = 1.0 if torque > 5.0 else -1.0
    y[GEARS], y[HYPOID] = side * q["gear_gap"], side * q["mesh_gap"]
    y[LOCKUP_HELD] = abs(torque)
    y[AIR] = max(torque + q["friction_constant"] + q["friction_viscous"] * turbine, 0.0)
    return y


@numba.njit(cache=True)
def _flank(twist, rate, stiffness, damping, gap, soft):
    """Torque across a gap: a spring and a damper that push and never pull."""
    depth = abs(twist) - gap
    if depth <= 0.0:
        return 0.0
    side = 1.0 if twist > 0.0 else -1.0
    share = min(1.0, depth / 2e-4) if soft else 1.0
    return side * max(0.0, stiffness * depth + damping * share * side * rate)


@numba.njit(cache=True)
def _rates(t, y, p, torque_times, torque):
    q = p[0]
    n = q.nodes
    d = np.zeros(y.size)
    w = y[CRANK]

    # engine: air path behind its delay, fuel cut, friction
    request = np.interp(t - q.air_delay, torque_times, torque)
    running = np.tanh(w / 5.0)
    friction = q.friction_constant * running + q.friction_viscous * w
    target = min(max(request + friction, q.idle_gain * (q.idle_speed - w), 0.0), q.maximum_torque)
    air = target
    if q.air_lag > 0.0:
        air = y[AIR]
        d[AIR] = (target - air) / q.air_lag
    engine = q.torque_gain * air + running * (q.torque_offset - q.accessories) - friction
    if q.ripple > 0.0:
        engine += running * q.ripple * np.sin(q.ripple_order * y[CRANK_ANGLE] + q.ripple_phase)

    # converter beside its lock-up clutch
    pump, runner = 0.0, 0.0
    fast, slow = max(w, y[TURBINE]), min(w, y[TURBINE])
    if fast > 0.0:
        pump = np.interp(slow / fast, q.speed_ratio, q.capacity) * fast * fast
        runner = pump
        if w >= y[TURBINE]:
            runner = pump * np.interp(slow / fast, q.speed_ratio, q.torque_ratio)
        else:
            pump, runner = -pump, -pump
    slip = w - y[PLATE]
    limit = q.lockup_capacity * (1.0 + (q.lockup_static - 1.0) * np.exp(-slip * slip))
    if q.slip_target > 0.0:  # proportional and integral control, which does not wind up
        more = q.slip_torque * (abs(slip) / q.slip_target - 1.0)
        asked = y[LOCKUP_HELD] + more
        # where a rate jumped to nothing at an end, an implicit step that ends there would not exist
        room = y[LOCKUP_HELD] if more < 0.0 else limit - asked
        d[LOCKUP_HELD] = more / q.slip_reset_time * min(max(room / SOFT_END, 0.0), 1.0)
        limit = min(max(asked, 0.0), limit)
    if q.other:
        z = y[LOCKUP_Z]
        d[LOCKUP_Z] = 300.0 * (slip - abs(slip) * z)
        lockup = limit * z + 0.02 * limit * d[LOCKUP_Z] / 300.0
    else:
        lockup = limit * np.tanh(slip / 0.05)
    lockup += q.lockup_drag * slip
    rate = y[PLATE] - y[TURBINE]
    d[DAMPER] = rate
    if q.other:  # hysteresis in place of three quarters of the viscous damping
        z = y[DAMPER_Z]
        d[DAMPER_Z] = (rate - abs(rate) * z) / 3e-3
        damper = q.damper_stiffness * y[DAMPER] + 0.25 * q.damper_damping * rate + 3.0 * z
    else:
        damper = q.damper_stiffness * y[DAMPER] + q.damper_damping * rate

    # gearbox, propeller shaft, final drive
    rate = y[TURBINE] - q.ratio * y[OUTPUT]
    if q.mount_compliance > 0.0:
        rate += (q.ratio - 1.0) * y[ROLL]
    d[GEARS] = rate
    gears = _flank(y[GEARS], rate, q.gear_stiffness, q.gear_damping, q.gear_gap, q.other)
    gear_loss = ((q.gear_loss_constant + q.gear_loss_fraction * abs(gears)) * np.tanh(y[TURBINE])
                 + q.gear_loss_viscous * y[TURBINE])
    d[FRONT] = y[OUTPUT] - y[SHAFT]
    front = 2.0 * (q.shaft_stiffness * y[FRONT] + q.shaft_damping * d[FRONT])
    d[REAR] = y[SHAFT] - y[PINION]
    rear = 2.0 * (q.shaft_stiffness * y[REAR] + q.shaft_damping * d[REAR])
    ring = y[FIXED]
    d[HYPOID] = y[PINION] - q.final_ratio * ring
    hypoid = _flank(y[HYPOID], d[HYPOID], q.mesh_stiffness, q.mesh_damping, q.mesh_gap, q.other)
    share = q.mesh_loss_fraction
    if hypoid * y[PINION] < 0.0:
        share += q.mesh_loss_coast
    mesh_loss = (q.mesh_loss_constant + share * abs(hypoid)) * np.tanh(y[PINION])
    oil = q.oil_drag * np.exp(-(t + 2.0) / q.oil_time) * y[SHAFT]

    # differential to tread
    first = FIXED + n
    last = FIXED + n - 1
    for i in range(n - 1):
        a, b = y[FIXED + i], y[FIXED + i + 1]
        twist = y[first + i]
        d[first + i] = a - b
        link = q.chain_stiffness[i] * twist + q.chain_damping[i] * (a - b)
        if i < q.hub and q.stage_twist > 0.0:
            inner = min(max(twist, -q.stage_twist), q.stage_twist)
            link -= q.chain_stiffness[i] * (1.0 - q.stage_ratio) * inner
        if i < q.hub and q.axle_hardening > 0.0:
            link += q.axle_hardening * (q.hub * twist) ** 3
        d[FIXED + i] -= link
        d[FIXED + i + 1] += link
    d[FIXED] += q.final_ratio * hypoid - q.axle_drag * np.tanh(ring / 0.02)
    carrier = y[AXLE] if q.suspended else y[BODY]
    sliding = q.radius * y[last] - carrier
    rolling = abs(q.radius * y[last]) / q.relaxation_length
    stiffness = q.slip_stiffness / q.relaxation_length
    if q.other:
        d[TREAD] = sliding - rolling * y[TREAD]
        force = stiffness * y[TREAD] / (1.0 + abs(y[TREAD]) * stiffness / q.tyre_limit)
    else:
        d[TREAD] = sliding - (rolling + abs(sliding) * stiffness / q.tyre_limit) * y[TREAD]
        force = stiffness * y[TREAD]
    d[last] -= q.radius * force
    bump = q.out_of_round * np.sin(y[WHEEL_ANGLE])  # a heavy spot lifts and pushes the axle

    # vehicle
    slope = q.grade
    if q.road_amplitude > 0.0:
        slope += q.road_amplitude * np.sin(2.0 * np.pi * y[DISTANCE] / q.road_length)
    d[SEAT_TRACK] = y[BODY] - y[SEAT]
    seat = q.seat_stiffness * y[SEAT_TRACK] + q.seat_damping * d[SEAT_TRACK]
    load = (q.drag * y[BODY] * abs(y[BODY]) + q.rolling * np.cos(slope) * np.tanh(y[BODY] / 0.02)
            + q.weight * np.sin(slope) + seat)
    push = force + bump
    if q.suspended:
        d[SUSPENSION] = y[AXLE] - y[BODY]
        push = q.suspension_stiffness * y[SUSPENSION] + q.suspension_damping * d[SUSPENSION]
        d[AXLE] = (force + bump - push) / q.axle_mass
    d[BODY] = (push - load) / q.body_mass
    d[SEAT] = seat / q.seat_mass

    # housings: read out, but for a powertrain that rolls enough to be felt
    d[CASE_SPRING] = y[CASE]
    d[CASE] = (-q.final_ratio * hypoid - q.case_stiffness * y[CASE_SPRING] - q.case_damping * y[CASE]) / q.case_inertia
    if q.mount_compliance > 0.0:
        d[MOUNT] = y[ROLL]
        hard = 1.0 + (y[MOUNT] / 0.03) ** 2
        d[ROLL] = (-q.mount_compliance * (engine + (q.ratio - 1.0) * gears)
                   - q.mount_stiffness * hard * y[MOUNT] - q.mount_damping * y[ROLL]) / q.mount_inertia

    d[CRANK] = (engine - pump - lockup) / q.engine_inertia
    d[PLATE] = (lockup - damper) / q.plate_inertia
    d[TURBINE] = (runner + damper - gears - gear_loss) / q.turbine_inertia
    d[OUTPUT] = (q.ratio * gears - front - q.output_drag * y[OUTPUT]) / q.output_inertia
    d[SHAFT] = (front - rear - oil) / q.shaft_inertia
    d[PINION] = (rear - hypoid - mesh_loss) / q.pinion_inertia
    for i in range(n):
        d[FIXED + i] /= q.chain_inertia[i]
    d[CRANK_ANGLE] = w
    d[DISTANCE] = y[BODY]
    d[WHEEL_ANGLE] = y[FIXED + q.hub]
    d[OUTPUT_ANGLE] = y[OUTPUT]
    return d


@numba.njit(cache=True)
def _outputs(time, states, p, torque_times, torque):
    q = p[0]
    table = np.empty((time.size, 11))
    for i in range(time.size):
        y = states[i]
        d = _rates(time[i], y, p, torque_times, torque)
        table[i, 0] = y[CRANK]
        table[i, 1] = y[TURBINE]
        table[i, 2] = y[OUTPUT]
        table[i, 3] = y[FIXED + q.hub]
        table[i, 4] = y[BODY]
        table[i, 5] = 2.0 * (q.shaft_stiffness * y[FRONT] + q.shaft_damping * (y[OUTPUT] - y[SHAFT]))
        table[i, 6] = d[SEAT]
        table[i, 7] = q.lever_arm * d[CASE]
        table[i, 8] = y[CRANK_ANGLE]
        table[i, 9] = y[WHEEL_ANGLE]
        table[i, 10] = y[OUTPUT_ANGLE]
    return table
