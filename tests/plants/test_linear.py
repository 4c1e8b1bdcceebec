"""Small vibrations: the matrices give what the plants do in time."""

import numpy as np
import pytest
from runs import PLANTS, plant, run, start_values

from driveline.plants.linear import modes, shuffle_mode


def swinging(name, kick=1e-3):
    """A plant under drive, and the same with its engine a little too fast."""
    model = plant(name, {"start.vehicle_speed": 12.0, "solver.maximum_substep": 1e-4}, engine_torque=150.0)
    still = model.save()
    model.state[0] += kick
    if name == "plant_fom":  # the lock-up clutch sticks: its plate goes with the engine
        model.state[model.network.nodes["damper_plate"]] += kick
    return model, still


@pytest.mark.parametrize("name", PLANTS)
def test_the_shuffle_mode_is_the_vibration_seen_in_time(name):
    """Fit of a damped sine to the difference of a kicked and an undisturbed run, after fast modes died."""
    model, still = swinging(name)
    mode = shuffle_mode(model)
    kicked = run(model, 1.2)
    model.restore(still)
    calm = run(model, 1.2)
    time = kicked["time"]
    signal = (kicked["engine_speed"] - calm["engine_speed"])[time > 0.25]
    # poles by linear prediction: the signal is one damped vibration on a drift (two slow real poles)
    every, order = 10, 4
    x = signal[::every]
    past = np.column_stack([x[order - 1 - j:len(x) - 1 - j] for j in range(order)])
    coefficients = np.linalg.lstsq(past, x[order:], rcond=None)[0]
    poles = np.log(np.roots(np.concatenate([[1.0], -coefficients])).astype(complex)) / (every * 1e-3)
    seen = min((pole for pole in poles if pole.imag > 10.0), key=lambda pole: abs(pole - mode.eigenvalue))
    assert seen.imag / (2.0 * np.pi) == pytest.approx(mode.frequency, rel=5e-3)
    assert seen.real == pytest.approx(mode.eigenvalue.real, rel=0.05)


def test_two_masses_swing_with_the_frequency_of_the_textbook():
    """omega^2 = k_s i_f^2 (1 / (J_1 (i i_f)^2) + 1 / J), damping ratio from c the same way; loads off."""
    quiet = {"gear.loss_constant": 0.0, "gear.loss_viscous": 0.0, "gear.loss_fraction": 0.0,
             "vehicle.rolling_resistance_force": 0.0, "vehicle.aerodynamic_factor": 0.0}
    model = plant("plant_rom_2dof", {**quiet, "start.vehicle_speed": 12.0}, engine_torque=100.0)
    p = model.parameters
    i, f = p.gear.transmission_ratio, p.gear.final_drive_ratio
    engine = p.engine_inertia * (i * f) ** 2
    wheel = p.wheel_inertia + p.vehicle.mass * p.vehicle.tyre_radius**2
    reduced = engine * wheel / (engine + wheel)
    omega = np.sqrt(p.shaft.stiffness * f**2 / reduced)
    decay = p.shaft.damping * f**2 / (2.0 * reduced)
    mode = shuffle_mode(model)
    assert mode.eigenvalue == pytest.approx(complex(-decay, np.sqrt(omega**2 - decay**2)), rel=1e-6)
    assert mode.damping_ratio == pytest.approx(decay / omega, rel=1e-6)
    assert mode.frequency == pytest.approx(np.sqrt(omega**2 - decay**2) / (2.0 * np.pi), rel=1e-6)


def test_three_masses_swing_with_the_modes_of_their_matrices():
    """Undamped: the eigenvalues of the 3DOF plant's mass and stiffness matrices at the wheels."""
    changes = {"shaft.damping": 0.0, "wheel_shaft.damping": 0.0, "gear.loss_viscous": 0.0,
               "gear.loss_fraction": 0.0, "gear.loss_constant": 0.0, "vehicle.aerodynamic_factor": 0.0,
               "start.vehicle_speed": 12.0}
    model = plant("plant_rom_3dof", changes, engine_torque=100.0)
    p = model.parameters
    i, f = p.gear.transmission_ratio, p.gear.final_drive_ratio
    shaft, tyre = p.shaft.stiffness * f**2, p.wheel_shaft.stiffness
    inertia = np.diag([p.engine_inertia * (i * f) ** 2, p.final_drive_inertia,
                       p.wheel_inertia + p.vehicle.mass * p.vehicle.tyre_radius**2])
    stiffness = np.array([[shaft, -shaft, 0.0], [-shaft, shaft + tyre, -tyre], [0.0, -tyre, tyre]])
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(inertia, stiffness)).real)
    expected = np.sqrt(squares[1:]) / (2.0 * np.pi)
    assert [mode.frequency for mode in modes(model)] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("name", PLANTS)
def test_every_vibration_of_a_driven_plant_dies_out(name):
    model, _ = swinging(name)
    found = modes(model)
    assert found == sorted(found, key=lambda mode: mode.frequency)
    for mode in found:
        assert 0.0 < mode.damping_ratio < 1.0
        assert mode.eigenvalue.imag > 0.0 > mode.eigenvalue.real
    matrix, names = model.state_matrix()
    assert matrix.shape == (len(names), len(names))
    assert np.linalg.eigvals(matrix).real.max() < 1e-2  # but for the drift of rolling itself


@pytest.mark.parametrize("variant, frequency", [("modified", 5.88), (None, 7.14)])
def test_the_pickup_shuffles_near_the_frequency_the_thesis_prints(variant, frequency):
    """Table 2.4, in 5th gear; the tip-in itself is evaluated elsewhere, hence 5 percent here."""
    values = start_values("plant_fom", "pickup_10r80", variant, 5)
    assert values["gear"] == 5.0
    model = plant("plant_fom", {"start.vehicle_speed": 12.0}, variant=variant, engine_torque=120.0)
    assert shuffle_mode(model).frequency == pytest.approx(frequency, rel=0.05)


def test_in_the_gap_the_engine_does_not_shuffle():
    model = plant("plant_rom_2dof", {"start.vehicle_speed": 12.0}, engine_torque=-30.0)
    run(model, 0.03, engine_torque=100.0)
    assert model["contact"] == 0.0
    with pytest.raises(ValueError, match="no vibration of the engine"):
        shuffle_mode(model)
