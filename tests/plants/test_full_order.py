"""The full-order plant: kinematics, inertia as felt, momentum, gear changes, standstill, converter."""

import re
from importlib import resources

import numpy as np
import pytest
from runs import events, input_rows, ledger, plant, run, start_values, steps, turnover

from driveline.elements.road_load import GRAVITY
from driveline.kernels import layout as k
from driveline.plants.full_order import FullOrderPlant
from driveline.vehicles import load

GEARS = range(1, 11)
FREE = {  # no load from outside but the engine's torque, which is what is asked for
    "engine.friction_constant": 0.0, "engine.friction_viscous": 0.0, "engine.accessory_torque": 0.0,
    "engine.idle_gain": 0.0, "engine.air_lag": 0.0, "engine.air_delay": 0.0, "final_drive.loss_constant": 0.0,
    "final_drive.loss_fraction": 0.0, "tyre.rolling_resistance": 0.0, "vehicle.drag_coefficient": 0.0,
    **{f"transmission.loss_{kind}[{i}]": 0.0
       for kind in ("constant", "viscous", "fraction") for i in range(1, 13)},
}


def felt_inertias(model, gear):
    """Inertia of every node, and its speed over the vehicle's when everything rolls, from the parameters."""
    p = model.parameters
    box, prop, r = p.transmission, p.propeller_shaft, p.tyre.radius
    wheel, output = 1.0 / r, p.final_drive.ratio / r
    turbine = output * box.ratio[gear + 1]
    front_wheels = 2.0 * (p.hub.inertia + p.tyre.belt_inertia) / r**2
    dmf = p.dual_mass_flywheel.secondary_inertia if p.dual_mass_flywheel.enabled else 0.0
    transfer = p.transfer_case.inertia if p.transfer_case.enabled else 0.0
    turning = (p.engine.inertia + dmf + p.converter.impeller_inertia + p.lockup_clutch.plate_inertia
               + p.converter.turbine_inertia + box.input_inertia + box.inertia[gear + 1])
    return {
        "turbine": (turning, turbine),
        "output": (box.output_inertia + transfer + prop.inertia + p.final_drive.pinion_inertia, output),
        "wheels": (p.final_drive.ring_inertia
                   + 2.0 * (p.axle_shaft.inertia + p.hub.inertia + p.tyre.belt_inertia), wheel),
        "vehicle": (p.vehicle.mass + front_wheels, 1.0),
    }


@pytest.mark.parametrize("vehicle, gears", [("pickup_10r80", (-1, *GEARS)), ("suv_6l80", (-1, *range(1, 7)))])
def test_rolling_steadily_all_speeds_are_in_the_ratios(vehicle, gears):
    """Without torque in the tyres there is no slip: nothing but ratios between engine and road."""
    for gear in gears:
        model = plant("plant_fom", {**FREE, "start.vehicle_speed": 10.0 * np.sign(gear)}, vehicle=vehicle,
                      variant=None, gear=gear)
        record = run(model, 0.2)
        p = model.parameters
        wheel = record["vehicle_speed"] / p.tyre.radius
        output = wheel * p.final_drive.ratio
        assert record["wheel_speed"] == pytest.approx(wheel, rel=1e-9)
        assert record["transmission_output_speed"] == pytest.approx(output, rel=1e-9)
        assert record["turbine_speed"] == pytest.approx(output * p.transmission.ratio[gear + 1], rel=1e-9)
        assert record["engine_speed"] == pytest.approx(record["turbine_speed"], rel=1e-9)
        assert record["engine_speed"][0] > 0.0


@pytest.mark.parametrize("options", [{}, {"dual_mass_flywheel.enabled": 1.0}, {"transfer_case.enabled": 1.0,
                                     "transfer_case.drag_viscous": 0.0}, {"suspension.enabled": 1.0}])
