"""The calculations inside the studies, on cases whose answer is known."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from cosim.studies.fom_validation import lag
from cosim.studies.gears import efficiency
from cosim.studies.lumping import Mistake, two_mass
from cosim.studies.manoeuvre import TipIn, shuffle, shuffle_after
from cosim.studies.observability import exact_rank, gramian, in_words, rank_of
from cosim.studies.stand_in import SEAT_NOISE, measure
from driveline import vehicles
from driveline.estimators.state_space import StateSpace
from driveline.plants.full_order import FullOrderParameters
from driveline.plants.reduced import reduce


@pytest.fixture(scope="module")
def vehicle():
    return vehicles.load("pickup_10r80", "modified")


@pytest.fixture(scope="module")
def full(vehicle):
    return vehicle.parameters(FullOrderParameters)


def test_exact_rank_sees_what_rounding_hides():
    third, tiny = Fraction(1, 3), Fraction(1, 10**40)
    assert exact_rank(np.array([[third, 1], [1, 3]], dtype=object))[0] == 1
    assert exact_rank(np.array([[third, 1], [1, 3 + tiny]], dtype=object))[0] == 2


def test_null_directions_are_mapped_to_zero():
    rows = np.array([[Fraction(v) for v in row] for row in ([1, 2, 3, 4], [2, 4, 7, 9], [3, 6, 10, 13])])
    rank, null = exact_rank(rows)
    assert (rank, len(null)) == (2, 2)
    for direction in null:
        assert not any(rows @ np.array(direction))
    assert in_words([[Fraction(1), Fraction(0), Fraction(-1, 2)]], ("a", "b", "c")) == "+1 a -0.5 c"


def test_rank_of_singular_values_drops_rounding_only():
    assert rank_of(np.array([1e6, 1.0, 1e-3, 1e-10])) == 3


def test_gramian_over_a_long_time_solves_the_lyapunov_equation():
    A, C = np.array([[-1.0, 2.0], [-3.0, -0.5]]), np.array([[1.0, 0.5]])
    found = gramian(StateSpace(A, np.zeros((2, 1)), C, ("a", "b")), 40.0, 4000)
    np.testing.assert_allclose(found, solve_continuous_lyapunov(A.T, -C.T @ C), rtol=1e-6)


def test_lag_of_a_shifted_signal_is_its_shift():
    time = np.arange(0.0, 3.0, 1e-3)

    def ringing(delay):
        return np.exp(-2.0 * (time - delay)) * np.cos(2.0 * np.pi * 5.9 * (time - delay))

    fits = [shuffle(time, ringing(delay), 0.5, 2.5) for delay in (0.0, 0.037)]
    assert lag(*fits) == pytest.approx(0.037, abs=1e-6)
    assert lag(*fits[::-1]) == pytest.approx(-0.037, abs=1e-6)


def test_right_lumping_is_the_models_own(full):
    ours, theirs = two_mass(full, Mistake("none")), reduce(full).two_mass
    assert ours.shaft.stiffness == pytest.approx(theirs.shaft.stiffness, rel=1e-6)
    assert ours.shaft.damping == pytest.approx(theirs.shaft.damping, rel=1e-6)
    assert replace(ours, shaft=theirs.shaft) == theirs


def test_half_the_axle_is_softer_and_no_slip_is_less_damped(full):
    right, one, rigid = (two_mass(full, m).shaft for m in (
        Mistake("none"), Mistake("one axle shaft", axle_shafts=1), Mistake("no slip", slip=False)))
    # springs in series: 1/k_one - 1/k_right is the compliance of one axle shaft less that of two
    assert one.stiffness < right.stiffness and rigid.damping < 0.3 * right.damping
    axle = full.axle_shaft.stiffness / full.final_drive.ratio**2
    no_slip_one = two_mass(full, Mistake("both", axle_shafts=1, slip=False)).shaft
    assert 1.0 / no_slip_one.stiffness - 1.0 / rigid.stiffness == pytest.approx(0.5 / axle, rel=0.02)


def test_without_losses_all_power_arrives(full):
    def lossless(table):
        return tuple(0.0 for _ in table)

    t = full.transmission
    free = replace(
        full, final_drive=replace(full.final_drive, loss_constant=0.0, loss_fraction=0.0),
        transmission=replace(
            t, loss_constant=lossless(t.loss_constant), loss_viscous=lossless(t.loss_viscous),
            loss_fraction=lossless(t.loss_fraction)))
    for gear in range(1, 11):
        assert efficiency(free, gear, 150.0) == pytest.approx(1.0, rel=1e-9)
        assert 0.8 < efficiency(full, gear, 150.0) < 1.0


def test_stand_in_swings_where_it_is_told_to(vehicle):
    tip_in = TipIn(stop=3.0)
    soft, stiff = (measure(vehicle, tip_in, frequency) for frequency in (5.7, 5.9))
    assert soft.axle_factor < stiff.axle_factor
    assert soft.frequency == pytest.approx(5.7, abs=0.1)
    seat = soft.result["seat_acceleration"]
    before = seat[soft.result.time < tip_in.start]  # steady coasting: what varies is noise
    assert np.std(before) == pytest.approx(SEAT_NOISE, rel=0.1)


def test_stand_in_is_the_same_every_time(vehicle):
    tip_in = TipIn(stop=2.6)
    first, second = (measure(vehicle, tip_in).result for _ in range(2))
    for name in first.names:
        np.testing.assert_array_equal(first[name], second[name])


def test_shuffle_of_a_run_needs_a_crossed_lash(vehicle):
    stand_in = measure(vehicle, TipIn(stop=3.0)).result
    with pytest.raises(ValueError, match="lash_position|no signal"):
        shuffle_after(stand_in, TipIn())
