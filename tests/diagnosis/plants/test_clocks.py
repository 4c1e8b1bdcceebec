"""Channels of another logger are named, with what their clock is off by; nothing that the catalogue can have is one."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar, clocks
from cosim.diagnosis.plants.clocks import Lag, check, lag, lags
from cosim.measured import load
from driveline.quantities import InputError

SPEEDS = ("engine_speed", "turbine_speed", "transmission_output_speed", "wheel_speed", "vehicle_speed")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A heavy car on soft shafts, whose shuffle is not the file's, and what it did."""
    folder = tmp_path_factory.mktemp("clocks") / "m"
    hide(["vehicle_mass=1.2", "shaft_stiffness=axle_shaft_stiffness:0.8"], 2, folder,
         manoeuvres=["tip_in:4", "pulse_train:5"])
    measurement = load(folder)
    return FullOrderCar(measurement.vehicle, measurement.variant), measurement


def shifted(measurement, seconds, **changes):
    """The recordings with channels that are so much later."""
    return replace(measurement, manoeuvres=tuple(
        replace(manoeuvre, **changes, channels={
            name: replace(channel, time=channel.time + seconds.get(name, 0.0))
            for name, channel in manoeuvre.channels.items()}) for manoeuvre in measurement.manoeuvres))


def test_what_is_possible_is_what_delays_of_the_catalogue_go_to():
    latest = [max(map(abs, p.limits)) for found in CATALOGUE.values() for p in found.parameters
              if any(target.endswith("delay") for target in p.targets)]
    assert max(latest) == clocks._POSSIBLE < clocks._LATE


def test_what_is_shifted_is_found_exactly():
    """Two signals that are one but for a shift, and for a factor of either sign."""
    signal = np.convolve(np.random.default_rng(1).normal(size=1000), np.ones(20), "valid")
    for shift in (-250, -45, 0, 17, 30, 41, 290):
        early, late = signal[max(0, shift):][:600], signal[max(0, -shift):][:600]
        found = lag(-3.0 * late + 7.0, early, 0.01)
        assert found.seconds == pytest.approx(0.01 * shift, abs=1e-9)
        assert found.late == (abs(shift) > 40) and found.on_time == (abs(shift) < 31)
    assert lag(signal[:600], signal[:600], 0.01, 1.23).seconds == pytest.approx(1.23)  # its clock began later
    nothing = lag(signal[:600], np.zeros(600), 0.01)
    assert not nothing.late and not nothing.on_time


def test_one_clock_is_on_time(recorded):
    car, measurement = recorded
    check(car, measurement)
    for manoeuvre in measurement.manoeuvres:
        found = lags(car, manoeuvre)
        assert set(SPEEDS) < set(found) and "differential_acceleration" not in found
        assert all(abs(each.seconds) <= 0.05 and not each.late for each in found.values())
    assert all(each.on_time for each in lags(car, measurement.manoeuvres[0]).values())


@pytest.mark.parametrize("seconds", [-2.0, -0.62, 0.62, 2.0])
@pytest.mark.parametrize("channel", ["engine_speed", "wheel_speed", "propeller_shaft_torque", "seat_acceleration"])
def test_a_channel_of_another_logger_is_named(recorded, channel, seconds):
    car, measurement = recorded
    late = shifted(measurement, {channel: seconds})
    found = [lags(car, manoeuvre) for manoeuvre in late.manoeuvres]
    assert {name for name, each in found[0].items() if each.late} == {channel}
    assert {name for name, each in found[1].items() if each.late} <= {channel}  # pulses are alike
    assert [each[channel].seconds for each in found] == pytest.approx([seconds, seconds], abs=0.03)
    with pytest.raises(InputError, match=rf"'{late.manoeuvres[0].name}': {channel} is about [\d.]+ s "
                       rf"{'late' if seconds > 0.0 else 'early'} against engine_torque.*write delay = -?[\d.]+ under "
                       rf"\[channels.{channel}\]"):
        check(car, late)


@pytest.mark.parametrize("seconds", [-1.4, 0.5])
def test_where_all_else_is_late_it_is_the_torque(recorded, seconds):
    car, measurement = recorded
    said = "late" if seconds > 0.0 else "early"
    with pytest.raises(InputError, match=rf"engine_torque is about [\d.]+ s {said} against all else.*write delay = "
                       rf"{'-' * (seconds < 0.0)}\d\.\d+ under \[channels.engine_torque\]"):
        check(car, shifted(measurement, {"engine_torque": seconds}))


