"""A shaft with a first stage: continuous, energy kept, order four through the change of stage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import Bench, ledger, plant, run, steps

from driveline.elements.two_stage_stiffness import (
    FirstStage,
    two_stage_energy,
    two_stage_guard,
    two_stage_torque,
)
from driveline.plants.assembly import GROUND

J, K, RATIO, WIDTH = 0.8, 9000.0, 0.3, 0.01


def oscillator(speed, substep=1e-4, damping=0.0):
    def build(net):
        a = net.node("a", J, "rad/s", "disc")
        net.staged_shaft("shaft", a, GROUND, K, damping, FirstStage(RATIO, WIDTH))

    return Bench(build, {"a": speed}, substep=substep)


@given(st.floats(-0.05, 0.05), st.floats(0.01, 5.0), st.floats(1e-3, 0.04))
def test_torque_is_the_slope_of_the_energy_and_both_are_continuous(twist, ratio, width):
    mode = 0.0 if abs(twist) <= width else np.sign(twist)
    h = 1e-7
    slope = (two_stage_energy(mode, twist + h, K, ratio, width)
             - two_stage_energy(mode, twist - h, K, ratio, width)) / (2.0 * h)
    assert slope == pytest.approx(two_stage_torque(mode, twist, 0.0, K, 0.0, ratio, width), abs=1e-2)
    for side in (-1.0, 1.0):
        for law in (two_stage_torque(0.0, side * width, 0.0, K, 0.0, ratio, width)
                    - two_stage_torque(side, side * width, 0.0, K, 0.0, ratio, width),
                    two_stage_energy(0.0, side * width, K, ratio, width)
                    - two_stage_energy(side, side * width, K, ratio, width)):
            assert law == pytest.approx(0.0, abs=1e-9 * K)
    assert not two_stage_guard(mode, twist, width) > 0.0


def exact_period(speed):
    """Of the undamped oscillator: four times a quarter through both stages, each a piece of a sine."""
    soft, hard = np.sqrt(RATIO * K / J), np.sqrt(K / J)
    first = np.arcsin(WIDTH * soft / speed) / soft
    at_kink = np.sqrt(speed**2 - (soft * WIDTH) ** 2)
    # beyond: about the twist -(1 - ratio) width of zero torque, from ratio * width on
    second = np.arctan2(at_kink / hard, RATIO * WIDTH) / hard
    return 4.0 * (first + second)


def test_the_period_of_a_swing_through_both_stages_is_the_exact_one():
    speed = 2.0
    period = exact_period(speed)
    record = run(oscillator(speed), 3.0 * period, dt=period / 64)
    assert record["a_speed"][63::64] == pytest.approx(speed, abs=1e-7)
    assert record["shaft_twist"][63::64] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(ledger(record) - 0.5 * J * speed**2).max() < 1e-7


def test_order_four_through_the_change_of_stage():
    period = exact_period(2.0)
    errors = [abs(run(oscillator(2.0, substep=h), 3.0 * period, dt=period / 4)["shaft_twist"][-1])
              for h in (1e-3, 5e-4)]
    assert errors[0] / errors[1] > 11.0


def test_without_a_first_stage_the_plant_is_the_same_to_the_bit():
    neutral = [{}, {"axle_first_stage.twist": 0.02}, {"axle_first_stage.stiffness_ratio": 0.3}]
    runs = [run(plant("plant_fom", {"start.vehicle_speed": 12.0, **p}, engine_torque=-20.0), 1.0,
                engine_torque=steps((0.0, -20.0), (0.2, 150.0))) for p in neutral]
    for other in runs[1:]:
        assert all((other[name] == runs[0][name]).all() for name in other)


def test_the_whole_plant_starts_at_rest_in_its_stage_and_keeps_its_energy():
    for torque in (5.0, 150.0):
        model = plant("plant_fom", {"start.vehicle_speed": 12.0, "axle_first_stage.twist": 0.01,
                                    "axle_first_stage.stiffness_ratio": 0.3}, engine_torque=torque)
        record = run(model, 0.3)
        # only the drag follows the speed; a wrong stage would ring
        assert np.abs(np.diff(record["vehicle_acceleration"])).max() < 2e-5
        record = run(model, 1.0, engine_torque=steps((0.0, -20.0), (0.2, 150.0)))
        left = ledger(record)
        assert np.ptp(left) < 1e-6 * record["energy_stored"].max()
