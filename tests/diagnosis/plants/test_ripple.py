"""What ripple does to the engine speed, and what samples of that look like."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from cosim.diagnosis.plants import STEP, FullOrderCar, Nuisance
from cosim.diagnosis.plants.led import ANCHORS
from cosim.diagnosis.plants.observation import Errors
from cosim.diagnosis.plants.ripple import beyond_samples, swing
from cosim.diagnosis.plants.run import Run

FAST = butter(4, 40.0, "high", fs=1.0 / STEP, output="sos")


@pytest.mark.parametrize("torque", [-20.0, 120.0])
def test_the_crankshaft_swings_as_when_simulated(torque):
    """The response is that of the plant where it starts: here it stays on one flank, locked to the damper's plate."""
    car, anchor = FullOrderCar("pickup_10r80"), ANCHORS["engine_speed"]
    inputs = np.tile(car.idle_inputs, (4000, 1))
    inputs[:, car.columns["engine_torque"]], inputs[:, car.columns["gear"]] = torque, 5
    free = Run("steady", "cruise", 5, 0.0, inputs, 15.0, {}, {})
    rough = {**car.values, "torque_ripple.amplitude": 10.0, "torque_ripple.phase": 1.0}
    smooth, shaken = (car.raw(values, free)["engine_speed"] for values in (car.values, rough))
    led = Run("led", "cruise", 5, 0.0, inputs, 15.0, {}, {}, anchors={"engine_speed": CubicSpline(free.time, smooth)})
    car._prepared(rough, led, Nuisance(), 0.0)
    middle = free.time - 0.5 * STEP
    expected = swing(car._plant, "led_engine_speed", anchor.node, anchor.gain, np.interp(middle, free.time, smooth))
    settled = slice(1500, 3800)
    true = sosfiltfilt(FAST, shaken - smooth)[settled]
    assert np.std(true) > 0.03
    assert np.std(CubicSpline(middle, expected)(free.time)[settled] - true) < 0.02 * np.std(true)


def test_a_swing_that_samples_follow_is_left_as_it_is_and_of_one_that_they_do_not_nothing_is():
    time = STEP * np.arange(3000)
    every = np.arange(0.0, 3.0, 0.01)
    shown, errors = CubicSpline(every, np.zeros(every.size)), Errors()
    slow, fast = np.sin(2.0 * np.pi * 2.0 * time), np.sin(2.0 * np.pi * 100.0 * time + 1.0)
    assert np.max(np.abs(beyond_samples(slow, time, shown, errors)[50:-50])) < 1e-3
    # sampled at its own frequency it stands still
    assert np.allclose(beyond_samples(fast, time, shown, errors)[50:-50], (fast - np.sin(1.0))[50:-50], atol=1e-6)


def test_samples_are_those_of_a_sensor_that_is_late():
    time = STEP * np.arange(3000)
    every = np.arange(0.0, 3.0, 0.01)
    fast = np.sin(2.0 * np.pi * 100.0 * time + 1.0)
    left = beyond_samples(fast, time, CubicSpline(every, np.zeros(every.size)), Errors(delay=0.005))
    assert np.allclose(left[200:-200], (fast + np.sin(1.0))[200:-200], atol=1e-6)
