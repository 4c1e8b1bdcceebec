"""Shares with intervals, and calibration."""

import math

import numpy as np
import pytest

from benchmarks.blind import figures


def test_wilson_interval():
    row = figures.rate("", "", [True] * 7 + [False] * 3)
    z, n, p = 1.959964, 10, 0.7
    middle, half = p + z**2 / (2 * n), z * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert row.low == pytest.approx((middle - half) / (1 + z**2 / n), rel=1e-5)
    assert row.high == pytest.approx((middle + half) / (1 + z**2 / n), rel=1e-5)
    # so many cases without an alarm it takes to show a rate of 1 %
    assert figures.rate("", "", [False] * 381).high < 0.01 < figures.rate("", "", [False] * 380).high + 1e-5


def test_a_target_that_few_cases_meet_is_not_shown():
    few, many, no = (figures.rate("", "", [False] * n, ("<=", 0.01)) for n in (2, 400, 0))
    assert few.met and not few.shown and few.cells()[-1] == "not shown"
    assert many.met and many.shown and many.cells()[-1] == "yes"
    assert no.cells()[-1] == "" and no.n == 0
    assert figures.rate("", "", [True, False], (">=", 0.8)).cells()[-1] == "**no**"
    median = figures.median("", "", [0.01] * 4 + [0.2], ("<=", 0.05))
    assert median.met and not median.shown


def test_a_few_cases_that_are_alike_show_nothing_of_their_mean():
    """Of one or seven there is no interval; of eight sets of one cause there is."""
    one, seven, eight = (figures.mean("", "", [1] * n, ("<=", 1.8)) for n in (1, 7, 8))
    for few in (one, seven):
        assert few.met and not few.shown and few.low is few.high is None and few.cells()[-1] == "not shown"
    assert eight.shown and (eight.low, eight.high) == (1.0, 1.0)
    error, _ = figures.calibration("", [np.array([[0.97, 1.0]])])
    assert error.met and not error.shown and error.low is None


def test_the_fewer_forecasts_the_larger_the_calibration_error_of_exact_ones():
    few, many = (np.mean(figures.exact_calibration_errors(np.full(n, 0.5))) for n in (25, 2500))
    assert few == pytest.approx(0.5 * np.sqrt(2.0 / np.pi) / 5.0, rel=0.1)  # mean distance of a binomial share
    assert many == pytest.approx(few / 10.0, rel=0.1)


def test_calibration_error():
    random = np.random.default_rng(1)
    said = random.uniform(size=20000)
    honest = np.column_stack([said, random.uniform(size=said.size) < said])
    assert figures.calibration_error(honest) < 0.02
    boastful = np.column_stack([0.5 + 0.5 * said, honest[:, 1]])
    assert figures.calibration_error(boastful) == pytest.approx(0.25, abs=0.02)
    assert sum(row["n"] for row in figures.reliability(honest)) == said.size
    assert figures.calibration_error(np.array([[1.0, 1.0], [0.3, 0.0]])) == pytest.approx(0.15)
