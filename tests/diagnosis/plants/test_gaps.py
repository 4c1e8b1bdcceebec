"""Where frames are lost nobody knows the torque; what it was is estimated with the rest."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.diagnose import _notices
from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import FILLED, Predictor, coordinates
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import STEP, FullOrderCar, Nuisance
from cosim.diagnosis.plants.gaps import WAVES, Gap, filled, gaps, known
from cosim.measured import Channel, load

CLOCK = np.arange(0.0, 3.0, 0.01)
RAMP = np.interp(CLOCK, [1.0, 1.08], [-15.0, 200.0])  # of torque: a tip-in


def channel(values, lost=()):
    kept = np.ones(CLOCK.size, dtype=bool)
    for begin, end in lost:
        kept &= (begin + 1e-6 > CLOCK) | (end - 1e-6 < CLOCK)
    return Channel("engine_torque", "N.m", CLOCK[kept], np.asarray(values)[kept], "")


def found(values, *lost, least=0.1):
    return gaps(channel(values, lost), 0.0, 3.0, least)


def test_where_every_frame_is_there_nothing_is_unknown():
    assert found(RAMP) == []


@pytest.mark.parametrize("values", [np.full(CLOCK.size, 80.0), 40.0 * CLOCK])
def test_what_goes_on_as_before_is_known(values):
    assert found(values, (1.4, 1.5)) == []


@pytest.mark.parametrize("lost", [(1.04, 1.14), (0.95, 1.05), (0.98, 1.10)])
def test_a_corner_that_nobody_saw_is_as_unknown_as_it_may_be(lost):
    """At least the error of the straight line that stands for it."""
    [gap] = found(RAMP, lost)
    middle = 0.5 * (gap.begin + gap.end)
    wrong = abs(np.interp(middle, [1.0, 1.08], [-15.0, 200.0]) - channel(RAMP, [lost]).at(middle))
    assert (gap.begin, gap.end) == pytest.approx(lost, abs=0.011)
    assert 0.5 * wrong < gap.torque < 215.0


def test_one_lost_frame_is_a_gap_only_where_it_matters():
    assert found(RAMP, (0.99, 1.01), least=0.5) == [] and len(found(RAMP, (0.99, 1.01), least=0.05)) == 1


def test_what_fills_a_gap_stays_within_it():
    gap, other, time = Gap(1.0, 1.2, 5.0), Gap(2.0, 2.1, 5.0), np.arange(0.0, 3.0, STEP)
    torque = filled([gap, other], [7.0, *[0.0] * (len(gap.waves) + len(other.waves) - 1)], time)
    assert torque.max() == pytest.approx(7.0) and time[np.argmax(torque)] == pytest.approx(1.1, abs=STEP)
    assert np.sum(torque) * STEP == pytest.approx(7.0 * 0.2 * 2.0 / np.pi, rel=1e-3)
    assert not np.any(torque[(time <= 1.0) | (time >= 1.2)])


@pytest.mark.parametrize(("at", "lasts"), [(1.02, 0.1), (1.05, 0.1), (1.07, 0.1), (1.1, 0.5), (1.25, 0.5)])
def test_what_waves_leave_of_a_step_in_a_gap_is_little(at, lasts):
    """A single wave leaves all of what a step in the middle is beside the line: above it first and below it then. Two
    leave of a step in half a second what lasts for long."""
    gap, time = Gap(1.0, 1.0 + lasts, 100.0), np.arange(0.0, 2.0, STEP)
    inside = (time > gap.begin) & (time < gap.end)
    missed = (np.where(time > at, 200.0, 0.0) - np.interp(time, [gap.begin, gap.end], [0.0, 200.0]))[inside]
    waves = np.column_stack([filled([gap], row, time)[inside] for row in np.eye(len(gap.waves))])
    heights = np.linalg.lstsq(waves, missed)[0]
    left = missed - waves @ heights
    assert np.abs(heights / gap.waves).max() < 1.3  # as large as they are supposed to be
    assert np.sum(left**2) < 0.4 * np.sum(missed**2)
    assert STEP * np.abs(np.cumsum(left)).max() < 0.1 * 0.1 * 200.0  # N.m.s, at whatever moment


def test_between_samples_that_are_far_apart_nothing_is_known():
    stamps = np.array([0.0, 0.01, 0.021, 0.03, 0.05, 0.06, 0.12, 0.13])  # one frame is lost, then five
    instants = np.array([0.0, 0.005, 0.04, 0.05, 0.061, 0.1, 0.12, 0.125, 0.13])
    assert list(known(stamps, instants)) == [True, True, True, True, False, False, False, True, True]


# -- in a recording -------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A tip-in of a plant that is as the file says, and the instant its torque is there."""
    folder = tmp_path_factory.mktemp("gaps") / "m"
    hide([], 2, folder, structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(folder)
    torque = measurement.manoeuvres[0].channels["engine_torque"]
    return measurement, float(torque.time[np.flatnonzero(np.diff(torque.values) > 5.0)[-1]])


def without(measurement, begin, end):
    """A car, and the run in which frames of the torque are lost."""
    [manoeuvre] = measurement.manoeuvres
    old = manoeuvre.channels["engine_torque"]
    return with_torque(measurement, old, (old.time <= begin) | (old.time >= end))


def with_torque(measurement, old, kept):
    [manoeuvre] = measurement.manoeuvres
    channels = {**manoeuvre.channels, old.name: replace(old, time=old.time[kept], values=old.values[kept])}
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    return car, car.runs(replace(measurement, manoeuvres=(replace(manoeuvre, channels=channels),)))[0]


def test_that_frames_are_lost_where_it_matters_is_told(recording):
    measurement, corner = recording
    told = []
    for begin, end in ((corner - 0.05, corner + 0.05), (corner + 3.0, corner + 3.1)):
        car, run = without(measurement, begin, end)
        told.append(" ".join(_notices(measurement, car, [run], [])))
    assert "frames of the torque are lost for up to 1" in told[0] and "frames" not in told[1]


def test_a_slow_logger_has_a_few_gaps_not_sixty(recording):
    measurement, _ = recording
    old = measurement.manoeuvres[0].channels["engine_torque"]
    lively = replace(old, values=old.values + 40.0 * np.sin(25.0 * old.time))
    kept = np.arange(old.time.size) % 20 < 11  # 100 ms with frames, 100 ms without
    _, run = with_torque(measurement, lively, kept)
    impulses = [gap.impulse for gap in run.gaps]
    assert np.sum(np.diff(old.time[kept]) > 0.09) > 30 and len(run.gaps) == 6
    assert impulses == sorted(impulses, reverse=True)


def test_frames_lost_while_the_driver_tips_in_are_made_up_for(recording):
    """Fitted, a healthy car leaves what it leaves where no frame is lost."""
    measurement, corner = recording
    left = []
    for lost in ((corner - 0.05, corner + 0.05), (0.0, 0.0)):
        car, run = without(measurement, *lost)
        with Predictor(car, [run], coordinates(car, [run])) as predictor:
            fitter = Fitter(predictor)
            file = fitter.nominal()
            noise = fitter.noise(file)
            fit = fitter.settle(fitter.refine(file, noise, 5), noise)
            place = run.slices["propeller_shaft_torque"]
            left.append([float(np.mean(noise.whiten(0, run.stacked - here.predicted[0])[place] ** 2))
                         for here in (file, fit)])
            heights = [x for c, x in zip(predictor.coordinates, fit.points[0]) if c.name == FILLED]
            assert any(gap.begin < corner < gap.end for gap in run.gaps) == (lost[1] > 0.0)
            assert len(heights) == WAVES * len(run.gaps)
    (before, after), (_, whole) = left
    assert before > 3.0 * after and after < 1.15 * whole


def test_a_filled_gap_drives_the_plant_as_what_was_there(recording):
    measurement, corner = recording
    car, run = without(measurement, corner - 0.05, corner + 0.05)
    [k] = [k for k, gap in enumerate(run.gaps) if gap.begin < corner < gap.end]
    heights = tuple(30.0 * (i == k) for i, gap in enumerate(run.gaps) for _ in gap.waves)
    there = replace(run, inputs=run.inputs.copy(), gaps=())
    there.inputs[:, car.columns["engine_torque"]] += filled(run.gaps, heights, run.time - STEP)
    one, other = (car.raw(car.values, r, n) for r, n in ((run, Nuisance(filled=heights)), (there, Nuisance())))
    assert all(np.array_equal(one[name], other[name]) for name in one)
    assert np.ptp(one["propeller_shaft_torque"] - car.raw(car.values, run)["propeller_shaft_torque"]) > 10.0
