"""Which causes do the same is seen before anything is fitted; what takes another's place does what that did."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.effect import factor
from cosim.diagnosis.fit.evidence import Evidence, Layout, Slopes
from cosim.diagnosis.fit.predict import Coordinate
from cosim.diagnosis.search.alike import LARGE, alike, instead

DETECTION, SAMPLES = 0.4, 60
CAUSES = ("slope", "rolling", "mass", "hidden", "swing", "late")


def coordinate(cause, run=None, probes=()):
    p = factor(cause, cause, unit="1", meaning="", spread=1.0, limits=(0.1, 10.0), detection=DETECTION, probes=probes)
    return Coordinate(cause, cause, cause, run, p, 0.2 * DETECTION, 1.0, 0.1, -2.0, 2.0)


@pytest.fixture(scope="module")
def problem():
    """Rolling does 1.5 times what slope does but for little; hidden does next to nothing, late nothing yet."""
    random = np.random.default_rng(7)
    slope, mass, little, start = random.standard_normal((4, SAMPLES))
    coordinates = [coordinate("slope"), coordinate("mass"), coordinate("rolling"), coordinate("hidden"),
                   coordinate("swing", run=0), coordinate("late", probes=(2.0,)),
                   Coordinate("start", "", "", 0, None, 0.3, 0.3, 0.01)]
    jacobian = np.column_stack([slope, mass, 1.5 * slope + 0.05 * little, 0.01 * mass, slope, slope, start])
    evidence = Evidence([Slopes(Layout(coordinates, [1]), 0, jacobian).seen(np.zeros(SAMPLES), np.zeros(7))])
    return coordinates, jacobian, evidence


def test_what_does_the_same_is_a_group_and_nothing_else_is(problem):
    coordinates, _, evidence = problem
    assert [set(group) for group in alike(evidence, coordinates, CAUSES)] == [{"slope", "rolling"}]


@pytest.mark.parametrize(("low", "first"), [(-2.0, "rolling"), (0.0, "slope")])
def test_what_can_be_large_to_both_sides_stands_for_its_group(problem, low, first):
    """Rolling shows 1.5 times what slope does, but what only drags cannot stand for a slope downhill."""
    coordinates, _, evidence = problem
    bounded = [replace(c, low=low) if c.cause == "rolling" else c for c in coordinates]
    assert alike(evidence, bounded, CAUSES)[0][0] == first


def test_a_group_needs_each_to_imitate_every_other():
    """Two that a third imitates by its two parameters, but neither the other."""
    random = np.random.default_rng(8)
    one, other, start = random.standard_normal((3, SAMPLES))
    coordinates = [coordinate("one"), coordinate("other"), coordinate("both"), coordinate("both"),
                   Coordinate("start", "", "", 0, None, 0.3, 0.3, 0.01)]
    jacobian = np.column_stack([one, other, one + other, one - other, start])
    evidence = Evidence([Slopes(Layout(coordinates, [1]), 0, jacobian).seen(np.zeros(SAMPLES), np.zeros(5))])
    assert alike(evidence, coordinates, ("one", "other", "both")) == []


def test_what_takes_its_place_does_what_it_did(problem):
    coordinates, jacobian, evidence = problem
    shared = np.zeros(len(coordinates))
    shared[[0, 1]] = LARGE * DETECTION, 0.3
    moved = shared + instead(evidence, coordinates, shared, "slope", "rolling")
    assert moved[0] == pytest.approx(0.0, abs=0.05) and moved[2] == pytest.approx(shared[0] / 1.5, abs=0.05)
    assert np.linalg.norm(jacobian @ (moved - shared)) < 0.05 * np.linalg.norm(jacobian @ shared)
