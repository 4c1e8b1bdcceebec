"""The step function: order four through contacts, events that end, nothing outside its state."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import PLANTS, REDUCED, Bench, events, input_rows, ledger, plant, run, steps, turnover

from driveline.elements.road_load import GRAVITY
from driveline.kernels import layout as k
from driveline.kernels import stepping
from driveline.quantities import InputError

EVERY_PLANT = pytest.mark.parametrize("name", PLANTS)
DRIVE = {"engine_torque": steps((0.0, -30.0), (0.1, 130.0), (0.6, -40.0))}
SLIP = {**DRIVE, "lockup_command": steps((0.0, 1.0), (0.2, 0.08), (0.5, 1.0))}


def rolling(name, substep=2e-4, **more):
    changes = {"start.vehicle_speed": 12.0, "solver.maximum_substep": substep}
    return plant(name, changes, engine_torque=-30.0, **more)


# -- order ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name, inputs", [("plant_fom", DRIVE), ("plant_fom", SLIP),
                                          *((name, DRIVE) for name in REDUCED)])
def test_halving_the_step_divides_the_error_by_sixteen_through_contacts_and_sticking(name, inputs):
    """Order four needs every contact and every sticking instant located to more than a step's error."""
    def converge(substep):
        model = rolling(name, substep)
        return run(model, 1.0, 2e-3, **inputs), events(model)

    reference, count = converge(1.25e-5)
    assert count > 8
    if inputs is SLIP:
        assert set(reference["lockup_clutch_sticks"]) == {0.0, 1.0}
    runs = [converge(substep) for substep in (4e-4, 1.25e-4, 5e-5)]
    for signal in ("propeller_shaft_torque", "engine_speed"):
        errors = [np.abs(record[signal] - reference[signal]).max() for record, _ in runs]
        slope = np.log(errors[0] / errors[2]) / np.log(4e-4 / 5e-5)
        assert slope > 3.5, (signal, errors)
    peak = np.abs(reference["propeller_shaft_torque"]).max()
    last = np.abs(runs[2][0]["propeller_shaft_torque"] - reference["propeller_shaft_torque"]).max()
    assert last < 1e-4 * peak


@pytest.mark.parametrize("vehicle, variant", [("pickup_10r80", "modified"), ("suv_6l80", None)])
def test_halving_the_step_divides_the_error_by_sixteen_while_tyres_spin_on_ice(vehicle, variant):
    """The wheels come to 200 rad/s while the vehicle hardly moves; the patch is then stiff at any of these steps."""
    def converge(substep):
        changes = {"tyre.friction_coefficient": 0.05, "start.vehicle_speed": 5.0, "solver.maximum_substep": substep}
        model = plant("plant_fom", changes, gear=2, vehicle=vehicle, variant=variant, engine_torque=20.0)
        return run(model, 2.0, engine_torque=steps((0.0, 20.0), (0.2, 400.0)))

    reference = converge(2.5e-5)
    coarse, fine = (converge(substep) for substep in (2e-4, 1e-4))
    assert reference["wheel_speed"][-1] > 100.0 and reference["vehicle_speed"][-1] < 6.0
    for signal in ("propeller_shaft_torque", "wheel_speed"):
        errors = [np.abs(record[signal] - reference[signal]).max() for record in (coarse, fine)]
        assert errors[0] < 1e-6 * np.abs(reference[signal]).max()
        assert errors[1] < errors[0] / 12.0
    assert np.ptp(ledger(coarse)) < 1e-10 * turnover(coarse)


@pytest.mark.parametrize("slip, forgets", [(0.1, 0.3), (0.9, 2.7), (1.0, 3.0), (12.0, 36.0)])
def test_a_substep_is_taken_in_parts_where_the_patch_asks_for_it_and_only_there(monkeypatch, slip, forgets):
    """``forgets``: rate of the patch times the sub-step, of which the method bears 2.78."""
    limit, substep, speed = 300.0, 1e-4, slip + 0.01
    stiffness = limit * forgets / (slip * substep)

    def build(net):
        belt, body = net.node("belt", 1e9, "rad/s", "belt"), net.node("body", 1e9, "m/s", "vehicle")
        net.contact("patch", belt, body, 1e6 * stiffness, 1e6, limit, 1.0)  # rolls on without forgetting

    model = Bench(build, {"belt": speed, "body": 0.0}, substep=substep, backend="python")
    taken = []
    try_step = stepping.try_step
    monkeypatch.setattr(stepping, "try_step", lambda plan, work, y, first, h, *more: (
        taken.append(h), try_step(plan, work, y, first, h, *more)))
    run(model, 1e-3)
    assert sum(taken) == pytest.approx(1e-3)
    if forgets < 2.78:
        assert len(taken) == 10
    else:
        assert max(taken) * forgets <= substep < 2.0 * min(taken) * forgets


# -- events -----------------------------------------------------------------------------------------------


