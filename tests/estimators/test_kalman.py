"""Discretisation, Riccati limit and the two filter steps, each against an independent way."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from driveline.estimators.dskse import Dskse
from driveline.estimators.kalman import correct, discretise, predict, stationary_gain
from driveline.estimators.lumped import measurement_matrix
from driveline.estimators.state_space import BACKLASH, CONTACT, Lumped, twists
from driveline.quantities import InputError
from driveline.vehicles import load

N, M = 6, 2
X, P, A, B, U, Q, ROOM = 0, 6, 42, 78, 90, 92, 98
WORK = ROOM + 2 * N * N


def lumped(gear=5):
    return Lumped.of(Dskse(Dskse.defaults_from(load("pickup_10r80", "modified"), gear)).parameters)


def covariance(rng):
    root = rng.standard_normal((N, N))
    return root @ root.T


@pytest.mark.parametrize("mode", [CONTACT, BACKLASH])
@pytest.mark.parametrize("period", [1e-4, 1e-3, 5e-3, 1e-2, 0.1])
def test_discretisation_is_the_matrix_exponential(mode, period):
    """Inside the lash the model is stiff: its angle follows with c_s / k_s, a fraction of a millisecond."""
    model = twists(lumped(), mode)
    joined = np.zeros((N + M, N + M))
    joined[:N] = np.hstack([model.A, model.B])
    expected = expm(joined * period)
    a, b = discretise(model.A, model.B, period)
    np.testing.assert_allclose(a, expected[:N, :N], rtol=1e-9, atol=1e-10 * np.abs(expected[:N, :N]).max())
    np.testing.assert_allclose(b, expected[:N, N:], rtol=1e-9, atol=1e-10 * np.abs(expected[:N, N:]).max())


def test_discretisation_of_nothing_changes_nothing():
    a, b = discretise(np.zeros((3, 3)), np.eye(3), 0.25)
    np.testing.assert_array_equal(a, np.eye(3))
    np.testing.assert_array_equal(b, 0.25 * np.eye(3))


@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_stationary_gain_is_the_riccati_solution_of_what_can_be_seen(period):
    """In contact only twist less lash angle can be seen: five states, for which the equation has a solution."""
    model = twists(lumped(), CONTACT)
    c, q, r = measurement_matrix(), np.diag([1e-2, 1e3, 5e-3, 4e-3, 1e-1, 1e-3]), np.diag([2e-5, 3e-5])
    a, _ = discretise(model.A, model.B, period)
    gain, spread = stationary_gain(a, c, q, r)
    seen = np.eye(N)[:5]
    seen[0, 5] = -1.0
    back = np.eye(N)[:, :5]
    small_a, small_c = seen @ a @ back, c @ back
    p = solve_discrete_are(small_a.T, small_c.T, seen @ q @ seen.T, r)
    s = small_c @ p @ small_c.T + r
    np.testing.assert_allclose(spread, s, rtol=1e-6)
    np.testing.assert_allclose(seen @ gain, np.linalg.solve(s, small_c @ p).T, rtol=1e-6, atol=1e-10)


def test_a_gain_that_does_not_settle_is_an_input_error():
    """Noise so large that the covariance leaves the finite numbers."""
    with pytest.raises(InputError, match="does not settle"), np.errstate(all="ignore"):
        stationary_gain(np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]]), 1e308 * np.eye(2), np.eye(1))


def test_prediction_is_that_of_the_textbook():
    rng = np.random.default_rng(1)
    a, b, p, q = rng.standard_normal((N, N)), rng.standard_normal((N, M)), covariance(rng), rng.random(N)
    x, u = rng.standard_normal(N), rng.standard_normal(M)
    work = np.concatenate([x, p.ravel(), a.ravel(), b.ravel(), u, q, np.zeros(2 * N * N)])
    predict(work, X, P, A, B, U, Q, ROOM, N, M)
    np.testing.assert_allclose(work[X:X + N], a @ x + b @ u, rtol=1e-12)
    np.testing.assert_allclose(work[P:P + N * N].reshape(N, N), a @ p @ a.T + np.diag(q), rtol=1e-12)


def test_measurements_one_at_a_time_are_the_batch_update():
    rng = np.random.default_rng(2)
    p, x, z, r = covariance(rng), rng.standard_normal(N), rng.standard_normal(M), np.array([0.3, 0.7])
    c = measurement_matrix()
    s = c @ p @ c.T + np.diag(r)
    gain = np.linalg.solve(s, c @ p).T
    work = np.concatenate([x, p.ravel(), np.zeros(WORK)])
    for value, noise, seen in zip(z, r, np.argmax(c, axis=1), strict=True):
        correct(work, X, P, seen, value - work[X + seen], noise, 0, N, ROOM, N)
    np.testing.assert_allclose(work[X:X + N], x + gain @ (z - c @ x), rtol=1e-12)
    np.testing.assert_allclose(work[P:P + N * N].reshape(N, N), (np.eye(N) - gain @ c) @ p, rtol=1e-10,
                               atol=1e-12)


def test_states_that_are_only_predicted_get_the_covariance_of_the_gain_that_is_used():
    rng = np.random.default_rng(3)
    p, x, r = covariance(rng), rng.standard_normal(N), 0.4
    work = np.concatenate([x, p.ravel(), np.zeros(WORK)])
    variance = correct(work, X, P, 1, 0.8, r, 1, 5, ROOM, N)
    gain = np.where((np.arange(N) >= 1) & (np.arange(N) < 5), p[:, 1], 0.0) / (p[1, 1] + r)
    left = np.eye(N) - np.outer(gain, np.eye(N)[1])
    assert variance == p[1, 1] + r
    np.testing.assert_allclose(work[X:X + N], x + 0.8 * gain, rtol=1e-12)
    assert (work[X], work[X + 5]) == (x[0], x[5])
    np.testing.assert_allclose(work[P:P + N * N].reshape(N, N),
                               left @ p @ left.T + r * np.outer(gain, gain), rtol=1e-10, atol=1e-12)


class Counted(float):
    """A float that counts what is done with it."""

    operations = 0

    def _do(self, name, other):
        Counted.operations += 1
        return Counted(getattr(float, name)(self, other))

    def __add__(self, other):
        return self._do("__add__", other)

    def __sub__(self, other):
        return self._do("__sub__", other)

    def __mul__(self, other):
        return self._do("__mul__", other)

    def __truediv__(self, other):
        return self._do("__truediv__", other)

    __radd__, __rmul__ = __add__, __mul__


def test_a_step_takes_the_same_number_of_operations_whatever_the_numbers():
    counts = set()
    for values in (np.zeros(WORK), np.ones(WORK), np.full(WORK, 1e300), np.full(WORK, np.nan),
                   np.random.default_rng(4).standard_normal(WORK)):
        Counted.operations = 0
        work = [Counted(value) for value in values]
        predict(work, X, P, A, B, U, Q, ROOM, N, M)
        predicted = Counted.operations
        correct(work, X, P, 1, Counted(0.1), Counted(1.0), 0, N, ROOM, N)
        counts.add((predicted, Counted.operations - predicted))
    # x: A x + B u; P: A P in full, then half of (A P) A' with its diagonal
    assert {predicted for predicted, _ in counts} == {2 * N * (N + M) + 2 * N**3 + N * N * (N + 1) + N}
    assert len(counts) == 1
