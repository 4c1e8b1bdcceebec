"""The printed and corrected matrices against the plant they stand for, and against one another."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from driveline import vehicles
from driveline.estimators.state_space import (
    BACKLASH,
    CONTACT,
    Lumped,
    observability_matrix,
    positions,
    reduced,
    scaled,
    twists,
)
from driveline.kernels import layout as k
from driveline.plants.full_order import FullOrderParameters
from driveline.plants.reduced import ThreeMassPlant, reduce
from driveline.quantities import InputError, from_values, parameter_variables


@pytest.fixture(scope="module")
def parameters():
    """The 3DOF model without losses and road load, which the matrices do not have."""
    full = from_values(FullOrderParameters, vehicles.load("pickup_10r80", "modified").values)
    three = reduce(full).three_mass
    return replace(
        three, gear=replace(three.gear, loss_constant=0.0, loss_viscous=0.0, loss_fraction=0.0),
        vehicle=replace(three.vehicle, aerodynamic_factor=0.0, rolling_resistance_force=0.0),
        start=replace(three.start, vehicle_speed=12.0))


@pytest.fixture
def plant(parameters):
    plant = ThreeMassPlant({v.name: v.start for v in parameter_variables(parameters)})
    plant["engine_torque"] = 100.0
    plant.initialize()
    return plant


# What the plant's states are in those of model II: it keeps the shaft's own twist, theta_d - theta_b.
PLANT_STATES = {
    "engine_speed": {"engine_speed": 1.0}, "final_drive_speed": {"final_drive_speed": 1.0},
    "wheel_speed": {"wheel_speed": 1.0}, "shaft_twist": {"shaft_twist": 1.0},
    "shaft_shaft_twist": {"shaft_twist": 1.0, "lash_angle": -1.0},
    "wheel_shaft_twist": {"wheel_shaft_twist": 1.0},
}


def transformation(names, states):
    return np.array([[PLANT_STATES[name].get(state, 0.0) for state in states] for name in names])


def test_contact_mode_is_the_plants_linearisation(plant, parameters):
    model = twists(Lumped.of(parameters), CONTACT)
    jacobian, names = plant.state_matrix()
    T = transformation(names, model.states)
    difference = jacobian @ T - T @ model.A
    assert np.abs(difference).max() < 1e-6 * np.abs(model.A).max()


def test_backlash_mode_is_the_plants_linearisation(plant, parameters):
    lumped = Lumped.of(parameters)
    model = twists(lumped, BACKLASH)
    plant.state[plant.network.modes][plant.network.branches["shaft"]] = 0.0
    jacobian, names = plant.state_matrix()
    T = transformation(names, model.states)
    own = names.index("shaft_shaft_twist")  # in the gap the kernel solves its decay, it has no rate there
    jacobian[own, own] = -lumped.k_s / lumped.c_s
    difference = jacobian @ T - T @ model.A
    assert np.abs(difference).max() < 1e-6 * np.abs(model.A).max()


def test_inputs_act_as_in_the_plant(plant, parameters):
    model = twists(Lumped.of(parameters), CONTACT)

    def rates(torque, grade):
        plant["engine_torque"], plant["road_grade"] = torque, grade
        found = plant.rates()[0]
        return np.array([found[plant.network.nodes[node]] for node in ("engine", "wheel")])

    rows = [model.states.index("engine_speed"), model.states.index("wheel_speed")]
    np.testing.assert_allclose(rates(101.0, 0.0) - rates(100.0, 0.0), model.B[rows, 0], atol=1e-9)
    uphill = np.arcsin(100.0 / plant.parameters.vehicle.weight)  # 100 N against the motion
    per_newton = (rates(100.0, uphill) - rates(100.0, 0.0)) / 100.0
    np.testing.assert_allclose(per_newton, model.B[rows, 1], atol=1e-9)
    assert model.B[rows[1], 1] < 0.0  # the printed sign is the other


@pytest.mark.parametrize("mode", [CONTACT, BACKLASH])
def test_model_two_is_model_one_without_the_angles(parameters, mode):
    p = Lumped.of(parameters)
    one, two = positions(p, mode), twists(p, mode)
    P = np.zeros((len(two.states), len(one.states)))
    for state in set(one.states) & set(two.states):
        P[two.states.index(state), one.states.index(state)] = 1.0
    P[two.states.index("shaft_twist"), one.states.index("engine_angle")] = 1.0 / p.i_tr
    P[two.states.index("shaft_twist"), one.states.index("final_drive_angle")] = -p.i_fdr
    P[two.states.index("wheel_shaft_twist"), one.states.index("final_drive_angle")] = 1.0
    P[two.states.index("wheel_shaft_twist"), one.states.index("wheel_angle")] = -1.0
    np.testing.assert_allclose(P @ one.A, two.A @ P, rtol=1e-12)
    np.testing.assert_allclose(P @ one.B, two.B, rtol=1e-12)
    np.testing.assert_allclose(two.C @ P, one.C)


def test_reduced_model_is_a_part_that_nothing_else_feeds(parameters):
    full, part = twists(Lumped.of(parameters), BACKLASH), reduced(Lumped.of(parameters))
    rows = [full.states.index(state) for state in part.states]
    others = [i for i in range(len(full.states)) if i not in rows]
    assert not full.A[np.ix_(rows, others)].any()
    np.testing.assert_array_equal(part.A, full.A[np.ix_(rows, rows)])


def test_fractions_give_the_same_matrices_exactly(parameters):
    exact, floats = (twists(Lumped.of(parameters, number), CONTACT) for number in (Fraction, float))
    assert exact.A.dtype == object and isinstance(exact.A[1, 0], Fraction)
    np.testing.assert_allclose(exact.A.astype(float), floats.A, rtol=1e-14)
    assert exact.A[1, 0] + exact.A[1, 5] == 0


def test_scaling_changes_units_but_not_the_dynamics(parameters):
    model = twists(Lumped.of(parameters), CONTACT)
    rate = 37.0
    small = scaled(model, rate)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(small.A) * rate),
                               np.sort_complex(np.linalg.eigvals(model.A)), rtol=1e-8, atol=1e-6)


def test_observability_matrix_stacks_powers():
    A, C = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[5.0, 6.0]])
    np.testing.assert_array_equal(observability_matrix(A, C), [[5.0, 6.0], [23.0, 34.0]])


def test_what_cannot_be_is_said(parameters):
    with pytest.raises(InputError, match="'open'.*'contact' or 'backlash'"):
        twists(Lumped.of(parameters), "open")
    with pytest.raises(InputError, match="shaft.damping is 0"):
        Lumped.of(replace(parameters, shaft=replace(parameters.shaft, damping=0.0)))


def test_the_plants_lash_branch_is_where_it_is_looked_for(plant):
    row = plant.network.branches["shaft"]
    laws = plant._branch_rows()[:, k.LAW]
    assert laws[row] == k.LASH
