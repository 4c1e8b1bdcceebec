"""Laws every plant keeps: energy, equilibrium at the start, no trace of the communication step, state."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from runs import PLANTS, REDUCED, events, input_rows, ledger, plant, run, start_values, steps, turnover

from driveline.kernels import layout as k
from driveline.models import MODELS
from driveline.quantities import InputError

EVERY_PLANT = pytest.mark.parametrize("name", PLANTS)

# Tip-in, tip-out, tip-in, overrun and a stop by the brake: all flanks, in a full-order plant the
# lock-up clutch locked, open, slipping, locked and open again.
TORQUE = steps((0.0, -20.0), (0.5, 150.0), (1.5, -30.0), (2.5, 120.0), (4.5, -50.0))
BRAKE = steps((0.0, 0.0), (5.0, 6000.0))
LOCKUP = steps((0.0, 1.0), (3.0, 0.0), (3.5, 0.12), (3.8, 1.0), (4.2, 0.0))

# A flank touched and left again within one sub-step of 0.2 ms is no contact: rad by which it may be passed.
GRAZE = 1e-5


def lively(name, changes=None, gear=5, **more):
    """A plant rolling at a speed that fits its gear, and its record of the manoeuvre above."""
    speed = {-1: -3.0, 1: 4.0, 2: 6.0}.get(gear, 12.0)
    changes = {"start.vehicle_speed": speed, **(changes or {})}
    model = plant(name, changes, gear=gear, engine_torque=-20.0, **more)
    inputs = {"engine_torque": TORQUE, "brake_torque": BRAKE}
    if name == "plant_fom":
        inputs["lockup_command"] = LOCKUP
    return model, run(model, 9.0, **inputs)


CASES = [("plant_fom", gear) for gear in (-1, *range(1, 11))] + [(name, 5) for name in REDUCED]
VARIANTS = {
    "dual-mass flywheel": {"dual_mass_flywheel.enabled": 1.0},
    "transfer case": {"transfer_case.enabled": 1.0},
    "suspension": {"suspension.enabled": 1.0},
    "all of them": {f"{part}.enabled": 1.0 for part in ("dual_mass_flywheel", "transfer_case", "suspension")},
    "no damping in the lashes": {"transmission.damping": 0.0, "final_drive.mesh_damping": 0.0},
    "no lash": {"transmission.half_gap": 0.0, "final_drive.half_gap": 0.0},
    "no lags": {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "lockup_clutch.lag": 0.0, "brake.lag": 0.0},
}


@pytest.mark.parametrize("name, gear", CASES)
def test_no_energy_appears_or_vanishes(name, gear):
    """What is left over is the integrator's error: a small part, which a shorter step makes smaller."""
    left = []
    for substep in (2e-4, 1e-4):
        model, record = lively(name, {"solver.maximum_substep": substep}, gear)
        left.append(np.ptp(ledger(record)) / turnover(record))
        assert abs(record["vehicle_speed"][-1]) < 0.1  # it stands and swings on its tyres
        assert events(model) > 5
        assert (np.diff(record["energy_dissipated"]) > -1e-8 * turnover(record)).all()
    assert left[0] < 1e-7
    assert left[1] < left[0] / 10.0 or left[1] < 1e-11  # order four gives 16; below there is only rounding


@pytest.mark.parametrize("variant", VARIANTS)
def test_energy_is_kept_with_every_option_of_the_full_order_plant(variant):
    model, record = lively("plant_fom", VARIANTS[variant])
    assert np.ptp(ledger(record)) < 1e-7 * turnover(record)
    for lash in ("final_drive", "transmission"):
        assert np.abs(record[f"{lash}_lash"]).max() <= model[f"{lash}.half_gap"] + GRAZE


