"""The tyre: torsional sidewall, and a contact patch with relaxation length and saturation.

The patch deflects by u [m]: u' = s - |v| u / sigma - |s| u / u_max with the slip speed s and the
transport speed v at the belt. At constant slip the force C u / sigma is then the slip stiffness
C times the slip for small slips and tends to friction times load for large ones; at standstill
it is a spring with dry friction (Dahl's model). One state, no division by speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from ..kernels.backend import kernel
from ..quantities import quantity

# |s| is rounded off below this slip speed [m/s], so that the law stays smooth for the integrator.
SMOOTH_SLIP_SPEED = 1e-2


@dataclass(frozen=True)
class Tyre:
    """One driven tyre."""

    belt_inertia: float = quantity("kg.m2", "inertia of belt and tread of one tyre", minimum=1e-4)
    stiffness: float = quantity("N.m/rad", "torsional stiffness of one sidewall", minimum=1e-3, nominal=1e4)
    damping: float = quantity("N.m.s/rad", "torsional damping of one sidewall", minimum=0.0, nominal=10.0)
    radius: float = quantity("m", "dynamic rolling radius", minimum=0.05, maximum=2.0)
    relaxation_length: float = quantity("m", "longitudinal relaxation length", minimum=1e-3, maximum=100.0)
    slip_stiffness: float = quantity("N", "force over slip at small slip, one tyre", minimum=1.0, nominal=1e5)
    friction_coefficient: float = quantity("1", "peak tyre-road friction", minimum=0.01)
    rolling_resistance: float = quantity("1", "rolling resistance over vehicle weight", minimum=0.0, maximum=0.5)


@kernel
def contact_relaxation_rate(slip_speed, transport_speed, relaxation_length, limit):
    """How fast [1/s] the contact patch forgets its deflection: as it rolls on, and as it slides."""
    slip = sqrt(slip_speed * slip_speed + SMOOTH_SLIP_SPEED * SMOOTH_SLIP_SPEED) - SMOOTH_SLIP_SPEED
    return abs(transport_speed) / relaxation_length + slip / limit


@kernel
def contact_deflection_rate(deflection, slip_speed, transport_speed, relaxation_length, limit):
    """Rate [m/s] of the contact patch's deflection; ``limit`` [m] is the deflection at full sliding."""
    return slip_speed - contact_relaxation_rate(slip_speed, transport_speed, relaxation_length, limit) * deflection
