"""The firing of the cylinders: an oscillation of the engine's torque with the angle of the crankshaft.

A four-stroke engine of n cylinders fires n/2 times a revolution: its order. The torque request is a mean
over a firing and knows nothing of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sin

from ..kernels.backend import kernel
from ..quantities import quantity


@dataclass(frozen=True)
class TorqueRipple:
    """Oscillation of the crankshaft torque; none with amplitude 0."""

    amplitude: float = quantity("N.m", "amplitude at the firing order, 0 without", start=0.0, minimum=0.0,
                                nominal=50.0)
    order: float = quantity("1", "oscillations in a revolution of the crankshaft", start=3.0, minimum=0.1,
                            maximum=24.0)
    phase: float = quantity("rad", "phase of the sine at the start", start=0.0)


@kernel
def ripple_torque(angle, amplitude, order, phase):
    """Torque [N.m] on the crankshaft at its ``angle`` [rad]."""
    return amplitude * sin(order * angle + phase)
