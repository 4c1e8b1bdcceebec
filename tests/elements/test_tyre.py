"""The contact patch: slip stiffness, saturation, and a spring at standstill."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import Bench, ledger, run

from driveline.elements.tyre import SMOOTH_SLIP_SPEED, contact_deflection_rate
from driveline.plants.assembly import GROUND

SLIP_STIFFNESS, RELAXATION, LIMIT, RADIUS = 1.2e5, 0.2, 5000.0, 0.4
ICE = 300.0  # the limit on ice


def tyre(belt_speed, body_speed, inertia=1e9, relaxation=RELAXATION, limit=LIMIT):
    """Belt and body so heavy that their speeds stay."""
    def build(net):
        belt = net.node("belt", inertia, "rad/s", "belt")
        body = net.node("body", 1e9, "m/s", "vehicle")
        net.contact("patch", belt, body, SLIP_STIFFNESS, relaxation, limit, RADIUS)

    return Bench(build, {"belt": belt_speed, "body": body_speed})


@pytest.mark.parametrize("forward", [1.0, -1.0])
@pytest.mark.parametrize("slip", [1e-3, -1e-3])
def test_at_small_slip_the_force_is_slip_stiffness_times_slip(slip, forward):
    """To first order: the exact steady force is C s / (1 + C |s| / limit)."""
    body = forward * 20.0 * (1.0 - forward * slip)
    record = run(tyre(forward * 20.0 / RADIUS, body), 0.5)
    first_order = SLIP_STIFFNESS * abs(slip)
    exact = first_order / (1.0 + first_order / LIMIT)
    force = np.sign(slip) * record["patch_torque"][-1]
    assert force == pytest.approx(first_order, rel=3e-2)
    # |s| is rounded off by at most 0.01 m/s of a slip speed of 0.02: at most half of the correction
    assert exact <= force <= exact + 0.5 * (first_order - exact)


@pytest.mark.parametrize("belt, body", [(150.0, 1.0), (-150.0, 1.0), (0.0, 30.0), (0.0, -30.0)])
def test_a_spinning_or_locked_wheel_gives_friction_times_load(belt, body):
    record = run(tyre(belt, body), 1.0)
    direction = np.sign(belt * RADIUS - body)
    force = record["patch_torque"][-1] * direction
    assert LIMIT * (0.95 if belt else 1.0 - 1e-3) < force <= LIMIT * (1.0 + 1e-3)


@pytest.mark.parametrize("belt, body", [(150.0, 1.0), (-150.0, 1.0), (0.0, 30.0), (0.0, -30.0), (1e4, 3.0)])
def test_on_ice_too_the_patch_settles_where_its_law_says_and_never_goes_beyond_its_limit(belt, body):
    """However fast it slides: the patch then forgets in a small part of a sub-step."""
    record = run(tyre(belt, body, limit=ICE), 0.2)
    slip, most = belt * RADIUS - body, ICE * RELAXATION / SLIP_STIFFNESS
    deflection = record["patch_deflection"]
    rounded = 1.0 + 2.0 * SMOOTH_SLIP_SPEED / abs(slip)
    assert np.abs(deflection).max() <= rounded * most
    settled = slip / (abs(belt * RADIUS) / RELAXATION + abs(slip) / most)
    assert deflection[-1] == pytest.approx(settled, rel=rounded - 1.0)


def test_a_wheel_spun_up_on_ice_turns_as_torque_and_friction_say_and_keeps_its_energy():
    """Over a second: inertia times the gain of speed is the torque less the limit at the radius, times the time."""
    inertia, torque = 3.0, 600.0

    def build(net):
        belt = net.node("belt", inertia, "rad/s", "belt")
        body = net.node("body", 1e9, "m/s", "vehicle")
        net.contact("patch", belt, body, SLIP_STIFFNESS, RELAXATION, ICE, RADIUS)
        net.source("engine", belt, torque, net.signal("on"))

    record = run(Bench(build, {"belt": 0.0, "body": 0.0}, {"on": 1.0}), 1.5)
    gain = record["belt_speed"][-1] - record["belt_speed"][499]
    assert gain == pytest.approx((torque - ICE * RADIUS) / inertia, rel=5e-3)
    assert np.ptp(ledger(record)) < 1e-9 * record["energy_stored"][-1]


def test_a_tyre_that_slides_faster_than_can_be_followed_is_an_error_at_once_and_nothing_moves():
    model = tyre(1e8, 0.0, limit=ICE)
    saved = model.save()
    with pytest.raises(ArithmeticError, match="slides faster"):
        model.step(0.0, 1e-3)
    assert model.save() == saved


def test_the_force_builds_up_over_the_relaxation_length():
    """At small slip: F = F_end (1 - exp(-x / sigma)) over the distance x rolled, at any speed."""
    for speed in (5.0, 25.0):
        record = run(tyre(speed * 1.0001 / RADIUS, speed), 4.0 * RELAXATION / speed, 1e-3)
        distance = speed * 1.0001 * record["time"]
        exact = 1.0 - np.exp(-distance / RELAXATION)
        shape = record["patch_torque"] / record["patch_torque"][-1]
        assert shape == pytest.approx(exact / exact[-1], abs=2e-3)


def test_at_standstill_the_patch_is_a_spring():
    """A belt on a fixed body swings with the patch's stiffness C / sigma at the radius."""
    inertia, kick = 3.0, 1e-6
    record = run(tyre(kick, 0.0, inertia), 0.5)
    omega = np.sqrt(SLIP_STIFFNESS / RELAXATION * RADIUS**2 / inertia)
    exact = kick * np.cos(omega * record["time"])
    assert np.abs(record["belt_speed"] - exact).max() < 1e-3 * kick
    assert np.ptp(ledger(record)) < 1e-6 * record["energy_stored"][0]


