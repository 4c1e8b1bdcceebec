"""Torque profiles are what they say: continuous, at their rates, with the tip-ins they name."""

import json

import numpy as np
import pytest

from cosim.studies.torque_profiles import (
    ENGINE_LAG,
    LONG,
    RATE,
    TIP_INS,
    TorqueProfile,
    ramp,
    ramps,
    random,
    step,
    steps,
    varying,
)
from driveline import vehicles

TIME = np.arange(0.0, LONG, 1e-3)
PROFILES = {"steps": steps(100.0), "ramps": ramps(RATE), "varying 1": varying(1), "varying 2": varying(2),
            "random": random()}


@pytest.mark.parametrize("name", PROFILES)
def test_ten_tip_ins_that_turn_the_torque_from_negative_to_positive(name):
    profile = PROFILES[name]
    torque = profile.values(TIME)
    assert len(profile.tip_ins) == TIP_INS and profile.tip_ins[-1] < LONG - 2.0
    for start in profile.tip_ins:
        assert torque[round(start * 1e3)] == pytest.approx(profile.low, abs=0.1)  # tip-outs are over
    assert np.sum((torque[:-1] < 0.0) & (torque[1:] >= 0.0)) == TIP_INS


@pytest.mark.parametrize("name", PROFILES)
def test_no_jumps_and_within_their_bounds(name):
    profile = PROFILES[name]
    torque = profile.values(TIME)
    high = max(change[1] for change in profile.changes)
    fastest = (high - profile.low) / ENGINE_LAG if profile.lag else max(change[2] for change in profile.changes)
    assert torque.min() >= profile.low and torque.max() <= high
    assert np.abs(np.diff(torque)).max() <= 1.0001e-3 * fastest


def test_one_of_many_ramps_and_steps_is_the_single_one():
    first = TIME[TIME < 3.0]
    np.testing.assert_allclose(ramps(400.0).values(first), ramp(400.0).values(first), atol=1e-10)
    np.testing.assert_allclose(steps(150.0, -30.0).values(first), step(150.0).values(first), atol=1e-10)


def test_values_do_not_depend_on_which_instants_are_asked_for():
    profile = random()
    np.testing.assert_array_equal(profile.values(TIME)[::7], profile.values(TIME[::7]))


def test_a_change_before_the_last_is_reached_goes_on_from_where_it_is():
    profile = TorqueProfile(low=0.0, changes=((1.0, 100.0, 50.0), (2.0, 0.0, 25.0)))
    np.testing.assert_allclose(profile.values(np.array([0.5, 1.5, 2.0, 3.0, 4.0, 9.0])),
                               [0.0, 25.0, 50.0, 25.0, 0.0, 0.0])
    assert profile.tip_ins == (1.0,)


def test_duty_cycle_and_pulse_width_vary_where_they_should():
    def shape(profile):
        ups, downs = np.array(profile.tip_ins), np.array([t for t, torque, _ in profile.changes if torque < 0.0])
        return np.diff(ups), downs - ups

    period, width = shape(ramps(RATE))
    assert np.ptp(period) == pytest.approx(0.0, abs=1e-9) and np.ptp(width) == pytest.approx(0.0, abs=1e-9)
    period, width = shape(varying(1))
    assert np.ptp(period) == pytest.approx(0.0, abs=1e-9) and np.ptp(width) > 1.0
    period, width = shape(varying(2))
    assert np.ptp(period) > 1.0 and np.ptp(width) > 1.0


def test_random_is_the_seeds():
    assert random(1) == random(1) != random(2)


def test_the_profile_can_be_told_in_a_results_provenance():
    assert json.loads(json.dumps(random().describe()))["kind"] == "torque_profile"


def test_the_lag_is_the_engines():
    assert vehicles.load("pickup_10r80").values["engine.air_lag"] == ENGINE_LAG


def test_later_is_the_same_later():
    profile = random().later(0.007)
    np.testing.assert_allclose(profile.values(TIME[7:]), random().values(TIME[:-7]), atol=1e-9)
    assert profile.tip_ins == pytest.approx(np.array(random().tip_ins) + 0.007)


def test_spread_moves_each_tip_in_against_the_one_before():
    profile = random()
    spread = profile.spread(0.002)
    expected = [begin + 0.002 * i for i, begin in enumerate(profile.tip_ins)]
    assert spread.tip_ins == pytest.approx(expected, abs=1e-9)
    widths = [[end[0] - begin[0] for begin, end in zip(p.changes[::2], p.changes[1::2])] for p in (profile, spread)]
    np.testing.assert_allclose(widths[0], widths[1], atol=1e-9)