@pytest.mark.parametrize("gear", [-1, *GEARS])
def test_a_torque_accelerates_the_whole_reflected_inertia(gear, options):
    """a = (T i i_f / r - m g sin(grade) - brake / r) / sum of inertia times (speed over vehicle's) squared."""
    torque, grade, brake = 60.0, 0.03, 250.0
    model = plant("plant_fom", {**FREE, **options, "start.vehicle_speed": 8.0 * np.sign(gear)}, gear=gear,
                  engine_torque=torque, road_grade=grade, brake_torque=brake)
    parts = felt_inertias(model, gear)
    felt = sum(inertia * ratio**2 for inertia, ratio in parts.values())
    force = (torque * parts["turbine"][1] - model["vehicle.mass"] * GRAVITY * np.sin(grade)
             - np.sign(gear) * brake * parts["wheels"][1])
    assert model["vehicle_acceleration"] == pytest.approx(force / felt, rel=1e-9)


@pytest.mark.parametrize("gear", [-1, 1, 5, 10])
def test_momentum_is_the_impulse_of_the_engine_whatever_swings_in_between(gear):
    """Sum of inertia * speed * (speed over vehicle speed): only torque from outside changes it.

    Through both lashes and in large swings; the tyres slip, the seat moves. After the pulse it stays.
    """
    model = plant("plant_fom", {**FREE, "start.vehicle_speed": 8.0 * np.sign(gear)}, gear=gear)
    p, net = model.parameters, model.network
    shape, _ = model.start_speeds(p, net)
    shape = shape / (8.0 * np.sign(gear))
    inertia = net.constants[net.plan[k.INERTIA]:][:len(net.nodes)].copy()
    inertia[net.nodes["planetary_sets"]] = p.transmission.inertia[gear + 1]

    def momentum():
        return float(np.sum(inertia * shape * model.state[:len(net.nodes)]))

    assert np.sum(inertia * shape**2) == pytest.approx(
        sum(j * ratio**2 for j, ratio in felt_inertias(model, gear).values()), rel=1e-12)
    at_vehicle = shape[net.nodes["crankshaft"]]
    expected, scale = momentum(), p.vehicle.mass * 8.0
    contacts = set()
    for i in range(60):
        torque = 130.0 if 5 <= i < 15 else 0.0
        record = run(model, 0.02, start=0.02 * i, engine_torque=torque)
        expected += torque * 0.02 * at_vehicle
        contacts |= set(record["final_drive_contact"])
        assert momentum() == pytest.approx(expected, abs=1e-11 * scale)
    assert contacts == {-1.0, 0.0, 1.0}


@pytest.mark.parametrize("speed, asked, engine", [
    (0.0, 0.0, "idle"), (0.0, 150.0, 150.0), (3.0, 0.0, "idle"), (25.0, 0.0, "turbine"), (25.0, 90.0, 90.0)])
def test_with_an_open_lock_up_clutch_the_engine_starts_as_asked_or_at_idle_or_with_the_turbine(
        speed, asked, engine):
    start = {"start.vehicle_speed": speed, "start.engine_speed": asked}
    model = plant("plant_fom", start, gear=4, lockup_command=0.0)
    p = model.parameters
    turbine = speed / p.tyre.radius * p.final_drive.ratio * p.transmission.ratio[5]
    assert model["turbine_speed"] == pytest.approx(turbine)
    expected = {"idle": p.engine.idle_speed, "turbine": turbine}.get(engine, engine)
    assert model["engine_speed"] == pytest.approx(expected)


