"""The reduced plants: against equations of their own, against each other, against the full-order one."""

import re
from pathlib import Path

import numpy as np
import pytest
from runs import REDUCED, ledger, plant, run, start_values, steps, turnover
from scipy.integrate import solve_ivp

from driveline import vehicles
from driveline.models import MODELS
from driveline.plants.full_order import FullOrderParameters
from driveline.plants.linear import shuffle_mode
from driveline.plants.reduced import reduce
from driveline.quantities import InputError, from_values, parameter_variables
from driveline.vehicles import load

TIP = ((0.0, -30.0), (0.1, 130.0), (0.6, -40.0))
DRIVE = {"engine_torque": steps(*TIP)}


def full_order(vehicle="pickup_10r80", variant="modified", **changes):
    values = {**load(vehicle, variant).values, **{name.replace("__", "."): x for name, x in changes.items()}}
    return from_values(FullOrderParameters, values)


def worst(first, second, signal):
    return np.abs(first[signal] - second[signal]).max() / np.abs(first[signal]).max()


# -- a one-page model of the 3DOF plant, with the lash angle as a state (thesis eq. 2.7) -------------------


def one_page_3dof(p, start, pieces, times):
    """Engine, rims and vehicle while it rolls forward; DOP853 between located contacts.

    Args:
        p: Parameters of the 3DOF plant.
        start: Engine, final drive and wheel speed, total twist, lash angle, tyre twist.
        pieces: (time from which, engine torque).
        times: When to give the engine speed, the wheel speed and the propeller shaft torque.

    Returns:
        These three at ``times``, and the instants of contact and separation.
    """
    i, f, r = p.gear.transmission_ratio, p.gear.final_drive_ratio, p.vehicle.tyre_radius
    k, c, alpha = p.shaft.stiffness, p.shaft.damping, p.shaft.half_gap
    vehicle = p.wheel_inertia + p.vehicle.mass * r**2

    def would_be_torque(x):
        return k * (x[3] - x[4]) + c * (x[0] / i - f * x[1])

    def slope(t, x, engine_torque, flank):
        shaft = would_be_torque(x) if flank else 0.0
        loss = ((p.gear.loss_constant + p.gear.loss_fraction * abs(shaft)) * np.tanh(x[0])
                + p.gear.loss_viscous * x[0])
        tyre = p.wheel_shaft.stiffness * x[5] + p.wheel_shaft.damping * (x[1] - x[2])
        air = p.vehicle.aerodynamic_factor * (r * x[2]) ** 2
        return np.array([
            (engine_torque - loss - shaft / i) / p.engine_inertia,
            (f * shaft - tyre) / p.final_drive_inertia,
            (tyre - r * (air + p.vehicle.rolling_resistance_force)) / vehicle,
            x[0] / i - f * x[1],
            0.0 if flank else x[0] / i - f * x[1] + k / c * (x[3] - x[4]),
            x[1] - x[2]])

    x, t, flank = np.array(start), 0.0, int(np.sign(start[4]))
    results, instants = [], []
    ends = [time for time, _ in pieces[1:]] + [times[-1]]
    for (_, torque), end in zip(pieces, ends, strict=True):
        while t < end:
            if flank:  # until the torque would pull the flank
                events = [lambda s, x, *a, flank=flank: would_be_torque(x) * flank]
            else:      # until one flank or the other is met
                events = [lambda s, x, *a: alpha - x[4], lambda s, x, *a: x[4] + alpha]
            for event in events:
                event.direction, event.terminal = -1, True
            path = solve_ivp(slope, (t, end), x, "DOP853", args=(torque, flank), events=events,
                             rtol=1e-11, atol=1e-13, dense_output=True)
            t, x = path.t[-1], path.y[:, -1].copy()
            inside = times[(times > path.t[0]) & (times <= t)]
            for y in path.sol(inside).T if inside.size else ():
                results.append((y[0], y[2], would_be_torque(y) if flank else 0.0))
            if path.status == 1:
                instants.append(t)
                if flank:
                    flank = 0
                else:
                    flank = 1 if len(path.t_events[0]) else -1
                    x[4] = flank * alpha
    return np.array(results).T, np.array(instants)