def full_order_energy(model):
    """Kinetic and elastic energy of the full-order plant, written down from its parameters."""
    p, s = model.parameters, dict(zip((e.name for e in model.network.entries), model.state))
    box, wheel = p.transmission, 2.0 * (p.hub.inertia + p.tyre.belt_inertia)
    prop = p.propeller_shaft
    inertias = {
        "crankshaft": p.engine.inertia + p.converter.impeller_inertia,
        "damper_plate": p.lockup_clutch.plate_inertia,
        "turbine": p.converter.turbine_inertia + box.input_inertia,
        "planetary_sets": box.inertia[int(model["gear"]) + 1],
        "transmission_output": box.output_inertia + prop.inertia / 4.0, "propeller_shaft": prop.inertia / 2.0,
        "pinion": p.final_drive.pinion_inertia + prop.inertia / 4.0,
        "differential": p.final_drive.ring_inertia + p.axle_shaft.inertia,
        "vehicle": p.vehicle.mass - p.seat.mass + wheel / p.tyre.radius**2, "seat": p.seat.mass,
        "differential_case": p.differential_case.inertia, "powertrain_roll": p.engine_mount.inertia,
    }
    springs = {
        "damper_twist": p.damper.stiffness, "transmission_shaft_twist": box.stiffness,
        "propeller_shaft_front_twist": 2.0 * prop.stiffness,
        "propeller_shaft_rear_twist": 2.0 * prop.stiffness,
        "final_drive_shaft_twist": p.final_drive.mesh_stiffness, "seat_deflection": p.seat.stiffness,
        "differential_case_twist": p.differential_case.stiffness,
        "engine_mount_twist": p.engine_mount.stiffness,
    }
    for side in ("left", "right"):
        inertias |= {f"{side}_hub": p.hub.inertia + p.axle_shaft.inertia / 2.0,
                     f"{side}_belt": p.tyre.belt_inertia}
        springs |= {f"{side}_axle_shaft_twist": p.axle_shaft.stiffness,
                    f"{side}_tyre_twist": p.tyre.stiffness,
                    f"{side}_contact_deflection": p.tyre.slip_stiffness / p.tyre.relaxation_length}
    assert {f"{name}_speed" for name in inertias} == {e for e in s if e.endswith("_speed")}
    return 0.5 * sum(j * s[f"{name}_speed"] ** 2 for name, j in inertias.items()) + 0.5 * sum(
        c * s[name] ** 2 for name, c in springs.items())


def reduced_energy(model):
    """The same for the reduced plants."""
    p, s = model.parameters, dict(zip((e.name for e in model.network.entries), model.state))
    vehicle = p.vehicle.mass * p.vehicle.tyre_radius**2
    twice = (p.engine_inertia * s["engine_speed"] ** 2 + (p.wheel_inertia + vehicle) * s["wheel_speed"] ** 2
             + p.shaft.stiffness * s["shaft_shaft_twist"] ** 2)
    if model.name != "plant_rom_2dof":
        twice += (p.final_drive_inertia * s["final_drive_speed"] ** 2
                  + p.wheel_shaft.stiffness * s["wheel_shaft_twist"] ** 2)
    if model.name == "plant_rom_3dof_split":
        twice += (p.output_inertia * s["output_speed"] ** 2
                  + p.transmission_shaft.stiffness * s["transmission_shaft_twist"] ** 2)
    return 0.5 * twice


@EVERY_PLANT
def test_the_stored_energy_is_that_of_the_parameters_and_the_state(name):
    model = plant(name, {"start.vehicle_speed": 12.0}, engine_torque=-20.0)
    energy = full_order_energy if name == "plant_fom" else reduced_energy
    for i, torque in enumerate((-20.0, 150.0, 150.0, -60.0)):
        run(model, 0.11, start=i * 0.11, engine_torque=torque)
        assert model["energy_stored"] == pytest.approx(energy(model), rel=1e-13)


