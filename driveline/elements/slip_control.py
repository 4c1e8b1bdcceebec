"""A lock-up clutch that is not closed: its control holds it at a small slip, so that it passes on no shuffle.

The pressure follows the slip by a proportional and an integral part, so the capacity does:

    C = h + K (|s|/s0 - 1),   dh/dt = K/T (|s|/s0 - 1),   0 <= C <= that of full pressure

with the slip s0 that is wanted, a torque K and a reset time T; h stands still where it is nothing and would be less,
and where the capacity is full and h would be more. In steady driving the slip is s0 whatever the torque, with the sign
of that. A quick change of torque goes into the slip first: shuffle meets a clutch that gives. Where the slip changes
its sign the clutch is dry friction like any other and may stick. With s0 = 0 there is no such control.

The two numbers of the control are found by tuning: one degree of freedom, the engine against the measured turbine
speed and torque, on four stretches of a drive with a 6L80 (171 s together): 2.20 rad/s, 19 N.m, 0.17 s leave 0.77 of
1.37 rad/s, whatever the fit began from.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity

LEAST = 0.25  # rad/s: a smaller slip no speed sensor shows and no control holds


@dataclass(frozen=True)
class SlipControl:
    """The control of a lock-up clutch that slips; none with a target below ``LEAST``."""

    target: float = quantity("rad/s", f"slip that the lock-up clutch is held at; closed below {LEAST:g}", start=0.0,
                             minimum=0.0, maximum=50.0, nominal=1.0)
    torque: float = quantity("N.m", "capacity that is added at once at twice that slip", start=20.0, minimum=1e-3,
                             nominal=10.0)
    reset_time: float = quantity("s", "time in which as much is added again if the slip stays", start=0.2,
                                 minimum=1e-3, nominal=0.1)

    @property
    def present(self) -> bool:
        """Whether it changes anything."""
        return self.target >= LEAST


@kernel
def controlled_capacity(mode, slip, held, target, torque, full):
    """Capacity [N.m] at a slip [rad/s] of the mode's sign; ``full`` is that of full pressure."""
    capacity = held + torque * (mode * slip / target - 1.0)
    if capacity < 0.0:
        return 0.0
    if capacity > full:
        return full
    return capacity


@kernel
def held_rate(mode, slip, held, capacity, target, torque, reset_time, full):
    """Rate [N.m/s] of the part of the capacity that stays."""
    rate = torque / reset_time * (mode * slip / target - 1.0)
    if (rate < 0.0 and held <= 0.0) or (rate > 0.0 and capacity >= full):
        return 0.0
    return rate