@EVERY_PLANT
def test_a_contact_is_met_at_the_same_instant_whatever_the_steps(name):
    """The instant is read off the mode with a communication step of 20 us; sub-steps differ by 10."""
    contact = "final_drive_contact" if name == "plant_fom" else "contact"
    instants = []
    for substep in (2e-4, 2e-5):
        model = rolling(name, substep)
        run(model, 0.1, **DRIVE)
        record = run(model, 0.3, 2e-5, start=0.1, **DRIVE)
        instants.append(record["time"][1:][np.diff(record[contact]) != 0.0])
    assert len(instants[0]) == len(instants[1]) >= 2
    assert np.abs(instants[0] - instants[1]).max() <= 2.1e-5


@pytest.mark.parametrize("name", PLANTS)
def test_a_vehicle_that_rolls_back_and_is_then_braked_stops_by_forces_alone(name):
    """The brake was open while the wheels reversed. No speed jumps; no energy is lost."""
    more = {"gear": 0, "lockup_command": 0.0} if name == "plant_fom" else {}
    model = plant(name, {"start.vehicle_speed": 2.0}, road_grade=0.1, engine_torque=0.0, **more)
    brake = 3000.0
    record = run(model, 12.0, brake_torque=steps((0.0, 0.0), (6.0, brake)))
    v = record["vehicle_speed"]
    assert v[0] > 0.0 > v[5000]
    mass, radius = model["vehicle.mass"], 0.4
    assert np.abs(np.diff(v)).max() < 3.0 * brake / radius / mass * 1e-3
    assert np.abs(v[-500:]).max() < 0.05
    assert np.ptp(ledger(record)) < 1e-6 * turnover(record)
    assert events(model) < 200


@pytest.mark.parametrize("name", REDUCED)
def test_brake_and_rolling_resistance_hold_a_standing_vehicle_together(name):
    """On a grade that neither holds alone, both do; it rolls where their sum is too little."""
    model = plant(name)
    p = model.parameters.vehicle
    brake = 0.02 * p.mass * GRAVITY * p.tyre_radius
    limit = (brake / p.tyre_radius + p.rolling_resistance_force) / (p.mass * GRAVITY)
    model = plant(name, brake_torque=brake, road_grade=0.98 * limit)
    held = run(model, 3.0)
    assert np.abs(held["vehicle_speed"]).max() < 1e-9
    rolls = run(model, 1.0, start=3.0, road_grade=1.1 * limit)
    assert rolls["vehicle_speed"][-1] < -1e-3
    model = plant(name, brake_torque=0.0, road_grade=0.0)  # from standstill with the brake open
    assert run(model, 1.0, engine_torque=50.0)["vehicle_speed"][-1] > 0.01


@EVERY_PLANT
def test_a_standing_plant_counts_no_events(name):
    """Held by its brake: modes settle, then nothing switches and nothing moves."""
    more = {"gear": 1, "lockup_command": 0.0} if name == "plant_fom" else {}
    model = plant(name, brake_torque=4000.0, engine_torque=0.0, road_grade=0.05, **more)
    run(model, 20.0, 5e-3)
    before = events(model)
    record = run(model, 5.0, 5e-3, start=20.0)
    assert events(model) == before
    assert np.abs(record["vehicle_speed"]).max() < 1e-3


# -- random chains ----------------------------------------------------------------------------------------

RATIO = st.sampled_from([1.0, 1.0, 0.7, -1.3, 3.1])
LINK = st.one_of(
    st.tuples(st.just("shaft"), st.sampled_from([50.0, 5e3]), st.sampled_from([0.0, 0.5, 2.0]), RATIO),
    st.tuples(st.just("lash"), st.sampled_from([500.0, 5e3]), st.sampled_from([0.0, 0.5, 2.0]), RATIO),
    st.tuples(st.just("friction"), st.sampled_from([0.0, 5.0, 60.0]), st.sampled_from([0.0, 0.1]), RATIO),
)


@settings(max_examples=60)
@given(st.lists(LINK, min_size=1, max_size=4),
       st.lists(st.sampled_from([0.02, 0.3, 2.0]), min_size=5, max_size=5),
       st.lists(st.floats(-10.0, 10.0), min_size=5, max_size=5))
def test_any_chain_of_elements_keeps_momentum_and_energy(links, inertias, speeds):
    """With ratio r at the far side of each link, p = sum J_i w_i n_i is free of all torques inside."""
    n = len(links) + 1
    names = "abcde"[:n]

    def build(net):
        nodes = [net.node(name, inertia, "rad/s", name) for name, inertia in zip(names, inertias)]
        for i, (kind, first, second, ratio) in enumerate(links):
            a, b = nodes[i], nodes[i + 1]
            if kind == "shaft":
                net.shaft(f"link_{i}", a, b, first, second, ratio_b=ratio)
            elif kind == "lash":
                net.lash(f"link_{i}", a, b, first, second, 0.02, ratio_b=ratio)
            else:
                net.friction(f"link_{i}", a, b, first, 1.2, second, ratio_b=ratio)

    model = Bench(build, dict(zip(names, speeds)), substep=5e-5)
    # rolling together, w_a = r w_b: in the far node's speed the torque sum is zero
    shape = 1.0 / np.concatenate([[1.0], np.cumprod([link[3] for link in links])])
    start = np.array(speeds[:n]) @ (shape * inertias[:n])
    record = run(model, 0.3)
    at = np.array([record[f"{name}_speed"] for name in names])
    momentum = (shape * inertias[:n]) @ at
    scale = np.abs(shape * inertias[:n]) @ np.abs(at)
    assert (np.abs(momentum - start) < 1e-11 * (1.0 + scale)).all()
    energy = 0.5 * np.array(speeds[:n]) ** 2 @ inertias[:n]
    left = ledger(record) - energy
    assert np.abs(left).max() < 1e-4 * energy + 1e-9
    assert (np.diff(record["energy_dissipated"]) > -1e-4 * energy - 1e-9).all()