@EVERY_PLANT
@pytest.mark.parametrize("torque", [-60.0, -15.0, 0.0, 130.0])
@pytest.mark.parametrize("speed", [3.0, 18.0])
def test_a_plant_starts_in_the_equilibrium_of_its_inputs(name, torque, speed):
    """Every inertia accelerates with the vehicle, no torque changes, and no clutch that sticks slips."""
    model = plant(name, {"start.vehicle_speed": speed}, gear=3, engine_torque=torque)
    net = model.network
    n = len(net.nodes)
    rates, _ = model.rates()
    reference, _ = model.start_speeds(model.parameters, net)
    shape = reference / speed
    acceleration = rates[net.nodes[model.body]] / shape[net.nodes[model.body]]
    assert rates[:n] == pytest.approx(shape * acceleration, abs=1e-6 * (1.0 + np.abs(shape).max()))
    slips = model.branch_rates()
    for branch, b in net.branches.items():
        row = net.plan[net.plan[k.BRANCH_TABLE] + b * k.BRANCH_COLUMNS:][:k.BRANCH_COLUMNS]
        if row[k.LAW] == k.FRICTION and model.state[net.modes][b] == 0.0:
            assert abs(slips[b]) < 1e-9, branch
    record = run(model, 0.3)
    swing = np.ptp(record["propeller_shaft_torque"])
    assert swing < 0.02 * (10.0 + np.abs(record["propeller_shaft_torque"]).max())


DRIVE = {"engine_torque": steps((0.0, -30.0), (0.1, 130.0), (0.6, -40.0))}


@EVERY_PLANT
def test_the_trajectory_does_not_depend_on_the_communication_step(name):
    """Inputs change on a grid of 10 ms; contacts fall where they fall, sensors tick by themselves."""
    sensors = {} if name != "plant_fom" else {
        f"{speed}_sensor.delay": 0.0137 for speed in ("engine_speed", "wheel_speed")}
    changes = {"start.vehicle_speed": 12.0, "solver.maximum_substep": 5e-5, **sensors}
    records = {}
    for dt in (0.25e-3, 1e-3, 2.5e-3, 10e-3):
        model = plant(name, changes, engine_torque=-30.0)
        every = round(10e-3 / dt)
        record = run(model, 1.0, dt, **DRIVE)
        records[dt] = {key: values[every - 1::every] for key, values in record.items()}
        records[dt]["events"] = np.array([events(model)])
    finest = records.pop(0.25e-3)
    for record in records.values():
        for key, values in record.items():
            scale = np.abs(finest[key]).max() + 1e-12
            on_can = key.endswith("_speed_measured")  # quantised: then a rounding error is no difference
            assert np.abs(values - finest[key]).max() <= (0.0 if on_can else 1e-6) * scale, key


@EVERY_PLANT
def test_save_and_restore_repeat_a_run_to_the_bit(name):
    model = plant(name, {"start.vehicle_speed": 12.0}, engine_torque=-30.0)
    run(model, 0.15, **DRIVE)  # inside the lash, with a delayed torque under way
    saved = model.save()
    first = run(model, 0.5, start=0.15, **DRIVE)
    end = model.save()
    model.restore(saved)
    again = run(model, 0.5, start=0.15, **DRIVE)
    assert model.save() == end
    fresh = plant(name, initialize=False)
    fresh.restore(saved)
    elsewhere = run(fresh, 0.5, start=0.15, **DRIVE)
    assert fresh.save() == end
    for key in first:
        assert (first[key] == again[key]).all() and (first[key] == elsewhere[key]).all(), key
    assert np.ptp(first["propeller_shaft_torque"]) > 10.0


@EVERY_PLANT
def test_restoring_brings_back_the_parameters_too(name):
    inertia = "engine.inertia" if name == "plant_fom" else "engine_inertia"
    value = start_values(name, "pickup_10r80", "modified", 5)[inertia]
    heavy = plant(name, {inertia: 3.0 * value, "start.vehicle_speed": 12.0}, engine_torque=-30.0)
    saved = heavy.save()
    expected = run(heavy, 0.3, **DRIVE)
    light = plant(name, {"start.vehicle_speed": 12.0}, engine_torque=-30.0)
    different = run(light, 0.3, **DRIVE)
    light.restore(saved)
    record = run(light, 0.3, **DRIVE)
    assert light[inertia] == 3.0 * value
    assert (record["engine_speed"] == expected["engine_speed"]).all()
    assert np.abs(different["engine_speed"] - expected["engine_speed"]).max() > 0.1