def test_a_standing_wheel_holds_a_force_below_its_limit_and_slides_above_it():
    """Pulled with half its limit the body stays where the patch's spring has it; it does not creep."""
    mass = 1000.0

    def build(net):
        belt = net.node("belt", 1.6, "rad/s", "belt")
        net.shaft("brake", belt, GROUND, 1e6, 500.0)
        body = net.node("body", mass, "m/s", "vehicle")
        net.shaft("damper", body, GROUND, 1e-3, 3e3)  # the patch alone would ring for long
        net.contact("patch", belt, body, SLIP_STIFFNESS, RELAXATION, LIMIT, RADIUS)
        net.source("pull", body, 1.0, net.signal("force"))

    model = Bench(build, {"belt": 0.0, "body": 0.0}, {"force": 0.0})
    run(model, 10.0, 1e-2, force=0.5 * LIMIT)
    late = run(model, 10.0, 1e-2, start=10.0, force=0.5 * LIMIT)
    assert np.abs(late["body_speed"]).max() < 1e-6
    assert late["patch_torque"] == pytest.approx(-0.5 * LIMIT, rel=1e-5)
    slides = run(model, 5.0, 1e-2, start=20.0, force=1.5 * LIMIT)
    # sliding at about 0.8 m/s, of which 0.01 are rounded off
    assert slides["body_speed"][-1] == pytest.approx(0.5 * LIMIT / 3e3, rel=0.03)


@given(st.floats(-0.05, 0.05), st.floats(-30.0, 30.0), st.floats(-50.0, 50.0))
def test_the_patch_only_takes_energy(deflection, slip_speed, transport_speed):
    """Force times slip, less what the spring stores, is heat."""
    rate = contact_deflection_rate(deflection, slip_speed, transport_speed, RELAXATION, 0.01)
    assert deflection * (slip_speed - rate) >= 0.0
    mirrored = contact_deflection_rate(-deflection, -slip_speed, transport_speed, RELAXATION, 0.01)
    assert mirrored == -rate
