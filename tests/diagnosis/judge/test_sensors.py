"""Whether a sensor errs, or a torque is missing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from floors import measured, shortened
from scipy.interpolate import CubicSpline

from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.judge.localise import Supposed
from cosim.diagnosis.judge.sensors import WrongSensor, odd_one, wrong_sensors
from cosim.diagnosis.plants import Nuisance
from cosim.diagnosis.plants.led import PLACES

_PLACES = ("engine", "axle", "vehicle")


@pytest.fixture(scope="module")
def short(car_and_run, measurement):
    car, _ = car_and_run
    return car, shortened(car.runs(measurement)[0], 4.0)


def odd(car, led):
    """The sensor that is at odds with all else in a run, beside a car that is fitted once."""
    with Predictor(car, [led], coordinates(car, [led])) as predictor:
        fitter = Fitter(predictor)
        fit = fitter.nominal()
        noise = fitter.noise(fit)
        supposed = Supposed(predictor, fitter.refine(fit, noise, 5), noise, _PLACES)
        return odd_one(wrong_sensors(supposed), supposed.listed())


def wrong(car, run, channel, change):
    """A run in which a channel, and what is led along it, is something else: of what is shown by a clock."""
    raw = car.raw(car.values, run.free)
    led = measured(car, run, raw)
    noise = led.measured[channel] - car.instruments(raw, car.values, run)[run.slices[channel]]
    shown = CubicSpline(run.time, raw[channel])
    anchors = dict(led.anchors)
    if channel in anchors:
        anchors[channel] = CubicSpline(run.time, change(shown, run.time))
    return replace(led, anchors=anchors,
                   measured={**led.measured, channel: change(shown, led.clocks[channel]) + noise})


def test_of_two_channels_that_contradict_each_other_either_may_be_wrong():
    sensors = [WrongSensor(name, gain, "lasting", 1.0) for name, gain in (
        ("a", 500.0), ("b", 0.0), ("c", 0.0), ("what drives", 0.0))]
    assert odd_one(sensors, []) is sensors[0] and odd_one(sensors[:3], []) is None
    close = [sensors[0], WrongSensor("b", 499.0, "lasting", 1.0), *sensors[2:]]
    assert odd_one(close, []) is None


# one leads the simulation, and its error pushes all that is simulated
@pytest.mark.parametrize("channel", ["vehicle_speed", "seat_acceleration"])
def test_a_late_channel_is_no_torque_that_is_missing(short, channel):
    car, run = short
    sensor = odd(car, wrong(car, run, channel, lambda shown, clock: shown(np.maximum(clock - 0.05, run.time[0]))))
    assert (sensor.channel, sensor.kind) == (channel, "delay")
    assert sensor.size == pytest.approx(0.05, rel=0.2)


@pytest.mark.parametrize("late", [0.1, -0.1])
def test_a_late_torque_is_no_channel_that_contradicts_all_else(short, late):
    """All the others are early against it together."""
    car, run = short
    given = measured(car, run, car.raw(car.values, run.free))
    inputs, column = given.inputs.copy(), car.columns[car.driver]
    inputs[:, column] = np.interp(run.time - late, run.time, inputs[:, column])
    sensor = odd(car, replace(given, inputs=inputs))
    assert (sensor.channel, sensor.kind) == ("engine_torque", "delay")
    assert sensor.size == pytest.approx(late, rel=0.3)  # fitting a healthy car without it took some of it


def test_what_drives_the_simulation_is_not_late_where_the_plant_refuses_that(short, monkeypatch):
    """And a diagnosis does not end there."""
    monkeypatch.setattr("cosim.diagnosis.judge.sensors.Predictor",
                        lambda *_: SimpleNamespace(all_runs=lambda points: None))
    car, run = short
    sensor = odd(car, wrong(car, run, "differential_acceleration", lambda shown, clock: -shown(clock)))
    assert (sensor.channel, sensor.kind) == ("differential_acceleration", "factor")


def test_a_sign_that_is_wrong_is_one(short):
    car, run = short
    sensor = odd(car, wrong(car, run, "differential_acceleration", lambda shown, clock: -shown(clock)))
    assert (sensor.channel, sensor.kind) == ("differential_acceleration", "factor")
    assert sensor.size < 0.0


def test_a_channel_that_wanders_off_is_one(short):
    car, run = short
    sensor = odd(car, wrong(car, run, "wheel_speed", lambda shown, clock: shown(clock) + 0.3 * np.sin(3.0 * clock)))
    assert (sensor.channel, sensor.kind) == ("wheel_speed", "lasting")
    assert sensor.size == pytest.approx(0.2, rel=0.3)


def test_a_channel_that_is_off_by_as_much_throughout_errs_by_about_that(short):
    """Less the start speed that was fitted to it; it errs by no twentieth, by which that varies."""
    car, run = short
    sensor = odd(car, wrong(car, run, "vehicle_speed", lambda shown, clock: shown(clock) + 0.5))
    assert (sensor.channel, sensor.kind) == ("vehicle_speed", "lasting")
    assert 0.2 < sensor.size < 0.6


@pytest.mark.parametrize("place", _PLACES)
def test_a_torque_that_is_missing_is_no_sensor(short, place):
    car, run = short
    push = 3.0 * PLACES[place].size * np.sin(2.0 * np.pi * (0.5 if place == "vehicle" else 2.0) * run.time)
    assert odd(car, measured(car, run, car.pushed(car.values, run.free, Nuisance(), place, push))) is None
