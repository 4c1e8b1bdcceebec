"""Fits that begin in the vehicle file, on plants of a few lines, whose landscapes are known."""

from dataclasses import replace

import numpy as np
import pytest
from vibration import found, leading

from cosim.diagnosis.search.pool import SWAPPED


def test_a_leader_is_fitted_once_more_from_the_file():
    """Where it has the right cause and size, but everything else is in another minimum: here a period off."""
    search, result = found({"size": 0.3})
    fitter, best = search.fitter, result.best
    period = np.pi / 4.0 * np.eye(len(best.shared))[0]
    bent = fitter.placed(best, best.causes, best.shared + period, [point + period for point in best.points])
    bent = fitter.assess(fitter.refine(bent, result.noise), result.noise)
    assert bent.score < best.score - 100.0
    search.afresh.scanned.clear()
    again, *scanned = search.afresh(bent, bent.causes)
    assert again.score == pytest.approx(best.score, abs=1.0) and again.near
    assert scanned and all("size" in fit.causes and len(fit.causes) == 2 for fit in scanned)
    assert search.afresh(bent, bent.causes) == []  # once


def test_beside_a_leader_fitted_from_the_file_a_cause_beyond_a_local_minimum_is_found():
    """More than half a period away: from where the leader is bent about what is missing no step leads there."""
    search, result = found({"size": 0.3, "phase": 0.5})
    assert result.best.causes == ("phase", "size")
    start = replace(search.fitter.nominal(), causes=("size",))
    leader = search.fitter.settle(search.fitter.assess(start, result.noise), result.noise)
    search.afresh.scanned.clear()
    _, *scanned = search.afresh(leader, leader.causes)
    settled = [search.fitter.settle(fit, result.noise) for fit in scanned if "phase" in fit.causes]
    assert max(fit.score for fit in settled) == pytest.approx(result.best.score, abs=1.0)


def test_in_place_of_a_single_cause_every_other_is_fitted_by_derivatives_of_its_own():
    search, result = found({"phase": 0.2})
    assert () in search.afresh.scanned and search.afresh(result.best, ()) == []
    search.afresh.scanned.clear()
    others = search.afresh(result.best, ())
    assert len(others) > 1 and all(fit.near and len(fit.causes) <= 1 for fit in others)
    assert search.pool.fits.keys() >= {fit.causes for fit in others}


def test_what_does_nothing_while_small_is_fitted_from_the_size_that_was_scanned_as_well(monkeypatch):
    """From the one it was found with it may end in another minimum: here at a limit."""
    search, result = found({"phase": 0.5})
    search.afresh.scanned.clear()
    assert search.afresh.as_scanned(("phase",)) == []
    monkeypatch.setattr(search.scan, "silent", list)
    off = leading(search, result.best, {"phase": -1.0})
    as_found, as_scanned, *_ = search.afresh(off, ("phase",))
    assert as_found.causes == as_scanned.causes == ("phase",)
    assert as_found.score < result.best.score - 20.0
    assert as_scanned.score == pytest.approx(result.best.score, abs=1.0) and as_scanned.near
    assert search.afresh.as_scanned(("phase", "size")) == []


def test_what_may_stand_in_place_of_the_leader_is_fitted_by_everything(monkeypatch):
    """Not what has all of the leader's causes, nor what is far behind it, nor what is too small."""
    search, result = found({"phase": 0.2})
    start, other = search.afresh.opened[0], replace(result.best, causes=("size",))
    assert start.causes == ("phase",)
    fit = search.afresh.by_its_own(start, other)
    assert fit.settled and fit.score == pytest.approx(result.best.score, abs=1.0)
    for leader in (result.best, result.healthy, replace(other, score=other.score + 1.1 * SWAPPED)):
        fit = search.afresh.by_its_own(start, leader)
        assert fit.near and not fit.settled
    monkeypatch.setattr("cosim.diagnosis.search.pool.SMALLEST", 1e3)
    assert not search.afresh.by_its_own(start, other).settled


def test_what_changes_gaps_is_fitted_from_the_file_to_either_side():
    """Also where a scan shows nothing of it; not again where it is settled, nor beside a leader of another kind."""
    search, result = found({"phase": 0.2})
    assert search.afresh.of_gaps(result.healthy) == []
    phase = search.coordinates[0]
    search.coordinates[0] = replace(phase, parameter=replace(phase.parameter, targets=("a.half_gap", "b.half_gap")))
    assert search.scan.gaps(["phase", "size"]) == ["phase"] and search.afresh.of_gaps(result.healthy) == []
    del search.pool.fits["phase",]
    assert search.afresh.of_gaps(replace(result.healthy, causes=("size",))) == []
    assert len(search.afresh.of_gaps(result.best)) == 2
    fits = [fit() for fit in search.afresh.of_gaps(result.healthy)]
    assert all(fit.causes == ("phase",) and fit.near for fit in fits) and len(fits) == 2
    assert max(fit.score for fit in fits) == pytest.approx(result.best.score, abs=1.0)
    search.afresh.scanned.clear()
    assert len(search.afresh(result.healthy, ())) >= 3
