import re
from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from floors import shortened

from cosim.diagnosis.fit.evidence import prior
from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.judge import proposal
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.search.identification import APART, LACKING
from cosim.measured import load

ONCE = {1: 1}  # a manoeuvre is driven, and fitted


def tip_in(folder, *effects):
    """The begin of a tip-in: the fitter, the vehicle file as it is, and the noise."""
    hide(effects, 2, folder, structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs = [shortened(run, 4.0) for run in car.runs(measurement)]
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


def propose(healthy, one, rivals, monkeypatch, gears=(5,), kinds=("tip_in",), drives=ONCE):
    """By recordings that say nothing of the one or the other."""
    fitter, _, noise = healthy
    monkeypatch.setattr(proposal, "_PROFILES", {kind: (gears, *proposal._PROFILES[kind][1:]) for kind in kinds})
    found = SimpleNamespace(best=one, noise=noise, lead=lambda fit: 0.0, odds=lambda fit: 1.0, temper=2.0)
    return proposal.propose(fitter, found, rivals, drives)


def test_a_supposition_is_not_apart_from_itself(healthy, monkeypatch):
    one = supposed(healthy, "vehicle_mass", 0.1)
    found = propose(healthy, one, [replace(one)], monkeypatch)
    assert found.separation_sigma == 0.0 and found.chance < 0.1


def test_a_run_says_more_of_what_it_shows_than_was_known(healthy):
    fitter, _, noise = healthy
    one = supposed(healthy, "engine_inertia", 0.15)
    run = proposal._candidate(fitter.predictor.car, fitter.predictor.runs[0], "tip_in",
                              proposal._PROFILES["tip_in"][2], 5, 220.0, 12.0)
    squares = proposal.information(fitter.predictor, noise, run, one, (1, 4))
    square = squares[1]
    for more in (4.0 * squares[4] - square, square - squares[4]):  # four of it say more than one, but not four times
        assert np.linalg.eigvalsh(more).min() > -1e-6 * np.linalg.eigvalsh(square).max() and np.trace(more) > 0.0
    assert np.linalg.eigvalsh(square).min() > -1e-6 * np.linalg.eigvalsh(square).max()
    evidence = fitter.judged(one, noise)
    shared = fitter.layout.shared
    after = evidence.expecting(square[np.ix_(shared, shared)], one.shared[shared])
    [place] = np.flatnonzero(shared == fitter.predictor.index("engine_inertia")[0])
    spread = prior(fitter.coordinates, one.causes)
    before, then = (np.sqrt(e.posterior(spread).covariance[place, place]) for e in (evidence, after))
    assert 0.3 * before < then < 0.9 * before  # it is much like the one there is


def test_runs_there_are_say_less_where_more_of_their_manoeuvre_are_driven(healthy, monkeypatch):
    """As they will be judged then: the same recording twice says what either does of two."""
    fitter, fit, noise = healthy
    [run], car = fitter.predictor.runs, fitter.predictor.car
    twice = Fitter(Predictor(car, [run, run], coordinates(car, [run, run])))
    doubled = copy(noise)
    doubled.runs = 2 * noise.runs
    doubled.least, doubled.scales = 2 * noise.least, 2 * noise.scales

    def told(evidence):
        common = [k for k, i in enumerate(evidence.layout.shared) if evidence.layout.coordinates[i].run is None]
        return [seen.slopes.capped[np.ix_(common, common)] for seen in evidence.seen]

    found = SimpleNamespace(best=fit, noise=noise)
    [before] = told(fitter.judged(fit, noise))
    [other] = told(proposal._repeated(fitter, found, ("step", 5, False), 1))
    assert np.array_equal(other, before)
    [again] = told(proposal._repeated(fitter, found, run.manoeuvre, 1))
    assert np.trace(again) < np.trace(before)
    for either in told(twice.judged(twice.nominal(), doubled)):
        assert again == pytest.approx(either, rel=1e-6, abs=1e-6 * np.abs(either).max())


def test_of_a_manoeuvre_that_was_driven_more_is_promised_by_what_the_recordings_say_then(healthy, monkeypatch):
    asked, repeated = [], proposal._repeated
    one = supposed(healthy, "engine_inertia", 0.3)
    rival = supposed(healthy, "shaft_stiffness:axle_shaft_stiffness", -0.3)

    def promised(heeded, gear):
        def spied(fitter, found, *more):
            asked.append(more)
            return repeated(fitter, found, *more) if heeded else fitter.judged(found.best, found.noise)

        monkeypatch.setattr(proposal, "_repeated", spied)
        return propose(healthy, one, [rival], monkeypatch, (gear,), drives={**ONCE, 3: 2})

    promised(True, 3)
    assert not asked
    assert promised(True, 5).apart != promised(False, 5).apart
    assert asked == 2 * [(("tip_in", 5, False), 1), (("tip_in", 5, False), 2)]


def test_a_slope_is_told_from_what_resists_on_the_way_back_only(tmp_path, monkeypatch):
    """There it pushes the other way, and what resists does not. Larger than one tip-in shows: 1.66."""
    fitter, fit, noise = tip_in(tmp_path / "m", "rolling_resistance=2.0")
    rolling, grade = (fitter.settle(fitter.assess(replace(fit, causes=(cause,)), noise), noise)
                      for cause in ("rolling_resistance", "road_grade"))
    for one, rival in ((rolling, grade), (grade, rolling)):
        found = propose((fitter, fit, noise), one, [rival], monkeypatch)
        assert found.back and found.separation_sigma > APART and found.chance > 0.5
        assert "the other way" in proposal.words(found, one)
    shared = fitter.layout.shared
    assert len(proposal._ways(fitter.predictor, (rolling, grade), shared)) == 2
    assert len(proposal._ways(fitter.predictor, (rolling,), shared)) == 1  # no slope to tell anything from
    graded = SimpleNamespace(coordinates=fitter.coordinates, runs=[replace(run, graded=True) for run in
                                                                   fitter.predictor.runs])
    assert len(proposal._ways(graded, (rolling, grade), shared)) == 1
    monkeypatch.setattr(proposal, "_ways", lambda predictor, fits, shared: {False: np.ones(shared.size)})
    found = propose((fitter, fit, noise), rolling, [grade], monkeypatch)
    assert found.separation_sigma < APART and "nothing that was tried does more" in proposal.words(found, rolling)


def test_the_best_candidate_is_proposed_with_words(healthy, monkeypatch):
    inertia = supposed(healthy, "engine_inertia", 0.3)
    stiffness = supposed(healthy, "shaft_stiffness:axle_shaft_stiffness", -0.3)
    found = propose(healthy, inertia, [stiffness], monkeypatch, kinds=("tip_in", "coast_down"))
    assert (found.kind, found.gear) == ("tip_in", 5) and found.separation_sigma > APART
    assert [fit for _, fit in found.apart] == [stiffness] and found.chance > 0.5
    assert re.search("engine inertia, if it is that, is then .* sigma from shaft stiffness; chance to tell which it is",
                     proposal.words(found, inertia))


def test_the_manoeuvre_after_which_one_most_probably_stands_alone_is_proposed(healthy, monkeypatch):
    fits = [supposed(healthy, cause, x) for cause, x in
            (("road_grade", 0.01), ("vehicle_mass", 0.1), ("aerodynamic_drag", 0.5))]
    each = [propose(healthy, fits[0], fits[1:], monkeypatch, (gear,)) for gear in (3, 7)]
    best = propose(healthy, fits[0], fits[1:], monkeypatch, (3, 7))
    assert best == max(each, key=lambda found: found.chance) and best.chance < 1.0
    distances = [sigma for sigma, _ in best.apart]
    assert distances == sorted(distances) and {id(fit) for _, fit in best.apart} == {id(fit) for fit in fits[1:]}


def test_what_once_hardly_tells_is_driven_several_times(healthy, monkeypatch):
    """Where that makes it surer; once where it is clear, or hopeless however often."""
    def found(inertia, stiffness, drives):
        one = supposed(healthy, "engine_inertia", inertia)
        rival = supposed(healthy, "shaft_stiffness:axle_shaft_stiffness", stiffness)
        return propose(healthy, one, [rival], monkeypatch, drives=drives), one

    often = {**ONCE, 3: 2, 4: 3}
    clear, one = found(0.6, -0.6, often)
    assert clear.times == 1 and "gain" not in proposal.words(clear, one)
    same = supposed(healthy, "vehicle_mass", 0.1)
    assert propose(healthy, same, [replace(same)], monkeypatch, drives=often).times == 1
    faint, one = found(0.25, -0.25, often)
    assert faint.times > 1 and "one of them to measure the gain on" in proposal.words(faint, one)
    once, _ = found(0.25, -0.25, ONCE)
    assert faint.separation_sigma > once.separation_sigma and faint.worth > once.worth == once.chance


def test_to_be_healthy_is_a_rival_but_nothing_that_a_recording_would_show(healthy, monkeypatch):
    _, fit, _ = healthy
    found = propose(healthy, supposed(healthy, "vehicle_mass", 0.1), [fit], monkeypatch)
    assert found.apart[0][1] is fit
    mass = supposed(healthy, "vehicle_mass", 0.1)
    assert "vehicle mass, if it is that, is then" in proposal.words(found, mass)
    assert "sigma from nothing wrong" in proposal.words(found, mass)


@pytest.mark.parametrize(("apart", "likely", "chance"), [
    ([[0.0, 9.0], [9.0, 0.0]], [1.0, 1.0], 1.0),
    ([[0.0, 3.0], [9.0, 0.0]], [1.0, 0.0], 0.5),  # only just, and nobody knows exactly
    ([[0.0, 3.0], [9.0, 0.0]], [1.0, 3.0], 0.875),
    ([[0.0, -9.0], [-9.0, 0.0]], [1.0, 1.0], 0.0)])
def test_the_chance_is_that_of_whichever_is_true(apart, likely, chance):
    fits = [SimpleNamespace(causes=(cause,)) for cause in "ab"]
    assert proposal._chance(np.array(apart), fits, np.array(likely)) == pytest.approx(chance, abs=0.005)


@pytest.mark.parametrize(("apart", "likely", "chance"), [
    ([[0.0, LACKING], [0.0, 0.0]], [1.0, 1.0], 0.5),  # either way just as far as is asked for
    ([[0.0, 9.0], [9.0, 0.0]], [1.0, 1.0], 1.0), ([[0.0, 9.0], [-9.0, 0.0]], [1.0, 1.0], 0.5)])
def test_a_further_cause_that_is_not_there_only_has_to_be_behind(apart, likely, chance):
    fits = [SimpleNamespace(causes=("a", "b")), SimpleNamespace(causes=("a",))]
    assert proposal._chance(np.array(apart), fits, np.array(likely)) == pytest.approx(chance, abs=0.005)


def test_none_only_has_to_be_behind_and_is_not_what_is_looked_for():
    fits = [SimpleNamespace(causes=("a",)), SimpleNamespace(causes=())]
    apart = np.array([[0.0, 0.0], [-9.0, 0.0]])
    assert proposal._chance(apart, fits, np.ones(2)) == pytest.approx(0.5)


def test_two_stages_are_told_from_soft_shafts_only_where_they_are_twisted_beyond_what_is_plausible(tmp_path):
    """A wider first stage does the same where a narrower second is reached; in third gear none that is likely."""
    fitter, fit, noise = tip_in(tmp_path / "m", "shaft_stiffness=0.75")
    cause = "shaft_stiffness:axle_shaft_stiffness"
    soft = fitter.settle(fitter.assess(replace(fit, causes=(cause,)), noise), noise)
    staged = fitter.placed(soft, ("two_stage_stiffness",), soft.shared, soft.points)
    found = SimpleNamespace(noise=noise, temper=2.0)
    wide = proposal._wide(fitter, found, (soft, replace(soft), staged))
    assert [len(others) > 3 for others in wide] == [False, False, True]
    car, runs = fitter.predictor.car, fitter.predictor.runs
    behind = {}
    for gear in (3, 6, 10):
        run = proposal._candidate(car, runs[0], "tip_in", proposal._PROFILES["tip_in"][2], gear, 220.0,
                                  150.0 * car.gearing.rolling(gear)["engine_speed"])
        behind[gear] = proposal._unseen(fitter.predictor, noise, run, soft, wide)
    assert all(np.isinf(gone[:2]).all() for gone in behind.values())
    assert behind[3][2] > APART > behind[6][2] >= behind[10][2]


def test_no_more_is_proposed_than_the_engine_gives(healthy, monkeypatch):
    car = healthy[0].predictor.car
    monkeypatch.setitem(car.values, "engine.maximum_torque", 140.0)
    found = propose(healthy, supposed(healthy, "vehicle_mass", 0.1), [healthy[1]], monkeypatch)
    assert found.torque == pytest.approx(140.0 - 30.0 - 0.08 * 150.0)
    assert proposal.words(found, healthy[1]).startswith("to 98 N.m from")
    example = healthy[0].predictor.runs[0]
    highest = []
    for torque in (0.8 * found.torque, found.torque, 2.0 * found.torque):
        run = proposal._candidate(car, example, "tip_in", ((0.0, -0.1), (0.5, 1.0)), 10, torque, found.speed)
        raw = car.raw(car.values, replace(run, start_speed=150.0 * car.gearing.rolling(10)["engine_speed"]))
        highest.append(raw["crankshaft_torque"].max())
    assert highest[0] < highest[1] - 10.0 and highest[2] == pytest.approx(highest[1], abs=1.0)


@pytest.mark.parametrize(("kind", "said"), [("tip_out", "to 176 N.m"), ("coast_down", "at -12 N.m")])
def test_the_torque_that_is_said_is_the_highest_there_is(healthy, monkeypatch, kind, said):
    mass = supposed(healthy, "vehicle_mass", 0.1)
    gear = 3 if kind == "tip_out" else proposal.TOP
    found = propose(healthy, mass, [healthy[1]], monkeypatch, (gear,), (kind,))
    assert proposal.words(found, mass).startswith(f"{said} from")


@pytest.mark.parametrize(("grip", "top", "expected"), [
    (1.0, 10, [3, 5, 10]), (3.0, 10, [2, 3, 5, 10]), (1.0, 4, [3, 4])])
def test_candidates_are_driven_in_gears_there_are_and_that_tyres_carry(healthy, grip, top, expected):
    car = healthy[0].predictor.car
    values = car.values | {"tyre.friction_coefficient": grip}
    ratios = {gear: x for gear, x in car.gearing.ratios.items() if gear <= top}
    other = SimpleNamespace(values=values, gearing=SimpleNamespace(ratios=ratios))
    assert proposal._drivable(other, (2, 3, 5, proposal.TOP), 220.0) == expected