@EVERY_PLANT
def test_initialising_again_starts_the_same_run(name):
    model = plant(name, {"start.vehicle_speed": 12.0}, engine_torque=-30.0)
    begun = model.save()
    first = run(model, 0.3, **DRIVE)
    model.values[0] = -30.0
    model.initialize()
    assert model.save() == begun
    again = run(model, 0.3, **DRIVE)
    for key in first:
        assert (first[key] == again[key]).all(), key


@EVERY_PLANT
def test_instances_side_by_side_do_not_touch_each_other(name):
    alone = plant(name, {"start.vehicle_speed": 12.0}, engine_torque=-30.0)
    expected = [run(alone, 0.02, start=0.02 * i, engine_torque=100.0)["engine_speed"] for i in range(10)]
    model, other = (plant(name, {"start.vehicle_speed": v}, engine_torque=-30.0) for v in (12.0, 7.0))
    for i in range(10):
        run(other, 0.02, start=0.02 * i, engine_torque=-50.0)
        assert (run(model, 0.02, start=0.02 * i, engine_torque=100.0)["engine_speed"] == expected[i]).all()


def test_a_tunable_parameter_takes_effect_at_once_and_the_rest_goes_on():
    """Without a change retuning is invisible to the bit; with one only its effect is seen."""
    runs = []
    for torque in (None, 4.0, 24.0):
        model = plant("plant_fom", {"start.vehicle_speed": 12.0, "engine.air_lag": 0.0,
                                    "engine.accessory_torque": 4.0}, engine_torque=60.0)
        run(model, 0.1)
        if torque is not None:
            model["engine.accessory_torque"] = torque
            model.retune()
        runs.append(run(model, 0.1, start=0.1))
    for key in runs[0]:
        assert (runs[0][key] == runs[1][key]).all(), key
    assert runs[2]["crankshaft_torque"] == pytest.approx(runs[0]["crankshaft_torque"] - 20.0, abs=1e-6)
    assert np.abs(runs[2]["engine_speed"][0] - runs[0]["engine_speed"][0]) < 0.1
    model.values[model.index["engine.accessory_torque"]] = -1.0
    saved = model.state.copy()
    with pytest.raises(InputError, match="engine.accessory_torque"):
        model.retune()
    assert (model.state == saved).all()


@EVERY_PLANT
def test_steps_one_by_one_and_in_one_call_give_the_same_run(name):
    """Up to rounding: (i + 1) dt and i dt + dt differ in the last bit of a double. Also through a change of gear."""
    one, many = (plant(name, {"start.vehicle_speed": 12.0}, engine_torque=-30.0) for _ in range(2))
    shifts = {"gear": steps((0.0, 5), (0.15, 6))} if name == "plant_fom" else {}
    rows = input_rows(one, 0.3, 1e-3, **DRIVE, **shifts)
    record = many.simulate(rows, 1e-3)
    for i, row in enumerate(rows):
        one.values[:row.size] = row
        one.step(i * 1e-3, 1e-3)
        assert one._outputs == pytest.approx(record[i], rel=1e-8, abs=1e-8)
    assert one.state == pytest.approx(many.state, rel=1e-8, abs=1e-8)


@EVERY_PLANT
def test_compiled_and_plain_python_give_the_same_bits(name):
    """Through a lash contact with all sensors on; a full-order plant also locks and shifts."""
    inputs = {"engine_torque": steps((0.0, -30.0), (0.02, 130.0))}
    changes = {"start.vehicle_speed": 12.0}
    if name == "plant_fom":
        inputs |= {"lockup_command": steps((0.0, 1.0), (0.1, 0.1), (0.2, 1.0)),
                   "gear": steps((0.0, 5), (0.25, 6))}
        changes |= {"engine.air_lag": 0.01, "engine.air_delay": 0.005, "engine.torque_noise": 2.0,
                    "torque_meter.enabled": 1.0, "engine_speed_sensor.delay": 0.012,
                    "wheel_speed_sensor.jitter_set": 3.0}
    models = [plant(name, changes, engine_torque=-30.0, backend=backend) for backend in ("native", "python")]
    records = [run(model, 0.3, **inputs) for model in models]
    for key in records[0]:
        assert (records[0][key] == records[1][key]).all(), key
    assert models[0].save() == models[1].save()
    assert events(models[0]) > 0


