"""Pieces of Kalman filters: discretisation, stationary gains, and the steps as kernels.

The kernels work on one flat float array: ``x`` is where the state begins, ``p`` the covariance row
by row, ``work`` room for n x n numbers. Measurements are taken one at a time, which for independent
ones gives what eq. 3.24 to 3.26 give, without a matrix inverse, and in a fixed number of operations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.backend import kernel
from ..quantities import InputError


def exponential(matrix: NDArray) -> NDArray:
    """Matrix exponential: Taylor series of the matrix halved until its norm is below a quarter."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300) * 4.0))))
    small = matrix / 2.0**halvings
    result = term = np.eye(len(matrix))
    for order in range(1, 20):
        term = term @ small / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result


def discretise(a: NDArray, b: NDArray, period: float) -> tuple[NDArray, NDArray]:
    """Exact discrete-time pair of x' = a x + b u for inputs held over ``period`` [s]."""
    n, m = b.shape
    joined = np.zeros((n + m, n + m))
    joined[:n, :n], joined[:n, n:] = a, b
    result = exponential(joined * period)
    return result[:n, :n], result[:n, n:]


def evenly(a: NDArray, state: int, period: float) -> NDArray:
    """What all states of x' = A x are after ``period`` [s] in which one of them was moved by 1, evenly."""
    _, moved = discretise(a, np.eye(len(a))[:, [state]], period)
    return moved[:, 0] / period


def stationary_gain(a: NDArray, c: NDArray, q: NDArray, r: NDArray) -> tuple[NDArray, NDArray]:
    """Gain to which the Kalman filter (eq. 3.23 to 3.26) settles, and its innovations' covariance.

    The gain settles also where the covariance does not, because a direction that is never seen
    wanders for ever: so it is with twist and lash angle in contact, of which only the difference
    acts on anything.

    Args:
        a, c: Discrete-time state and output matrices.
        q, r: Covariances of process and measurement noise.

    Raises:
        InputError: The gain does not settle.
    """
    # Structure-preserving doubling: the k-th pass gives the covariance after 2**k steps.
    g, h, f = c.T @ np.linalg.solve(r, c), q.copy(), a.T.copy()
    identity = np.eye(len(a))
    gain = np.zeros((len(a), len(c)))
    for _ in range(40):
        inverse = np.linalg.inv(identity + g @ h)
        h = h + f.T @ h @ inverse @ f
        f, g = f @ inverse @ f, g + f @ inverse @ g @ f.T
        h = 0.5 * (h + h.T)
        spread = c @ h @ c.T + r
        before, gain = gain, np.linalg.solve(spread, c @ h).T
        if not np.isfinite(gain).all():
            break
        # beyond this, rounding in the wandering direction grows faster than the gain still changes
        if np.abs(gain - before).max() <= 1e-8 * np.abs(gain).max():
            return gain, spread
    raise InputError("the Kalman gain does not settle: check the process noise and the model")


@kernel
def predict(work, x, p, a, b, u, q, room, n, m):
    """x = A x + B u and P = A P A' + diag(q) (eq. 3.22, 3.23); all at offsets in ``work``."""
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += work[a + n * i + j] * work[x + j]
        for j in range(m):
            total += work[b + m * i + j] * work[u + j]
        work[room + i] = total
    for i in range(n):
        work[x + i] = work[room + i]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += work[a + n * i + k] * work[p + n * k + j]
            work[room + n * i + j] = total
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += work[room + n * i + k] * work[a + n * j + k]
            if i == j:
                total += work[q + i]
            work[p + n * i + j] = total
            work[p + n * j + i] = total


@kernel
def correct(work, x, p, seen, innovation, r, first, last, room, n):
    """Take one measurement of state ``seen`` (eq. 3.24 to 3.26); returns the innovation's variance.

    Only states ``first`` to ``last - 1`` are corrected. The covariance is updated for the gain that
    is really used (Joseph's form), so it stays symmetric and positive semidefinite.
    """
    s = work[p + n * seen + seen] + r
    for i in range(n):
        work[room + i] = work[p + n * i + seen]
    for i in range(n):
        gain = 0.0
        if first <= i < last:
            gain = work[room + i] / s
        work[room + n + i] = gain
        work[x + i] += gain * innovation
    for i in range(n):
        for j in range(i + 1):
            change = (work[room + n + i] * work[room + n + j] * s - work[room + n + i] * work[room + j]
                      - work[room + i] * work[room + n + j])
            value = work[p + n * i + j] + change
            work[p + n * i + j] = value
            work[p + n * j + i] = value
    return s