def test_the_3dof_plant_converges_with_order_four_to_a_solution_of_its_equations():
    changes = {"start.vehicle_speed": 12.0}
    model = plant("plant_rom_3dof", changes, engine_torque=-30.0)
    s = dict(zip((entry.name for entry in model.network.entries), model.state))
    start = [s["engine_speed"], s["final_drive_speed"], s["wheel_speed"], s["shaft_twist"],
             s["shaft_twist"] - s["shaft_shaft_twist"], s["wheel_shaft_twist"]]
    times = np.arange(1, 251) * 4e-3
    (engine, wheel, torque), instants = one_page_3dof(model.parameters, start, TIP, times)
    assert instants.size >= 8
    errors = []
    for substep in (2e-3, 1e-3, 5e-4):
        model = plant("plant_rom_3dof", {**changes, "solver.maximum_substep": substep}, engine_torque=-30.0)
        record = run(model, 1.0, 4e-3, **DRIVE)
        errors.append([np.abs(record[name] - exact).max() for name, exact in (
            ("engine_speed", engine), ("wheel_speed", wheel), ("propeller_shaft_torque", torque))])
    errors = np.array(errors)
    assert (np.log2(errors[0] / errors[2]) / 2.0 > 3.5).all(), errors
    model = plant("plant_rom_3dof", changes, engine_torque=-30.0)
    record = run(model, 1.0, 4e-3, **DRIVE)
    assert np.abs(record["propeller_shaft_torque"] - torque).max() < 1e-7 * np.abs(torque).max()
    # contacts fall where the solution has them: the mode as recorded every 4 ms agrees
    modes = np.concatenate([[-1.0], record["contact"]])
    changed = np.floor(instants / 4e-3).astype(int)
    odd = np.bincount(changed, minlength=times.size) == 1
    assert (np.diff(modes)[odd[:times.size]] != 0.0).all()


# -- limits in which one model is another -----------------------------------------------------------------


def test_a_3dof_plant_with_rigid_tyres_is_the_2dof_plant():
    """The difference goes with 1 / k_w."""
    two = {"start.vehicle_speed": 12.0, "solver.maximum_substep": 2e-5}
    three_values = start_values("plant_rom_3dof", "pickup_10r80", "modified", 5)
    shaft = {name: three_values[name] for name in ("shaft.stiffness", "shaft.damping", "shaft.half_gap")}
    reference = run(plant("plant_rom_2dof", {**two, **shaft, "wheel_inertia": three_values["wheel_inertia"]
                                             + three_values["final_drive_inertia"]}, engine_torque=-30.0),
                    1.0, **DRIVE)
    differences = []
    for stiffness in (1e8, 1e9):
        stiff = {"wheel_shaft.stiffness": stiffness, "wheel_shaft.damping": 2e-5 * stiffness**0.5 * 1e3}
        record = run(plant("plant_rom_3dof", {**two, **stiff}, engine_torque=-30.0), 1.0, **DRIVE)
        differences.append(worst(reference, record, "engine_speed"))
    assert differences[1] < 1e-4
    assert differences[1] < 0.2 * differences[0]


