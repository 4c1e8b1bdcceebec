"""Whole steps by what a mode does to small changes: exact where a plant is linear, however fast it swings.

From one contact to the next a plant is nearly linear: shafts, a lash on its flank, what sticks. With derivatives A of
the rates F by the state, kept for each set of modes, a step of h [s] from state y ends at

    y + h phi1(h A) F(y) + h phi2(h A) r,    phi1(z) = (exp(z) - 1) / z,    phi2(z) = (phi1(z) - 1) / z

where r is what the rates changed by in the step before, beyond A times the change of the state: by slip of the tyres,
drag of the air, losses, and because derivatives grow old. That is the exponential multistep method of order two (Cox
and Matthews, Journal of Computational Physics 176 (2002), 430). It asks for the rates once a step, at its end, where
Runge-Kutta in two sub-steps asks for them nine times; once more where r of this step is another, which then takes the
place of that before. Rates at the start are those at the end of the step before, plus what torques that drive by a
signal have changed by since, times what a unit of them does; all are asked for where anything else hears of a change.

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
    BENT, BENT_TABLE, BRANCHES, BRANCH_COLUMNS, BRANCH_TABLE, CALM, CONTINUOUS, DRIVERS, DRIVER_TABLE, ENGINE, FAILED,
    HEARD, HEARD_TABLE, INTEGRALS, INTEGRAL_TABLE, KEPT, LAGS, LAG_TABLE, LAW, LEADING, MOST_KEPT, NODE_A, NOT_A_MODE,
    PARAMETER, PROPAGATION_HEAD, REFERENCE, REFUSED, SIGNAL, SLOT_HEAD, SOURCE, SWINGING, SWINGS, TWIST, USED, WHOLE,
    kept_places, moving,
)
from .laws import engine_torques, leading_torque, rates, source_torque, swinging_torque
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
    bent = plan[BENT]
    _, heard, before, _ = kept_places(plan, kept)  # before: r of the step before
    whole = work[kept + WHOLE] > 0.0
    work[kept + WHOLE] = 0.0
    if not are_used(plan, work, modes, kept):
        work[kept + CALM] += 1.0
        if work[kept + CALM] < PATIENCE * (1.0 + work[kept + FAILED]):
            return False
    if whole and same_heard(plan, work, signal, heard):
        drive_on(plan, work, y, dy, signal, torque, used_slot(plan, work, kept))
    else:
        rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
        if largest_guard(plan, work, y, signal, torque, modes) > 0.0:
            return False
    if work[kept + USED] < 0.0:
        work[kept + USED] = float(int(work[kept + KEPT]) % MOST_KEPT)
        work[kept + KEPT] += 1.0
        linearise(plan, work, y, dy, y2, dy2, h, signal, torque, torque_b, modes, matrix, kept)
    slot = used_slot(plan, work, kept)
    _, _, response, phi1, phi2, _ = slot_places(plan, slot)
    for i in range(n):
        work[y2 + i] = work[y + i]
    add_product(work, y2, phi1, dy, m, m)
    add_product(work, y2, phi2, before, m, bent)
    swinging = int(work[slot + SWINGING])
    swung = 0.0
    if swinging >= 0:
        b = plan[plan[DRIVER_TABLE] + swinging]
        swung = work[torque + b]
        t = swung
        for s in range(SWINGS):
            if s > 0:
                t = swing_ahead(plan, work, y, dy, signal, b, s * h / (SWINGS - 1))
            for i in range(m):
                work[y2 + i] += t * work[response + s * m + i]
    lag_table = plan[LAG_TABLE]
    for i in range(plan[LAGS]):
        place = plan[lag_table + 3 * i]
        lag = work[plan[lag_table + 3 * i + 2]]
        if lag > 0.0 and work[dy + place] != 0.0:
            work[y2 + place] += (1.0 - exp(-h / lag)) * lag * work[dy + place]
    integrals = plan[INTEGRAL_TABLE]
    for i in range(plan[INTEGRALS]):
        speed = plan[integrals + 2 * i + 1]
        work[y2 + plan[integrals + 2 * i]] += 0.5 * h * (work[y + speed] + work[y2 + speed])
    spring_back(plan, work, y, y2, h, modes)
    rates(plan, work, y2, dy2, signal, torque, torque_b, modes, matrix)
    energy = remainder(plan, work, y, dy, y2, dy2, spare, h, swung, torque, slot, before)
    if not energy <= TOLERANCE:  # nor where it is no number
        for i in range(bent):
            work[before + i] = 0.0
        work[slot + REFUSED] += 1.0
        if work[slot + REFUSED] >= MOST_REFUSED:
            work[slot + SLOT_HEAD] = NOT_A_MODE
            work[kept + PROPAGATION_HEAD] = NOT_A_MODE
            work[kept + FAILED] += 1.0
        return False
    if energy > AS_BEFORE:
        for i in range(bent):
            work[before + i] = work[spare + i] - work[before + i]
        add_product(work, y2, phi2, before, m, bent)
        rates(plan, work, y2, dy2, signal, torque, torque_b, modes, matrix)
        remainder(plan, work, y, dy, y2, dy2, spare, h, swung, torque, slot, before)
    for i in range(bent):
        work[before + i] = work[spare + i]
    if largest_guard(plan, work, y2, signal, torque, modes) > 0.0:
        return False
    work[slot + REFUSED] = 0.0
    for i in range(n - 2, n):  # the ledger, beside what springs back
        work[y2 + i] += 0.5 * h * (work[dy + i] + work[dy2 + i])
    for i in range(n):
        work[y + i] = work[y2 + i]
        work[dy + i] = work[dy2 + i]
    for i in range(plan[HEARD]):
        work[heard + i] = work[signal + plan[plan[HEARD_TABLE] + i]]
    work[kept + WHOLE] = 1.0
    return True


@kernel
def same_heard(plan, work, signal, heard):
    """Whether the signals are those of the step before, but for what only drives."""
    table = plan[HEARD_TABLE]
    for i in range(plan[HEARD]):
        if work[heard + i] != work[signal + plan[table + i]]:
            return False
    return True


@kernel
def drive_on(plan, work, y, dy, signal, torque, slot):
    """Bring the rates ``work[dy:]`` of the state ``work[y:]`` from the signals of the step before to those of this."""
    n = plan[CONTINUOUS]
    m = moving(plan)
    _, driving, _, _, _, _ = slot_places(plan, slot)
    for i in range(plan[DRIVERS]):
        b = plan[plan[DRIVER_TABLE] + i]
        row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
        p = plan[row + PARAMETER]
        law = plan[row + LAW]
        rate = work[p] * work[y + plan[row + NODE_A]]
        t = work[torque + b]  # one that swings goes by what turns
        if law == ENGINE:
            x = plan[row + TWIST]
            drive, drag, air_rate = engine_torques(work, p, work[y + x], rate, signal, plan[row + SIGNAL])
            if work[p + 11] > 0.0:
                work[dy + x] = air_rate
            t = drag - drive
        elif law == SOURCE:
            t = source_torque(plan, work, row, signal)
        elif law == LEADING:
            t = leading_torque(plan, work, row, rate, signal)
        change = t - work[torque + b]
        if change != 0.0:
            for j in range(m):
                work[dy + j] += change * work[driving + i * m + j]
            work[dy + n - 2] -= change * rate


@kernel
def remainder(plan, work, y, dy, y2, dy2, r, h, swung, torque, slot, before):
    """What rates changed by over a step, beyond what the derivatives say and what swings does, into ``work[r:]``.

    Returns about the energy [J] of what it does to the state in a step by being another than that of the step before.
    """
    bent = plan[BENT]
    table = plan[BENT_TABLE]
    weights, driving, _, _, _, entries = slot_places(plan, slot)
    swinging = int(work[slot + SWINGING])
    change = 0.0
    if swinging >= 0:
        change = work[torque + plan[plan[DRIVER_TABLE] + swinging]] - swung
        driving += swinging * moving(plan)
    energy = 0.0
    at = entries
    for i in range(bent):
        place = plan[table + i]
        value = work[dy2 + place] - work[dy + place] - change * work[driving + place]
        for _ in range(int(work[at])):
            j = int(work[at + 1])
            value -= work[at + 2] * (work[y2 + j] - work[y + j])
            at += 2
        at += 1
        work[r + i] = value
        moved = 0.5 * h * (value - work[before + i])
        energy += 0.5 * work[weights + i] * moved * moved
    return energy


@kernel
def are_used(plan, work, modes, kept):
    """Whether derivatives for these modes are in use, after looking for them if modes have changed."""
    branches = plan[BRANCHES]
    last, _, before, _ = kept_places(plan, kept)
    if not are_same(work, last, modes, branches):
        for b in range(branches):
            work[last + b] = work[modes + b]
        for i in range(plan[BENT]):
            work[before + i] = 0.0
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