# -- nothing but the state --------------------------------------------------------------------------------


@EVERY_PLANT
def test_the_scratch_may_hold_anything_between_two_calls(name):
    clean, dirty = rolling(name), rolling(name)
    for i in range(20):
        torque = 130.0 if i >= 3 else -30.0
        first = run(clean, 0.02, start=0.02 * i, engine_torque=torque)
        dirty.network.work[:] = np.nan
        second = run(dirty, 0.02, start=0.02 * i, engine_torque=torque)
        for signal in first:
            assert (first[signal] == second[signal]).all(), signal
    assert clean.save() == dirty.save()


@EVERY_PLANT
def test_the_rates_are_the_slope_of_the_trajectory(name):
    """``rates`` (for linearisation) and ``run`` (for time) are the same equations."""
    changes = {"engine.air_delay": 0.0} if name == "plant_fom" else {}
    model = plant(name, {"start.vehicle_speed": 12.0, **changes}, engine_torque=130.0)
    model.values[0] = -30.0
    run(model, 0.02, engine_torque=-30.0)
    n = int(model.network.plan[k.CONTINUOUS])
    before = model.state[:n].copy()
    at_start, _ = model.rates()
    at_start = at_start.copy()
    h = 1e-5
    model.step(0.02, h)
    at_end, _ = model.rates()
    slope = (model.state[:n] - before) / h
    size = np.abs(at_start) + np.abs(at_end) + 1e-6 * (1.0 + np.abs(before) / h * 1e-6)
    assert (np.abs(slope - 0.5 * (at_start + at_end)) < 1e-4 * size + 1e-4).all()


@EVERY_PLANT
def test_time_has_no_origin(name):
    early, late = rolling(name), rolling(name)
    late.initialize(86400.0)
    moved = {signal: lambda t, f=f: f(t - 86400.0) for signal, f in DRIVE.items()}
    first, second = run(early, 1.0, **DRIVE), run(late, 1.0, start=86400.0, **moved)
    for signal in ("engine_speed", "propeller_shaft_torque", "lash_position"):
        assert np.abs(first[signal] - second[signal]).max() < 1e-6 * np.abs(first[signal]).max(), signal


# -- the delayed input ------------------------------------------------------------------------------------

DELAYED = {"engine.friction_constant": 0.0, "engine.friction_viscous": 0.0, "engine.accessory_torque": 0.0,
           "engine.idle_gain": 0.0, "engine.air_lag": 0.0, "start.vehicle_speed": 12.0}


def test_every_value_of_a_delayed_input_arrives_once_in_order_and_in_time():
    """600 values under way at a time; each is held as long as it was given."""
    model = plant("plant_fom", {**DELAYED, "engine.air_delay": 0.6})
    record = run(model, 2.0, engine_torque=lambda t: 20.0 + 10.0 * np.sin(40.0 * t))
    t = record["time"] - 1e-3 - 0.6
    late = t > 1e-6
    assert record["crankshaft_torque"][late] == pytest.approx(20.0 + 10.0 * np.sin(40.0 * t[late]), abs=1e-9)
    assert record["crankshaft_torque"][t < -1e-6] == pytest.approx(0.0, abs=1e-12)


def test_more_changes_under_way_than_there_is_room_for_are_an_error_that_says_so():
    model = plant("plant_fom", {**DELAYED, "engine.air_delay": 1.0})
    with pytest.raises(ArithmeticError, match="air_delay"):
        run(model, 1.0, 2.5e-4, engine_torque=lambda t: 20.0 + t)


def test_a_state_that_leaves_the_numbers_is_an_error_and_not_a_result():
    model = plant("plant_rom_3dof", {"start.vehicle_speed": 12.0})
    model.state[0] = 1e200  # a speed whose energy has no number
    with pytest.raises(ArithmeticError, match="no longer finite|without end"):
        model.simulate(input_rows(model, 5.0, 5e-3, engine_torque=100.0), 5e-3)


def test_a_substep_at_which_the_integrator_would_be_unstable_is_refused_before_it_runs():
    with pytest.raises(InputError, match="solver.maximum_substep is 0.005 s: .* needs at most"):
        plant("plant_rom_3dof", {"start.vehicle_speed": 12.0, "solver.maximum_substep": 5e-3})
    with pytest.raises(InputError, match="needs at most 0.0004"):  # stable in fifth gear, not in first
        plant("plant_fom", {"start.vehicle_speed": 12.0, "solver.maximum_substep": 5e-4})