@pytest.mark.parametrize("rigid", ["transmission_shaft", "shaft"])
def test_a_split_plant_with_one_rigid_lashless_side_is_the_lumped_one(rigid):
    """The light inertia then turns with its neighbour; the difference goes with one over stiffness.

    Without a loss over the torque carried, which the two take from different shafts.
    """
    values = start_values("plant_rom_3dof_split", "pickup_10r80", "modified", 5)
    ratio, final = values["gear.transmission_ratio"], values["gear.final_drive_ratio"]
    kept = "shaft" if rigid == "transmission_shaft" else "transmission_shaft"
    gap, output = 0.06, values["output_inertia"]
    lumped = {f"shaft.{x}": values[f"{kept}.{x}"] for x in ("stiffness", "damping")} | {"shaft.half_gap": gap}
    if rigid == "transmission_shaft":
        lumped |= {"engine_inertia": values["engine_inertia"] + output / ratio**2}
    else:
        lumped |= {"engine_inertia": values["engine_inertia"],
                   "final_drive_inertia": values["final_drive_inertia"] + output * final**2}
    common = {"start.vehicle_speed": 12.0, "solver.maximum_substep": 1e-5, "gear.loss_fraction": 0.0}
    reference = run(plant("plant_rom_3dof", {**common, **lumped}, engine_torque=-30.0), 0.8, **DRIVE)
    differences = []
    for stiffness in (3e6, 3e7):
        split = {f"{rigid}.half_gap": 0.0, f"{rigid}.stiffness": stiffness, f"{kept}.half_gap": gap,
                 f"{rigid}.damping": 0.02 * np.sqrt(stiffness)}
        record = run(plant("plant_rom_3dof_split", {**common, **split}, engine_torque=-30.0), 0.8, **DRIVE)
        differences.append(worst(reference, record, "engine_speed"))
    assert differences[1] < 1e-4
    assert differences[1] < 0.2 * differences[0]


STIFF = {  # a vehicle of which only hypoid mesh and tyre sidewalls give way; nothing is lost in gears
    "engine.air_lag": 0.0, "engine.air_delay": 0.0, "engine.accessory_torque": 0.0, "engine.idle_gain": 0.0,
    "engine.friction_constant": 200.0, "damper.stiffness": 3e6, "damper.damping": 100.0,
    "transmission.stiffness": 3e6, "transmission.damping": 100.0, "transmission.half_gap": 0.0,
    "propeller_shaft.stiffness": 3e6, "propeller_shaft.damping": 100.0, "axle_shaft.stiffness": 1e7,
    "axle_shaft.damping": 500.0, "final_drive.mesh_stiffness": 4000.0, "final_drive.mesh_damping": 6.0,
    "tyre.stiffness": 2e4, "tyre.damping": 60.0, "tyre.slip_stiffness": 3e7, "tyre.friction_coefficient": 1e3,
    "seat.mass": 1.0, "final_drive.loss_constant": 0.0, "final_drive.loss_fraction": 0.0,
    **{f"transmission.loss_{kind}[{i}]": 0.0
       for kind in ("constant", "viscous", "fraction") for i in range(1, 13)},
}


@pytest.mark.parametrize("gear", [1, 5])
def test_a_full_order_plant_that_is_stiff_but_in_two_places_is_the_3dof_plant(gear):
    """Same vehicle file, reduced by ``reduce``: the same tip-in, both lash crossings included.

    What is left goes with the compliance that is left. The torque is compared by its mean square:
    it jumps at a contact, and a contact a microsecond late is a large difference for as long.
    """
    speed = 12.0 if gear == 5 else 5.0
    common = {"start.vehicle_speed": speed, "solver.maximum_substep": 2e-5}
    full = run(plant("plant_fom", {**STIFF, **common}, gear=gear, engine_torque=-30.0), 1.0, **DRIVE)
    values = {**load("pickup_10r80", "modified").values, **STIFF}
    three = reduce(from_values(FullOrderParameters, values), gear, speed, 100.0).three_mass
    flat = {"engine_inertia": three.engine_inertia, "final_drive_inertia": three.final_drive_inertia,
            "wheel_inertia": three.wheel_inertia}
    for group in ("shaft", "wheel_shaft", "gear", "vehicle"):
        flat |= {f"{group}.{name}": value for name, value in vars(getattr(three, group)).items()}
    lumped = run(plant("plant_rom_3dof", {**flat, **common}, gear=gear, engine_torque=-30.0), 1.0, **DRIVE)
    assert worst(full, lumped, "engine_speed") < 3e-4
    assert worst(full, lumped, "vehicle_speed") < 1e-4
    assert worst(full, lumped, "lash_position") < 1e-2
    torque = full["propeller_shaft_torque"]
    assert np.std(torque - lumped["propeller_shaft_torque"]) < 0.01 * np.abs(torque).max()
    crossings = [np.flatnonzero(np.diff(record[name]) > 0.0) for record, name in (
        (full, "final_drive_contact"), (lumped, "contact"))]
    assert abs(int(crossings[0][0]) - int(crossings[1][0])) <= 1


