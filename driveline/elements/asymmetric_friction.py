"""Friction that depends on the direction: of the power in a gear, of the motion in a guide.

Hypoid teeth slide differently on either side, so the loss depends on which way power flows. The share
changes where the carried torque is zero, so the loss itself does not jump. A guide or a nut that is wiped,
oiled or loaded from one side drags more one way than the other; that changes where the speed is zero, and
there the drag is zero.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity


@dataclass(frozen=True)
class AsymmetricFriction:
    """What the final drive loses on the coast flanks beyond its loss on the drive flanks; 0 without."""

    coast_loss_fraction: float = quantity(
        "1", "loss over carried torque on the coast flanks beyond that on the drive flanks", start=0.0,
        minimum=-0.9, maximum=0.9)


@kernel
def flank_loss_fraction(speed, carried_torque, drive, coast_excess):
    """Loss over carried torque: ``drive``, and ``coast_excess`` more where power flows backward."""
    if speed * carried_torque < 0.0:
        return drive + coast_excess
    return drive


@dataclass(frozen=True)
class DirectionalDrag:
    """What a guide drags moving backward beyond what it drags moving forward; 0 without."""

    backward_damping: float = quantity(
        "N.s/m", "viscous friction moving backward beyond that moving forward", start=0.0)


@kernel
def directional_drag(slip, drag, backward):
    """Viscous coefficient at this slip: ``drag``, and ``backward`` more where it is negative."""
    if slip < 0.0:
        return drag + backward
    return drag
