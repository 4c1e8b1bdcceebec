"""The torsional damper behind the lock-up clutch rubs: its springs on their guides, its plates on one another.

A vehicle file has one viscous number for what it loses, ``damper.damping``. Friction loses the same whatever the
frequency: of a swing with an amplitude A [rad] at the frequency w [rad/s] it takes 4 T A, viscous damping pi c w A^2,
so one number stands for the other at one amplitude only, where T = pi c w A / 4. It turns round as Dahl's model has it
(Solid friction damping of mechanical vibrations, AIAA Journal 14 (1976), 1675): what rubs deflects by u,

    torque = T u / u_max,    u' = s - |s| u / u_max

with the rate s of the damper's twist. That is the law of a tyre's contact patch which does not roll, and is computed
as that.

The twist over which it builds up, a tenth of a degree, is an engineering estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..quantities import quantity


@dataclass(frozen=True)
class DamperFriction:
    """Dry friction in the damper of the lock-up clutch; none without a torque."""

    torque: float = quantity("N.m", "dry friction torque of the lock-up clutch's damper, 0 without", start=0.0,
                             minimum=0.0, maximum=1000.0, nominal=10.0)
    twist: float = quantity("rad", "twist over which that torque builds up", start=2e-3, minimum=1e-5, maximum=1.0,
                            nominal=1e-3)
