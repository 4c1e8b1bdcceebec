"""Friction in the lock-up clutch's damper: Dahl's curves, what a loop takes, and what it does in a car."""

import numpy as np
import pytest
from runs import Bench, ledger, plant, run

from driveline.elements.damper_friction import DamperFriction

FRICTION = DamperFriction(torque=4.0, twist=2e-3)
TURNING = 1.0  # rad/s, so fast that what is rounded off near rest is a hundredth


def rubbing(speed, torque=0.0, inertia=1e9, stiffness=0.0):
    """One side turns, the other is too heavy to."""
    def build(net):
        one = net.node("one", inertia, "rad/s", "one side")
        other = net.node("other", 1e9, "rad/s", "the other")
        net.rubbing("rubbing", one, other, FRICTION)
        if stiffness:
            net.shaft("spring", one, other, stiffness, 0.0)
        net.source("motor", one, torque, net.signal("on"))

    return Bench(build, {"one": speed, "other": 0.0}, {"on": 1.0})


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_builds_up_over_its_twist_and_then_is_its_torque(side):
    """From rest Dahl's curve is T (1 - exp(-x / u))."""
    record = run(rubbing(side * TURNING), 0.02)
    turned = TURNING * record["time"]
    wanted = side * FRICTION.torque * (1.0 - np.exp(-turned / FRICTION.twist))
    np.testing.assert_allclose(record["rubbing_torque"], wanted, atol=0.015 * FRICTION.torque)
    assert record["rubbing_torque"][-1] == pytest.approx(side * FRICTION.torque, rel=0.015)


@pytest.mark.parametrize("amplitude", [0.02, 0.04])
def test_a_loop_takes_the_same_whatever_its_frequency(amplitude):
    """4 T (A - u): of the way there and back, 4 A, the torque builds up over as much as 2 u at either end."""
    taken = []
    for frequency in (4.0, 8.0):
        turning, inertia = 2.0 * np.pi * frequency, 500.0
        # a heavy flywheel on a spring: friction takes next to nothing of its swing in a period
        record = run(rubbing(amplitude * turning, inertia=inertia, stiffness=inertia * turning**2), 1.25 / frequency)
        ends = (1.25 / frequency, 0.25 / frequency)
        later, sooner = np.interp(ends, record["time"], record["energy_dissipated"])
        taken.append(later - sooner)
        assert np.ptp(ledger(record)) < 1e-6 * record["energy_stored"].max()
    assert taken == pytest.approx([4.0 * FRICTION.torque * (amplitude - FRICTION.twist)] * 2, rel=0.02)


def test_a_car_whose_damper_rubs_swings_less_and_rolls_on_as_before():
    """Friction takes from shuffle as damping does; steadily it does nothing."""
    driven = {"start.vehicle_speed": 15.0, "damper.damping": 0.0}
    made = {torque: plant("plant_fom", {**driven, "damper_friction.torque": torque}, gear=4, engine_torque=40.0)
            for torque in (0.0, 6.0)}
    assert "damper_friction_deflection" not in [entry.name for entry in made[0.0].network.entries]
    records = {torque: run(model, 2.5, engine_torque=120.0) for torque, model in made.items()}
    swings = {torque: np.ptp(record["propeller_shaft_torque"][700:1200])
              for torque, record in records.items()}
    assert swings[6.0] < swings[0.0]
    assert records[6.0]["vehicle_speed"][-1] == pytest.approx(records[0.0]["vehicle_speed"][-1], rel=1e-4)
    for record in records.values():
        assert np.ptp(ledger(record)) < 1e-6 * record["energy_stored"].max()


def test_at_the_start_it_bears_nothing():
    """Which of damper and friction bore what before, nobody knows."""
    model = plant("plant_fom", {"start.vehicle_speed": 15.0, "damper_friction.torque": 6.0}, gear=4,
                  engine_torque=100.0)
    place = [entry.name for entry in model.network.entries].index("damper_friction_deflection")
    assert model.state[place] == 0.0
    record = run(model, 0.5, engine_torque=100.0)
    assert np.ptp(record["propeller_shaft_torque"]) < 1.0
