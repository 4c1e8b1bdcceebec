"""The evidence of a missing torque against the densities it stands for."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from cosim.diagnosis.effect import factor
from cosim.diagnosis.fit.evidence import Layout, prior
from cosim.diagnosis.fit.fitting import Tangent
from cosim.diagnosis.fit.predict import Coordinate
from cosim.diagnosis.judge.torques import Healthy, Torque, likeliest

SAMPLES, PIECES, KNOTS, SIZE = 30, 4, 3, 1.7
LEFT = [1.0, 2.5]  # by what the noise's variance is larger


def coordinate(cause, run, tolerance):
    p = factor(cause, cause, unit="1", meaning="", spread=1.0, limits=(0.1, 10.0), detection=0.4) if cause else None
    return Coordinate(cause or "start", cause, cause, run, p, tolerance, 1.0, 0.1)


def alike(count):
    return 0.5 * np.eye(count) + 0.5


@pytest.fixture
def problem():
    """Coordinates, slopes by them and by the pieces of a torque, and what is left, of two runs."""
    random = np.random.default_rng(2)
    coordinates = [coordinate("one", None, 0.3), coordinate("two", None, 0.2), coordinate("", 0, 0.4),
                   coordinate("", 1, 0.4)]
    slopes = [random.standard_normal((SAMPLES, 3)).astype(np.float32) for _ in LEFT]
    pieces = [random.standard_normal((SAMPLES, PIECES)) for _ in LEFT]
    left = [p @ (2.0 * random.standard_normal(PIECES)) + random.standard_normal(SAMPLES) for p in pieces]
    layout = Layout(coordinates, [1] * len(LEFT))
    # the derivatives are a fit's, which knows of one cause
    fit = SimpleNamespace(causes=("one",), points=[np.zeros(4)] * 2, tangents=[Tangent(s) for s in slopes])
    bends = [[size * random.standard_normal((SAMPLES, KNOTS)) for size in (0.4, 0.2)] for _ in LEFT]
    healthy = [Healthy(layout, r, fit, y, np.ones(SAMPLES), b) for r, (y, b) in enumerate(zip(left, bends))]
    spread = prior(coordinates, fit.causes)
    apart = np.abs(np.subtract.outer(np.arange(KNOTS), np.arange(KNOTS)))
    smooth = np.exp(-apart / KNOTS)
    usual = [noise * np.eye(SAMPLES) + (s * spread[layout.columns[r]] ** 2) @ s.T.astype(float)
             + sum(kind @ smooth @ kind.T for kind in b) for r, (s, noise, b) in enumerate(zip(slopes, LEFT, bends))]
    return healthy, pieces, left, usual


def lead(left, usual, further):
    """Log density of what is left with a further covariance over that without."""
    zero = np.zeros(left.size)
    return (multivariate_normal.logpdf(left, zero, usual + further) - multivariate_normal.logpdf(left, zero, usual))


def test_each_recording_alone_has_the_evidence_of_its_density(problem):
    healthy, pieces, left, usual = problem
    true = [lead(y, cov, SIZE**2 * p @ alike(PIECES) @ p.T) for y, cov, p in zip(left, usual, pieces)]
    for shared in (True, False):
        assert Torque(healthy, pieces, alike, shared).alone(SIZE, LEFT) == pytest.approx(true)
    assert Torque(healthy, pieces, alike, False).gain(SIZE, LEFT) == pytest.approx(sum(true))


def test_a_curve_is_the_same_in_all_recordings(problem):
    healthy, pieces, left, usual = problem
    both = np.zeros((2 * SAMPLES, 2 * SAMPLES))
    both[:SAMPLES, :SAMPLES], both[SAMPLES:, SAMPLES:] = usual
    stacked = np.vstack(pieces)
    true = lead(np.concatenate(left), both, SIZE**2 * stacked @ alike(PIECES) @ stacked.T)
    torque = Torque(healthy, pieces, alike, True)
    assert torque.gain(SIZE, LEFT) == pytest.approx(true)
    (first, _), (second, _) = torque.solve(SIZE, LEFT)
    assert np.array_equal(first, second)


def test_of_several_suppositions_the_likeliest_is_that_by_which_it_was_made(problem):
    healthy, pieces, _, _ = problem
    for own, shown in zip(healthy, pieces):
        own.residual = own.residual + 20.0 * shown[:, 2]
    assert likeliest(healthy, pieces, (0.1, 1.0, 10.0)) == 2
