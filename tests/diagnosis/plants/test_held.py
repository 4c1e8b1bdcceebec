"""Channels that a logger wrote more often than they were measured."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.diagnose import _notices
from cosim.diagnosis.fit.noise import floors
from cosim.diagnosis.plants.held import updates
from cosim.measured import Measurement

_ROWS = np.arange(0.0, 7.0, 0.001)


def measured(period, noise=1.0, resolution=0.1, jitter=0.03, seed=1):
    """When a signal was measured, and what was read."""
    random = np.random.default_rng(seed)
    clock = np.arange(0.0, 7.0, period)
    clock[1:] += jitter * period * random.standard_normal(clock.size - 1)
    values = 100.0 * np.sin(clock) + noise * random.standard_normal(clock.size)
    return clock, resolution * np.round(values / resolution)


def held(clock, values, rows=_ROWS):
    return values[np.searchsorted(clock, rows, side="right") - 1]


@pytest.mark.parametrize(("period", "jitter"), [
    (0.002, 0.0), (0.004, 0.0), (0.01, 0.04), (0.02, 0.04), (0.05, 0.04), (0.1, 0.0)])
def test_what_was_measured_is_found_among_what_was_held(period, jitter):
    clock, values = measured(period, jitter=jitter)
    found = updates(held(clock, values))
    assert found.size == pytest.approx(clock.size, abs=0.04 * clock.size + 1)
    apart = np.abs(np.interp(_ROWS[found], clock, np.arange(clock.size)) - np.round(
        np.interp(_ROWS[found], clock, np.arange(clock.size))))
    assert np.mean(apart * period <= 0.001 + 0.1 * period) > 0.98


@pytest.mark.parametrize("resolution", [0.01, 0.3, 1.0, 3.0, 10.0, 30.0])
def test_what_is_written_as_it_is_measured_is_not_held(resolution):
    """However coarsely it is read, and also where it moves evenly or hardly."""
    for seed in range(5):
        assert updates(measured(0.01, resolution=resolution, seed=seed)[1]) is None
    for signal in (10.0 * _ROWS, 0.3 * _ROWS, np.full(_ROWS.size, 5.0), 100.0 * np.sin(_ROWS)):
        assert updates(resolution * np.round(signal / resolution)) is None


def test_a_torque_that_stays_is_no_slow_ramp_to_the_next():
    clock = np.arange(0.0, 7.0, 0.01)
    values = 90.0 + 110.0 * np.tanh(np.clip((clock - 1.1) / 0.1, -1.5, 1.5))
    found = updates(held(clock, values), stays=True)
    assert np.allclose(np.interp(clock, _ROWS[found], held(clock, values)[found]), values, atol=15.0)
    lost = np.delete(np.arange(clock.size), slice(300, 305))  # of a sensor: nobody knows
    clock, values = measured(0.01)
    apart = np.diff(_ROWS[updates(held(clock[lost], values[lost]))])
    assert apart.max() == pytest.approx(0.06, abs=0.003)


def test_held_rows_count_as_what_was_measured(car_and_run, measurement):
    car, run = car_and_run
    manoeuvre, = measurement.manoeuvres
    rows = np.arange(manoeuvre.start, manoeuvre.stop, 0.001)
    table = {name: replace(channel, time=rows, values=held(channel.time, channel.values, rows))
             for name, channel in manoeuvre.channels.items()}
    given = Measurement("m", measurement.vehicle, measurement.variant, (replace(manoeuvre, channels=table),))
    again, = car.runs(given)
    for name, clock in run.clocks.items():
        assert again.clocks[name].size == pytest.approx(clock.size, rel=0.1)  # some read the same twice
    torque = car.columns["engine_torque"]
    assert np.abs(again.inputs[200:6000, torque] - np.interp(
        again.time[200:6000] - 0.001, run.time - 0.001, run.inputs[:, torque])).max() < 25.0
    before, after = floors([run]), floors([again])
    assert all(after[name] == pytest.approx(before[name], rel=0.25) for name in before)
    notice, = (text for text in _notices(given, car, [again], []) if "held" in text)
    assert "engine_speed" in notice and not any("held" in text for text in _notices(measurement, car, [run], []))
