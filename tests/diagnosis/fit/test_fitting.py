"""Where a fit of one supposition ends."""

from dataclasses import replace

import numpy as np
import pytest
from vibration import CLOCK, Plant, found

from cosim.diagnosis.fit.fitting import Fitter, Tangent
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.measured import load


@pytest.fixture(scope="module")
def pulses(tmp_path_factory):
    """A pulse train, which crosses the lash six times, of a healthy car, and what its file has wrong."""
    folder = tmp_path_factory.mktemp("fitting") / "m"
    hidden = hide([], 3, folder, structure="same", manoeuvres=["pulse_train:4"])
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    return car, car.runs(measurement), hidden


def true_coordinates(listed, hidden):
    """Of every number of the file and every run; no effect is there."""
    point = np.zeros(len(listed))
    for i, c in enumerate(listed):
        if c.run is None and not c.effect:
            table = c.name.partition("[")[0]
            point[i] = np.log1p(next((x for name, x in hidden.drift.items() if name.partition("[")[0] == table), 0.0))
        elif c.name in ("torque", "grade"):
            point[i] = hidden.recordings[c.run]["torque_bias" if c.name == "torque" else c.name]
    return point


def test_from_the_vehicle_file_it_is_as_good_a_fit_as_from_the_truth(pulses):
    """Steps by derivatives of where nothing fits ended 950 below, with a lash shifted by nine times its tolerance."""
    car, runs, hidden = pulses
    with Predictor(car, runs, coordinates(car, runs)) as predictor:
        fitter = Fitter(predictor)
        file = fitter.nominal()
        noise = fitter.noise(file)
        start = fitter.at(true_coordinates(predictor.coordinates, hidden))
        fits = [fitter.settle(fitter.assess(begun, noise), noise)
                for begun in (fitter.cooled(file, noise), fitter.refine(start, noise))]
    assert fits[0].score > fits[1].score - 10.0
    apart = fits[0].shared[fitter.layout.shared] / fitter.scale[fitter.layout.shared]
    assert np.abs(apart).max() < 3.0


def test_a_last_small_step_leaves_the_derivatives_as_they_were_taken():
    """What it shows beyond them is chance, over next to no step."""
    search, result = found({"phase": 0.2})
    fitter, fit = search.fitter, result.best
    off = 0.01 * np.sqrt(fit.posterior.covariance[0, 0]) * np.eye(len(fit.shared))[0]
    beside = fitter.placed(fit, fit.causes, fit.shared + off, [point + off for point in fit.points])
    moved = fitter.renewed(beside, result.noise)
    assert moved.settled and moved.shared[0] != beside.shared[0]
    for kept, taken in zip(moved.tangents, fitter.relinearise(beside).tangents):
        assert np.array_equal(kept.jacobian, taken.jacobian)


def test_a_score_is_what_was_reached_and_a_hope_what_derivatives_promise():
    """Where they are right, refining fulfils the promise."""
    search, result = found({"curve": 0.06})
    fitter, noise = search.fitter, result.noise
    start = fitter.assess(replace(fitter.nominal(), causes=("curve",)), noise)
    moved = fitter.assess(fitter.refine(start, noise), noise)
    assert start.hope - start.score > 5.0
    assert moved.score == pytest.approx(start.hope, abs=0.5)
    assert 0.0 <= moved.hope - moved.score < 0.5


def test_where_derivatives_promise_much_and_nothing_is_gained_others_are_tried_once(monkeypatch):
    search, result = found({"curve": 0.06})
    fitter, noise = search.fitter, result.noise
    start = fitter.assess(replace(fitter.nominal(), causes=("curve",)), noise)
    monkeypatch.setattr(fitter, "refine", lambda fit, noise: replace(fit))  # no step gains anything
    once = fitter.renewed(start, noise)
    assert once.stuck and not (once.near or once.settled)
    assert fitter.renewed(once, noise).settled
    assert fitter.renewed(start, noise, everything=False).near  # by some derivatives nothing is promised
    assert fitter.renewed(result.best, noise).settled


def test_derivatives_follow_a_step_and_tell_how_far_they_were_off():
    random = np.random.default_rng(3)
    run = Plant({}).runs[0]
    noise = Noise([run], [np.zeros((2, CLOCK.size))], [np.zeros(CLOCK.size)])
    jacobian, step = random.standard_normal((CLOCK.size, 4)), random.standard_normal(4)
    change = random.standard_normal(CLOCK.size)
    moved = Tangent(jacobian).moved(step, change, np.array([1.0, 2.0, 0.5, 0.1]), noise, 0)
    assert moved.jacobian @ step == pytest.approx(change, abs=1e-4)
    assert moved.bent == pytest.approx(np.sum(noise.whiten(0, change - jacobian @ step) ** 2))
    assert Tangent(jacobian).moved(0.0 * step, change, np.ones(4), noise, 0).bent == 0.0


def test_what_one_recording_alone_shows_is_no_further_cause():
    """Unless it is clear beyond doubt."""
    search, result = found({"size": 0.4})
    fitter, best = search.fitter, result.best

    def other(gain, foretold):
        return replace(best, causes=("curve", *best.causes), score=best.score + gain,
                       foretold=best.foretold + np.array(foretold))

    fitter.measured = fitter.measured * 2  # recordings enough
    best = replace(best, foretold=np.zeros(4))
    assert not fitter.shows(other(1.0, [-1.0, 20.0, -1.0, 0.0]), best)
    assert fitter.shows(other(1.0, [4.0, 9.0, -1.0, 1.0]), best)
    assert fitter.shows(other(20.0, [-1.0, 50.0, -1.0, 0.0]), best)
    fitter.measured = fitter.measured[:2]  # too few to ask
    assert fitter.shows(other(1.0, [-1.0, 20.0, -1.0, 0.0]), best)