def test_where_one_channel_is_on_time_it_is_not_the_torque(recorded):
    """Which is then of the same logger."""
    car, measurement = recorded
    others = [name for name in measurement.manoeuvres[0].channels if name not in ("engine_torque", "vehicle_speed")]
    with pytest.raises(InputError, match="engine_speed is about .* late, .* against engine_torque"):
        check(car, shifted(measurement, dict.fromkeys(others, 0.85)))


def test_two_channels_of_one_logger_are_named_together(recorded):
    car, measurement = recorded
    with pytest.raises(InputError, match="wheel_speed is about 0.8. s late, vehicle_speed is about 0.8. s late"):
        check(car, shifted(measurement, {"wheel_speed": 0.85, "vehicle_speed": 0.85}))


def test_what_it_is_against_is_not_known_of_two(recorded):
    """With one channel beside the torque either may be of the other logger; the message says against which."""
    car, measurement = recorded
    few = replace(measurement, manoeuvres=tuple(
        replace(m, channels={name: m[name] for name in ("engine_torque", "vehicle_speed")})
        for m in measurement.manoeuvres))
    with pytest.raises(InputError, match="vehicle_speed is about (0.99|1.0.) s late against engine_torque"):
        check(car, shifted(few, {"vehicle_speed": 1.0}))


def test_a_time_of_day_is_as_good(recorded):
    car, measurement = recorded
    later = dict.fromkeys(measurement.manoeuvres[0].channels, 36000.0)
    check(car, shifted(measurement, later))
    with pytest.raises(InputError, match="wheel_speed is about 0.6. s late"):
        check(car, shifted(measurement, later | {"wheel_speed": 36000.62}))


def test_a_wrong_sign_is_not_a_clock(recorded):
    """Which is told by another message."""
    car, measurement = recorded
    turned = replace(measurement, manoeuvres=tuple(
        replace(m, channels={name: replace(channel, values=-channel.values if "torque" in name else channel.values)
                             for name, channel in m.channels.items()}) for m in measurement.manoeuvres))
    check(car, turned)


@pytest.mark.parametrize("effect", ["wheel_speed_delay=0.3", "engine_torque_delay=0.3", "engine_speed_delay=0.2",
                                    "torque_meter_filter=0.2", "clock_drift=0.02",
                                    "converter_slip=lockup_capacity:0.03"])
def test_what_the_catalogue_explains_is_left_to_it(tmp_path, effect):
    hide([effect], 4, tmp_path / "m", manoeuvres=["tip_out:3", "ramp:5"])
    measurement = load(tmp_path / "m")
    check(FullOrderCar(measurement.vehicle, measurement.variant), measurement)


def test_what_cannot_be_told_is_not_asked(recorded, monkeypatch):
    """A drive, several gears, a sensor that was not there, a torque that cannot be simulated."""
    car, measurement = recorded
    late = shifted(measurement, {"wheel_speed": 0.62})
    check(car, shifted(late, {}, kind="drive"))
    manoeuvre = late.manoeuvres[0]
    time = manoeuvre["engine_torque"].time
    gear = replace(manoeuvre["engine_torque"], name="gear", unit="1", values=np.where(time < 3.0, 4.0, 5.0))
    assert not lags(car, replace(manoeuvre, gear=None, channels={**manoeuvre.channels, "gear": gear}))
    same = replace(gear, values=np.full(time.size, 4.0))
    assert lags(car, replace(manoeuvre, gear=None, channels={**manoeuvre.channels, "gear": same}))["wheel_speed"].late
    dead = replace(manoeuvre["wheel_speed"], values=np.full_like(manoeuvre["wheel_speed"].values, 9.0))
    assert "wheel_speed" not in lags(car, replace(manoeuvre, channels={**manoeuvre.channels, "wheel_speed": dead}))

    def fails(values, run):
        raise ArithmeticError("left the finite numbers")

    monkeypatch.setattr(car, "raw", fails)
    check(car, late)


def test_a_lag_in_between_is_neither():
    assert Lag(0.62, 0.05, 5.0).late and Lag(0.0, 0.05, 0.2).on_time
    assert not Lag(0.62, 0.05, 3.0).late and not Lag(0.0, 0.05, 0.3).on_time
    assert not Lag(0.62, 0.2, 5.0).late  # as an engine's whose clutch slips
    assert not Lag(0.35, 0.05, 100.0).late