# -- what ``reduce`` does ---------------------------------------------------------------------------------


@pytest.mark.parametrize("gear", [-1, *range(1, 11)])
def test_all_reduced_models_have_the_inertia_lash_and_static_stiffness_of_the_full_order_one(gear):
    p = full_order()
    reduced = reduce(p, gear)
    box, prop, r = p.transmission, p.propeller_shaft, p.tyre.radius
    i, f = box.ratio[gear + 1], p.final_drive.ratio
    wheels = 2.0 * (p.hub.inertia + p.tyre.belt_inertia)
    turning = (p.engine.inertia + p.converter.impeller_inertia + p.lockup_clutch.plate_inertia
               + p.converter.turbine_inertia + box.input_inertia + box.inertia[gear + 1])
    output = box.output_inertia + prop.inertia + p.final_drive.pinion_inertia
    felt = (turning * (i * f) ** 2 + output * f**2 + p.final_drive.ring_inertia + 2.0 * p.axle_shaft.inertia
            + wheels + p.vehicle.mass * r**2 + wheels)
    for kind in ("two_mass", "three_mass", "split_lash"):
        m = getattr(reduced, kind)
        rolling = m.engine_inertia * (i * f) ** 2 + m.wheel_inertia + m.vehicle.mass * r**2
        rolling += getattr(m, "final_drive_inertia", 0.0) + getattr(m, "output_inertia", 0.0) * f**2
        assert rolling == pytest.approx(felt, rel=1e-12), kind
        gap = m.shaft.half_gap + (m.transmission_shaft.half_gap if kind == "split_lash" else 0.0)
        assert gap == pytest.approx(box.half_gap / abs(i) + p.final_drive.half_gap, rel=1e-12)
        assert m.shaft.stiffness > 0.0 and m.shaft.damping > 0.0
        # drag at the engine while it turns at 150 rad/s and carries nothing
        drag = m.gear.loss_constant + m.gear.loss_viscous * 150.0
        assert drag == pytest.approx(box.loss_constant[gear + 1] + box.loss_viscous[gear + 1] * 150.0
                                     + p.final_drive.loss_constant / abs(i), rel=1e-12)
    three, split = reduced.three_mass, reduced.split_lash
    series = 1.0 / (1.0 / split.transmission_shaft.stiffness + 1.0 / split.shaft.stiffness)
    assert three.shaft.stiffness == pytest.approx(series, rel=0.02)
    axle = p.axle_shaft.stiffness * 2.0 / f**2
    springs = (p.damper.stiffness * i**2, box.stiffness * i**2, prop.stiffness,
               p.final_drive.mesh_stiffness, axle)
    static = 1.0 / sum(1.0 / stiffness for stiffness in springs)
    assert three.shaft.stiffness == pytest.approx(static, rel=0.02)


@pytest.mark.parametrize("gear", [-1, 1, 3, 5, 10])
@pytest.mark.parametrize(("torque", "grade"), [(-30.0, 0.0), (100.0, 0.0), (100.0, 0.1), (30.0, -0.1)])
def test_reduced_and_full_order_plants_accelerate_alike(gear, torque, grade):
    """Same losses, loads and inertias where they act, and the same weight; without accessories, which are no
    driveline's."""
    start = {"start.vehicle_speed": np.sign(gear) * {1: 4.0, -1: 4.0}.get(gear, 14.0)}
    full = plant("plant_fom", {**start, "engine.accessory_torque": 0.0}, gear=gear, engine_torque=torque,
                 road_grade=grade)
    scale = abs(full["axle_shaft_torque"]) / full["tyre.radius"] / full["vehicle.mass"] + 0.05
    for name in REDUCED:
        reduced = plant(name, start, gear=gear, engine_torque=torque, road_grade=grade)
        assert abs(reduced["vehicle_acceleration"] - full["vehicle_acceleration"]) < 0.01 * scale, name


