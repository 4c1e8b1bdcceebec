"""What a sensor shows, against exact signals and against the plant's own torque meter."""

import numpy as np
import pytest
from runs import plant, run, start_values, steps
from scipy.signal import cheb2ord, cheby2, freqz_sos

from cosim.diagnosis.plants.observation import CHANNELS, DEFAULTS, Errors, filtered, observe
from driveline.quantities import InputError

TIME = np.arange(1, 7001) * 1e-3
STAMPS = np.sort(np.random.default_rng(3).uniform(0.5, 6.5, 400))


def line(t):
    return 120.0 + 7.0 * np.asarray(t)


def shown(channel="engine_speed", signal=line, stamps=STAMPS, **errors):
    values = {f"observe.{channel}.{name}": value for name, value in errors.items()}
    return observe({channel: signal(TIME)}, TIME, values, channel, stamps)


def test_without_errors_a_channel_shows_the_truth_at_its_own_instants():
    for channel in CHANNELS:
        assert shown(channel) == pytest.approx(line(STAMPS), abs=1e-10)


def test_delay_clock_gain_and_offset_are_exact_on_a_straight_line():
    assert shown(delay=0.03) == pytest.approx(line(STAMPS - 0.03), abs=1e-10)
    assert shown(gain=1.1, offset=-4.0) == pytest.approx(1.1 * line(STAMPS) - 4.0, abs=1e-10)
    assert shown(clock_drift=0.01, clock_offset=0.2) == pytest.approx(line((STAMPS - 0.2) / 1.01), abs=1e-10)
    # a clock that runs fast stamps late: at a stamp the channel shows an earlier value
    assert (shown(clock_drift=0.01) < line(STAMPS)).all()
    together = shown(gain=1.1, offset=-4.0, delay=0.03, clock_drift=0.01)
    assert together == pytest.approx(1.1 * line(STAMPS / 1.01 - 0.03) - 4.0, abs=1e-10)


def test_eccentricity_swings_once_a_revolution_in_proportion_to_the_speed():
    speed, share, phase = 40.0, 0.01, 0.6
    seen = shown("wheel_speed", lambda t: np.full(t.size, speed), eccentricity=share, eccentricity_phase=phase)
    angle = speed * (STAMPS - TIME[0])
    assert seen == pytest.approx(speed * (1.0 + share * np.cos(angle + phase)), abs=1e-4)


@pytest.mark.parametrize("period", [1 / 120, 1 / 30, 0.08])
def test_the_filter_has_the_phase_and_gain_of_the_scaled_chebyshev_filter(period):
    frequency = 0.4 / period
    order, _ = cheb2ord(0.9 / period, 1.0 / period, 1.0, 80.0, fs=1000.0)
    _, response = freqz_sos(cheby2(order, 80.0, 1.0 / period, output="sos", fs=1000.0),
                            worN=[2.0 * np.pi * frequency / 1000.0])
    seen = shown("propeller_shaft_torque", lambda t: np.sin(2.0 * np.pi * frequency * t),
                 stamps=TIME[4000:], filter_period=period)
    angle = 2.0 * np.pi * frequency * TIME[4000:]
    expected = np.abs(response[0]) * np.sin(angle + np.angle(response[0]))
    assert seen == pytest.approx(expected, abs=2e-3)


def test_a_filter_that_vanishes_does_so_gradually():
    pulse = np.where((TIME > 1.0) & (TIME < 1.5), 100.0, 0.0)
    periods = np.concatenate([[0.0], np.geomspace(1e-5, 1e-2, 60)])
    seen = np.array([filtered(pulse, 1e-3, period, {}) for period in periods])
    assert (seen[0] == pulse).all()
    jump = np.abs(np.diff(seen, axis=0)).mean(axis=1)
    assert jump.max() < 0.2
    assert seen[:, -1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("variant", ["modified", None])
def test_it_shows_what_the_plants_own_torque_meter_shows(variant):
    model = plant("plant_fom", {"start.vehicle_speed": 12.0, "torque_meter.gain": 1.05,
                                "torque_meter.offset": 3.0}, variant=variant, engine_torque=-20.0)
    record = run(model, 3.0, engine_torque=steps((0.0, -20.0), (0.5, 200.0)))
    values = {**start_values("plant_fom", "pickup_10r80", variant, 5), "torque_meter.gain": 1.05,
              "torque_meter.offset": 3.0}
    seen = observe(record, record["time"], values, "propeller_shaft_torque", record["time"])
    inside = slice(5, None)
    assert seen[inside] == pytest.approx(record["propeller_shaft_torque_measured"][inside], abs=0.05)


def test_errors_of_the_file_and_of_the_effect_add_up():
    values = {"wheel_speed_sensor.delay": 0.01, "observe.wheel_speed.delay": 0.02, "torque_meter.enabled": 1.0,
              "torque_meter.stopband_frequency": 25.0, "observe.propeller_shaft_torque.filter_period": -0.04}
    assert Errors.of("wheel_speed", values).delay == pytest.approx(0.03)
    assert Errors.of("propeller_shaft_torque", values).filter_period == 0.0
    assert Errors.of("engine_speed", DEFAULTS) == Errors()
    with pytest.raises(InputError, match="observe.wheel_speed.dealy"):
        Errors.of("wheel_speed", {"observe.wheel_speed.dealy": 1.0})
