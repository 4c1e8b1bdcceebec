"""Where long recordings are cut."""

import numpy as np
import pytest

from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.plants.calm import calm_parts, pauses
from cosim.measured import CANONICAL, Channel, Manoeuvre, Measurement

LONGEST = 15.0


def torque(values, time):
    return Channel("engine_torque", "N.m", time, values, "")


@pytest.mark.parametrize(("seed", "moves"), [*((seed, 1.0) for seed in range(8)), (8, 0.0)])
def test_parts_are_the_stretch_and_none_is_long_or_of_no_use(seed, moves):
    random = np.random.default_rng(seed)
    begin, length = random.uniform(0.0, 50.0), random.uniform(1.0, 6.0) * LONGEST
    time = np.arange(0.0, begin + length + 1.0, 0.01)
    wanders = torque(moves * np.cumsum(random.standard_normal(time.size)), time)
    parts = calm_parts(wanders, begin, begin + length, LONGEST)
    assert parts[0][0] == begin and parts[-1][1] == begin + length
    assert [a for a, _ in parts[1:]] == [b for _, b in parts[:-1]]
    lengths = np.diff(parts, axis=1)
    assert lengths.max() <= LONGEST and lengths.min() >= LONGEST / 4.0


@pytest.mark.parametrize("length", [2.0, LONGEST])
def test_what_is_short_enough_is_one_part(length):
    time = np.arange(0.0, 20.0, 0.01)
    assert calm_parts(torque(np.sin(time), time), 0.5, 0.5 + length, LONGEST) == [(0.5, 0.5 + length)]


@pytest.mark.parametrize("steps", [(10.0,), (14.0,), (8.0, 18.0), (4.0, 11.5, 19.0, 26.0, 34.0)])
def test_what_a_step_shakes_up_is_in_one_part_whatever_the_noise(steps):
    """The middle of a recording is where a manoeuvre is; evenly cut, the first of these was in two parts."""
    random, time = np.random.default_rng(3), np.arange(0.0, steps[-1] + 10.0, 0.01)
    values = sum((-1) ** i * 150.0 * (time > step) for i, step in enumerate(steps)) + random.standard_normal(time.size)
    for _, cut in calm_parts(torque(values, time), 0.0, float(time[-1]), LONGEST)[:-1]:
        assert all(not cut - 1.95 < step < cut + 0.45 for step in steps)


def test_a_pause_is_where_no_torque_is_known_within_the_stretch():
    time = np.concatenate([np.arange(0.0, 3.0, 0.01), np.arange(4.5, 6.0, 0.01), np.arange(6.9, 9.0, 0.01)])
    flat = torque(np.zeros(time.size), time)
    assert pauses(flat, 0.0, 9.0) == [pytest.approx((2.99, 4.5))]  # 0.9 s is a gap that is filled
    assert pauses(flat, 4.0, 9.0) == [(4.0, 4.5)] and pauses(flat, 5.0, 9.0) == []
    slow = np.arange(0.0, 9.0, 0.9)
    assert pauses(torque(np.zeros(slow.size), slow), 0.0, 8.0) == []


@pytest.mark.parametrize("pause", [2.0, 10.0, 40.0])
def test_two_manoeuvres_of_one_file_are_two_whatever_lies_between(pause):
    """Of a pause of ten seconds half were simulated with a torque that nobody recorded."""
    time = np.arange(0.0, 14.0, 0.01)
    drive = np.clip(-30.0 + 200.0 * (time % 7.0 - 2.0), -30.0, 120.0)
    found = stretches_of(time + pause * (time >= 7.0), drive)
    assert [run.manoeuvre for run in found.runs] == 2 * [("tip_in", 4, False)]
    first, second = found.runs
    assert first.time[-1] == pytest.approx(6.99, abs=0.002) and second.start == pytest.approx(7.0 + pause)
    assert found.left_out == [f"long: nothing is compared from 6.99 to {7.0 + pause:.3g} s: engine_torque was not "
                              "recorded"]


def stretches_of(time, drive):
    """What one recording of tip-ins, whose speeds say little else, is made into."""
    car = FullOrderCar("suv_6l80")
    shown = {"engine_torque": drive, "engine_speed": 180.0 + np.sin(time), "wheel_speed": 60.0 + np.sin(time)}
    channels = {name: Channel(name, CANONICAL[name].unit, time, values, name) for name, values in shown.items()}
    return car.stretches(Measurement("m", car.vehicle, None, (Manoeuvre("long", "tip_in", 4, channels),)))


def test_what_is_driven_again_in_one_recording_is_a_repeat():
    time = np.arange(0.0, 40.0, 0.01)
    runs = stretches_of(time, np.clip(-30.0 + 200.0 * ((time - 8.0) % 13.0), -30.0, 120.0)).runs
    assert len(runs) > 2 and {run.manoeuvre for run in runs} == {("tip_in", 4, False)}


def test_a_reversal_in_the_middle_of_a_long_recording_is_simulated_as_one():
    """Cut evenly its second part began with the torque at its highest slope, as a car does not that rolls steadily."""
    time = np.arange(0.0, 20.0, 0.01)
    calm, lively = sorted(stretches_of(time, np.clip(-30.0 + 200.0 * (time - 9.9), -30.0, 120.0)).runs,
                          key=lambda run: np.ptp(run.inputs[:, 0]))
    assert [np.ptp(run.inputs[:, 0]) for run in (calm, lively)] == [0.0, 150.0]
    assert np.ptp(lively.inputs[:2000, 0]) == 0.0
    # what is left is no repeat of it, of which one might be kept back
    assert [run.manoeuvre for run in (calm, lively)] == [None, ("tip_in", 4, False)]