@pytest.mark.parametrize("name", REDUCED)
@pytest.mark.parametrize("grade", [0.25, -0.4])
def test_a_brake_holds_what_the_rolling_resistance_leaves_of_the_grade(name, grade):
    p = plant(name).parameters.vehicle
    needed = p.tyre_radius * (p.weight * abs(np.sin(grade)) - p.rolling_resistance_force * np.cos(grade))
    for share, moves in ((1.0005, False), (0.9995, True)):
        model = plant(name, brake_torque=needed, road_grade=grade)
        run(model, 2.0, brake_torque=1.1 * needed)
        record = run(model, 1.0, start=2.0, brake_torque=share * needed)
        assert (abs(record["vehicle_speed"][-1]) > 1e-4) == moves
        assert not moves or record["vehicle_speed"][-1] * grade < 0.0


def test_what_only_turns_is_less_than_the_mass():
    with pytest.raises(InputError, match="vehicle.rolling_mass is 3000 kg: less than vehicle.mass"):
        plant("plant_rom_3dof", {"vehicle.rolling_mass": 3000.0})


@pytest.mark.parametrize("gear", [0, 11, -2])
def test_a_gear_that_is_not_there_cannot_be_reduced(gear):
    with pytest.raises(InputError, match="gear"):
        reduce(full_order(), gear)


def test_a_gear_without_a_ratio_cannot_be_reduced():
    with pytest.raises(InputError, match="gear is 7"):
        reduce(full_order("suv_6l80", None), 7)


def test_more_torque_than_the_tyres_hold_cannot_be_reduced():
    with pytest.raises(InputError, match="torque"):
        reduce(full_order(), 1, torque=2000.0)


@pytest.mark.parametrize("name", REDUCED)
@pytest.mark.parametrize("gear", [-1, 1, 10])
def test_every_gear_drives_and_keeps_its_energy(name, gear):
    speed = {-1: -3.0, 1: 4.0, 10: 20.0}[gear]
    model = plant(name, {"start.vehicle_speed": speed}, gear=gear, engine_torque=-20.0)
    record = run(model, 4.0, engine_torque=steps((0.0, -20.0), (0.5, 120.0), (1.5, -40.0), (2.0, 100.0)))
    assert np.ptp(ledger(record)) < 1e-8 * turnover(record)
    assert set(record["contact"]) >= {-1.0, 1.0}
    ratio = model["gear.transmission_ratio"] * model["gear.final_drive_ratio"]
    mean_engine, mean_wheel = record["engine_speed"].mean(), record["wheel_speed"].mean()
    assert mean_engine == pytest.approx(ratio * mean_wheel, rel=0.02)
    assert mean_engine > 0.0


@pytest.mark.parametrize("name", REDUCED)
def test_a_torque_accelerates_the_whole_reflected_inertia(name):
    quiet = {"gear.loss_constant": 0.0, "gear.loss_viscous": 0.0, "gear.loss_fraction": 0.0,
             "vehicle.rolling_resistance_force": 0.0, "vehicle.aerodynamic_factor": 0.0}
    model = plant(name, {**quiet, "start.vehicle_speed": 10.0}, engine_torque=80.0, road_grade=0.02)
    p = model.parameters
    i, f, r = p.gear.transmission_ratio, p.gear.final_drive_ratio, p.vehicle.tyre_radius
    felt = (p.engine_inertia * (i * f) ** 2 + getattr(p, "output_inertia", 0.0) * f**2
            + getattr(p, "final_drive_inertia", 0.0) + p.wheel_inertia) / r**2 + p.vehicle.mass
    force = 80.0 * i * f / r - p.vehicle.weight * np.sin(0.02)
    assert model["vehicle_acceleration"] == pytest.approx(force / felt, rel=1e-9)


