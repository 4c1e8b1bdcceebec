"""Who takes the lead from whom, on plants of a few lines."""

from dataclasses import replace

import pytest
from vibration import found


def test_a_settled_fit_in_another_minimum_is_fitted_again_from_the_leader():
    """Where the leader was settled later and better, its rivals are not left where they were."""
    search, result = found({"phase": 0.5})
    fitter, noise = search.fitter, result.noise
    stuck = fitter.assess(replace(fitter.nominal(), causes=("phase",), near=True), noise)
    leader = fitter.settle(replace(result.best, causes=("phase", "slope"), settled=False), noise)
    assert stuck.score < result.best.score - 20.0
    search.pool.fits = {(): result.healthy, stuck.causes: stuck, leader.causes: leader}
    search.challenge(leader)
    again = search.pool.fits[("phase",)]
    assert again.score == pytest.approx(result.best.score, abs=1.0) and again.near


def test_a_settled_fit_that_falls_short_of_its_own_promise_is_fitted_again():
    search, result = found({"phase": 0.5})
    fitter, noise = search.fitter, result.noise
    leader = fitter.settle(replace(result.best, causes=("phase", "slope"), settled=False), noise)
    promising = {("phase",): -5.0}
    for score, hope, stuck in ((-5.0, -5.0, []), (-9.0, -9.0, [("phase",)]), (-9.0, 0.0, [("phase",)]),
                               (-5.0, 0.0, [("phase",)]), (-300.0, -13.0, [("phase",)])):
        rival = replace(result.best, causes=("phase",), score=leader.score + score, hope=leader.hope + hope, near=True)
        search.pool.fits = {leader.causes: leader, rival.causes: rival}
        search.challenge.challenged = None
        assert search.challenge.stuck(leader, promising) == stuck, (score, hope)
        assert search.challenge.stuck(leader, promising) == []  # once for a leader


def test_what_a_rivals_own_derivatives_promise_is_fitted_too():
    """From where the leader is, with another cause in its place, nothing of it is seen."""
    search, result = found({"size": 0.4, "curve": 0.9})
    fitter, noise = search.fitter, result.noise
    true = result.best.causes
    leader, rival = (fitter.settle(fitter.assess(replace(fitter.nominal(), causes=causes), noise), noise)
                     for causes in (("curve", "phase"), ("size",)))
    leader.hope = result.best.hope - 30.0  # a leader, as long as nobody fits what is true
    search.pool.fits = {(): result.healthy, leader.causes: leader, rival.causes: rival}
    assert search.challenge.advised(leader, {true: result.best.hope - leader.hope}) == []  # it promises that itself
    [fit] = search.challenge.advised(leader, {})
    assert fit.causes == true and fit.near and fit.score == pytest.approx(result.best.score, abs=1.0)
    assert search.challenge.advised(leader, {}) == []  # once for a leader
    # as nothing is promised beyond what is true, no further cause is
    search.challenge.tried, search.pool.fits = set(), {(): result.healthy, rival.causes: rival, true: fit}
    assert search.challenge.advised(fit, {}) == []


def test_swaps_are_fitted_however_many_causes_could_be_added():
    """Each of those promises its log prior, and what stands in place of the true cause may promise less."""
    search, result = found({"size": 0.4, "curve": 0.9})
    leader = search.fitter.settle(result.best, result.noise)
    search.pool.fits = {(): result.healthy, leader.causes: leader}
    promised = search.challenge.challengers(leader, result.noise, (1, 2))
    swapped = [causes for causes in promised if len(causes) == len(leader.causes)]
    added = [causes for causes in promised if len(causes) > len(leader.causes)]
    assert min(promised[causes] for causes in added) > max(promised[causes] for causes in swapped)
    assert any(causes in search.pool.fits for causes in swapped)
