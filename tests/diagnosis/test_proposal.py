from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis import proposal
from cosim.diagnosis.evidence import prior
from cosim.diagnosis.fitting import Fitter
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.identify import APART
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.predict import Predictor, coordinates
from cosim.measured import load


def tip_in(folder, *effects):
    """A tip-in: the fitter, the vehicle file as it is, and the noise."""
    hide(effects, 2, folder, structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs = car.runs(measurement)
    fitter = Fitter(Predictor(car, runs, coordinates(car, runs)))
    fit = fitter.nominal()
    return fitter, fit, fitter.noise(fit)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    """Of a healthy car."""
    return tip_in(tmp_path_factory.mktemp("proposal") / "m")


def supposed(healthy, cause, value):
    fitter, fit, _ = healthy
    shared = np.zeros(len(fitter.coordinates))
    shared[fitter.predictor.index(cause)] = value
    return replace(fit, causes=(cause,), shared=shared)


def sigma(fit, further):
    return float(np.sqrt(2.0 * max(further, 0.0)))


def propose(healthy, one, rivals, monkeypatch, gears=(5,), kinds=("tip_in",), sigma=sigma):
    """By recordings that say nothing of the one or the other."""
    fitter, _, noise = healthy
    monkeypatch.setattr(proposal, "_GEARS", gears)
    monkeypatch.setattr(proposal, "_PROFILES", {kind: proposal._PROFILES[kind] for kind in kinds})
    return proposal.propose(fitter, SimpleNamespace(best=one, noise=noise, apart=sigma), rivals)


def test_a_supposition_is_not_apart_from_itself(healthy, monkeypatch):
    one = supposed(healthy, "vehicle_mass", 0.1)
    assert propose(healthy, one, [one], monkeypatch).separation_sigma == 0.0


def test_a_run_says_more_of_what_it_shows_than_was_known(healthy):
    fitter, _, noise = healthy
    one = supposed(healthy, "engine_inertia", 0.15)
    run = proposal._candidate(fitter.predictor.car, fitter.predictor.runs[0], "tip_in",
                              proposal._PROFILES["tip_in"][1], 5, 220.0, 12.0)
    square = proposal.information(fitter.predictor, noise, run, one)
    assert np.linalg.eigvalsh(square).min() > -1e-6 * np.linalg.eigvalsh(square).max()
    evidence = fitter.judged(one, noise)
    shared = fitter.layout.shared
    after = evidence.expecting(square[np.ix_(shared, shared)], one.shared[shared])
    [place] = np.flatnonzero(shared == fitter.predictor.index("engine_inertia")[0])
    spread = prior(fitter.coordinates, one.causes)
    before, then = (np.sqrt(e.posterior(spread).covariance[place, place]) for e in (evidence, after))
    assert 0.3 * before < then < 0.9 * before  # it is much like the one there is


def test_what_does_the_same_is_not_told_apart_and_that_is_said(healthy, monkeypatch):
    """On a road without turns nothing tells a slope from rolling resistance."""
    rolling, grade, mass = (supposed(healthy, cause, x) for cause, x in
                            (("rolling_resistance", 0.5), ("road_grade", 0.008), ("vehicle_mass", 0.1)))
    monkeypatch.setattr(proposal, "_ways", lambda predictor, fits, shared: {False: np.ones(shared.size)})
    found = propose(healthy, rolling, [grade], monkeypatch)
    assert found.separation_sigma < APART and "too little" in proposal.words(found, rolling)
    assert propose(healthy, rolling, [mass], monkeypatch).separation_sigma > APART


def test_what_a_slope_does_is_told_apart_on_the_way_back(tmp_path, monkeypatch):
    """There it pushes the other way, and what resists does not."""
    fitter, fit, noise = tip_in(tmp_path / "m", "rolling_resistance=1.6")
    rolling, grade = (fitter.settle(fitter.assess(replace(fit, causes=(cause,)), noise), noise)
                      for cause in ("rolling_resistance", "road_grade"))
    for one, rival in ((rolling, grade), (grade, rolling)):
        found = propose((fitter, fit, noise), one, [rival], monkeypatch)
        assert found.back and found.separation_sigma > APART
        assert "the other way" in proposal.words(found, one)


def test_the_best_candidate_is_proposed_with_words(healthy, monkeypatch):
    inertia = supposed(healthy, "engine_inertia", 0.2)
    stiffness = supposed(healthy, "shaft_stiffness:axle_shaft_stiffness", -0.15)
    found = propose(healthy, inertia, [stiffness], monkeypatch, kinds=("tip_in", "cruise"))
    assert (found.kind, found.gear) == ("tip_in", 5) and found.separation_sigma > APART
    assert found.nearest is stiffness
    assert "engine inertia and shaft stiffness" in proposal.words(found, inertia)


def test_a_manoeuvre_that_tells_more_rivals_apart_is_proposed(healthy, monkeypatch):
    """What only tells the mass from it would leave the drag of air where it is, and the other way round."""
    grade, mass, drag = (supposed(healthy, cause, x) for cause, x in
                         (("road_grade", 0.01), ("vehicle_mass", 0.1), ("aerodynamic_drag", 0.5)))
    gears = (3, 7)
    both = propose(healthy, grade, [mass, drag], monkeypatch, gears)
    alone = {fit.causes[0]: propose(healthy, grade, [fit], monkeypatch, gears) for fit in (mass, drag)}
    assert both.separation_sigma <= min(found.separation_sigma for found in alone.values())
    told = propose(healthy, grade, [mass, drag], monkeypatch, gears,
                   sigma=lambda fit, further: sigma(fit, further + (1e4 if fit is drag else 0.0)))
    assert (told.gear, told.nearest) == (alone["vehicle_mass"].gear, mass)
