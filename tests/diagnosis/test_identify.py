"""The search on plants of a few lines, whose landscapes are known."""

from dataclasses import replace

import numpy as np
import pytest
from vibration import CLOCK, DETECTION, RUNS, Plant, WithPlay

from cosim.diagnosis.fitting import Tangent
from cosim.diagnosis.identify import SMALLEST, Search
from cosim.diagnosis.noise import Noise


def found(hidden):
    search = Search(Plant(hidden), lambda text: None)
    return search, search.run()


def test_where_nothing_is_hidden_nothing_is_found():
    assert found({})[1].best.causes == ()


@pytest.mark.parametrize("cause, size", [("size", 0.3), ("size", -0.2), ("curve", 0.8), ("phase", 0.2)])
def test_a_cause_is_found_with_its_size(cause, size):
    search, result = found({cause: size})
    assert result.best.causes == (cause,)
    [i] = search.predictor.index(cause)
    assert result.best.shared[i] == pytest.approx(size, abs=0.6 * DETECTION)


def test_a_cause_beyond_a_local_minimum_is_found():
    """More than half a period away, a fit from the file ends up a period off."""
    search, result = found({"phase": 0.5})
    assert result.best.causes == ("phase",) and result.best.shared[0] == pytest.approx(0.5, abs=0.02)
    start = replace(search.fitter.nominal(), causes=("phase",))
    started = search.fitter.assess(search.fitter.refine(start, result.noise), result.noise)
    assert started.score < result.best.score - 20.0


def test_a_settled_fit_in_another_minimum_is_fitted_again_from_the_leader():
    """Where the leader was settled later and better, its rivals are not left where they were."""
    search, result = found({"phase": 0.5})
    fitter, noise = search.fitter, result.noise
    stuck = fitter.assess(replace(fitter.nominal(), causes=("phase",), near=True), noise)
    leader = fitter.settle(replace(result.best, causes=("phase", "slope"), settled=False), noise)
    assert stuck.score < result.best.score - 20.0
    search.pool = {(): result.healthy, stuck.causes: stuck, leader.causes: leader}
    search.challenge(leader)
    again = search.pool[("phase",)]
    assert again.score == pytest.approx(result.best.score, abs=1.0) and again.near


def test_a_leader_is_fitted_once_more_from_the_file():
    """Where it has the right cause and size, but everything else is in another minimum: here a period off."""
    search, result = found({"size": 0.3})
    fitter, best = search.fitter, result.best
    period = np.pi / 4.0 * np.eye(len(best.shared))[0]
    bent = fitter.placed(best, best.causes, best.shared + period, [point + period for point in best.points])
    bent = fitter.assess(fitter.refine(bent, result.noise), result.noise)
    assert bent.score < best.score - 100.0
    search.scanned.clear()
    again, *scanned = search._afresh(bent, bent.causes)
    assert again.score == pytest.approx(best.score, abs=1.0) and again.near
    assert scanned and all("size" in fit.causes and len(fit.causes) == 2 for fit in scanned)
    assert search._afresh(bent, bent.causes) == []  # once


def test_beside_a_leader_fitted_from_the_file_a_cause_beyond_a_local_minimum_is_found():
    """More than half a period away: from where the leader is bent about what is missing no step leads there."""
    search, result = found({"size": 0.3, "phase": 0.5})
    assert result.best.causes == ("phase", "size")
    start = replace(search.fitter.nominal(), causes=("size",))
    leader = search.fitter.settle(search.fitter.assess(start, result.noise), result.noise)
    search.scanned.clear()
    _, *scanned = search._afresh(leader, leader.causes)
    settled = [search.fitter.settle(fit, result.noise) for fit in scanned if "phase" in fit.causes]
    assert max(fit.score for fit in settled) == pytest.approx(result.best.score, abs=1.0)


def test_everything_is_scanned_beside_a_leader_and_in_place_of_each_of_its_causes():
    search, result = found({"size": 0.3, "curve": 0.8})
    assert result.best.causes == ("curve", "size")
    assert {("curve", "size"), ("curve",), ("size",)} <= search.scanned
    assert not search._swapped(result.best)  # nothing is left to scan
    search.scanned.clear()
    assert search._swapped(result.best) and search.scanned == {("curve",), ("size",)}


def test_in_place_of_a_single_cause_every_other_is_fitted_by_derivatives_of_its_own():
    search, result = found({"phase": 0.2})
    assert () in search.scanned and search._afresh(result.best, ()) == []
    search.scanned.clear()
    others = search._afresh(result.best, ())
    assert len(others) > 1 and all(fit.near and len(fit.causes) <= 1 for fit in others)
    assert search.pool.keys() >= {fit.causes for fit in others}


