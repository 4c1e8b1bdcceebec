"""The vehicle's longitudinal mass and what the road and the air do to it."""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity

GRAVITY = 9.80665  # [m/s2], standard gravity


@dataclass(frozen=True)
class RoadLoad:
    """Mass, aerodynamic drag and how the weight stands on the driven axle."""

    mass: float = quantity("kg", "mass of the whole vehicle as driven", minimum=1.0, nominal=2000.0)
    frontal_area: float = quantity("m2", "frontal area", minimum=0.0)
    drag_coefficient: float = quantity("1", "aerodynamic drag coefficient", minimum=0.0)
    air_density: float = quantity("kg/m3", "air density", minimum=0.0)
    driven_load_fraction: float = quantity("1", "share of the weight on the driven axle", minimum=0.01, maximum=1.0)


@kernel
def aerodynamic_force(speed, factor):
    """Drag [N] at ``speed`` [m/s]; ``factor`` is half density times drag area."""
    return factor * speed * abs(speed)
