"""The lash as the thesis's equations 2.5 to 2.8 have it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from runs import Bench, ledger, mode, run

from driveline.elements.backlash import lash_guard, lash_relaxation, lash_torque

J1, J2, STIFFNESS, GAP = 0.4, 1.5, 2000.0, 0.05
FLOATS = st.floats(-10.0, 10.0)


def bench(damping=6.0, speeds=(0.0, 0.0), torque=0.0, gap=GAP, turn=0.0):
    def build(net):
        a = net.node("a", J1, "rad/s", "driving side")
        b = net.node("b", J2, "rad/s", "driven side")
        net.source("drive", a, 1.0, net.signal("torque"))
        net.lash("lash", a, b, STIFFNESS, damping, gap)
        net.turned("lash", net.signal("turn"))

    return Bench(build, dict(zip("ab", speeds)), {"torque": torque, "turn": turn})


def test_in_the_gap_the_torque_is_zero_and_the_shaft_relaxes_exponentially():
    model = bench(speeds=(0.0, 1.0))
    psi = 1e-4  # k psi = 0.2 N.m is less than c times the separating rate: contact is lost at once
    at = model.network.twists["lash"]
    model.state[[at, at + 1]] = psi + GAP, psi
    record = run(model, 0.02, 1e-4)
    assert (record["lash_torque"] == 0.0).all()
    assert (record["lash_mode"] == 0.0).all()
    exact = psi * np.exp(-STIFFNESS / 6.0 * record["time"])
    assert record["lash_shaft_twist"] == pytest.approx(exact, rel=1e-12)
    assert record["lash_lash"] == pytest.approx(psi + GAP - record["time"] - exact, abs=1e-14)
    # what the shaft held became heat
    heat = 0.5 * STIFFNESS * (psi**2 - exact**2)
    assert record["energy_dissipated"] == pytest.approx(heat, rel=1e-9)


@pytest.mark.parametrize("damping", [0.0, 6.0])
def test_the_gap_is_crossed_in_the_time_its_width_takes(damping):
    """Free flight at relative speed v over 2 alpha; then the far flank, whose torque pulls back."""
    speed = 1.7
    flight = 2.0 * GAP / speed
    model = bench(damping, speeds=(0.0, speed))
    before = run(model, 0.0588, 1e-4)
    assert flight == pytest.approx(0.0588235, abs=1e-6)
    assert before["lash_mode"][-1] == 0.0
    after = run(model, 0.0002, 1e-4, start=0.0588)
    assert after["lash_mode"][0] == -1.0
    assert after["lash_torque"][0] < 0.0
    # without damping the twist after contact is (v / omega) sin(omega (t - flight))
    if damping == 0.0:
        omega = np.sqrt(STIFFNESS * (1.0 / J1 + 1.0 / J2))
        exact = -speed / omega * np.sin(omega * (after["time"] - flight))
        assert after["lash_shaft_twist"] == pytest.approx(exact, rel=1e-6)


def test_to_turn_one_side_of_a_lash_is_as_if_what_is_on_it_turned_faster():
    turn, drive = 1.7, {"torque": lambda t: 40.0 * np.sin(30.0 * t)}
    turned, faster = (run(model, 0.6, **drive) for model in (bench(turn=turn), bench(speeds=(turn, 0.0))))
    assert {-1.0, 0.0, 1.0} == set(turned["lash_mode"])
    for name in ("b_speed", "lash_torque", "lash_lash"):
        assert turned[name] == pytest.approx(faster[name], abs=1e-9), name
    assert turned["a_speed"] + turn == pytest.approx(faster["a_speed"], abs=1e-9)
    assert np.ptp(ledger(turned)) < 1e-6 * turned["energy_dissipated"][-1]


def test_a_lash_without_damping_bounces_elastically():
    """Between the flanks the sides fly freely; each contact is half a vibration and reverses the rate."""
    record = run(bench(0.0, speeds=(0.0, 1.7)), 1.0)
    rate = (record["a_speed"] - record["b_speed"])[record["lash_mode"] == 0.0]
    assert np.abs(rate) == pytest.approx(1.7, rel=1e-7)
    assert rate.min() < 0.0 < rate.max()
    assert np.ptp(ledger(record)) < 1e-9


@settings(max_examples=25)
@given(st.lists(st.floats(-150.0, 150.0), min_size=5, max_size=20), st.sampled_from([0.0, 0.5, 6.0, 40.0]),
       st.sampled_from([0.0, 1e-3, GAP]))
def test_whatever_the_torque_the_lash_angle_stays_inside_the_gap_and_the_torque_fits_the_flank(
        torques, damping, gap):
    model = bench(damping, gap=gap)
    record = run(model, 0.01 * len(torques), torque=lambda t: np.repeat(torques, 10))
    scale = 1.0 + np.abs(record["lash_torque"]).max()
    assert np.isfinite(record["a_speed"]).all()
    assert np.abs(record["lash_lash"]).max() <= gap + 1e-12
    assert (record["lash_mode"] * record["lash_torque"] >= -1e-7 * scale).all()
    assert (record["lash_torque"][record["lash_mode"] == 0.0] == 0.0).all()
    in_contact = record["lash_mode"] != 0.0
    flank = record["lash_mode"][in_contact] * gap
    assert record["lash_lash"][in_contact] == pytest.approx(flank, abs=1e-12)
    assert np.abs(ledger(record)).max() < 1e-6 * (1.0 + record["energy_stored"].max())
    assert mode(model, "lash") in (-1.0, 0.0, 1.0)


@given(FLOATS, FLOATS, st.floats(0.1, 100.0), st.floats(0.0, 10.0))
def test_both_flanks_are_mirror_images(twist, rate, stiffness, damping):
    for contact in (-1.0, 0.0, 1.0):
        for gap in (0.0, 1.0):
            lash = twist - 0.3 * twist
            if contact == 0.0 and lash == 0.0:
                continue  # the middle belongs to one side
            assert lash_guard(contact, twist, 0.3 * twist, rate, stiffness, damping, gap) == lash_guard(
                -contact, -twist, -0.3 * twist, -rate, stiffness, damping, gap)
        assert lash_torque(contact, twist, rate, stiffness, damping) == -lash_torque(
            -contact, -twist, -rate, stiffness, damping)


@given(FLOATS, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.1, 1e4), st.floats(1e-3, 10.0))
def test_relaxing_twice_is_relaxing_for_the_sum_of_both_times(twist, first, second, stiffness, damping):
    once = lash_relaxation(twist, first + second, stiffness, damping)
    twice = lash_relaxation(lash_relaxation(twist, first, stiffness, damping), second, stiffness, damping)
    assert twice == pytest.approx(once, rel=1e-9, abs=1e-290)
    assert lash_relaxation(twist, first, stiffness, 0.0) == 0.0
