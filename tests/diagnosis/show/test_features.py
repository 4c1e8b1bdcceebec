"""Features read off signals whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.plants import STEP, Run
from cosim.diagnosis.show.features import FEATURES, Reader, loop_area, order_content, unit_of, words

DURATION = 7.0


def recorded(drive, periods=None, **signals):
    """A run with ``signals(time)`` as its channels and ``drive(time)`` as the torque."""
    time = STEP * np.arange(1, round(DURATION / STEP) + 1)
    clocks = {name: np.arange(0.3, DURATION - 0.05, (periods or {}).get(name, 0.01)) for name in signals}
    return Run("x", "tip_in", 5, 0.0, drive(time)[:, None], 15.0, clocks,
               {name: signal(clocks[name]) for name, signal in signals.items()})


def step(time, at=1.0):
    return np.where(time < at, -20.0, 200.0)


def read(run, reference=None):
    return Reader(run, run.stacked if reference is None else reference.stacked).read(run.stacked)


def ringing(frequency, damping, size=100.0, at=1.0):
    """A torque that steps and rings."""
    omega = 2.0 * np.pi * frequency / np.sqrt(1.0 - damping**2)

    def signal(time):
        t = np.maximum(time - at, 0.0)
        swing = np.exp(-damping * omega * t) * np.cos(2.0 * np.pi * frequency * t)
        return np.where(time < at, -30.0, 300.0 - size * swing)

    return signal


def smooth(frequency):
    """A torque that rises in a tenth of a second and rings, without a corner that sampling could miss."""
    def signal(time):
        t = np.maximum(time - 1.0, 0.0)
        return 135.0 + 165.0 * np.tanh((time - 1.0) / 0.06) + 80.0 * t / (t + 0.05) * np.exp(-2.0 * t) * np.sin(
            2.0 * np.pi * frequency * t)

    return signal


@pytest.mark.parametrize("frequency", [2.3, 5.88, 7.14])
@pytest.mark.parametrize("damping", [0.02, 0.06, 0.12])
def test_shuffle_is_that_of_a_damped_sinusoid(frequency, damping):
    """On a signal that drifts, too, and whatever its size."""
    def signal(time):
        return 0.2 * ringing(frequency, damping)(time) + 3.0 * time + 0.5 * time**2

    found = read(recorded(step, propeller_shaft_torque=signal))
    assert found[("propeller_shaft_torque", "shuffle frequency")] == pytest.approx(frequency, rel=4e-3)
    assert found[("propeller_shaft_torque", "shuffle damping")] == pytest.approx(damping, rel=0.05)


def test_without_a_quick_change_of_torque_there_is_no_shuffle_to_read():
    def slow(time):
        return 40.0 + 10.0 * np.sin(time)

    found = read(recorded(slow, propeller_shaft_torque=lambda time: 2.0 * slow(time)))
    assert not {"shuffle frequency", "shuffle damping", "overshoot"} & {feature for _, feature in found}


def test_what_does_not_ring_has_no_shuffle_frequency():
    random = np.random.default_rng(1)
    found = read(recorded(step, engine_speed=lambda time: 100.0 + 9.0 * time + random.normal(size=time.size)))
    assert ("engine_speed", "shuffle frequency") not in found


def test_what_swings_where_the_reference_does_not_is_not_late():
    """No shift within what is looked at makes it fit, so the best of them is at an end."""
    plain = recorded(step, {"wheel_speed": 0.02}, wheel_speed=lambda t: 30.0 + 2.0 * np.tanh((t - 1.0) / 2.0))
    swings = recorded(step, {"wheel_speed": 0.02}, wheel_speed=lambda t: (
        30.0 + 2.0 * np.tanh((t - 1.0) / 2.0)) * (1.0 + 0.01 * np.cos(30.0 * t)))
    found = read(swings, plain)
    assert ("wheel_speed", "lag") not in found and ("wheel_speed", "amplitude") not in found
    assert found[("wheel_speed", "waveform")] > 0.1
    assert read(plain)[("wheel_speed", "lag")] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("lag", [-0.021, 0.0, 0.004, 0.030, 0.110])
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.25])
def test_a_shifted_and_scaled_signal_has_that_lag_and_amplitude(lag, gain):
    base = smooth(5.0)
    run = recorded(step, {"wheel_speed": 0.02}, wheel_speed=lambda time: gain * base(time - lag) + 7.0)
    reference = recorded(step, {"wheel_speed": 0.02}, wheel_speed=base)
    found = read(run, reference)
    assert found[("wheel_speed", "lag")] == pytest.approx(lag, abs=1.5e-3)
    assert found[("wheel_speed", "amplitude")] == pytest.approx(gain, rel=0.03)
    before, after = Reader(run, reference.stacked).shifted_share("wheel_speed", run.stacked)
    assert after < 0.05 * before or abs(lag) < 0.005 and gain == 1.0


def test_one_channel_is_late_behind_the_others_whatever_moves_all_of_them():
    """All 12 ms late, as the torque was, and one sensor 4 ms more."""
    base = smooth(5.0)

    def run(common, own):
        def late(lag):
            return lambda time: base(time - lag)

        return recorded(step, engine_speed=late(common), turbine_speed=late(common),
                        propeller_shaft_torque=late(common + own), seat_acceleration=late(common))

    found = read(run(0.012, 0.004), run(0.0, 0.0))
    assert found[("engine_speed", "lag")] == pytest.approx(0.012, abs=5e-4)
    assert found[("propeller_shaft_torque", "lag behind the others")] == pytest.approx(0.004, abs=5e-4)
    assert found[("engine_speed", "lag behind the others")] == pytest.approx(0.0, abs=5e-4)


def test_another_frequency_is_no_shift():
    run, reference = (recorded(step, wheel_speed=smooth(f)) for f in (5.0, 5.6))
    before, after = Reader(run, reference.stacked).shifted_share("wheel_speed", run.stacked)
    assert after > 0.2 * before


def test_what_is_turned_round_is_not_half_a_period_late():
    """As of an accelerometer that is mounted upside down."""
    reference = recorded(step, seat_acceleration=smooth(6.0))
    turned = read(recorded(step, seat_acceleration=lambda time: -smooth(6.0)(time)), reference)
    assert not {("seat_acceleration", "lag"), ("seat_acceleration", "amplitude")} & set(turned)
    assert ("seat_acceleration", "waveform") in turned
    assert ("seat_acceleration", "lag") in read(reference)


def test_beside_a_torque_that_hardly_changes_another_has_no_gain_or_zero_offset():
    """As where the simulation's torque coasts, and the car's does not."""
    def coasting(time):
        return -45.0 + 0.2 * time

    found = read(recorded(step, propeller_shaft_torque=smooth(6.0)), recorded(step, propeller_shaft_torque=coasting))
    assert not {("propeller_shaft_torque", "gain"), ("propeller_shaft_torque", "zero offset")} & set(found)


def test_where_a_recording_begins_in_the_shuffle_its_torque_has_no_gain_or_zero_offset():
    """A simulation that begins steadily changes by less than what swings still: the line through both had a factor of
    -2.5, and was 1000 N.m off at a torque of 0."""
    def steady(time):
        return 288.0 + 0.25 * np.sin(0.5 * time)

    def swings(time):
        return 288.0 - 0.75 * np.sin(0.5 * time) + 17.0 * np.exp(-1.5 * time) * np.cos(2.0 * np.pi * 6.0 * time)

    found = read(recorded(step, propeller_shaft_torque=swings), recorded(step, propeller_shaft_torque=steady))
    assert not {("propeller_shaft_torque", "gain"), ("propeller_shaft_torque", "zero offset")} & set(found)


def test_gain_and_zero_offset_of_a_torque_are_told_apart():
    base = ringing(5.0, 0.06)
    found = read(recorded(step, propeller_shaft_torque=lambda time: 1.04 * base(time) - 12.0),
                 recorded(step, propeller_shaft_torque=base))
    assert found[("propeller_shaft_torque", "gain")] == pytest.approx(1.04)
    assert found[("propeller_shaft_torque", "zero offset")] == pytest.approx(-12.0)


@pytest.mark.parametrize("lag", [0.02, -0.015, 0.08])
def test_a_torque_that_is_late_has_the_gain_and_zero_offset_it_has(lag):
    found = read(recorded(step, {"propeller_shaft_torque": 0.004},
                          propeller_shaft_torque=lambda time: 1.1 * smooth(5.9)(time - lag) + 7.0),
                 recorded(step, {"propeller_shaft_torque": 0.004}, propeller_shaft_torque=smooth(5.9)))
    assert found[("propeller_shaft_torque", "gain")] == pytest.approx(1.1, abs=0.003)
    assert found[("propeller_shaft_torque", "zero offset")] == pytest.approx(7.0, abs=0.6)


def test_dead_time_is_how_long_the_torque_stays_at_zero():
    """From -100 N.m at 1 kN.m/s up to zero, a plateau of 0.13 s there, up to 300 N.m."""
    def signal(time):
        return np.interp(time, [1.0, 1.1, 1.23, 1.53], [-100.0, 0.0, 0.0, 300.0])

    found = read(recorded(step, {"propeller_shaft_torque": 0.004}, propeller_shaft_torque=signal))
    band = 0.05 * 400.0
    assert found[("propeller_shaft_torque", "reversal dead time")] == pytest.approx(
        0.13 + 2.0 * band / 1000.0, abs=2e-3)


def test_a_torque_that_never_reverses_has_no_dead_time():
    found = read(recorded(step, propeller_shaft_torque=lambda time: 100.0 + ringing(5.0, 0.06)(time)))
    assert ("propeller_shaft_torque", "reversal dead time") not in found


def test_overshoot_is_the_first_peak_over_the_level_it_settles_at():
    found = read(recorded(step, {"propeller_shaft_torque": 0.004},
                          propeller_shaft_torque=ringing(2.0, 0.1, at=1.0)))
    first_peak = 100.0 * np.exp(-0.1 * np.pi / np.sqrt(1.0 - 0.1**2))
    assert found[("propeller_shaft_torque", "overshoot")] == pytest.approx(first_peak, rel=0.05)


def test_a_hysteresis_loop_encloses_its_area():
    """A parallelogram, by shoelace exactly; run through three times, three times that."""
    x = np.concatenate([np.linspace(0.0, 10.0, 50), np.linspace(10.0, 0.0, 50)])
    y = 3.0 * x + np.where(np.arange(100) < 50, -2.0, 2.0)
    assert loop_area(x, y) == pytest.approx(10.0 * 4.0)
    assert loop_area(np.tile(x, 3), np.tile(y, 3)) == pytest.approx(3.0 * 10.0 * 4.0)
    assert loop_area(x, 3.0 * x) == pytest.approx(0.0, abs=1e-9)


def test_loop_area_of_a_torque_is_read_where_the_drive_comes_back():
    def swing(time):
        return 100.0 * np.sin(2.0 * np.pi * time)

    def late(time):
        return 100.0 * np.sin(2.0 * np.pi * time - 0.5)

    found = read(recorded(swing, propeller_shaft_torque=late))
    rounds = DURATION - 0.35
    assert found[("propeller_shaft_torque", "loop area")] == pytest.approx(
        rounds * np.pi * 100.0**2 * np.sin(0.5), rel=0.02)
    assert ("propeller_shaft_torque", "loop area") not in read(recorded(step, propeller_shaft_torque=late))


def test_drift_and_speed_ratio():
    """A wheel speed that is late while the vehicle gains speed does not change the ratio."""
    def true(time):
        return 40.0 + 2.0 * time + 0.3 * np.sin(1.3 * time)

    found = read(recorded(step, {"wheel_speed": 0.02}, transmission_output_speed=lambda time: 3.3 * true(time),
                          wheel_speed=lambda time: true(time - 0.03)))
    assert found[("wheel_speed", "drift")] == pytest.approx(2.0, abs=0.05)
    assert found[("transmission_output_speed over wheel_speed", "speed ratio")] == pytest.approx(3.3, rel=1e-4)


@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_order_content_is_the_amplitude_at_that_order_of_a_shaft_that_speeds_up(rate):
    """Also where the firing order, up to 86 Hz here, is folded by sampling at 100 Hz."""
    random = np.random.default_rng(2)
    time = np.sort(np.arange(0.0, 7.0, 1.0 / rate) + random.normal(0.0, 3e-4, round(7.0 * rate)))
    angle = 130.0 * time + 0.5 * 7.0 * time**2
    slow = 130.0 + 7.0 * time + 0.4 * np.sin(2.0 * np.pi * 5.9 * time)
    for amplitude in (0.0, 0.2):
        values = slow + amplitude * np.sin(3.0 * angle + 0.7) + random.normal(0.0, 0.05, time.size)
        found = order_content(time, values, time, 130.0 + 7.0 * time, 3.0)
        assert found == pytest.approx(amplitude, abs=0.02)


@pytest.mark.parametrize("frequency", [20.0, 60.0, 72.0, 90.0, 110.0, 128.0, 140.0, 180.0])
def test_order_content_is_read_above_half_of_the_sampling_rate(frequency):
    """At 100 Hz; the third order of an engine is at 70 to 120 Hz in a tip-in."""
    random, time = np.random.default_rng(2), np.arange(0.0, 7.0, 0.01)
    speed = 2.0 * np.pi * frequency / 3.0 * (1.0 + 0.05 * (time / 7.0 - 0.5))
    angle = np.concatenate([[0.0], np.cumsum(0.005 * (speed[1:] + speed[:-1]))])
    slow = speed + 0.4 * np.sin(2.0 * np.pi * 5.9 * time) * np.exp(-time)
    for amplitude in (0.0, 0.15):
        values = slow + amplitude * np.sin(3.0 * angle + 0.7) + random.normal(0.0, 0.05, time.size)
        assert order_content(time, values, time, speed, 3.0) == pytest.approx(amplitude, abs=0.02)


def test_order_content_of_a_shaft_that_hardly_turns_is_not_told():
    time = np.arange(0.0, 7.0, 0.01)
    assert order_content(time, np.sin(time), time, np.full(time.size, 1.0), 1.0) is None


def test_every_feature_is_read_the_same_way_off_what_is_equal():
    run = recorded(step, propeller_shaft_torque=ringing(5.0, 0.06), wheel_speed=lambda time: 40.0 + time)
    found = read(run)
    assert found[("propeller_shaft_torque", "lag")] == pytest.approx(0.0, abs=1e-9)
    assert found[("propeller_shaft_torque", "amplitude")] == pytest.approx(1.0)
    assert found[("propeller_shaft_torque", "gain")] == pytest.approx(1.0)
    assert ("propeller_shaft_torque", "waveform") not in found  # none where there is no difference
    assert {feature for _, feature in found} <= set(FEATURES)


def test_words_tell_side_and_size():
    torque = "propeller_shaft_torque"
    assert words(torque, "shuffle frequency", 5.85, 7.14) == "shuffle frequency 22 % high"
    assert words(torque, "zero offset", 10.0, 0.0) == "zero offset 10 N.m low"
    assert words("wheel_speed", "lag", 0.03, 0.0) == "measured 30 ms later than simulated"
    assert words("wheel_speed", "lag", -0.002, 0.0) == "measured 2 ms earlier than simulated"
    assert words(torque, "lag behind the others", 0.0042, 0.0) == "measured 4.2 ms later than the other channels"
    assert words(torque, "overshoot", 10.0, 35.0) == "overshoot 3.5 times as large as measured"
    assert words("vehicle_speed", "drift", -0.5, -0.4) == "speed lost 20 % too slowly"
    assert words("vehicle_speed", "drift", 0.5, 0.6) == "speed gained 20 % too fast"
    assert words("vehicle_speed", "drift", -0.1, 0.1) == "drift 0.2 m/s/s high"
    assert words(torque, "overshoot", -10.0, -6.0) == "overshoot 4 N.m high"
    assert words(torque, "waveform", 12.0, 3.0) == (
        "waveform off by 12 N.m rms, 4.0 times what tolerance and noise explain")
    assert unit_of("wheel_speed", "drift") == "rad/s/s"
    assert unit_of("engine_speed over turbine_speed", "speed ratio") == "1"


def holed(run, begin, end):
    """The same run, with the samples of a span lost in all channels."""
    clocks = {name: clock[(clock < begin) | (clock > end)] for name, clock in run.clocks.items()}
    return replace(run, clocks=clocks, measured={
        name: run.measured[name][np.isin(run.clocks[name], clock)] for name, clock in clocks.items()})


@pytest.mark.parametrize("gap", [(0.9, 1.15), (1.1, 1.35), (1.0, 1.5), (1.2, 1.5), (4.0, 4.3)])
def test_what_a_gap_hides_is_not_read_off_the_straight_line_through_it(gap):
    """Shuffle damped by 0.049 was read as 0.010, a dead time of 51 ms as 30, an overshoot of 46 N.m as 27."""
    late = 0.03

    def made(shift, gain, offset):
        return recorded(step, propeller_shaft_torque=lambda t: gain * smooth(6.0)(t - shift) + offset,
                        wheel_speed=lambda t: 30.0 + gain * (t - shift + 0.1 * np.sin(3.0 * t)))

    run, reference = made(late, 1.1, 5.0), made(0.0, 1.0, 0.0)
    whole, found = read(run, reference), read(holed(run, *gap), holed(reference, *gap))
    for key, value in found.items():
        if key[1] not in ("waveform", "drift"):  # which say how large errors and slopes are where they are read
            # what is near zero is so beside the largest torque, which a gap may hide
            assert value == pytest.approx(whole[key], rel=5e-3, abs=4e-3 if "dead" in key[1] else 1e-3), key
    shows = {name for signal, name in found if signal == "propeller_shaft_torque"}
    shuffle, reversal = {"shuffle frequency", "shuffle damping"}, {"reversal dead time"}
    assert shuffle | reversal | {"overshoot"} <= {name for signal, name in whole if signal == "propeller_shaft_torque"}
    assert shuffle & shows == (shuffle if gap in ((0.9, 1.15), (4.0, 4.3)) else set())
    assert reversal & shows == (reversal if gap[0] > 0.95 else set())
    assert ("overshoot" in shows) == (gap == (4.0, 4.3))


def test_a_gap_in_one_channel_leaves_the_others_as_they_were():
    run = recorded(step, propeller_shaft_torque=smooth(6.0), engine_speed=smooth(5.0), turbine_speed=smooth(5.0))
    clock = run.clocks["propeller_shaft_torque"]
    kept = (clock < 1.2) | (clock > 1.6)
    lost = replace(run, clocks=run.clocks | {"propeller_shaft_torque": clock[kept]}, measured=run.measured | {
        "propeller_shaft_torque": run.measured["propeller_shaft_torque"][kept]})
    whole, found = read(run), read(lost)
    for (name, feature), value in found.items():
        if name != "propeller_shaft_torque" and feature != "lag behind the others":
            assert value == pytest.approx(whole[(name, feature)]), (name, feature)


@pytest.mark.parametrize("begin", [6.2, 6.3])
def test_what_is_too_short_to_be_shifted_has_no_lag(begin):
    """A stretch of a drive: beyond what the longest shift needs on either side there is next to nothing of it."""
    run = recorded(step, propeller_shaft_torque=smooth(6.0), wheel_speed=smooth(2.0))
    short = holed(run, 0.0, begin)
    found = read(short, short)
    assert "waveform" not in found and all(np.isfinite(value) for value in found.values())
    assert not {"lag", "amplitude"} & {feature for _, feature in found}


def test_a_channel_that_is_hardly_there_says_nothing():
    run = recorded(step, propeller_shaft_torque=smooth(6.0), wheel_speed=smooth(2.0))
    found = read(holed(run, 0.7, 6.7), holed(run, 0.7, 6.7))
    assert not found


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_overshoot_is_as_large_driven_as_in_overrun(sign):
    """What a torque is larger by than what it settles at, whichever way."""
    base = ringing(5.0, 0.06)
    found = read(recorded(lambda time: sign * step(time), propeller_shaft_torque=lambda time: sign * base(time)))
    time = np.arange(1.0, 3.0, 0.001)
    assert found[("propeller_shaft_torque", "overshoot")] == pytest.approx(base(time).max() - 300.0, abs=6.0)


def test_a_drive_that_does_not_come_back_runs_through_no_loop():
    """Neither where it is noisy before or after, nor where it comes back by little of what it is."""
    random = np.random.default_rng(5)

    def noisy(drive):
        return lambda time: drive(time) + random.standard_normal(time.size)

    for drive in (step, lambda time: -step(time), lambda time: 200.0 + 20.0 * np.sin(time)):
        found = read(recorded(noisy(drive), propeller_shaft_torque=lambda time: 2.0 * step(time) + np.sin(9.0 * time)))
        assert ("propeller_shaft_torque", "loop area") not in found
    found = read(recorded(noisy(lambda time: 90.0 + 110.0 * np.sin(time)),
                          propeller_shaft_torque=lambda time: 180.0 + 220.0 * np.sin(time - 0.1)))
    assert found[("propeller_shaft_torque", "loop area")] == pytest.approx(np.pi * 110.0 * 220.0 * np.sin(0.1), rel=0.2)
