"""Dry friction between two nodes, with true sticking: clutches, brakes, rolling resistance.

While slipping, the torque is the capacity against the slip. While sticking, it is whatever keeps
the slip at zero (a constraint, solved together with every other sticking element), until that
would exceed the static capacity. No regularisation, so nothing creeps or chatters at zero slip.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity

# Reversed slip [rad/s or m/s] that may be rounding: at breakaway, or where the slip only touches
# zero, its sign would otherwise switch the mode to and fro without end.
ROUNDING_SLIP = 1e-11


@dataclass(frozen=True)
class LockupClutch:
    """The torque converter's lock-up clutch, from the impeller to its damper plate."""

    capacity: float = quantity("N.m", "kinetic torque capacity at full command", minimum=0.0, nominal=500.0)
    lag: float = quantity("s", "first-order lag of the capacity behind the command", minimum=0.0)
    static_ratio: float = quantity("1", "static over kinetic capacity", minimum=1.0)
    drag: float = quantity("N.m.s/rad", "viscous drag of the open clutch", minimum=0.0)
    plate_inertia: float = quantity("kg.m2", "inertia of the damper plate", minimum=1e-5, nominal=0.01)


@dataclass(frozen=True)
class Brake:
    """The service brakes at the driven wheels; the input is their total torque."""

    lag: float = quantity("s", "first-order lag of the brake torque behind its input", minimum=0.0)


@kernel
def friction_torque(mode, slip, capacity, drag):
    """Torque [N.m] while slipping (mode -1 or 1); the drag part only while sticking (mode 0)."""
    return mode * capacity + drag * slip


@kernel
def friction_guard(mode, slip, torque, capacity, static_capacity):
    """Positive where the mode has ended: slip reversed, or the sticking torque too large.

    An open clutch follows its slip as well, so that the sign is right when its capacity returns.
    """
    if mode == 0.0:
        return abs(torque) - static_capacity
    return -mode * slip - ROUNDING_SLIP
