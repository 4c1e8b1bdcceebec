"""A torsional shaft or bushing: spring and damper in parallel (Kelvin-Voigt)."""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity


@dataclass(frozen=True)
class Shaft:
    """A compliant shaft between two nodes; torque = stiffness * twist + damping * twist rate."""

    stiffness: float = quantity("N.m/rad", "torsional stiffness", minimum=1e-3, nominal=1e4)
    damping: float = quantity("N.m.s/rad", "torsional damping", minimum=0.0, nominal=10.0)


@dataclass(frozen=True)
class MassiveShaft(Shaft):
    """A shaft with inertia of its own, lumped at its ends."""

    inertia: float = quantity("kg.m2", "moment of inertia of the shaft", minimum=0.0, nominal=0.01)


@dataclass(frozen=True)
class Bushing:
    """A translational compliance."""

    stiffness: float = quantity("N/m", "stiffness", minimum=1e-3, nominal=1e5)
    damping: float = quantity("N.s/m", "damping", minimum=0.0, nominal=1e3)


@kernel
def shaft_torque(twist, rate, stiffness, damping):
    """Torque [N.m] of a shaft twisted by ``twist`` [rad] and twisting at ``rate`` [rad/s]."""
    return stiffness * twist + damping * rate
