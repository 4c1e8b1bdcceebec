"""The search on plants of a few lines, whose landscapes are known."""

from dataclasses import replace

import numpy as np
import pytest
from vibration import CLOCK, DETECTION, Plant, WithPlay, WithStages, found, leading

from cosim.diagnosis.search import identify
from cosim.diagnosis.search.identify import Search
from cosim.diagnosis.search.pool import SMALLEST


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


def test_everything_is_scanned_beside_a_leader_and_in_place_of_each_of_its_causes():
    search, result = found({"size": 0.3, "curve": 0.8})
    assert result.best.causes == ("curve", "size")
    assert {("curve", "size"), ("curve",), ("size",)} <= search.afresh.scanned
    assert not search._swapped(result.best)  # nothing is left to scan
    search.afresh.scanned.clear()
    assert search._swapped(result.best) and search.afresh.scanned == {("curve",), ("size",)}


def test_beside_a_cause_that_may_as_well_not_be_there_nothing_is_searched():
    """But beside the others, and beside a single one that may not be there either."""
    search, result = found({"size": 0.3, "curve": 0.8})
    leader, fits = result.best, search.pool.fits
    assert search._needed(leader) is leader and search._needed(fits["curve",]) is fits["curve",]
    fits["curve",].score = leader.score - 1.0
    fits["size",].score = leader.score - 2.0
    assert search._needed(leader) is fits["curve",]
    fits["curve",].score = leader.score - 100.0
    assert search._needed(leader) is fits["size",]
    fits[()].score = fits["size",].score + 1.0
    assert search._needed(fits["size",]) is fits["size",]
    search.afresh.scanned.clear()
    assert search._swapped(search._needed(leader)) and search.afresh.scanned == {()}


def test_where_no_cause_explains_a_recording_two_are_tried_at_once():
    """Beside the size that a cause has in the file, and as if that recording were not doubtful."""
    search = Search(Plant({"size": 0.5, "phase": 0.5}), lambda text: None)
    search._open()
    assert search.pool.doubtful and max(map(len, search.pool.fits)) == 1
    search._two_at_once()
    leader = search.pool.worthy()[0]
    assert leader.causes == ("phase", "size") and not search.pool.doubtful
    assert leader.shared[:2] == pytest.approx([0.5, 0.5], abs=0.02)


def test_who_cannot_be_told_from_the_leader_is_settled_as_it_is():
    """By its causes' derivatives alone a rival stays short of where it can get; one that is no rival is left alone."""
    search, result = found({"size": 0.3})
    leader = result.best
    short, far = (replace(search.scan.probes(result.healthy, [cause], [4.0])[0], near=True, score=leader.score - short)
                  for cause, short in (("curve", 1.0), ("phase", 100.0)))
    search.pool.fits |= {short.causes: short, far.causes: far}
    assert search._rivals_settled(leader)
    assert search.pool.fits[short.causes].settled and not search.pool.fits[far.causes].settled
    assert not search._rivals_settled(leader)


def test_who_is_near_the_leader_is_fitted_in_further_ways_once():
    """Here a rival is a period off, and is told from the leader, but by less than further ways may gain."""
    search, result = found({"phase": 0.2})
    leader, causes, period = result.best, ("curve", "phase"), -np.pi / 4.0 * np.eye(len(result.best.shared))[0]
    rival = search.fitter.placed(leader, causes, leader.shared + period, [point + period for point in leader.points])
    search.pool.fits |= {causes: replace(rival, near=True, settled=True, score=leader.score - 15.0)}
    search.pool.fits[causes].shared[4] = 2.0 * DETECTION
    search.refitted.clear()
    assert search._once_more(leader) and {leader.causes, causes} <= search.refitted.keys()
    better = search.pool.fits[causes]
    assert better.shared[0] == pytest.approx(0.2, abs=0.02) and better.score > leader.score - 8.0
    assert not search._once_more(leader)


def test_what_derivatives_do_not_show_is_scanned():
    assert set(Search(WithPlay({"size": 0.4, "curve": 0.5}), lambda text: None).run().best.causes) == {"size", "curve"}


def test_a_leader_is_settled_by_everything_only_after_everything_was_scanned_beside_it(monkeypatch):
    """There derivatives by everything are taken anew; those taken before would have been for nothing."""
    search = Search(Plant({"size": 0.3, "phase": 0.5}), lambda text: None)
    settle, settled = search.fitter.settle, []

    def seen(fit, noise, everything=True):
        if everything:
            settled.append((fit.causes, fit.causes in search.afresh.scanned))
        return settle(fit, noise, everything)

    monkeypatch.setattr(search.fitter, "settle", seen)
    search.run()
    assert [scanned for causes, scanned in settled if causes == ("phase", "size")][0]


class AtOnce(Plant):
    """Several fits at once, their simulations in this process."""

    def __init__(self, hidden):
        super().__init__(hidden)
        self.workers, self._pool = 3, "of nobody"

    def many(self, jobs):
        return [self.predict(*job) for job in jobs]


def test_fits_that_know_nothing_of_each_other_are_the_same_at_once():
    hidden = {"size": 0.4, "curve": 0.9}
    (_, one), several = found(hidden), Search(AtOnce(hidden), lambda text: None).run()
    assert [fit.causes for fit in several.alternatives] == [fit.causes for fit in one.alternatives]
    for here, there in zip(several.alternatives, one.alternatives):
        assert here.score == there.score and np.array_equal(here.shared, there.shared)


def test_two_causes_are_found():
    assert set(found({"size": 0.4, "curve": 0.9})[1].best.causes) == {"size", "curve"}