@pytest.mark.parametrize("name", REDUCED)
@pytest.mark.parametrize("changes", [
    {"coulomb_drag.torque": 300.0}, {"transfer_case.enabled": 1.0, "transfer_case.drag_viscous": 0.5},
    {"transfer_case.enabled": 1.0, "transfer_case.drag_viscous": 0.5, "coulomb_drag.torque": 100.0}])
def test_what_drags_in_the_full_order_plant_drags_in_the_reduced_ones(name, changes):
    start = {"start.vehicle_speed": 12.0}
    vehicle = load("pickup_10r80", "modified")
    speeds = []
    for extra in ({}, changes):
        full = plant("plant_fom", {**start, "engine.accessory_torque": 0.0, **extra}, engine_torque=20.0)
        parts = reduce(from_values(FullOrderParameters, {**vehicle.values, **extra}))
        kind = {"plant_rom_2dof": "two_mass", "plant_rom_3dof": "three_mass"}.get(name, "split_lash")
        values = {v.name: v.start for v in parameter_variables(getattr(parts, kind))}
        speeds.append([run(model, 3.0)["vehicle_speed"][-1]
                       for model in (full, plant(name, {**values, **start}, engine_torque=20.0))])
    lost = np.subtract(*speeds)
    assert lost[0] > 0.3
    assert lost[1] == pytest.approx(lost[0], rel=0.02)


def test_a_dual_mass_flywheel_is_in_the_shuffle_of_the_reduced_models():
    """Half as stiff as the rest of the driveline at the engine: it takes a tenth of the frequency."""
    values = {**load("pickup_10r80", "modified").values, "dual_mass_flywheel.enabled": 1.0}
    rolling = {"start.vehicle_speed": 12.0}
    full = shuffle_mode(plant("plant_fom", {**rolling, "dual_mass_flywheel.enabled": 1.0}, engine_torque=120.0))
    without = shuffle_mode(plant("plant_fom", rolling, engine_torque=120.0))
    three = {v.name: v.start for v in parameter_variables(reduce(from_values(FullOrderParameters, values)).three_mass)}
    reduced = shuffle_mode(plant("plant_rom_3dof", {**three, **rolling}, engine_torque=120.0))
    assert full.frequency < 0.9 * without.frequency
    assert reduced.frequency == pytest.approx(full.frequency, rel=0.03)


@pytest.mark.parametrize("name", REDUCED)
def test_a_gear_without_ratio_is_named(name):
    model = plant(name, initialize=False)
    model["gear.transmission_ratio"] = 0.0
    with pytest.raises(InputError, match="gear.transmission_ratio is 0"):
        model.initialize()


@pytest.mark.parametrize("name", REDUCED)
@pytest.mark.parametrize("text", [
    'stiffness = { value = 15.5, unit = "Nm/rad"', 'stiffness = { value = -1, unit = "kN.m/rad"',
    'colour = { value = 1, unit = "1", source = "looked" }\nstiffness = { value = 15.5, unit = "kN.m/rad"'])
def test_a_vehicle_file_is_as_wrong_for_a_reduced_plant_as_for_the_full_order_one(name, text, tmp_path):
    given = (Path(vehicles.__file__).parent / "pickup_10r80.toml").read_text()
    right = re.search(r"(?m)^\[axle_shaft\][^\[]*?^(stiffness = \{ value = [^,]*, unit = [^,]*)", given)
    assert right
    path = tmp_path / "car.toml"
    path.write_text(given[:right.start(1)] + text + given[right.end(1):])
    for model in ("plant_fom", name):
        with pytest.raises(InputError, match="car.toml, line"):
            MODELS[model].defaults_from(load(path))