def test_compiled_and_plain_python_give_the_same_bits_while_tyres_spin():
    changes = {"start.vehicle_speed": 5.0, "tyre.friction_coefficient": 0.05}
    models = [plant("plant_fom", changes, gear=1, engine_torque=400.0, backend=backend)
              for backend in ("native", "python")]
    assert models[0].log == models[1].log[-1:]  # the other says too that it is slow
    for model in models:
        record = run(model, 0.2)
        assert record["wheel_speed"][-1] * model["tyre.radius"] > record["vehicle_speed"][-1] + 4.0
    assert models[0].save() == models[1].save()


@settings(max_examples=15)
@given(st.lists(st.floats(-120.0, 400.0), min_size=4, max_size=8),
       st.lists(st.sampled_from([0.0, 0.1, 1.0]), min_size=8, max_size=8),
       st.lists(st.sampled_from([0.0, 0.0, 2500.0]), min_size=8, max_size=8),
       st.floats(-0.15, 0.15), st.sampled_from([-1, 1, 3, 7]), st.sampled_from([0.0, 1.0, 8.0]),
       st.lists(st.sampled_from([0, 0, 0, 1, -1]), min_size=8, max_size=8))
@example([368.0, 0.0, 0.0, 0.0], [0.0] * 8, [0.0] * 8, -0.125, -1, 1.0, [0] * 8)  # more than the tyres carry
@example([357.0, 0.0, 0.0, 0.0], [0.0] * 8, [0.0] * 8, -0.125, -1, 1.0, [0] * 8)
def test_whatever_the_driver_does_the_full_order_plant_stays_finite_and_keeps_its_energy(
        torques, commands, brakes, grade, gear, speed, shifts):
    changes = {"start.vehicle_speed": np.sign(gear) * speed, "solver.maximum_substep": 1e-4}
    model = plant("plant_fom", changes, gear=gear, engine_torque=torques[0], road_grade=grade,
                  lockup_command=float(speed > 0.0))
    n = len(torques)
    gears = np.clip(gear + np.cumsum(shifts[:n]), -1, 10)
    record = run(model, 0.25 * n, engine_torque=np.repeat(torques, 250), gear=np.repeat(gears, 250),
                 lockup_command=np.repeat(commands[:n], 250), brake_torque=np.repeat(brakes[:n], 250))
    for values in record.values():
        assert np.isfinite(values).all()
    assert np.ptp(ledger(record)) < 1e-5 * turnover(record) + 1e-3
    for lash in ("final_drive", "transmission"):
        assert np.abs(record[f"{lash}_lash"]).max() <= model[f"{lash}.half_gap"] + GRAZE
    contact = record["transmission_contact"]
    assert (contact * record["transmission_input_torque"] >= -1e-6).all()
    assert events(model) < 60 * n


@pytest.mark.parametrize("name", REDUCED)
@settings(max_examples=15)
@given(st.lists(st.tuples(st.floats(-150.0, 300.0), st.sampled_from([0.0, 0.0, 150.0, 4000.0]),
                          st.floats(-0.15, 0.15)), min_size=3, max_size=8),
       st.sampled_from([-1, 1, 5]), st.sampled_from([0.0, 0.3, 6.0]), st.sampled_from([0.0, 1.0]))