def test_the_heat_made_is_that_of_every_damper_and_both_contact_patches():
    """Sum of damping times rate squared, from the parameters and the speeds of a swinging driveline.

    The converter is emptied: beside the locked clutch it feels the damper's twist rate as slip.
    """
    empty = {f"converter.capacity[{i}]": 0.0 for i in range(1, 12)}
    model = plant("plant_fom", {**FREE, **empty, "start.vehicle_speed": 8.0}, gear=3)
    p, names = model.parameters, [entry.name for entry in model.network.entries]
    for i in range(12):
        run(model, 0.013, start=0.013 * i, engine_torque=150.0)
        s, rates = dict(zip(names, model.state)), dict(zip(names, model.rates()[0]))
        w = {name.removesuffix("_speed"): value for name, value in s.items() if name.endswith("_speed")}
        in_contact = {name: float(model[f"{name}_contact"] != 0.0) for name in ("transmission", "final_drive")}
        prop = 2.0 * p.propeller_shaft.damping
        heat = [
            p.damper.damping * (w["damper_plate"] - w["turbine"]) ** 2,
            prop * (w["transmission_output"] - w["propeller_shaft"]) ** 2,
            prop * (w["propeller_shaft"] - w["pinion"]) ** 2,
            p.seat.damping * (w["vehicle"] - w["seat"]) ** 2,
            p.differential_case.damping * w["differential_case"] ** 2,
            p.engine_mount.damping * w["powertrain_roll"] ** 2,
            in_contact["transmission"] * p.transmission.damping * (
                w["planetary_sets"] - p.transmission.ratio[4] * w["transmission_output"]) ** 2,
            in_contact["final_drive"] * p.final_drive.mesh_damping * (
                w["pinion"] - p.final_drive.ratio * w["differential"]) ** 2,
        ]
        for side in ("left", "right"):
            hub, belt, patch = w[f"{side}_hub"], w[f"{side}_belt"], f"{side}_contact_deflection"
            slip = p.tyre.radius * belt - w["vehicle"]
            heat += [p.axle_shaft.damping * (w["differential"] - hub) ** 2, p.tyre.damping * (hub - belt) ** 2,
                     p.tyre.slip_stiffness / p.tyre.relaxation_length * s[patch] * (slip - rates[patch])]
        assert rates["energy_dissipated"] == pytest.approx(sum(heat), rel=1e-9)
        assert sum(heat) > 1.0


# -- gear changes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("old, new", [
    (5, 6), (6, 5), (5, 3), (1, 2), (4, 8), (8, 4), (5, 0), (0, 5), (10, 9)])
def test_a_gear_change_under_drive_ends_in_the_new_ratio_and_keeps_the_energy(old, new):
    model = plant("plant_fom", {"start.vehicle_speed": 9.0}, gear=old, engine_torque=80.0)
    record = run(model, 3.0, gear=steps((0.0, old), (0.5, new)))
    assert np.isfinite(np.column_stack(list(record.values()))).all()
    assert np.ptp(ledger(record)) < 1e-6 * turnover(record)
    if new != 0:
        ratio = model.parameters.transmission.ratio[new + 1]
        late = record["time"] > 2.5
        assert record["turbine_speed"][late] == pytest.approx(
            ratio * record["transmission_output_speed"][late], rel=0.02)


@pytest.mark.parametrize("old, new", [(5, 6), (6, 5), (5, 3), (3, 5), (1, 4), (8, 3)])
def test_a_gear_change_is_no_blow(old, new):
    """No speed jumps: the turbine is let go with the torque it carried, and meets a capacity that grows."""
    dt = 1e-4
    model = plant("plant_fom", {"start.vehicle_speed": 9.0}, gear=old, engine_torque=80.0)
    p = model.parameters
    turbine = p.converter.turbine_inertia + p.transmission.input_inertia
    engine = p.engine.inertia + p.converter.impeller_inertia
    carried = abs(run(model, 0.1, dt)["transmission_input_torque"][-1])
    record = run(model, 1.5, dt, start=0.1, gear=new)
    since = record["time"] - 0.1
    first = since < 5e-3
    grown = p.transmission.shift_capacity * since / p.transmission.shift_lag
    change = np.abs(np.diff(record["turbine_speed"]))
    assert (change < (2.0 * carried + grown[1:]) / turbine * dt)[first[1:]].all()
    strongest = p.lockup_clutch.capacity * p.lockup_clutch.static_ratio + 200.0
    assert np.abs(np.diff(record["engine_speed"])).max() < strongest / engine * dt


@pytest.mark.parametrize("gear", [0, 1])
def test_in_neutral_nothing_passes_the_gearbox(gear):
    model = plant("plant_fom", gear=gear, lockup_command=0.0, engine_torque=100.0)
    record = run(model, 2.0)
    if gear == 0:
        assert np.abs(record["vehicle_speed"]).max() < 1e-9
        assert record["engine_speed"][-1] > 200.0
    else:
        assert record["vehicle_speed"][-1] > 1.0


