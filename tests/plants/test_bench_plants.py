"""The small plants against exact solutions and hand-written equations of motion."""

import numpy as np
import pytest
from runs import ledger, run

from driveline import vehicles
from driveline.plants.bench import BenchPlant, SingleMassPlant
from driveline.quantities import InputError

CARRIAGE = {"vehicle.mass": 95.0, "guide.friction": 20.0, "guide.damping": 160.0,
            "asymmetric_friction.backward_damping": 75.0, "drive.force_offset": 1.5, "drive.force_gain": 1.1}
MOTOR = {"engine.inertia": 8e-5, "motor_bearing.friction": 0.02, "motor_bearing.damping": 6e-4,
         "propeller_shaft.stiffness": 50.0, "propeller_shaft.damping": 1e-3, "hub.inertia": 3e-5,
         "coulomb_drag.torque": 2e-3, "load_bearing.damping": 1e-5, "engine.torque_gain": 0.9}


def made(kind, values, **start):
    plant = kind({**values, **{name.replace("__", "."): value for name, value in start.items()}})
    plant.initialize()
    return plant


@pytest.mark.parametrize(("speed", "damping"), [(0.3, 160.0), (-0.3, 235.0)])
def test_the_carriage_coasts_to_rest_by_the_exact_solution_one_way_and_the_other(speed, damping):
    """m v' = -F_c - d v: an exponential that aims at -F_c/d, and rest where it crosses zero."""
    values = CARRIAGE | {"drive.force_offset": 0.0}
    record = run(made(SingleMassPlant, values, start__speed=speed), 1.2, force=0.0)
    rest = 20.0 / damping
    exact = np.sign(speed) * np.maximum((abs(speed) + rest) * np.exp(-damping / 95.0 * record["time"]) - rest, 0.0)
    assert record["speed"] == pytest.approx(exact, abs=1e-9)
    assert record["speed"][-1] == 0.0


def test_dry_friction_holds_the_carriage_until_the_force_exceeds_it():
    record = run(made(SingleMassPlant, CARRIAGE), 2.0, force=lambda t: 10.0 * t)
    breaks_away = (20.0 - 1.5) / 1.1 / 10.0
    assert np.abs(record["speed"][record["time"] < breaks_away - 2e-3]).max() < 1e-15
    assert (record["speed"][record["time"] > breaks_away + 3e-3] > 0.0).all()


@pytest.mark.parametrize(("kind", "values", "drive", "size"), [
    (SingleMassPlant, CARRIAGE, "force", 80.0), (BenchPlant, MOTOR, "motor_torque", 0.3)])
def test_energy_is_kept(kind, values, drive, size):
    plant = kind({**values, "solver.maximum_substep": 1e-4})
    plant.initialize()
    record = run(plant, 3.0, **{drive: lambda t: size * np.sin(5.0 * t)})
    assert np.ptp(ledger(record)) < 1e-6 * record["energy_supplied"].max()


def test_motor_and_load_swing_against_each_other_at_the_frequency_of_two_masses():
    values = MOTOR | {name: 0.0 for name in ("motor_bearing.friction", "motor_bearing.damping", "coulomb_drag.torque",
                                             "load_bearing.damping", "propeller_shaft.damping")}
    plant = made(BenchPlant, values, start__motor_speed=10.0)
    matrix, _ = plant.state_matrix()
    frequency = np.abs(np.linalg.eigvals(matrix).imag).max()
    assert frequency == pytest.approx(np.sqrt(50.0 * (1.0 / 8e-5 + 1.0 / 3e-5)), rel=1e-6)


def test_the_inline_torque_is_what_the_load_takes():
    record = run(made(BenchPlant, MOTOR | {"propeller_shaft.damping": 0.02}), 2.0,
                 motor_torque=lambda t: 0.1 + 0.2 * np.sin(3.0 * t))
    later = record["time"] > 0.5
    speed = record["load_speed"][later]
    needs = 3e-5 * np.gradient(speed, 1e-3) + 2e-3 * np.sign(speed) + 1e-5 * speed
    rolling = np.abs(speed) > 5.0  # differences see a reversal late
    rolling[[0, -1]] = False
    assert record["inline_torque"][later][rolling] == pytest.approx(needs[rolling], abs=2e-4)


def test_coasting_is_what_each_mass_would_do_on_its_own():
    speeds = np.array([-40.0, -1e-6, 0.0, 3.0, 250.0])
    plant = made(BenchPlant, MOTOR)
    before = plant.save()
    plant["motor_torque"] = 0.2
    motor, load = plant.coasting(speeds)
    sign = np.array([-1.0, -1.0, 1.0, 1.0, 1.0])
    assert motor == pytest.approx((0.9 * 0.2 - 0.02 * sign - 6e-4 * speeds) / 8e-5)
    assert load == pytest.approx((-2e-3 * sign - 1e-5 * speeds) / 3e-5)
    plant["motor_torque"] = 0.0
    assert plant.save() == before


@pytest.mark.parametrize(("kind", "name"), [(BenchPlant, "dyno_5nm"), (SingleMassPlant, "emps")])
def test_the_shipped_files_describe_their_plant_and_no_other(kind, name):
    other = SingleMassPlant if kind is BenchPlant else BenchPlant
    file = vehicles.load(name)
    kind(kind.defaults_from(file)).initialize()
    with pytest.raises(InputError):
        other(other.defaults_from(file))


@pytest.mark.parametrize(("kind", "values", "wrong"), [
    (BenchPlant, MOTOR, {"propeller_shaft.damping": 0.505}), (BenchPlant, MOTOR, {"engine.inertia": 8e-8}),
    (SingleMassPlant, CARRIAGE, {"guide.damping": 2e6})])
def test_a_substep_that_is_unstable_once_dry_friction_slips_is_refused_while_it_still_sticks(kind, values, wrong):
    with pytest.raises(InputError, match="maximum_substep is 0.0002 s: the fastest motion of this plant"):
        made(kind, values | wrong)


def test_a_motion_that_no_substep_follows_is_refused_in_few_digits():
    with pytest.raises(InputError, match="is followed by no solver.maximum_substep: look for a parameter") as caught:
        made(SingleMassPlant, CARRIAGE | {"guide.damping": 1e200})
    assert len(str(caught.value)) < 200


def test_looking_for_an_unstable_substep_leaves_what_sticks_sticking():
    plant = made(BenchPlant, MOTOR)
    assert (plant.state[plant.network.modes][[plant.network.branches[name] for name in
                                              ("motor_friction", "load_friction")]] == 0.0).all()
