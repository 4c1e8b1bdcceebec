"""What a shaft carries beside what is in proportion to its twist: any curve over that, straight between its knots.

Splines that tilt, rubber that stiffens: a law that nobody has an equation for. Its numbers are signals, so it may be
another in every simulation of one plant; what it does counts as work done on the plant, not as energy stored.
"""

from __future__ import annotations

from ..kernels.backend import kernel

KNOTS = 7
# The signals that give it, in their order: twist at its first knot [rad], twist between knots [rad], and the torque at
# each [N.m].
SIGNALS = ("curve_begin", "curve_pitch", *(f"curve_{i}" for i in range(KNOTS)))


@kernel
def curve_torque(work, curve, twist):
    """Torque [N.m] at a twist [rad] by the curve whose numbers begin at ``work[curve]``; beyond its ends as there."""
    heights = curve + 2
    place = (twist - work[curve]) / work[curve + 1]
    if place <= 0.0:
        return work[heights]
    i = 0
    while i < KNOTS - 1 and place > 1.0:
        place -= 1.0
        i += 1
    if i == KNOTS - 1:
        return work[heights + i]
    return work[heights + i] + place * (work[heights + i + 1] - work[heights + i])
