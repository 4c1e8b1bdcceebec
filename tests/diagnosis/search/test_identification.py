"""How far suppositions are apart, and from when on a cause is named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import norm
from vibration import found

from cosim.diagnosis import catalogue
from cosim.diagnosis.search.detectable import Shown
from cosim.diagnosis.search.identification import APART, LACKING, Identification, tempered


@pytest.mark.parametrize("lead, best", [(-5.0, ()), (1.2, ()), (1.6, ("drag",)), (30.0, ("drag",))])
def test_a_cause_is_named_that_is_twice_as_likely_as_nothing(lead, best):
    """Odds of 2 are a lead of 1.39, tempered by 2."""
    healthy, drag = (SimpleNamespace(causes=causes, effects=causes, score=score, hope=score, near=True, shared=[])
                     for causes, score in (((), 0.0), (("drag",), lead)))
    first, second = (drag, healthy) if lead > 0.0 else (healthy, drag)
    found = Identification(first, [first, second], healthy, None, [], [], {})
    named = found.significant()
    assert named.best.causes == best and named.alternatives[0] is named.best
    assert {fit.causes: share for fit, share in zip(named.alternatives, named.shares())} == pytest.approx(
        {fit.causes: share for fit, share in zip(found.alternatives, found.shares())})


@pytest.mark.parametrize("size, significant", [(0.9, False), (1.1, True), (-1.9, False), (-2.1, True)])
def test_no_cause_is_named_that_is_smaller_than_the_recordings_show(size, significant):
    """However far it leads: its own size cannot be the reason."""
    drag = SimpleNamespace(cause="drag", name="drag", phase="")
    healthy, dragged = (SimpleNamespace(causes=causes, effects=causes, score=score, hope=score, near=True,
                                        shared=np.array([size])) for causes, score in (((), 0.0), (("drag",), 9.0)))
    found = Identification(dragged, [dragged, healthy], healthy, None, [], [drag], {0: Shown(2.0, 1.0, 1.7)})
    assert found.significant().best.causes == (("drag",) if significant else ())


def test_two_that_do_the_same_are_two_chances_that_something_is_there():
    """Each may be smaller than what shows of one alone."""
    coordinates = [SimpleNamespace(cause=cause, name=cause, phase="") for cause in ("slope", "tilt")]
    healthy, slope, tilt = (SimpleNamespace(causes=causes, effects=causes, score=score, hope=score, near=True,
                                            shared=np.array([0.91, 0.97]))
                            for causes, score in (((), 0.0), (("slope",), 2.0), (("tilt",), 2.0)))
    shown = {0: Shown(1.0, 1.0, 1.7), 1: Shown(1.0, 1.0, 1.7)}
    rivals = Identification(slope, [slope, tilt, healthy], healthy, None, [], coordinates, shown)
    assert rivals.significant().best is healthy
    same = replace(rivals, alike=[("tilt", "slope")])
    assert same.significant() is same


@pytest.mark.parametrize("sizes, needed", [((1.2, 1.3), LACKING), ((1.2, 0.8), APART), ((0.8, 0.8), APART)])
def test_a_further_cause_that_is_smaller_than_would_show_has_to_be_as_far_ahead_as_another_cause(sizes, needed):
    """One that is large enough only has to be likelier than not there."""
    coordinates = [SimpleNamespace(cause=cause, name=cause, phase="") for cause in ("lash", "shaft")]
    both, lash = (SimpleNamespace(causes=causes, shared=np.array(sizes)) for causes in (("lash", "shaft"), ("lash",)))
    shown = {0: Shown(1.0, 1.0, 1.7), 1: Shown(1.0, 1.0, 1.7)}
    found = Identification(both, [both, lash], lash, None, [], coordinates, shown)
    assert found.told_without(lash) == needed


def test_where_fits_of_the_same_supposition_differ_a_lead_counts_for_less():
    search, result = found({"phase": 0.2})
    far = replace(result.best, causes=("curve",), score=result.best.score - 15.0, near=False)
    sure = at(result, result.best, far)
    search.refitted = {("curve",): 14.0, ("phase",): 8.0, ("size",): 0.5}
    doubtful = replace(sure, temper=search.temper)
    assert search.temper == tempered(8.0) and sure.apart(far) > APART > doubtful.apart(far) > 0.0
    assert sure.shares()[1] < 0.01 < doubtful.shares()[1] < 0.5


@pytest.mark.parametrize("scatter", [0.0, 2.0, 8.0])
@pytest.mark.parametrize("lead", [1.0, 9.0, 30.0])
def test_odds_are_those_of_a_lead_with_an_error(scatter, lead):
    """The mean of what it would be with every error."""
    errors = scatter * norm.ppf((np.arange(4000) + 0.5) / 4000)
    mean = float(np.mean(expit((lead + errors) / tempered(0.0))))
    assert float(expit(lead / tempered(scatter))) == pytest.approx(mean, abs=0.02)


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
    ahead = at(result, short, best)  # the best is one of several that do the same, and this none of them
    assert ahead.odds(best) == pytest.approx(np.exp(20.0 / ahead.temper)) and ahead.odds(short) == 1.0


def test_between_effects_that_push_alike_a_lead_counts_for_less(monkeypatch):
    """A plant of another structure does otherwise where they differ."""
    monkeypatch.setattr(catalogue, "CATALOGUE", {"slope": SimpleNamespace(pushes_like=("tilt",))})
    _, result = found({"size": 0.3})
    best = replace(result.best, causes=("size", "slope"), near=False)
    rivals = [replace(best, causes=causes, score=best.score - 12.0)
              for causes in (("size", "tilt"), ("size",), ("slope", "tilt"), ("curve", "slope"))]
    assert [at(result, best, fit).lead(fit) for fit in rivals] == pytest.approx([6.0, 12.0, 12.0, 12.0])
    assert [at(result, best, fit).apart(fit) < APART for fit in rivals] == [True, False, False, False]