def test_who_cannot_be_told_from_the_leader_is_settled_as_it_is():
    """By its causes' derivatives alone a rival stays short of where it can get; one that is no rival is left alone."""
    search, result = found({"size": 0.3})
    leader = result.best
    short, far = (replace(search.scan.probes(result.healthy, [cause], [4.0])[0], near=True, score=leader.score - short)
                  for cause, short in (("curve", 1.0), ("phase", 100.0)))
    search.pool |= {short.causes: short, far.causes: far}
    assert search._rivals_settled(leader)
    assert search.pool[short.causes].settled and not search.pool[far.causes].settled
    assert not search._rivals_settled(leader)


def test_what_derivatives_do_not_show_is_scanned():
    assert set(Search(WithPlay({"size": 0.4, "curve": 0.5}), lambda text: None).run().best.causes) == {"size", "curve"}


def test_a_leader_is_settled_by_everything_only_after_everything_was_scanned_beside_it(monkeypatch):
    """There derivatives by everything are taken anew; those taken before would have been for nothing."""
    search = Search(Plant({"size": 0.3, "phase": 0.5}), lambda text: None)
    settle, settled = search.fitter.settle, []

    def seen(fit, noise, everything=True):
        if everything:
            settled.append((fit.causes, fit.causes in search.scanned))
        return settle(fit, noise, everything)

    monkeypatch.setattr(search.fitter, "settle", seen)
    search.run()
    assert [scanned for causes, scanned in settled if causes == ("phase", "size")][0]


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


def test_two_causes_are_found():
    assert set(found({"size": 0.4, "curve": 0.9})[1].best.causes) == {"size", "curve"}


def test_causes_that_do_the_same_stand_side_by_side():
    _, result = found({"slope": 0.3})
    first, second = result.alternatives[:2]
    assert {first.causes, second.causes} == {("slope",), ("tilt",)}
    assert abs(first.score - second.score) < 1.0


def at(result, *fits):
    """A result with other fits, the first of them the best."""
    return replace(result, best=fits[0], alternatives=list(fits))


def test_a_rival_in_a_worse_minimum_is_not_refuted():
    """Its own derivatives promise what its fit did not reach; as long as they were taken where it is."""
    _, result = found({"size": 0.3})
    best = result.best
    short = replace(best, causes=("curve",), score=best.score - 20.0, hope=best.hope + 5.0, near=True)
    half = replace(short, hope=best.hope - 4.0)
    stale, real = replace(short, near=False), replace(short, hope=best.hope - 18.0)
    leads = [at(result, best, fit).lead(fit) for fit in (short, half, stale, real)]
    assert leads == pytest.approx([0.0, 4.0, 20.0, 18.0])
    assert at(result, best, short).shares() == pytest.approx([0.5, 0.5])
    assert at(result, best, real).shares()[1] < 1e-3


def test_causes_that_do_the_same_are_together_more_likely_than_each():
    search, result = found({})
    none = result.healthy
    assert search.alike == [("slope", "tilt")]
    close, other = (replace(none, causes=(cause,), score=none.score - 1.0) for cause in ("slope", "tilt"))
    lonely = replace(none, causes=("size",), score=none.score - 1.0)
    far = replace(other, score=none.score - 4.0)
    assert search._likeliest([none, close, other])[0] is close
    assert search._likeliest([none, close, lonely]) == [none, close, lonely]
    assert search._likeliest([none, close, far])[0] is none


def test_a_settled_fit_that_falls_short_of_its_own_promise_is_fitted_again():
    search, result = found({"phase": 0.5})
    fitter, noise = search.fitter, result.noise
    leader = fitter.settle(replace(result.best, causes=("phase", "slope"), settled=False), noise)
    promising = {("phase",): -5.0}
    for score, hope, stuck in ((-5.0, -5.0, []), (-9.0, -9.0, [("phase",)]), (-9.0, 0.0, [("phase",)]),
                               (-5.0, 0.0, [("phase",)]), (-300.0, -13.0, [("phase",)])):
        rival = replace(result.best, causes=("phase",), score=leader.score + score, hope=leader.hope + hope, near=True)
        search.pool, search.challenged = {leader.causes: leader, rival.causes: rival}, None
        assert search._stuck(leader, promising) == stuck, (score, hope)
        assert search._stuck(leader, promising) == []  # once for a leader


