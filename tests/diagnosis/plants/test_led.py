"""Simulations led along measured speeds."""

from dataclasses import replace

import numpy as np
import pytest
from floors import FLOORS
from scipy.interpolate import CubicSpline

from cosim.diagnosis.plants import Nuisance
from cosim.diagnosis.plants.led import led_by
from cosim.diagnosis.plants.observation import observe


def test_led_by_its_own_speeds_it_goes_its_own_way(car_and_run):
    car, run = car_and_run
    free = car.raw(car.values, run.free)
    led = car.raw(car.values, led_by(run, free))
    for name in ("engine_speed", "propeller_shaft_torque", "wheel_speed"):
        # what leads it is half a step old, sampled once a step
        assert np.max(np.abs(led[name] - free[name])) < 2e-2 * np.ptp(free[name])


@pytest.mark.parametrize(("noisy", "ripple", "lost", "most"), [
    (False, 0.0, 0.0, 0.03), (True, 0.0, 0.0, 0.25), (False, 35.0, 0.0, 0.04), (False, 0.0, 0.1, 0.03)])
def test_what_leads_it_leaves_little_beside_the_noise_of_the_channels(car_and_run, noisy, ripple, lost, most):
    """Straight lines between samples damp shuffle, by 0.09 of the speeds' noise; noise that leads moves the seat.

    Little enough to be overlooked, and slow enough to move the parameters of five recordings by 3 sigma. Ripple of 70
    to 120 Hz, sampled every 10 ms, would shake the driveline slowly, by 0.37 of the noise. A curve through both ends of
    a tenth of a second without frames would miss a trough of the shuffle, by 0.18.
    """
    car, run = car_and_run
    values = {**car.values, "torque_ripple.amplitude": ripple, "torque_ripple.phase": 1.0}
    raw, random = car.raw(values, run.free), np.random.default_rng(1)
    anchors, swing = {}, run.time[np.argmax(raw["propeller_shaft_torque"])]  # the engine is slowed down most there
    for name, every in (("engine_speed", 10), ("vehicle_speed", 50)):
        time, shown = run.time[every // 2::every], raw[name][every // 2::every]
        seen = np.abs(time - swing) > 0.5 * lost
        time, shown = time[seen], shown[seen]
        anchors[name] = CubicSpline(time, shown + noisy * FLOORS[name] * random.standard_normal(time.size))
    left = car.predict(values, replace(run, anchors=anchors)) - car.predict(values, run.free)
    for name, place in run.slices.items():
        assert np.sqrt(np.mean(left[place] ** 2)) < most * FLOORS[name], name


@pytest.mark.parametrize("errors", [{"delay": 0.05}, {"gain": 1.02, "offset": 0.1},
                                    {"clock_drift": 1e-3, "clock_offset": 0.03}])
def test_what_the_sensors_that_lead_it_do_is_undone(car_and_run, errors):
    """By speeds that are late, or off, it is led as by those that are right, where it is known what they do."""
    car, run = car_and_run
    raw, names = car.raw(car.values, run.free), ("engine_speed", "vehicle_speed")
    wrong = car.values | {f"observe.{name}.{error}": size for name in names for error, size in errors.items()}
    clock = np.arange(run.start - 0.2, run.time[-1] + 0.2, 1e-3)
    shown = {name: CubicSpline(clock, observe(raw, run.time, wrong, name, clock)) for name in names}
    right, undone, taken = (car.raw(values, replace(run, anchors=anchors, gaps=())) for values, anchors in (
        (car.values, led_by(run, raw).anchors), (wrong, shown), (car.values, shown)))
    for name in names:
        left = np.abs(undone[name] - right[name]).max()
        assert left < 0.02 * np.abs(taken[name] - right[name]).max() and left < 0.02 * FLOORS[name], name


def test_a_led_driveline_forgets_a_torque(car_and_run):
    car, run = car_and_run
    led = led_by(run, car.raw(car.values, run.free))
    kick = np.zeros(len(run.inputs))
    kick[2500:2600] = 5.0
    for one, forgets in ((led, True), (run.free, False)):
        change = np.abs(car.raw(car.values, one, Nuisance(), kick)["vehicle_speed"]
                        - car.raw(car.values, one)["vehicle_speed"])
        assert (change[-500:].max() < 0.3 * change.max()) == forgets
