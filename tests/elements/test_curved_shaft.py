"""A curve over a shaft's twist: what it says between and beyond its knots, and a straight one is a stiffer shaft."""

import numpy as np
import pytest
from runs import Bench, ledger, run

from driveline.elements.curved_shaft import KNOTS, SIGNALS, curve_torque
from driveline.plants.assembly import GROUND

J, K = 0.8, 9000.0


def test_between_knots_it_is_straight_and_beyond_its_ends_as_there():
    random = np.random.default_rng(1)
    knots, heights = -0.03 + 0.01 * np.arange(KNOTS), random.standard_normal(KNOTS)
    numbers = np.concatenate([[7.0], [knots[0], 0.01], heights])  # it need not lie at the beginning
    twists = np.concatenate([np.linspace(-0.05, 0.05, 401), knots])
    assert [curve_torque(numbers, 1, x) for x in twists] == pytest.approx(np.interp(twists, knots, heights), abs=1e-12)


def disc(stiffness, heights=None):
    """On a shaft, with a curve over its twist or none; the numbers of the curve are inputs."""
    begin, pitch = -0.03, 0.01

    def build(net):
        a = net.node("a", J, "rad/s", "disc")
        net.shaft("shaft", a, GROUND, stiffness, 0.0)
        if heights is not None:
            net.curve("curve", "shaft", 0.5, net.signal(SIGNALS[0]))

    at = begin + pitch * np.arange(KNOTS)
    return Bench(build, {"a": 2.0}, heights and dict(zip(SIGNALS, [begin, pitch, *heights(at)])))


def test_a_straight_curve_is_a_stiffer_shaft():
    curved, stiffer = run(disc(K, lambda twist: 2.0 * 1500.0 * twist), 0.3), run(disc(K + 1500.0), 0.3)
    assert curved["a_speed"] == pytest.approx(stiffer["a_speed"], abs=1e-9)


def test_what_it_does_is_work_and_the_balance_holds():
    record = run(disc(K, lambda twist: 4e7 * twist**3), 0.3)
    assert np.ptp(record["energy_supplied"]) > 0.05 * record["energy_stored"].max()
    assert np.ptp(ledger(record)) < 1e-6 * record["energy_stored"].max()