def test_what_a_rivals_own_derivatives_promise_is_fitted_too():
    """From where the leader is, with another cause in its place, nothing of it is seen."""
    search, result = found({"size": 0.4, "curve": 0.9})
    fitter, noise = search.fitter, result.noise
    true = result.best.causes
    leader, rival = (fitter.settle(fitter.assess(replace(fitter.nominal(), causes=causes), noise), noise)
                     for causes in (("curve", "phase"), ("size",)))
    leader.hope = result.best.hope - 30.0  # a leader, as long as nobody fits what is true
    search.pool = {(): result.healthy, leader.causes: leader, rival.causes: rival}
    assert search._advised(leader, {true: result.best.hope - leader.hope}) == []  # it promises that itself
    [fit] = search._advised(leader, {})
    assert fit.causes == true and fit.near and fit.score == pytest.approx(result.best.score, abs=1.0)
    assert search._advised(leader, {}) == []  # once for a leader
    # as nothing is promised beyond what is true, no further cause is
    search.tried, search.pool = set(), {(): result.healthy, rival.causes: rival, true: fit}
    assert search._advised(fit, {}) == []


def test_swaps_are_fitted_however_many_causes_could_be_added():
    """Each of those promises its log prior, and what stands in place of the true cause may promise less."""
    search, result = found({"size": 0.4, "curve": 0.9})
    leader = search.fitter.settle(result.best, result.noise)
    search.pool = {(): result.healthy, leader.causes: leader}
    promised = search._challengers(leader, result.noise, (1, 2))
    swapped = [causes for causes in promised if len(causes) == len(leader.causes)]
    added = [causes for causes in promised if len(causes) > len(leader.causes)]
    assert min(promised[causes] for causes in added) > max(promised[causes] for causes in swapped)
    assert any(causes in search.pool for causes in swapped)


def test_what_healthy_cars_differ_by_is_no_cause():
    assert found({"size": 0.5 * SMALLEST * DETECTION})[1].best.causes == ()


def test_what_would_have_to_be_implausible_is_no_cause():
    """It explains most of what is wrong, and more than anything else does, where it may be no larger."""
    search, result = found({"curve": 1.3})
    assert ("curve",) not in [fit.causes for fit in result.alternatives]
    fit = search.pool[("curve",)]
    assert fit.score > result.healthy.score + 20.0 and fit.score > result.best.score
    assert fit.shared[4] == pytest.approx(1.0, abs=0.2 * DETECTION) and not search.worth(fit)
    assert search.worth(replace(fit, near=False))  # on its way, it may come back


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


def test_a_run_that_nothing_explains_counts_for_less():
    plant = Plant({"size": 0.3})
    plant.runs[1].measured["engine_speed"][:] += 0.5 * np.sign(np.sin(2.0 * np.pi * 3.7 * CLOCK))
    search = Search(plant, lambda text: None)
    result = search.run()
    plain = search.fitter.noise(result.best)
    scales = [np.median(result.noise.scales[r] / plain.scales[r]) for r in range(RUNS)]
    assert scales[0] == pytest.approx(1.0, abs=0.2) and scales[1] > 1.5
    assert result.best.causes == ("size",)


def test_four_causes_are_found_one_after_the_other():
    causes = found({"size": 0.4, "phase": 0.2, "curve": 0.9, "slope": 0.3})[1].best.causes
    assert len(causes) == 4 and {"size", "phase", "curve"} < set(causes) and {"slope", "tilt"} & set(causes)


def test_of_causes_that_do_the_same_one_is_looked_for_and_both_are_found():
    search, result = found({"slope": 0.3, "size": 0.4})
    assert result.alike == [("slope", "tilt")] and "tilt" not in search.causes
    first, second = (next(fit for fit in result.alternatives if fit.causes == ("size", cause))
                     for cause in ("slope", "tilt"))
    assert result.best in (first, second) and first.near and second.near
    assert (first.score, first.hope) == (second.score, second.hope) and first.hope > first.score - 1e-6
    assert abs(first.score - second.score) < 1.0


def test_what_goes_one_way_only_is_not_said_to_do_the_same_the_other_way():
    """Nor is it what is looked for in place of both."""
    search = Search(Plant({"slope": -0.3}, lowest=0.0), lambda text: None)
    result = search.run()
    assert result.alike == [("slope", "tilt")] and result.best.causes == ("slope",)
    assert result.shares()[0] > 0.9 and search.pool[("tilt",)].score < result.best.score - 20.0


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