def test_whatever_the_driver_does_a_reduced_plant_stays_finite_and_keeps_its_energy(
        name, manoeuvre, gear, speed, damped):
    changes = {"start.vehicle_speed": np.sign(gear) * speed}
    model = plant(name, changes | ({} if damped else {"shaft.damping": 0.0}), gear=gear)
    torques, brakes, grades = (np.repeat(values, 300) for values in zip(*manoeuvre))
    record = run(model, 0.3 * len(manoeuvre), engine_torque=torques, brake_torque=brakes, road_grade=grades)
    for values in record.values():
        assert np.isfinite(values).all()
    assert np.ptp(ledger(record)) < 1e-5 * turnover(record) + 1e-6
    assert (record["contact"] * record["propeller_shaft_torque"] >= -1e-6).all()
    gap = model["shaft.half_gap"] + (model["transmission_shaft.half_gap"] if "split" in name else 0.0)
    assert np.abs(record["lash_position"]).max() <= gap + GRAZE
    assert events(model) < 120 * len(manoeuvre)


# -- what is refused ------------------------------------------------------------------------------------


@EVERY_PLANT
@pytest.mark.parametrize("dt", [0.0, -1e-3, np.nan, np.inf])
def test_a_step_that_is_no_positive_length_is_refused_and_nothing_moves(name, dt):
    model = plant(name, {"start.vehicle_speed": 12.0})
    saved = model.save()
    with pytest.raises(InputError, match="communication step.*positive length"):
        model.step(0.0, dt)
    with pytest.raises(InputError, match="communication step.*positive length"):
        model.simulate(input_rows(model, 0.01, 1e-3), dt)
    assert model.save() == saved


@EVERY_PLANT
@pytest.mark.parametrize("variable, value", [
    ("engine_torque", np.nan), ("engine_torque", np.inf), ("brake_torque", -1.0), ("road_grade", 2.0)])
def test_an_impossible_input_is_refused_by_name_and_nothing_moves(name, variable, value):
    model = plant(name, {"start.vehicle_speed": 12.0})
    saved = model.save()
    with pytest.raises(InputError, match=variable):
        model[variable] = value
    with pytest.raises(InputError, match=variable):
        run(model, 0.01, **{variable: steps((0.0, 0.0), (0.005, value))})
    assert model.save() == saved
    model.values[model.index[variable]] = value  # as a host writes it, past every check
    with pytest.raises(InputError, match=variable):
        model.step(0.0, 1e-3)


@pytest.mark.parametrize("vehicle, gear", [
    ("pickup_10r80", 11), ("pickup_10r80", -2), ("pickup_10r80", 2.5), ("suv_6l80", 7), ("suv_6l80", 10)])
def test_an_unknown_gear_is_refused_and_nothing_moves(vehicle, gear):
    model = plant("plant_fom", {"start.vehicle_speed": 12.0}, vehicle=vehicle, variant=None)
    saved = model.save()
    with pytest.raises(InputError, match="gear"):
        run(model, 0.01, gear=gear)
    assert model.save() == saved
    model.values[model.index["gear"]] = gear
    if gear == int(gear):
        with pytest.raises(InputError, match="gear"):
            model.step(0.0, 1e-3)
        with pytest.raises(InputError, match="gear"):
            model.initialize()


@EVERY_PLANT
@pytest.mark.parametrize("kind", ["negative", "nan", "infinite", "missing"])
def test_a_wrong_inertia_is_refused_by_name(name, kind):
    inertia = "hub.inertia" if name == "plant_fom" else "wheel_inertia"
    values = dict(start_values(name, "pickup_10r80", "modified", 5))
    if kind == "missing":
        del values[inertia]
    else:
        values[inertia] = {"negative": -0.1, "nan": np.nan, "infinite": np.inf}[kind]
    with pytest.raises(InputError, match=inertia):
        MODELS[name](values).initialize()


def test_a_gear_table_that_is_too_short_is_refused_by_name():
    values = dict(start_values("plant_fom", "pickup_10r80", "modified", 5))
    del values["transmission.inertia[12]"]
    with pytest.raises(InputError, match="transmission.inertia has 11 entries"):
        MODELS["plant_fom"](values).initialize()


def test_a_wrong_number_of_input_columns_is_refused():
    model = plant("plant_rom_3dof")
    with pytest.raises(InputError, match="shape"):
        model.simulate(np.zeros((10, 2)), 1e-3)
