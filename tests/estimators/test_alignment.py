"""Signals of one time: what was when, delays that are told, the delay that is found."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from driveline.estimators import alignment as a
from driveline.quantities import InputError

PERIOD = 0.01
STRETCH = 0.17


class Block:
    """An alignment alone."""

    def __init__(self, period=PERIOD, **delays):
        self.work = np.zeros(a.KNOWLEDGE + 3)
        self.work[:a.KNOWLEDGE] = a.SoughtDelays(**delays).constants(period, STRETCH)
        self.state = np.zeros(a.BLOCK)

    def take(self, *signals):
        """Takes a frame in; age, torque, engine and wheel speed of one time."""
        age = a.align(self.state, self.work, 0, 0, np.array(signals), a.KNOWLEDGE)
        return age, *self.work[a.KNOWLEDGE:]

    def learn(self, frames, lag, acceleration, torque_twist=lambda t: 0.0 * t, speed=30.0, seed=None):
        """Frames in contact whose wheel speed is late; the speeds are those at the shaft."""
        random = np.random.default_rng(seed)
        t = np.arange(frames + 1) * PERIOD
        wheel = speed + acceleration * (t - lag)
        rate = speed + acceleration * t - wheel + np.gradient(torque_twist(t), PERIOD)
        if seed is not None:
            rate += random.normal(0.0, 0.02, rate.size)
        for i in range(1, frames + 1):
            a.learn(self.state, self.work, 0, 0, 0.5 * (rate[i - 1] + rate[i]) * PERIOD, torque_twist(t)[i], wheel[i])

    @property
    def found(self):
        return self.state[a.FOUND], np.sqrt(self.state[a.VARIANCE])


# ---- frames of one time -------------------------------------------------------------------------------


def test_without_delays_frames_pass_as_they_are():
    block = Block()
    for frame in np.random.default_rng(1).normal(100.0, 30.0, (200, 3)):
        assert block.take(*frame) == (0.0, *frame)


@settings(max_examples=60)
@given(engine=st.floats(0.0, 0.05), wheel=st.floats(0.0, 0.05), period=st.sampled_from([1e-3, 2e-3, 1e-2, 0.03]))
def test_every_signal_is_read_as_it_was_when_the_latest_was_taken(engine, wheel, period):
    """Straight lines are met exactly, also between frames."""
    block = Block(period, engine_speed=engine, wheel_speed=wheel)
    for n in range(150):
        t = n * period
        age, *read = block.take(5.0 * t, 100.0 + 3.0 * (t - engine), 30.0 - 2.0 * (t - wheel))
    assert age == max(engine, wheel)
    then = t - age
    # a thousandth of a frame is no fraction of one
    np.testing.assert_allclose(read, [5.0 * then, 100.0 + 3.0 * then, 30.0 - 2.0 * then], atol=6e-3 * period)


def test_a_missing_frame_is_missing_when_its_time_has_come():
    block = Block(wheel_speed=0.02)
    frames = np.column_stack([np.arange(12.0), 100.0 + np.arange(12.0), 30.0 + np.arange(12.0)])
    frames[5, 1] = np.nan
    read = np.array([block.take(*frame)[1:] for frame in frames])
    np.testing.assert_array_equal(np.flatnonzero(read[:, 1] == a.ABSENT), [7])
    np.testing.assert_array_equal(read[2:, 0], frames[:-2, 0])
    np.testing.assert_array_equal(read[:, 2], frames[:, 2])


def test_a_delay_longer_than_what_is_kept_is_refused():
    with pytest.raises(InputError, match=r"delay.wheel_speed is 0.03 s: .* 0.0062 s are kept"):
        Block(1e-4, wheel_speed=0.03)


# ---- the delay that is found ----------------------------------------------------------------------------


@pytest.mark.parametrize("lag", [-0.02, 0.0, 0.03, 0.08])
@pytest.mark.parametrize("acceleration", [-3.0, 8.0])
def test_the_lag_is_found_while_the_speed_changes(lag, acceleration):
    block = Block()
    block.take(0.0, 0.0, 0.0)
    block.learn(1000, lag, acceleration)
    found, deviation = block.found
    assert found == pytest.approx(lag, abs=3.0 * deviation) and deviation < 2e-3


def test_a_constant_speed_teaches_nothing():
    block = Block()
    block.take(0.0, 0.0, 0.0)
    block.learn(1000, 0.03, 0.0)
    assert block.found == (0.0, pytest.approx(0.02))


def test_shuffle_teaches_nothing():
    """Whatever its phase: a stretch is a period of it."""
    for phase in np.linspace(0.0, 2.0 * np.pi, 7):
        block = Block()
        block.take(0.0, 0.0, 0.0)
        # twist that a wrong stiffness does not explain
        block.learn(600, 0.01, 8.0, lambda t, phase=phase: 0.02 * np.sin(2.0 * np.pi * t / STRETCH + phase))
        assert block.found[0] == pytest.approx(0.01, abs=1e-3)


def test_noise_is_averaged_and_the_deviation_is_not_too_small():
    errors = []
    for seed in range(40):
        block = Block()
        block.take(0.0, 0.0, 0.0)
        block.learn(300, 0.02, 8.0, seed=seed)
        errors.append((block.found[0] - 0.02) / block.found[1])
    assert np.sqrt(np.mean(np.square(errors))) < 1.2


def test_none_is_sought_where_none_is_unknown():
    block = Block(wheel_speed_deviation=0.0)
    block.take(0.0, 0.0, 0.0)
    block.learn(1000, 0.03, 8.0)
    assert block.found == (0.0, 0.0)
