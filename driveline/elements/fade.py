"""A smooth sign, for small torques that oppose rotation."""

from __future__ import annotations

from math import tanh

from ..kernels.backend import kernel


@kernel
def fade(x):
    """Hyperbolic tangent; beyond 20 it is 1 to the last bit and not worth computing."""
    if x > 20.0:
        return 1.0
    if x < -20.0:
        return -1.0
    return tanh(x)
