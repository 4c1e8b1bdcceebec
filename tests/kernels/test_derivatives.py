"""The exponential's functions, by another way."""

import numpy as np
import pytest
from scipy.linalg import expm

from driveline.kernels.derivatives import exponential


@pytest.mark.parametrize("m", [3, 4, 6, 9])
def test_the_functions_are_those_of_the_exponential(m):
    """Of a matrix whose motions are as fast as a step of Runge-Kutta allows, by an exponential of blocks."""
    random = np.random.default_rng(m)
    a = random.normal(size=(m, m))
    a *= 5.0 / np.abs(np.linalg.eigvals(a)).max()
    a -= np.eye(m) * max(np.linalg.eigvals(a).real.max(), 0.0)
    work = np.zeros(5 * m * m)
    work[:m * m] = a.T.ravel()
    exponential(work, 0, 3 * m * m, 4 * m * m, m, 6)
    phi1, phi2, quarter = (work[at:at + m * m].reshape(m, m).T for at in (3 * m * m, 4 * m * m, 0))
    blocks = np.zeros((3 * m, 3 * m))
    blocks[:m, :m], blocks[:m, m:2 * m], blocks[m:2 * m, 2 * m:] = a, np.eye(m), np.eye(m)
    both = expm(blocks)
    assert phi1 == pytest.approx(both[:m, m:2 * m], abs=1e-10)
    assert phi2 == pytest.approx(both[:m, 2 * m:], abs=1e-10)
    assert quarter == pytest.approx(expm(a / 4.0) - np.eye(m), abs=1e-10)