def test_shifting_to_neutral_lets_the_vehicle_coast_without_the_engine():
    """Behind the shift element only what it carries along slows the vehicle: air, rolling and axle drag."""
    changes = {"final_drive.loss_constant": 0.0, "final_drive.loss_fraction": 0.0}
    model = plant("plant_fom", {**changes, "start.vehicle_speed": 15.0}, gear=5, engine_torque=100.0)
    record = run(model, 3.0, gear=steps((0.0, 5), (0.5, 0)))
    p = model.parameters
    late = record["time"] > 2.0
    v = record["vehicle_speed"][late].mean()
    parts = felt_inertias(model, 0)
    sets = p.transmission.inertia[1] * (p.final_drive.ratio / p.tyre.radius) ** 2
    felt = sum(j * r**2 for name, (j, r) in parts.items() if name != "turbine") + sets
    air = 0.5 * p.vehicle.air_density * p.vehicle.drag_coefficient * p.vehicle.frontal_area * v**2
    rolling = p.tyre.rolling_resistance * p.vehicle.mass * GRAVITY
    assert record["vehicle_acceleration"][late].mean() == pytest.approx(-(air + rolling) / felt, rel=0.02)


# -- converter and lock-up clutch -------------------------------------------------------------------------


def test_the_locked_clutch_does_not_slip_at_all_and_does_not_chatter():
    model = plant("plant_fom", {"start.vehicle_speed": 15.0}, engine_torque=-20.0)
    record = run(model, 20.0, engine_torque=steps((0.0, -20.0), (1.0, 200.0), (2.0, -30.0), (3.0, 150.0)))
    assert (record["lockup_clutch_sticks"] == 0.0).all()
    nodes = model.network.nodes
    assert abs(model.state[nodes["crankshaft"]] - model.state[nodes["damper_plate"]]) < 1e-10
    assert events(model) < 60  # lash contacts of three torque reversals


def test_the_lock_up_clutch_opens_slips_and_closes_again():
    model = plant("plant_fom", {"start.vehicle_speed": 15.0}, engine_torque=120.0)
    record = run(model, 6.0, lockup_command=steps((0.0, 1.0), (1.0, 0.0), (3.0, 0.1), (5.0, 1.0)))
    t, sticks = record["time"], record["lockup_clutch_sticks"]
    capacity = model["lockup_clutch.capacity"]
    assert (sticks[t < 1.0] == 0.0).all()
    assert (sticks[(t > 1.5) & (t < 4.9)] == 1.0).all()
    open_ = (t > 2.0) & (t < 3.0)
    drag = model["lockup_clutch.drag"]
    assert record["lockup_clutch_torque"][open_] == pytest.approx(
        drag * record["converter_slip"][open_], rel=0.05, abs=0.05)
    slipping = (t > 3.8) & (t < 5.0)
    assert record["lockup_clutch_torque"][slipping] == pytest.approx(0.1 * capacity, rel=0.02)
    assert (sticks[t > 5.8] == 0.0).all()
    assert np.ptp(ledger(record)) < 1e-7 * turnover(record)
    assert events(model) < 30


# -- standstill -------------------------------------------------------------------------------------------


def test_creeping_from_standstill_with_the_converter_open():
    model = plant("plant_fom", gear=1, lockup_command=0.0, engine_torque=0.0)
    record = run(model, 6.0)
    assert record["vehicle_speed"][-1] > 0.5
    assert (np.diff(record["travelled_distance"]) > -1e-9).all()
    assert np.ptp(ledger(record)) < 1e-6 * turnover(record)


@pytest.mark.parametrize("gear", [-1, 0, 1])
def test_a_brake_holds_the_vehicle_in_gear(gear):
    model = plant("plant_fom", gear=gear, lockup_command=0.0, brake_torque=5000.0, road_grade=0.1)
    run(model, 10.0)
    record = run(model, 5.0, start=10.0)
    assert np.abs(record["wheel_speed"]).max() < 1e-9
    assert abs(np.diff(record["travelled_distance"][[0, -1]])[0]) < 1e-4


