"""Whole steps by what a mode does to small changes: exact where a plant is linear, however fast it swings.

From one contact to the next a plant is nearly linear: shafts, a lash on its flank, what sticks. With derivatives A of
the rates F by the state, kept for each set of modes, a step of h [s] from state y ends at

    y + h phi1(h A) F(y) + h phi2(h A) r,    phi1(z) = (exp(z) - 1) / z,    phi2(z) = (phi1(z) - 1) / z

where r is what the rates changed by in the step before, beyond A times the change of the state: by slip of the tyres,
drag of the air, losses, and because derivatives grow old. That is the exponential multistep method of order two (Cox
and Matthews, Journal of Computational Physics 176 (2002), 430). It asks for the rates twice a step, at either end,
where Runge-Kutta in two sub-steps asks for them nine times; once more where r of this step is another, which then
takes the place of that before.

The firing of the cylinders swings too much in a step to be a part of r: its torque is looked at in five instants, and
what each leaves at the end is summed by Boole's rule.

A step is refused, and left to ``stepping``, where a guard turns positive or r changes by too much; and where the
modes have not been the same for long, as derivatives and the functions of them cost what some 150 steps save.
"""

from __future__ import annotations

from math import exp

from .backend import kernel
from .derivatives import add_product, linearise, slot_places, used_slot
from .layout import (
    BRANCHES, BRANCH_COLUMNS, BRANCH_TABLE, CALM, CONTINUOUS, FAILED, INTEGRALS, INTEGRAL_TABLE, KEPT, LAGS, LAG_TABLE,
    MOST_KEPT, NODE_A, NOT_A_MODE, PARAMETER, PROPAGATION_HEAD, REFERENCE, SLOT_HEAD, SWINGS, USED, moving,
)
from .laws import rates, swinging_torque
from .stepping import largest_guard, spring_back

PATIENCE = 50.0  # steps in the same modes after which derivatives are taken; as many more for each time they failed
MOST_REFUSED = 10.0  # steps in a row that old derivatives may be wrong for
TOLERANCE = 1e-7  # energy [J] of what a change of r does to the state in a step; refused beyond
AS_BEFORE = 1e-10  # the same: r counts as that of the step before


@kernel
def propagate(plan, work, y, dy, y2, dy2, spare, h, signal, torque, torque_b, modes, matrix, kept):
    """Advance ``work[y:]`` by ``h`` [s] with constant signals; False, and nothing moved, where that is refused."""
    n = plan[CONTINUOUS]
    m = moving(plan)
    before = kept + PROPAGATION_HEAD + plan[BRANCHES]  # r of the step before
    if not are_used(plan, work, modes, kept):
        work[kept + CALM] += 1.0
        if work[kept + CALM] < PATIENCE * (1.0 + work[kept + FAILED]):
            return False
    rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
    if largest_guard(plan, work, y, signal, torque, modes) > 0.0:
        return False
    if work[kept + USED] < 0.0:
        work[kept + USED] = float(int(work[kept + KEPT]) % MOST_KEPT)
        work[kept + KEPT] += 1.0
        linearise(plan, work, y, dy, y2, dy2, h, signal, torque, torque_b, modes, matrix, kept)
    slot = used_slot(plan, work, kept)
    _, response, phi1, phi2, _ = slot_places(plan, slot)
    for i in range(n):
        work[y2 + i] = work[y + i]
    add_product(work, y2, phi1, dy, m)
    add_product(work, y2, phi2, before, m)
    swinging = int(work[slot + 2])
    swung = 0.0
    if swinging >= 0:
        swung = work[torque + swinging]
        t = swung
        for s in range(SWINGS):
            if s > 0:
                t = swing_ahead(plan, work, y, dy, signal, swinging, s * h / (SWINGS - 1))
            for i in range(m):
                work[y2 + i] += t * work[response + (s + 1) * m + i]
    lag_table = plan[LAG_TABLE]
    for i in range(plan[LAGS]):
        place = plan[lag_table + 3 * i]
        lag = work[plan[lag_table + 3 * i + 2]]
        if lag > 0.0:
            work[y2 + place] += (1.0 - exp(-h / lag)) * lag * work[dy + place]
    integrals = plan[INTEGRAL_TABLE]
    for i in range(plan[INTEGRALS]):
        speed = plan[integrals + 2 * i + 1]
        work[y2 + plan[integrals + 2 * i]] += 0.5 * h * (work[y + speed] + work[y2 + speed])
    spring_back(plan, work, y, y2, h, modes)
    rates(plan, work, y2, dy2, signal, torque, torque_b, modes, matrix)
    energy = remainder(plan, work, y, dy, y2, dy2, spare, h, swung, torque, slot, before)
    if not energy <= TOLERANCE:  # nor where it is no number
        for i in range(m):
            work[before + i] = 0.0
        work[slot + 1] += 1.0
        if work[slot + 1] >= MOST_REFUSED:
            work[slot + SLOT_HEAD] = NOT_A_MODE
            work[kept + PROPAGATION_HEAD] = NOT_A_MODE
            work[kept + FAILED] += 1.0
        return False
    if energy > AS_BEFORE:
        for i in range(m):
            work[before + i] = work[spare + i] - work[before + i]
        add_product(work, y2, phi2, before, m)
        rates(plan, work, y2, dy2, signal, torque, torque_b, modes, matrix)
        remainder(plan, work, y, dy, y2, dy2, spare, h, swung, torque, slot, before)
    for i in range(m):
        work[before + i] = work[spare + i]
    if largest_guard(plan, work, y2, signal, torque, modes) > 0.0:
        return False
    work[slot + 1] = 0.0
    for i in range(n - 2, n):  # the ledger, beside what springs back
        work[y2 + i] += 0.5 * h * (work[dy + i] + work[dy2 + i])
    for i in range(n):
        work[y + i] = work[y2 + i]
        work[dy + i] = work[dy2 + i]
    return True


