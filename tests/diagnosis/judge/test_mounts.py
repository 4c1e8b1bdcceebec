"""How a powertrain rolls on its mounts."""

import numpy as np
import pytest

from cosim.diagnosis.judge.mounts import SUPPOSED, turned, words

STEP = 1e-3
TWO = 2.0  # a gear in which the gears turn by as much as the housing rolls
TIME = np.arange(0.0, 3.0, STEP)
SOFT = [i for i, (_, doubled) in enumerate(SUPPOSED) if np.isinf(doubled)]
HARD = [i for i, (_, doubled) in enumerate(SUPPOSED) if np.isfinite(doubled)]


@pytest.mark.parametrize("supposed", SOFT)
def test_on_mounts_that_do_not_harden_it_rings_as_a_mass_on_a_spring(supposed):
    frequency, _ = SUPPOSED[supposed]
    rate, damping = 2.0 * np.pi * frequency, 0.12
    ringing = rate * np.sqrt(1.0 - damping**2)
    after = np.maximum(TIME - 1.0, 0.0)
    exact = 1.0 - np.exp(-damping * rate * after) * (
        np.cos(ringing * after) + damping * rate / ringing * np.sin(ringing * after))
    [found] = turned([np.where(TIME >= 1.0, 50.0, 0.0)], [TWO], STEP)
    np.testing.assert_allclose(found[:, supposed], exact / exact.max(), atol=0.04)  # half a step at 12.6 Hz


@pytest.mark.parametrize("supposed", HARD)
def test_mounts_are_twice_as_stiff_under_the_torque_that_is_said(supposed):
    _, doubled = SUPPOSED[supposed]
    borne = [np.full(10, torque) for torque in (0.0, 1e-3, doubled, 1.001 * doubled, -doubled)]
    rest, pushed, there, beyond, back = (run[:, supposed] for run in turned(borne, [TWO] * 5, STEP))
    assert np.ptp(there) < 1e-9 and rest[0] == 0.0 and back == pytest.approx(-there)  # it begins in equilibrium
    compliance = np.array([(pushed[0] - rest[0]) / 1e-3, (beyond[0] - there[0]) / (1e-3 * doubled)])
    assert there[0] / doubled / compliance[0] == pytest.approx(0.5, rel=1e-3)
    assert compliance[1] / compliance[0] == pytest.approx(1.0 / 3.0, rel=2e-3)  # of what it gives to a little more


@pytest.mark.parametrize("supposed", HARD[:3])
def test_mounts_that_harden_ring_faster_the_more_they_bear(supposed):
    """Of little swings about a load: by the root of the stiffness there, which is three times that at rest."""
    frequency, doubled = SUPPOSED[supposed]
    [found] = turned([np.where(TIME >= 0.1, 1.01, 1.0) * doubled], [TWO], STEP)
    swing = found[100:, supposed] - found[-1, supposed]
    turns = np.flatnonzero(np.diff(np.sign(swing)))[:6]
    assert 0.5 / (STEP * np.diff(turns).mean()) == pytest.approx(np.sqrt(3.0) * frequency, rel=0.03)


def test_in_a_direct_gear_it_turns_nothing_and_in_others_by_their_ratio():
    torque = 100.0 * np.sin(TIME)
    direct, over, low = turned([torque, torque, torque], [1.0, 0.8, 3.0], STEP)
    assert not direct.any() and np.abs(low).max(axis=0) == pytest.approx(1.0)
    np.testing.assert_allclose(over, -0.1 * low)
    assert not turned([torque], [1.0], STEP)[0].any()


def test_what_is_supposed_is_told():
    assert words(SOFT[0]).endswith("Hz on mounts") and words(HARD[0]).endswith("Hz on mounts that harden")
