"""How large a cause has to be: by the evidence of data that show it."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.detectable import detectable, would_show
from cosim.diagnosis.effect import factor, shift
from cosim.diagnosis.evidence import Evidence, Layout, Slopes, prior
from cosim.diagnosis.predict import Coordinate

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
    return coordinates, jacobian, Slopes(Layout(coordinates, 1), 0, jacobian)


def seen(slopes, data):
    return Evidence([slopes.seen(data, np.zeros(7))])


def test_data_of_that_size_have_just_the_evidence_that_is_needed(problem):
    coordinates, jacobian, slopes = problem
    found = detectable(seen(slopes, np.zeros(SAMPLES)), coordinates, NEEDED)
    for i in (0, 1, 3):
        evidence = seen(slopes, found[i] * jacobian[:, i])
        lead = np.subtract(*(evidence.posterior(prior(coordinates, causes)).log_evidence
                             for causes in ((coordinates[i].cause,), ())))
        assert lead == pytest.approx(NEEDED, abs=1e-6)
    assert found[0] < 0.5 * found[1] and found[2] == np.inf and set(found) == {0, 1, 2, 3}


def test_what_was_measured_does_not_matter(problem):
    coordinates, jacobian, slopes = problem
    quiet, loud = (detectable(seen(slopes, x * jacobian[:, 0]), coordinates, NEEDED) for x in (0.0, 3.0))
    assert quiet == pytest.approx(loud)


def test_sizes_are_told_in_the_unit_of_the_value_and_only_if_plausible():
    coordinates = [coordinate("stiffness"), coordinate("offset", make=shift, low=-0.1),
                   replace(coordinate("swing", run=0, make=shift), phase="swing.phase")]
    rows = would_show({0: 0.2, 1: 0.5, 2: 0.3}, coordinates, {"stiffness": 100.0, "offset": 2.0})
    assert rows[0] == {"effect": "stiffness", "parameter": "stiffness", "nominal": 100.0,
                       "below": pytest.approx(100.0 * np.exp(-0.2)), "above": pytest.approx(100.0 * np.exp(0.2)),
                       "unit": "N.m"}
    assert rows[1]["below"] is None and rows[1]["above"] == pytest.approx(2.5)
    assert rows[2]["below"] is None and rows[2]["above"] == pytest.approx(0.3)  # an amplitude