def test_a_standing_vehicle_without_any_torque_stays_exactly_where_it_is():
    model = plant("plant_fom", {**FREE, "tyre.rolling_resistance": 0.01}, gear=0, lockup_command=0.0)
    record = run(model, 5.0)
    for name in ("vehicle_speed", "wheel_speed", "transmission_output_speed", "propeller_shaft_torque"):
        assert (record[name] == 0.0).all(), name
    assert events(model) < 5


def test_braking_to_standstill_stops_and_stays():
    model = plant("plant_fom", {"start.vehicle_speed": 8.0}, gear=2, engine_torque=-20.0)
    record = run(model, 15.0, brake_torque=steps((0.0, 0.0), (1.0, 6000.0)),
                 lockup_command=steps((0.0, 1.0), (1.5, 0.0)))
    late = record["time"] > 10.0
    assert np.abs(record["wheel_speed"][late]).max() < 1e-9
    assert np.abs(record["vehicle_speed"][late]).max() < 0.02
    assert np.ptp(record["travelled_distance"][late]) < 1e-3
    assert record["engine_speed"][-1] > 0.5 * model["engine.idle_speed"]
    assert events(model) < 200


def test_reversing_torque_crosses_both_lashes_each_time_and_returns():
    """At a beat far below shuffle, lash angle and torque have one sign, and each period is like the last."""
    model = plant("plant_fom", {**FREE, "start.vehicle_speed": 12.0, "engine.friction_constant": 60.0})
    record = run(model, 8.0, engine_torque=lambda t: np.where(t % 2.0 < 1.0, 50.0, -50.0))
    contact = record["final_drive_contact"]
    for half in range(2, 8):
        settled = (record["time"] > half + 0.9) & (record["time"] < half + 1.0)
        assert (contact[settled] == (1.0 if half % 2 == 0 else -1.0)).all()
        assert (record["transmission_contact"][settled] == contact[settled]).all()
    span = np.ptp(record["lash_position"])
    ratio = model.parameters.transmission.ratio[6]
    assert span == pytest.approx(
        2.0 * (model["final_drive.half_gap"] + model["transmission.half_gap"] / ratio), rel=1e-9)


# -- the description --------------------------------------------------------------------------------------


def test_the_state_list_names_every_continuous_state_once():
    model = plant("plant_fom", {"suspension.enabled": 1.0, "dual_mass_flywheel.enabled": 1.0})
    names = [entry.name for entry in model.network.entries]
    assert len(names) == len(set(names)) == model.network.plan[k.CONTINUOUS]
    assert 40 <= len(names) <= 60  # the AMESim model of the thesis has 47, Simulink adds 3
    assert all(entry.unit and entry.meaning for entry in model.network.entries)


def test_start_values_of_another_gear_differ_in_the_gear_alone():
    fourth, fifth = (start_values("plant_fom", "pickup_10r80", "modified", gear) for gear in (4, 5))
    assert {name for name in fifth if fourth[name] != fifth[name]} == {"gear"}
    assert FullOrderPlant(fourth)["gear"] == 4.0


def test_sensors_see_before_time_zero_what_they_see_after():
    """A log with a pre-trigger: whole seconds earlier, so all clocks have the same phase."""
    records = []
    for start in (-2.0, 1.0):
        model = plant("plant_fom", {"start.vehicle_speed": 12.0}, engine_torque=-20.0, initialize=False)
        model.initialize(start)
        records.append(run(model, 0.6, start=start, engine_torque=steps((start, -20.0), (start + 0.1, 150.0))))
    for name in ("propeller_shaft_torque_measured", "transmission_output_speed_measured", "wheel_speed_measured"):
        before, after = (record[name] for record in records)
        assert np.ptp(after) > 0.0
        assert np.abs(before - after).max() < 1e-3 * np.ptp(after), name  # instants have other last bits


def test_torque_noise_before_time_zero_changes_as_often_and_is_as_large():
    changes = {"start.vehicle_speed": 12.0, "engine.torque_noise": 5.0, "engine.noise_period": 0.01,
               "engine.air_lag": 0.0, "torque_meter.enabled": 0.0}
    model = plant("plant_fom", changes, engine_torque=100.0, initialize=False)
    model.initialize(-1.0)
    torque = run(model, 2.0, start=-1.0)["crankshaft_torque"]
    held = np.abs(np.diff(torque)) < 0.1  # friction moves with the speed
    assert (~held[:999]).sum() == pytest.approx(100, abs=6) == (~held[1000:]).sum()
    assert np.std(torque[:1000]) == pytest.approx(5.0, rel=0.3)


