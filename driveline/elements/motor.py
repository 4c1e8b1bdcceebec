"""The motor of a bench: a rotor, and an estimate of its torque.

Unlike an engine it drives both ways, from standstill on, and no control unit stands between request and
torque:

    delivered = gain * request(t - delay) + offset
"""

from __future__ import annotations

from dataclasses import dataclass

from ..quantities import quantity


@dataclass(frozen=True)
class Motor:
    """Rotor and air gap of an electric motor; names as those of an engine where the meaning is the same."""

    inertia: float = quantity("kg.m2", "rotor and what turns with it before the inline sensor", minimum=1e-9,
                              nominal=1e-4)
    torque_gain: float = quantity("1", "delivered over estimated torque", start=1.0, minimum=0.0)
    torque_offset: float = quantity("N.m", "error of the estimated torque", start=0.0)
    air_delay: float = quantity("s", "delay of the torque behind its estimate", start=0.0, minimum=0.0, maximum=1.0)


@dataclass(frozen=True)
class LinearDrive:
    """The drive of a carriage: a force proportional to what is asked for."""

    force_gain: float = quantity("1", "delivered over estimated force", start=1.0, minimum=0.0)
    force_offset: float = quantity("N", "error of the estimated force", start=0.0)
    delay: float = quantity("s", "delay of the force behind its estimate", start=0.0, minimum=0.0, maximum=1.0)
