"""A gear that loses another share of the torque on its coast flanks than on its drive flanks.

Hypoid teeth slide differently on either side, so the loss depends on which way power flows. The share
changes where the carried torque is zero, so the loss itself does not jump.
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
