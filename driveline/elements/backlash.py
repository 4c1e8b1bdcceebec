"""Backlash with a compliant shaft: the physical model with the lash angle as a state.

Nordin's model as the thesis prints it (eq. 2.5 to 2.8). With the total twist ``theta_d``, the lash
angle ``theta_b`` in [-alpha, alpha] and the shaft's own twist ``psi = theta_d - theta_b``:

    torque      T = k psi + c psi'
    in the gap  theta_b' = theta_d' + (k / c) psi      (2.7, middle line)

In the gap that makes psi' = -(k/c) psi, hence T = 0 exactly and psi = psi0 exp(-k t / c) exactly:
nothing has to be integrated for it. In contact theta_b stands at +-alpha and psi' = theta_d'. So
the element keeps (theta_d, psi), a contact mode in {-1, 0, 1}, and two switching conditions.
Without damping (c = 0) the shaft springs back at once, psi = 0 in the gap: a plain dead zone.
"""

from __future__ import annotations

from math import exp

from ..kernels.backend import kernel


@kernel
def lash_torque(mode, shaft_twist, rate, stiffness, damping):
    """Torque [N.m]: zero in the gap (mode 0), a shaft's in contact (eq. 2.8)."""
    if mode == 0.0:
        return 0.0
    return stiffness * shaft_twist + damping * rate


@kernel
def lash_relaxation(shaft_twist, time, stiffness, damping):
    """The shaft's own twist [rad] after ``time`` [s] in the gap (eq. 2.7 solved)."""
    if damping <= 0.0:
        return 0.0
    return shaft_twist * exp(-stiffness / damping * time)


@kernel
def lash_guard(mode, twist, shaft_twist, rate, stiffness, damping, half_gap):
    """Positive where the contact mode has ended.

    In contact: the torque [N.m] has reversed. In the gap: the lash angle is at a flank *and*
    still presses outward, so that a flank just left is not met again by rounding. The lash angle's
    rate has the sign of k psi + c psi'; without damping it is the twist's rate itself.
    """
    torque = stiffness * shaft_twist + damping * rate
    if mode > 0.0:
        return -torque
    if mode < 0.0:
        return torque
    outward = torque if damping > 0.0 else rate
    lash = twist - shaft_twist
    if lash >= 0.0:
        return min(lash - half_gap, outward)
    return min(-half_gap - lash, -outward)
