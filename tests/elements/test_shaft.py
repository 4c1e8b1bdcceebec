"""A shaft between two inertias has an exact solution."""

import numpy as np
import pytest
from runs import Bench, ledger, run


@pytest.mark.parametrize("damping", [0.0, 0.8])
def test_two_inertias_on_a_shaft_swing_as_the_formula_says(damping):
    j1, j2, stiffness, kick = 0.3, 1.1, 700.0, 4.0

    def build(net):
        a = net.node("a", j1, "rad/s", "one end")
        b = net.node("b", j2, "rad/s", "other end")
        net.shaft("shaft", a, b, stiffness, damping)

    record = run(Bench(build, {"a": kick, "b": 0.0}), 1.0)
    reduced = j1 * j2 / (j1 + j2)
    decay = damping / (2.0 * reduced)
    omega = np.sqrt(stiffness / reduced - decay**2)
    t = record["time"]
    twist = kick / omega * np.exp(-decay * t) * np.sin(omega * t)
    rate = kick * np.exp(-decay * t) * (np.cos(omega * t) - decay / omega * np.sin(omega * t))
    assert np.abs(record["shaft_twist"] - twist).max() < 1e-7 * kick / omega
    torque = stiffness * twist + damping * rate
    assert np.abs(record["shaft_torque"] - torque).max() < 1e-6 * np.abs(torque).max()
    assert np.abs(record["a_speed"] * j1 + record["b_speed"] * j2 - j1 * kick).max() < 1e-12
    assert np.ptp(ledger(record)) < 1e-8 * 0.5 * j1 * kick**2


def test_ratios_on_both_sides_refer_inertia_and_torque():
    """Rate 3 w_a + 2 w_b (a ratio may be negative): torque acts as -3 T on a and -2 T on b."""
    j_a, j_b, stiffness = 0.2, 0.5, 300.0

    def build(net):
        a = net.node("a", j_a, "rad/s", "one end")
        b = net.node("b", j_b, "rad/s", "other end")
        net.shaft("shaft", a, b, stiffness, 0.0, ratio_a=3.0, ratio_b=-2.0)

    record = run(Bench(build, {"a": 1.0, "b": 0.0}), 0.5)
    omega = np.sqrt(stiffness * (9.0 / j_a + 4.0 / j_b))
    assert np.abs(record["shaft_twist"] - 3.0 / omega * np.sin(omega * record["time"])).max() < 1e-6
    # J_a w_a / 3 - J_b w_b / 2 is free of the shaft's torque
    assert np.ptp(j_a * record["a_speed"] / 3.0 - j_b * record["b_speed"] / 2.0) < 1e-13
