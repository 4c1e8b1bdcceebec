"""Dry friction on the axle that no vehicle should have: brakes that do not release, bearing preload.

A friction between the differential and the housing with the law of ``friction``: constant against the
rotation, whichever way, and holding at standstill. Without it there is no such element.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..quantities import quantity


@dataclass(frozen=True)
class CoulombDrag:
    """Dry friction at the axle; 0 without."""

    torque: float = quantity("N.m", "dry friction torque at the axle, 0 without", start=0.0, minimum=0.0, nominal=10.0)
