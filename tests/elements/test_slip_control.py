"""A lock-up clutch that is held at a slip: its exact motion, its rest, what it does to shuffle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import Bench, ledger, mode, plant, run, steps, turnover
from scipy.linalg import expm

from driveline.elements.slip_control import LEAST, SlipControl
from driveline.plants.assembly import GROUND

INERTIA, FULL = 0.4, 300.0
CONTROL = SlipControl(target=2.0, torque=20.0, reset_time=0.2)
TIP_IN_AND_OUT = {"engine_torque": steps((0.0, -10.0), (0.5, 200.0), (2.0, -30.0))}


def clutch(torque, speed=CONTROL.target, control=CONTROL, **more):
    """An inertia that a torque drives against a clutch to the ground."""
    def build(net):
        node = net.node("engine", INERTIA, "rad/s", "engine")
        net.source("drive", node, 1.0, net.signal("torque"))
        net.friction("clutch", node, GROUND, FULL, signal=net.signal("command"), control=control)

    return Bench(build, {"engine": speed}, {"torque": torque, "command": 1.0}, **more)


def held(model, torque):
    """As if that torque had been there for long."""
    model.state[[entry.name for entry in model.network.entries].index("clutch_held")] = torque
    return model


def exact(torque, start, capacity, time):
    """Slip and capacity that is held after a step of the torque, from both linear equations while it slips on."""
    k, s0, reset = CONTROL.torque, CONTROL.target, CONTROL.reset_time
    matrix = np.array([[-k / s0 / INERTIA, -1.0 / INERTIA, (torque + k) / INERTIA],
                       [k / reset / s0, 0.0, -k / reset], [0.0, 0.0, 0.0]])
    return np.array([expm(matrix * t) @ (start, capacity, 1.0) for t in time])[:, :2].T


def test_a_step_of_torque_goes_into_the_slip_and_then_into_the_capacity():
    model = held(clutch(100.0), 100.0)
    record = run(model, 3.0, torque=150.0)
    slip, capacity = exact(150.0, CONTROL.target, 100.0, record["time"])
    assert slip.min() > 0.0 and slip.max() > 1.7 * CONTROL.target
    assert record["engine_speed"] == pytest.approx(slip, abs=1e-8)
    assert record["clutch_held"] == pytest.approx(capacity, abs=1e-7)
    assert record["engine_speed"][-1] == pytest.approx(CONTROL.target, rel=1e-4)
    assert record["clutch_torque"][-1] == pytest.approx(150.0, rel=1e-4)
    assert np.ptp(ledger(record)) < 1e-9 * turnover(record)


def test_both_ways_are_alike():
    one, other = (run(held(clutch(sign * 80.0, sign * CONTROL.target), 80.0), 3.0,
                      torque=lambda t, sign=sign: sign * np.where(t < 1.0, 80.0, np.where(t < 2.0, 140.0, -25.0)))
                  for sign in (1.0, -1.0))
    for name in ("engine_speed", "clutch_torque"):
        assert other[name] == pytest.approx(-one[name], abs=1e-9)


def test_when_the_torque_turns_round_it_sticks_until_its_capacity_has_gone_and_slips_the_other_way():
    model = held(clutch(100.0), 100.0)
    record = run(model, 4.0, torque=-40.0)
    slip, sticks = record["engine_speed"], record["clutch_mode"] == 0.0
    first, last = np.flatnonzero(sticks)[[0, -1]]
    assert sticks[first:last + 1].all() and np.abs(slip[sticks]).max() < 1e-14
    assert (slip[:first] > 0.0).all() and (slip[last + 1:] < 0.0).all()
    # sticking, what is held falls evenly, and it lets go when that is the torque and what a slip of 0 takes off
    fall = np.diff(record["clutch_held"][first:last]) / 1e-3
    assert fall == pytest.approx(-CONTROL.torque / CONTROL.reset_time, rel=1e-9)
    assert record["clutch_held"][last] == pytest.approx(40.0 + CONTROL.torque, abs=0.15)
    assert slip[-1] == pytest.approx(-CONTROL.target, rel=1e-3)
    assert np.ptp(ledger(record)) < 1e-9 * turnover(record)


def test_it_does_not_wind_up():
    """Neither more torque than it can carry nor a clutch that is told to open moves what is held any further."""
    model = held(clutch(250.0), 250.0)
    record = run(model, 6.0, torque=lambda t: np.where(t < 1.0, FULL + 20.0, 100.0))
    assert record["clutch_torque"].max() == FULL
    assert record["clutch_held"].max() <= FULL
    assert record["engine_speed"][-1] == pytest.approx(CONTROL.target, rel=1e-2)
    opened = run(held(clutch(50.0), 50.0), 2.0, torque=0.0, command=0.0)
    assert (opened["clutch_torque"] == 0.0).all() and opened["clutch_held"].max() == 50.0


@settings(max_examples=25)
@given(st.lists(st.floats(-400.0, 400.0), min_size=4, max_size=15),
       st.lists(st.sampled_from([0.0, 0.3, 1.0]), min_size=15, max_size=15))
def test_whatever_torque_and_command_it_never_gives_energy(torques, commands):
    n = len(torques)
    record = run(clutch(0.0, 5.0), 0.1 * n, torque=lambda t: np.repeat(torques, 100),
                 command=lambda t: np.repeat(commands[:n], 100))
    scale = 1.0 + np.abs(record["engine_speed"]).max()
    assert (np.diff(record["energy_dissipated"]) >= -1e-9).all()
    assert (record["clutch_torque"] * record["engine_speed"] >= -1e-9 * scale * FULL).all()
    assert np.abs(record["clutch_torque"]).max() <= FULL * (1.0 + 1e-12)
    assert record["clutch_held"].min() >= -1.0 and record["clutch_held"].max() <= FULL + 1.0
    assert np.ptp(ledger(record)) < 1e-9 * (1.0 + turnover(record))


@pytest.mark.parametrize("torque", [-60.0, -3.0, 2.0, 20.0, 130.0, 300.0])
@pytest.mark.parametrize("gear", [1, 5, 8])
@pytest.mark.parametrize(("target", "converter_carries"), [(2.0, 25.0), (8.0, 131.0)])
def test_a_car_starts_at_rest_with_its_control(torque, gear, target, converter_carries):
    """The slip that is wanted, whatever the torque; less where the converter alone carries it, then nothing is held."""
    model = plant("plant_fom", {"start.vehicle_speed": 15.0, "slip_control.target": target}, gear=gear,
                  engine_torque=torque)
    rates, torques = model.rates()
    net = model.network
    n = len(net.nodes)
    shape = model.start_speeds(model.parameters, net)[0] / 15.0
    assert rates[:n] == pytest.approx(shape * rates[net.nodes["vehicle"]], abs=1e-8)
    slip, carried = model["converter_slip"], torques[net.branches["lockup_clutch"]]
    held = [entry.name for entry in net.entries].index("lockup_clutch_held")
    assert rates[held] == pytest.approx(0.0, abs=1e-6)
    assert model.state[held] >= 0.0
    if abs(carried) > 0.5:
        assert slip == pytest.approx(target * np.sign(carried), rel=1e-9)
    else:
        assert model.state[held] == 0.0 and 0.0 < abs(slip) < target and abs(torque) < converter_carries
    record = run(model, 1.0)
    assert np.ptp(record["propeller_shaft_torque"]) < 0.04 * (10.0 + np.abs(record["propeller_shaft_torque"]).max())


def test_a_clutch_that_slips_passes_on_no_shuffle():
    """That is what it is for: after a tip-in the torque swings once, after a tip-out it sticks."""
    swings = {}
    for target in (0.0, 2.0):
        record = run(plant("plant_fom", {"start.vehicle_speed": 15.0, "slip_control.target": target},
                           engine_torque=-10.0), 4.0, **TIP_IN_AND_OUT)
        time, torque = record["time"], record["propeller_shaft_torque"]
        swings[target] = [np.ptp(np.diff(torque[(time > t + 0.4) & (time < t + 1.0)])) for t in (0.5, 2.0)]
        assert np.ptp(ledger(record)) < 1e-8 * turnover(record)
    assert swings[2.0][0] < 0.1 * swings[0.0][0]
    assert swings[2.0][1] > 10.0 * swings[2.0][0]


def test_below_what_a_control_can_hold_the_clutch_is_closed():
    start = {"start.vehicle_speed": 15.0}
    closed, barely = (plant("plant_fom", start | more, engine_torque=-10.0)
                      for more in ({}, {"slip_control.target": 0.99 * LEAST}))
    one, other = (run(model, 3.0, **TIP_IN_AND_OUT) for model in (closed, barely))
    assert all((one[name] == other[name]).all() for name in one)
    assert mode(closed, "lockup_clutch") == 0.0


def test_order_four_through_sticking_and_letting_go():
    """The places where it sticks and lets go are located; it opens wholly with a kink, which is not."""
    errors = []
    for substep in (4e-3, 2e-3, 1e-3, 2.5e-4):
        model = held(clutch(100.0, substep=substep), 100.0)
        record = run(model, 1.6, 8e-3, torque=lambda t: 100.0 + 30.0 * np.sin(9.0 * t) - 150.0 * (t > 0.4))
        errors.append(record["engine_speed"])
        assert {-1.0, 0.0, 1.0} == set(record["clutch_mode"]) and record["clutch_torque"].all()
    *coarse, finest = errors
    first, second, third = (np.abs(one - finest).max() for one in coarse)
    assert second < first / 11.0 and third < second / 11.0


@pytest.mark.parametrize(("speed", "command"), [(0.0, 1.0), (12.0, 0.0)])
def test_a_car_begins_where_its_control_is_at_an_end(speed, command):
    """There the rate of what it holds jumps; differences over that made the plant seem too fast for any step."""
    model = plant("plant_fom", {"start.vehicle_speed": speed, "slip_control.target": 2.0}, engine_torque=20.0,
                  lockup_command=command)
    matrix, names = model.state_matrix()
    held = names.index("lockup_clutch_held")
    assert matrix[held, held] == 0.0 and np.abs(np.linalg.eigvals(matrix)).max() < 1e4
    record = run(model, 1.0)
    assert np.isfinite(record["engine_speed"]).all() and np.ptp(ledger(record)) < 1e-8 * turnover(record)
