"""Dry friction: when it slips, when it sticks, and that it then really stands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import Bench, events, ledger, run, steps

from driveline.elements.road_load import GRAVITY
from driveline.kernels import layout as k
from driveline.plants.assembly import GROUND

J1, J2, CAPACITY = 0.25, 1.4, 30.0


def clutch(speeds, static_ratio=1.0, drag=0.0, **inputs):
    def build(net):
        a = net.node("a", J1, "rad/s", "driving side")
        b = net.node("b", J2, "rad/s", "driven side")
        net.source("drive", a, 1.0, net.signal("torque"))
        net.friction("clutch", a, b, CAPACITY, static_ratio, drag, signal=net.signal("command"))

    return Bench(build, dict(zip("ab", speeds)), {"torque": 0.0, "command": 1.0, **inputs})


@pytest.mark.parametrize("speeds", [(100.0, 20.0), (-40.0, 55.0)])
def test_a_clutch_joins_two_inertias_in_the_time_and_at_the_speed_of_the_momentum_law(speeds):
    model = clutch(speeds)
    slip = speeds[0] - speeds[1]
    together = abs(slip) / (CAPACITY * (1.0 / J1 + 1.0 / J2))
    common = (J1 * speeds[0] + J2 * speeds[1]) / (J1 + J2)
    record = run(model, 1.0)
    before = record["time"] < together
    impulse = np.sign(slip) * CAPACITY * record["time"][before]
    assert record["a_speed"][before] == pytest.approx(speeds[0] - impulse / J1, abs=1e-10)
    assert record["b_speed"][before] == pytest.approx(speeds[1] + impulse / J2, abs=1e-10)
    after = ~before
    assert record["a_speed"][after] == pytest.approx(common, abs=1e-10)
    assert (record["a_speed"][after] == record["b_speed"][after]).all()
    assert (record["clutch_mode"] == np.where(before, np.sign(slip), 0.0)).all()
    assert events(model) == 1
    assert record["energy_dissipated"][-1] == pytest.approx(0.5 * J1 * J2 / (J1 + J2) * slip**2, rel=1e-10)
    assert np.ptp(ledger(record)) < 1e-9


def test_a_sticking_clutch_carries_its_share_and_lets_go_at_its_static_capacity():
    """Sticking, it accelerates J2: T J2 / (J1 + J2). It breaks away where that exceeds 1.2 C."""
    share, ramp = J2 / (J1 + J2), 50.0
    model = clutch((0.0, 0.0), static_ratio=1.2)
    record = run(model, 1.5, torque=lambda t: ramp * t)
    torque = ramp * (record["time"] - 1e-3)
    sticks = torque * share <= 1.2 * CAPACITY
    assert 0 < sticks.sum() < sticks.size
    assert record["clutch_torque"][sticks] == pytest.approx(torque[sticks] * share, abs=1e-9)
    assert record["clutch_torque"][~sticks] == pytest.approx(CAPACITY, rel=1e-12)
    assert (record["clutch_mode"] == np.where(sticks, 0.0, 1.0)).all()
    assert events(model) == 1


@settings(max_examples=25)
@given(st.lists(st.floats(-100.0, 100.0), min_size=4, max_size=15),
       st.lists(st.sampled_from([0.0, 0.3, 1.0]), min_size=15, max_size=15))
def test_whatever_torque_and_command_the_clutch_never_gives_energy(torques, commands):
    model = clutch((5.0, 0.0), static_ratio=1.1)
    n = len(torques)
    record = run(model, 0.02 * n, torque=lambda t: np.repeat(torques, 20),
                 command=lambda t: np.repeat(commands[:n], 20))
    slip = record["a_speed"] - record["b_speed"]
    scale = 1.0 + np.abs(record["a_speed"]).max()
    assert (np.diff(record["energy_dissipated"]) >= -1e-9).all()
    assert np.abs(slip[record["clutch_mode"] == 0.0]).max(initial=0.0) < 1e-11 * scale
    assert (record["clutch_torque"] * slip >= -1e-9 * scale).all()
    assert np.abs(ledger(record) - ledger(record)[0]).max() < 1e-9 * (1.0 + record["energy_stored"].max())
    assert np.abs(record["clutch_torque"]).max() <= 1.1 * CAPACITY * (1.0 + 1e-9)


def test_an_open_clutch_whose_slip_reversed_closes_without_a_jump():
    """The impulse of a stale sign of the slip would stop the slip at once, and lose its energy."""
    model = clutch((10.0, 0.0), command=0.0)
    record = run(model, 1.0, torque=steps((0.0, -10.0), (0.5, 0.0)), command=steps((0.0, 0.0), (0.6, 1.0)))
    slip = record["a_speed"] - record["b_speed"]
    assert slip[0] > 0.0 > slip[499]
    closing = record["time"] > 0.6
    limit = CAPACITY * (1.0 / J1 + 1.0 / J2) * 1e-3
    assert np.abs(np.diff(slip))[closing[1:]].max() <= limit * (1.0 + 1e-9)
    assert slip[-1] == 0.0
    assert np.ptp(ledger(record)) < 1e-9


def test_drag_of_an_open_clutch_lets_the_slip_decay_exponentially():
    record = run(clutch((10.0, 0.0), drag=0.2, command=0.0), 1.0)
    slip = 10.0 * np.exp(-0.2 * (1.0 / J1 + 1.0 / J2) * record["time"])
    assert record["a_speed"] - record["b_speed"] == pytest.approx(slip, rel=1e-9)


def test_two_clutches_in_series_share_one_load_by_the_inertias_behind_them():
    inertias = (0.3, 0.8, 2.1)

    def build(net):
        a, b, c = (net.node(name, inertia, "rad/s", name) for name, inertia in zip("abc", inertias))
        net.source("drive", a, 1.0, net.signal("torque"))
        net.friction("first", a, b, 100.0)
        net.friction("second", b, c, 100.0)

    model = Bench(build, dict.fromkeys("abc", 0.0), {"torque": 40.0})
    record = run(model, 0.5)
    assert record["first_torque"] == pytest.approx(40.0 * (0.8 + 2.1) / 3.2, rel=1e-12)
    assert record["second_torque"] == pytest.approx(40.0 * 2.1 / 3.2, rel=1e-12)
    assert record["c_speed"] == pytest.approx(40.0 / 3.2 * record["time"], rel=1e-12)
    assert np.abs(record["a_speed"] - record["c_speed"]).max() < 1e-13
    assert events(model) == 0


def vehicle(speed, coefficient=0.015, mass=1800.0, **inputs):
    def build(net):
        body = net.node("body", mass, "m/s", "vehicle")
        net.friction("rolling", body, GROUND, coefficient * mass * GRAVITY, signal=k.COS_GRADE)
        net.source("grade", body, -mass * GRAVITY, k.SIN_GRADE)
        net.integral(body, "distance", "m", "way")

    return Bench(build, {"body": speed}, {"road_grade": 0.0, **inputs})




@pytest.mark.parametrize("speed", [3.0, -3.0])
def test_rolling_resistance_stops_a_vehicle_where_the_formula_says_and_holds_it(speed):
    model = vehicle(speed)
    record = run(model, 40.0, 0.01)
    deceleration = 0.015 * GRAVITY
    stop = abs(speed) / deceleration
    moving = record["time"] < stop
    exact = speed - np.sign(speed) * deceleration * record["time"]
    assert record["body_speed"][moving] == pytest.approx(exact[moving], abs=1e-10)
    assert (record["body_speed"][~moving] == 0.0).all()
    distance = [entry.name for entry in model.network.entries].index("distance")
    assert model.state[distance] == pytest.approx(speed * stop / 2.0, rel=1e-10)
    assert events(model) == 1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_standing_vehicle_holds_on_a_grade_below_its_rolling_resistance_and_rolls_above(sign):
    model = vehicle(0.0)
    held = run(model, 1.0, road_grade=sign * (np.arctan(0.015) - 1e-6))
    assert (held["body_speed"] == 0.0).all()
    grade = np.arctan(0.015) + 1e-3
    rolls = run(model, 1.0, road_grade=sign * grade)
    acceleration = GRAVITY * (np.sin(grade) - 0.015 * np.cos(grade))
    assert rolls["body_speed"] == pytest.approx(-sign * acceleration * rolls["time"], rel=1e-9)
