"""Air and grade on a vehicle, against their exact solutions."""

import numpy as np
import pytest
from runs import Bench, ledger, run

from driveline.elements.road_load import GRAVITY, aerodynamic_force
from driveline.kernels import layout as k


@pytest.mark.parametrize("speed", [40.0, -40.0])
def test_coasting_against_the_air_alone_is_a_hyperbola(speed):
    mass, factor = 1500.0, 0.45

    def build(net):
        net.aerodynamic("air", net.node("body", mass, "m/s", "vehicle"), factor)

    record = run(Bench(build, {"body": speed}), 30.0, 0.05)
    exact = speed / (1.0 + factor * abs(speed) / mass * record["time"])
    assert record["body_speed"] == pytest.approx(exact, rel=1e-10)
    assert np.ptp(ledger(record)) < 1e-8 * record["energy_stored"][0]


def test_free_fall_towards_terminal_speed():
    """On a slope with air: v = v_t tanh(g sin(beta) t / v_t)."""
    mass, factor, grade = 1500.0, 0.45, 0.12

    def build(net):
        body = net.node("body", mass, "m/s", "vehicle")
        net.aerodynamic("air", body, factor)
        net.source("grade", body, -mass * GRAVITY, k.SIN_GRADE)

    record = run(Bench(build, {"body": 0.0}, {"road_grade": -grade}), 60.0, 0.05)
    pull = GRAVITY * np.sin(grade)
    terminal = np.sqrt(mass * pull / factor)
    exact = terminal * np.tanh(pull * record["time"] / terminal)
    assert record["body_speed"] == pytest.approx(exact, rel=1e-9)
    assert np.ptp(ledger(record)) < 1e-8 * record["energy_supplied"][-1]


def test_drag_opposes_the_motion():
    assert aerodynamic_force(10.0, 0.5) == 50.0 == -aerodynamic_force(-10.0, 0.5)
