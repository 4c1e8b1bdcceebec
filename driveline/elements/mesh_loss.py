"""Gear and bearing losses of a rotating part: constant, over speed, and over the torque carried."""

from __future__ import annotations

from ..kernels.backend import kernel
from .fade import fade

# The loss turns its sign within about this speed [rad/s].
FADE_SPEED = 1.0


@kernel
def loss_torque(speed, carried_torque, constant, viscous, fraction):
    """Loss torque [N.m] against the rotation at ``speed`` [rad/s]."""
    return (constant + fraction * abs(carried_torque)) * fade(speed / FADE_SPEED) + viscous * speed