@pytest.mark.parametrize("lag", [0.0, 0.15])
def test_with_an_open_clutch_too_the_engine_starts_with_the_torque_it_was_asked_for(lag):
    model = plant("plant_fom", {"start.vehicle_speed": 12.0, "engine.air_lag": lag}, engine_torque=120.0,
                  lockup_command=0.0)
    assert model["crankshaft_torque"] == pytest.approx(120.0 - model["engine.accessory_torque"], abs=1e-9)


# -- more torque than the tyres carry -----------------------------------------------------------------------

VEHICLES = pytest.mark.parametrize("vehicle, variant", [("pickup_10r80", "modified"), ("suv_6l80", None)])


def tyres_carry(model):
    """Force of the driven tyres when they slide [N]."""
    net = model.network
    rows = [net.plan[net.plan[k.BRANCH_TABLE] + net.branches[f"{side}_contact"] * k.BRANCH_COLUMNS:]
            for side in ("left", "right")]
    return sum(net.constants[row[k.PARAMETER] + 2] * net.constants[row[k.PARAMETER] + 4] for row in rows)


@VEHICLES
@pytest.mark.parametrize("friction", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("gear, speed, locked", [(1, 0.0, 0.0), (2, 5.0, 1.0), (5, 15.0, 1.0)])
def test_wheels_that_spin_push_with_friction_times_load_and_no_energy_appears(
        vehicle, variant, friction, gear, speed, locked):
    """A vehicle on ice gains at most what its tyres carry, and that while its wheels turn far beyond rolling."""
    changes = {"tyre.friction_coefficient": friction, "start.vehicle_speed": speed, "tyre.rolling_resistance": 0.0,
               "vehicle.drag_coefficient": 0.0}
    model = plant("plant_fom", changes, gear=gear, vehicle=vehicle, variant=variant, lockup_command=locked,
                  engine_torque=20.0)
    torque = 400.0 if gear < 5 else {0.3: 560.0}.get(friction, 300.0)
    record = run(model, 3.0, engine_torque=steps((0.0, 20.0), (0.2, torque)))
    assert np.ptp(ledger(record)) < 1e-9 * turnover(record)
    carried, (mass, along) = tyres_carry(model), felt_inertias(model, gear)["vehicle"]
    assert along == 1.0
    wheels = record["wheel_speed"] * model["tyre.radius"] - record["vehicle_speed"]
    spinning = wheels > 2.0 + record["vehicle_speed"]
    if gear < 5 or friction < 0.3:
        assert spinning[-1]
    v = record["vehicle_speed"]
    assert (np.diff(v[::100]) < 1.05 * 0.1 * carried / mass).all()
    if spinning[1000:].all():
        # the law's force falls short of the limit by what rolling on makes the patch forget
        force = mass * (v[-1] - v[1000]) / (record["time"][-1] - record["time"][1000])
        assert 0.9 * carried < force <= carried


@VEHICLES
@pytest.mark.parametrize("friction, torque, brake", [(0.6, 450.0, 0.0), (0.1, 400.0, 0.0), (0.05, 0.0, 4000.0)])
def test_with_more_torque_than_the_tyres_carry_the_start_is_rolling_and_the_log_says_so(
        vehicle, variant, friction, torque, brake):
    """No equilibrium rolls; the vehicle has the speed it was given, its wheels roll, its engine gives what is asked."""
    model = plant("plant_fom", {"start.vehicle_speed": 5.0, "tyre.friction_coefficient": friction}, gear=1,
                  vehicle=vehicle, variant=variant, engine_torque=torque, brake_torque=brake)
    wheel = 5.0 / model["tyre.radius"]
    shaft = wheel * model["final_drive.ratio"]
    assert model["vehicle_speed"] == 5.0
    assert model["wheel_speed"] == pytest.approx(wheel)
    assert model["transmission_output_speed"] == pytest.approx(shaft)
    assert model["engine_speed"] == pytest.approx(shaft * model["transmission.ratio[3]"])
    assert model["propeller_shaft_torque"] == 0.0
    assert model["crankshaft_torque"] == pytest.approx(torque - model["engine.accessory_torque"])
    [told] = model.log
    assert "starts rolling" in told and "gear 1" in told and f"carry {tyres_carry(model):.0f} N" in told
    assert f"{model['crankshaft_torque']:.0f} N.m" in told
    model.initialize()
    assert model.log == [told]  # once, however often it is started
    model["engine_torque"], model["brake_torque"] = 10.0, 0.0
    model.initialize()
    assert model.log == []  # what is said of a start goes with it


@pytest.mark.parametrize("friction, gear, speed, torque", [
    (0.05, 2, 8.0, 30.0), (0.05, 6, 8.0, 60.0), (0.1, 6, 25.0, -100.0), (0.1, 4, 8.0, -100.0), (0.3, -1, -8.0, -100.0)])
def test_on_ice_a_start_that_the_tyres_just_carry_is_an_equilibrium(friction, gear, speed, torque):
    """Also in the overrun, where the tyres must turn the engine."""
    model = plant("plant_fom", {"start.vehicle_speed": speed, "tyre.friction_coefficient": friction}, gear=gear,
                  engine_torque=torque)
    rates, _ = model.rates()
    speeds, _ = model.start_speeds(model.parameters, model.network)
    body = model.network.nodes["vehicle"]
    shape = speeds / speed
    assert rates[:len(speeds)] == pytest.approx(shape * rates[body], abs=1e-6 * np.abs(shape).max())
    for side in ("left", "right"):
        assert abs(rates[model.network.twists[f"{side}_contact"]]) < 1e-9
    assert model["wheel_speed"] * model["tyre.radius"] == pytest.approx(speed, rel=0.5)
    assert model.log == []


def test_a_start_with_sliding_tyres_is_simulated_and_told():
    """Just below what they carry there is an equilibrium in which wheels turn far faster than the vehicle rolls."""
    model = plant("plant_fom", {"start.vehicle_speed": 30.0, "tyre.friction_coefficient": 0.1}, gear=6,
                  engine_torque=127.0)
    slip = model["wheel_speed"] * model["tyre.radius"] - 30.0
    assert slip > 15.0
    [told] = model.log
    assert f"sliding at {slip:.3g} m/s" in told and f"carry {tyres_carry(model):.0f} N" in told
    record = run(model, 0.5)
    assert np.ptp(record["propeller_shaft_torque"]) < 0.05 * record["propeller_shaft_torque"][0]


def test_inputs_that_cannot_be_written_to_are_simulated():
    model = plant("plant_fom", {"start.vehicle_speed": 12.0}, engine_torque=100.0)
    rows = input_rows(model, 0.01, 1e-3)
    rows.setflags(write=False)
    assert np.isfinite(model.simulate(rows, 1e-3)).all()


def test_what_a_vehicle_file_need_not_say_is_set_as_well(tmp_path):
    """Of the FMU that is built from the pickup its resolution of the wheel speed stayed for a car that has none."""
    shipped = resources.files("driveline.vehicles").joinpath("pickup_10r80.toml").read_text()
    bare = re.sub(r"(?ms)^\[wheel_speed_sensor\]\n.*?(?=^\[)", "", shipped)
    (tmp_path / "bare.toml").write_text(bare)
    file = load(tmp_path / "bare.toml")
    values = FullOrderPlant.defaults_from(file)
    model = plant("plant_fom", initialize=False)
    assert model["wheel_speed_sensor.resolution"] == 0.01 and "wheel_speed_sensor.resolution" not in file.values
    assert values["wheel_speed_sensor.resolution"] == values["torque_ripple.amplitude"] == 0.0
    parameters = {variable.name for variable in model.variables if variable.causality == "parameter"}
    assert {name.partition(".")[0] for name in parameters - values.keys()} == {"start", "solver"}
    assert file.values.items() <= values.items() and values.keys() - parameters == {"gear"}