def test_causes_that_do_the_same_stand_side_by_side():
    _, result = found({"slope": 0.3})
    first, second = result.alternatives[:2]
    assert {first.causes, second.causes} == {("slope",), ("tilt",)}
    assert abs(first.score - second.score) < 1.0


def test_what_pushes_like_a_cause_of_the_leader_is_fitted_as_well_as_the_leader(monkeypatch):
    """It may be in a worse minimum, where lashes are crossed at other moments: here half a period off."""
    monkeypatch.setattr(identify, "push_alike", lambda one, other: {*one, *other} == {"slope", "curve"})
    search, result = found({"slope": 0.4, "size": 0.3})
    fitter, best = search.fitter, result.best
    assert best.causes in (("size", "slope"), ("size", "tilt")) and ("curve", "size") in search.instead
    right = search.pool.fits["curve", "size"]
    assert right.near
    off = 0.4 * np.eye(len(best.shared))[0]
    short = fitter.placed(right, right.causes, right.shared + off, [point + off for point in right.points])
    search.pool.fits[right.causes] = replace(fitter.assess(short, result.noise), near=True)
    assert not search._pushed_alike(best)  # once
    search.instead.clear()
    assert search._pushed_alike(best)
    assert search.pool.fits[right.causes].score == pytest.approx(right.score, abs=2.0)


def test_what_a_healthy_car_has_too_much_of_is_fitted_as_a_cause():
    """Where it is a part of what is hidden; once, and not where healthy cars have as much, or nothing is explained."""
    search, result = found({"size": 0.3})
    [i] = search.predictor.index("size")
    healthy, tolerance = result.healthy, search.coordinates[i].tolerance

    def car(sigma):
        there = sigma * tolerance * np.eye(len(healthy.shared))[i]
        return search.fitter.placed(healthy, (), there, [there.copy() for _ in healthy.points])

    del search.pool.fits["size",]
    search.strained.clear()
    assert not search._freed(car(2.0)) and ("size",) not in search.pool.fits
    assert search._freed(car(-3.0)) and not search._freed(car(3.0))
    again = search.pool.fits["size",]
    assert again.settled and again.score == pytest.approx(result.best.score, abs=1.0)
    search.strained.clear()
    search.pool.noise = search.pool.plain.tempered(np.array([1.0, *[2.0] * (len(healthy.points) - 1)]))
    assert not search._freed(car(3.0))


def test_what_does_nothing_while_small_is_tried_at_a_size_beside_a_leader():
    """Its derivatives say nothing, and where nothing else is fitted a scan does not show it. Once for a leader."""
    search = Search(WithStages({"size": 0.3}, stage=0.42, width=0.21), lambda text: None)
    best = search.run().best
    assert best.causes == ("size", "stages") and search.scan.silent(["phase", "size", "stages"]) == ["stages"]
    leader = search.pool.settle(replace(search.pool.fits["size",], near=False, settled=False))
    del search.pool.fits[best.causes]
    search.probed.clear()
    assert search._probed(leader) and not search._probed(leader)
    again = search.pool.fits[best.causes]
    assert again.near and again.score == pytest.approx(best.score, abs=1.0)
    search = Search(WithStages({"size": 0.3}), lambda text: None)
    best = search.run().best
    fitted = set(search.pool.fits)
    search.probed.clear()
    assert not search._probed(best) and set(search.pool.fits) == fitted  # it promises nothing


def test_a_leader_is_better_with_a_cause_that_is_larger():
    """Where its fit ended in another minimum. Once for a leader, and not where no size is better."""
    search, result = found({"size": 0.3})
    search.resized.clear()
    assert not search._resized(result.best) and not search._resized(result.healthy)
    leader = leading(search, result.best, {"size": 0.2})
    assert not search._resized(leader)  # that was asked
    search.resized.clear()
    assert search._resized(leader) and not search._resized(leader)
    again = search.pool.fits["size",]
    assert again.settled and again.score == pytest.approx(result.best.score, abs=1.0)
    assert again.shared == pytest.approx(result.best.shared, abs=0.1 * DETECTION)


def test_what_made_up_for_a_cause_that_was_too_small_is_no_cause_beside_it():
    search, result = found({"size": 0.3})
    leader = leading(search, result.best, {"size": 0.2, "curve": 2.0 * DETECTION})
    del search.pool.fits["size",]
    search.resized.clear()
    assert search._resized(leader)
    assert search.pool.fits["size",].score == pytest.approx(result.best.score, abs=1.0)
    assert search.pool.fits[leader.causes] is leader


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


def test_what_healthy_cars_differ_by_is_no_cause():
    assert found({"size": 0.5 * SMALLEST * DETECTION})[1].best.causes == ()


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
    assert result.shares()[0] > 0.9 and search.pool.fits[("tilt",)].score < result.best.score - 20.0


def test_what_does_the_same_as_far_as_recordings_reach_is_listed():
    """Derivatives at the file do not say so, and a fit from a stage that ends within them need not get there."""
    search = Search(WithStages({"slope": 0.3}), lambda text: None)
    result = search.run()
    assert result.best.causes == ("slope",) and not result.alike
    [stages] = [fit for fit in result.alternatives if fit.causes == ("stages",)]
    stages.score -= 100.0  # as if the search had ended where they are too narrow
    search._put_around()
    again = search.pool.fits["stages",]
    assert 0.0 < result.lead(again) < 5.0 and again.near and again.hope <= again.score
    assert again.shared[3] == pytest.approx(0.3, abs=0.02) and 8.0 * again.shared[4] > 0.9 * CLOCK[-1]


def test_a_slope_that_changes_within_a_recording_is_not_the_slope():
    result = Search(WithStages({}, stage=0.3, width=0.4), lambda text: None).run()
    assert result.best.causes == ("stages",) and result.best.shared[4] == pytest.approx(0.4, abs=0.05)
