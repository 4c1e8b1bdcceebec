"""A shaft with a first stage: softer (or stiffer) up to a certain twist, its own stiffness beyond it.

Loose splines or rubber in series that bottoms. The torque is continuous, its slope is not; the element
keeps its stage as a mode (0: first, -1 or 1: beyond it to either side), so that the change is located in
time like that of a lash.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity


@dataclass(frozen=True)
class FirstStage:
    """The first stage of an axle shaft; none with a ratio of 1 or no twist."""

    stiffness_ratio: float = quantity("1", "stiffness of the first stage over that of the shaft", start=1.0,
                                      minimum=1e-3, maximum=10.0)
    twist: float = quantity("rad", "twist to either side at which the first stage ends, 0 without", start=0.0,
                            minimum=0.0, maximum=1.0)

    @property
    def present(self) -> bool:
        """Whether it changes anything."""
        return self.stiffness_ratio != 1.0 and self.twist > 0.0


@kernel
def two_stage_torque(mode, twist, rate, stiffness, damping, ratio, width):
    """Torque [N.m] of a shaft twisted by ``twist`` [rad] whose first stage ends at ``width`` [rad]."""
    if mode == 0.0:
        return ratio * stiffness * twist + damping * rate
    return stiffness * (twist - mode * width * (1.0 - ratio)) + damping * rate


@kernel
def two_stage_guard(mode, twist, width):
    """Positive where the twist [rad] has left the stage."""
    if mode == 0.0:
        return abs(twist) - width
    return width - mode * twist


@kernel
def two_stage_energy(mode, twist, stiffness, ratio, width):
    """Elastic energy [J]; the same from both stages where they meet."""
    if mode == 0.0:
        return 0.5 * ratio * stiffness * twist * twist
    beyond = twist - mode * width * (1.0 - ratio)
    return 0.5 * stiffness * (beyond * beyond + width * width * ratio * (1.0 - ratio))