@kernel
def remainder(plan, work, y, dy, y2, dy2, r, h, swung, torque, slot, before):
    """What rates changed by over a step, beyond what the derivatives say and what swings does, into ``work[r:]``.

    Returns about the energy [J] of what it does to the state in a step by being another than that of the step before.
    """
    m = moving(plan)
    weights, response, _, _, entries = slot_places(plan, slot)
    swinging = int(work[slot + 2])
    change = 0.0
    if swinging >= 0:
        change = work[torque + swinging] - swung
    for i in range(m):
        work[r + i] = work[dy2 + i] - work[dy + i] - change * work[response + i]
    for k in range(int(work[slot])):
        at = entries + 3 * k
        j = int(work[at + 1])
        work[r + int(work[at])] -= work[at + 2] * (work[y2 + j] - work[y + j])
    energy = 0.0
    for i in range(m):
        change = 0.5 * h * (work[r + i] - work[before + i])
        energy += 0.5 * work[weights + i] * change * change
    return energy


@kernel
def are_used(plan, work, modes, kept):
    """Whether derivatives for these modes are in use, after looking for them if modes have changed."""
    branches = plan[BRANCHES]
    last = kept + PROPAGATION_HEAD
    if not are_same(work, last, modes, branches):
        for b in range(branches):
            work[last + b] = work[modes + b]
        for i in range(moving(plan)):
            work[last + branches + i] = 0.0
        work[kept + CALM] = 0.0
        count = int(work[kept + KEPT])
        if count > MOST_KEPT:
            count = MOST_KEPT
        work[kept + USED] = float(count)
        while work[kept + USED] >= 0.0:
            work[kept + USED] -= 1.0
            if work[kept + USED] >= 0.0 and are_same(work, used_slot(plan, work, kept) + SLOT_HEAD, modes, branches):
                return True
    return work[kept + USED] >= 0.0


@kernel
def swing_ahead(plan, work, y, dy, signal, b, time):
    """Torque [N.m] of branch ``b``, which swings with an angle, a ``time`` [s] ahead of state and rates."""
    row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
    table = plan[INTEGRAL_TABLE]
    angle = work[y + plan[row + REFERENCE]]
    for i in range(plan[INTEGRALS]):
        if plan[table + 2 * i] == plan[row + REFERENCE]:
            turning = plan[table + 2 * i + 1]
            angle += time * (work[y + turning] + 0.5 * time * work[dy + turning])
    p = plan[row + PARAMETER]
    return swinging_torque(work, p, work[p] * work[y + plan[row + NODE_A]], angle, signal)


@kernel
def are_same(work, some, others, count):
    """Whether two sets of numbers are the same."""
    for i in range(count):
        if work[some + i] != work[others + i]:
            return False
    return True
