"""Sensors that hang, or are at the end of their range."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.diagnose import _notices
from cosim.diagnosis.plants import Nuisance
from cosim.diagnosis.plants.frozen import frozen
from cosim.measured import Measurement

_TIME = np.arange(0.0, 7.0, 0.01)


def read(signal, noise, resolution, seed=1):
    """What a sensor with noise shows, as finely as it is read."""
    random = np.random.default_rng(seed)
    return resolution * np.round((signal + noise * random.standard_normal(signal.size)) / resolution)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("resolution", [0.01, 0.3, 0.9, 3.0, 30.0])  # of a noise of 1
def test_a_sensor_that_measures_is_not_taken_for_one_that_hangs(resolution, seed):
    for signal in (np.zeros(_TIME.size) + 5.0, 100.0 * _TIME, 100.0 * np.sin(_TIME)):
        assert not frozen(read(signal, 1.0, resolution, seed)).any()


@pytest.mark.parametrize("resolution", [0.01, 0.3, 0.8])
def test_all_that_a_sensor_repeats_while_it_hangs_is_found(resolution):
    values = read(50.0 * np.sin(_TIME) + 200.0, 1.0, resolution)
    hangs = (_TIME > 3.0) & (_TIME < 4.0)
    values[hangs] = values[~hangs & (_TIME <= 3.0)][-1]
    # chance may have it hang a sample longer
    assert set(np.flatnonzero(hangs)) <= set(np.flatnonzero(frozen(values))) and frozen(values).sum() <= hangs.sum() + 2


def test_what_is_beyond_the_range_of_a_sensor_is_none_that_was_measured():
    values = np.minimum(read(50.0 * np.sin(_TIME), 1.0, 0.1), 40.0)
    found, beyond = frozen(values), 50.0 * np.sin(_TIME) > 42.0
    assert found[beyond].mean() > 0.95 and not found[50.0 * np.sin(_TIME) < 38.0].any()


def test_what_is_read_coarsely_or_stands_still_does_not_hang():
    speed = np.where(_TIME < 3.0, 20.0, 20.0 + 3.0 * (_TIME - 3.0))
    assert not frozen(read(speed, 0.02, 0.28)).any()  # whole km/h
    standing = read(np.maximum(_TIME - 3.0, 0.0), 0.0, 0.01) + np.where(_TIME > 3.0, 0.01, 0.0)
    assert not frozen(standing).any()


@pytest.mark.parametrize("noise", [0.0, 0.2, 0.4])  # of the resolution
def test_a_smooth_speed_that_stands_still_in_a_cruise_does_not_hang(noise):
    """However its shuffle swings afterwards: that is motion, not noise that the cruise would have to show."""
    clock = np.arange(0.0, 10.0, 0.02)
    since = np.maximum(clock - 4.0, 0.0)
    swing = 0.15 * np.exp(-since) * (1.0 - np.cos(2.0 * np.pi * 5.0 * since))
    for seed in range(5):
        assert not frozen(read(57.0 + 4.3 * since + swing, 0.001 * noise, 0.001, seed)).any()


def test_the_rest_of_a_recording_counts_where_a_sensor_hangs(car_and_run, measurement):
    """It neither leads the simulation nor is compared there, and what limits the diagnosis says so."""
    car, whole = car_and_run
    manoeuvre = measurement.manoeuvres[0]
    speed = manoeuvre["vehicle_speed"]
    values = np.where(speed.time < 3.0, speed.values, speed.values[speed.time < 3.0][-1])
    hanging = replace(manoeuvre, channels={**manoeuvre.channels, "vehicle_speed": replace(speed, values=values)})
    given = Measurement("m", measurement.vehicle, measurement.variant, (hanging,))
    run, = car.runs(given)
    assert len(run.inputs) == len(whole.inputs) and run.clocks["engine_speed"].size == whole.clocks["engine_speed"].size
    assert run.clocks["vehicle_speed"].max() < 3.1
    inputs = car._prepared(car.values, run, Nuisance(), 0.0)
    leads = inputs[:, car.columns["leads_vehicle_speed"]]
    assert leads[1:2500].mean() > 0.9 and not leads[3600:].any()
    notice, = (text for text in _notices(given, car, [run], []) if "hangs" in text)
    assert "vehicle_speed" in notice and "3.9 s, from 3.05 to 7 s" in notice
    assert not any("hangs" in text for text in _notices(measurement, car, [whole], []))
