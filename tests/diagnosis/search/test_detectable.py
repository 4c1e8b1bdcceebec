"""How large a cause has to be: by the evidence of data that show it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from cosim.diagnosis.effect import factor, shift
from cosim.diagnosis.fit.evidence import Evidence, Layout, Slopes, prior
from cosim.diagnosis.fit.predict import Coordinate
from cosim.diagnosis.search.detectable import Shown, detectable, told, would_show

SAMPLES, NEEDED = 80, 8.0


def coordinate(cause, run=None, probes=(), make=factor, low=-1.0, high=1.0):
    p = make(cause, cause, unit="N.m", meaning="", spread=1.0, limits=(0.3, 3.0), detection=0.1, probes=probes)
    return Coordinate(cause, cause, cause, run, p, 0.02, 1.0, 0.1, low, high)


@pytest.fixture(scope="module")
def problem():
    random = np.random.default_rng(11)
    swing = coordinate("swing", run=0, probes=(0.5,))
    coordinates = [coordinate("clear"), coordinate("dim"), coordinate("never"), swing, replace(swing, part=1),
                   coordinate("late", probes=(2.0,)), Coordinate("start", "", "", 0, None, 0.3, 0.3, 0.01)]
    jacobian = random.standard_normal((SAMPLES, 7)) * np.array([30.0, 2.0, 0.0, 4.0, 4.0, 1.0, 1.0])
    return coordinates, jacobian, Slopes(Layout(coordinates, [1]), 0, jacobian)


def seen(slopes, data):
    return Evidence([slopes.seen(data, np.zeros(7))])


def straight(jacobian, changes):
    return [[jacobian @ change] for change in changes]


def test_data_of_that_size_have_just_the_evidence_that_is_needed(problem):
    coordinates, jacobian, slopes = problem
    found = detectable(seen(slopes, np.zeros(SAMPLES)), coordinates, NEEDED, partial(straight, jacobian))
    for i in (0, 1, 3):
        assert found[i][0] == found[i][1]
        evidence = seen(slopes, found[i][1] * jacobian[:, i])
        lead = np.subtract(*(evidence.posterior(prior(coordinates, causes)).log_evidence
                             for causes in ((coordinates[i].cause,), ())))
        assert lead == pytest.approx(NEEDED, abs=1e-6)
    assert found[0][0] < 0.5 * found[1][0] and found[2][:2] == (np.inf, np.inf) and set(found) == {0, 1, 2, 3}


def test_another_size_has_the_evidence_that_is_told(problem):
    coordinates, jacobian, slopes = problem
    found = detectable(seen(slopes, np.zeros(SAMPLES)), coordinates, NEEDED, partial(straight, jacobian))
    for i, share in ((0, 0.7), (0, -1.4), (1, 0.2)):
        point = share * found[i].above * np.eye(7)[i]
        evidence = seen(slopes, jacobian @ point)
        lead = np.subtract(*(evidence.posterior(prior(coordinates, causes)).log_evidence
                             for causes in ((coordinates[i].cause,), ())))
        assert told(found, coordinates, point, coordinates[i].cause, NEEDED) == pytest.approx(lead, abs=1e-6)


def test_what_was_measured_does_not_matter(problem):
    coordinates, jacobian, slopes = problem
    quiet, loud = (detectable(seen(slopes, x * jacobian[:, 0]), coordinates, NEEDED, partial(straight, jacobian))
                   for x in (0.0, 3.0))
    assert all(quiet[i] == pytest.approx(loud[i]) for i in quiet)


def test_a_size_is_enough_only_where_it_is_simulated_to_be(problem):
    """Downwards ``clear`` has little to take away, and ``dim`` does less than derivatives say."""
    coordinates, jacobian, slopes = problem

    def bent(changes):
        own = [change.copy() for change in changes]
        for change in own:
            change[0] = max(change[0], -0.01)
            change[1] *= 0.7
        return straight(jacobian, own)

    plain, found = (detectable(seen(slopes, np.zeros(SAMPLES)), coordinates, NEEDED, simulate)
                    for simulate in (partial(straight, jacobian), bent))
    assert plain[0][0] > 0.01 and found[0][:2] == (np.inf, plain[0][1])
    assert found[1][:2] == pytest.approx([size / 0.7 for size in plain[1][:2]], rel=0.05)


def test_what_cannot_be_simulated_would_not_show(problem):
    coordinates, jacobian, slopes = problem
    found = detectable(seen(slopes, np.zeros(SAMPLES)), coordinates, NEEDED, lambda changes: [None] * len(changes))
    assert {shown[:2] for shown in found.values()} == {(np.inf, np.inf)}


def test_sizes_are_told_in_the_unit_of_the_value_and_only_if_plausible():
    coordinates = [coordinate("stiffness"), coordinate("offset", make=shift, low=-0.1),
                   replace(coordinate("swing", run=0, make=shift), phase="swing.phase")]
    shown = {i: Shown(size, size, 1.0) for i, size in enumerate((0.2, 0.5, 0.3))}
    rows = would_show(shown, coordinates, {"stiffness": 100.0, "offset": 2.0})
    assert rows[0] == {"effect": "stiffness", "parameter": "stiffness", "nominal": 100.0,
                       "below": pytest.approx(100.0 * np.exp(-0.2)), "above": pytest.approx(100.0 * np.exp(0.2)),
                       "unit": "N.m"}
    assert rows[1]["below"] is None and rows[1]["above"] == pytest.approx(2.5)
    assert rows[2]["below"] is None and rows[2]["above"] == pytest.approx(0.3)  # an amplitude


def test_a_cause_is_told_by_its_parameter_that_shows_most_to_the_side_where_it_is():
    swings = [replace(coordinate("swing", run=run), phase="swing.phase", part=part)
              for run in (0, 1) for part in (0, 1)]
    coordinates = [coordinate("load"), replace(coordinate("load"), name="other"), *swings, coordinate("late")]
    smallest = {0: Shown(0.2, 0.4, 2.0), 1: Shown(0.3, np.inf, 3.0), 2: Shown(np.inf, 0.5, 1.0)}

    def found(cause, **at):
        point = np.zeros(7)
        for name, value in at.items():
            point[int(name[1:])] = value
        return told(smallest, coordinates, point, cause, NEEDED)

    assert found("load", _0=-0.2) == found("load", _0=0.4) == pytest.approx(NEEDED)
    assert found("load", _0=0.2) == pytest.approx(0.25 * (NEEDED + 2.0) - 2.0)
    assert found("load", _0=0.2, _1=-0.3) == pytest.approx(NEEDED) and found("load", _0=0.2, _1=9.0) < 1.0
    assert found("swing", _2=-0.3, _3=0.4, _4=0.0, _5=0.5) == pytest.approx(NEEDED)  # an amplitude of 0.5 in both
    assert found("late", _6=0.01) == np.inf  # nobody knows from which size on that shows
