"""Time stepping of a network between two instants of the clock.

A span is cut into equal sub-steps of classical Runge-Kutta of order four. A lash flank met or left,
a clutch that sticks or slips, a shaft that passes from one stage to another is located inside its
sub-step on the sign of its guard, the mode changes there, and integration goes on from there: order
four holds through contacts.

A tyre that slides makes its contact patch stiff: the faster it slides, the faster the patch forgets its deflection. A
sub-step that is longer than the method bears at that rate is taken in parts; any other is not, and keeps its bits.
"""

from __future__ import annotations

from ..elements.backlash import lash_guard, lash_relaxation
from ..elements.friction import friction_guard
from ..elements.two_stage_stiffness import two_stage_guard
from .backend import kernel
from .laws import fastest_patch, friction_capacity, rates, relative_speed, slipping_capacity
from .layout import (
    BRANCH_COLUMNS, BRANCH_TABLE, CONTINUOUS, INERTIA, LASH, LAW, NODE_A, NODE_B, OK, PARAMETER,
    SIGNAL, SLIDES_TOO_FAST, SLIPPING, SUBSTEP, SWITCHES, SWITCH_TABLE, TOO_MANY_EVENTS, TWIST, TWO_STAGE,
)

BORNE = 2.78  # rate times step up to which Runge-Kutta's method of order four is stable
PART = 1.0  # rate times part of a sub-step: what the patch forgets in it is then right to 1 %
MOST_PARTS = 5000.0  # of a sub-step


@kernel
def integrate(plan, work, y, dy, y2, dy2, spare, span, signal, torque, torque_b, modes, matrix):
    """Advance ``work[y:]`` by ``span`` [s] with constant signals; returns (status, events)."""
    n = plan[CONTINUOUS]
    substep = work[SUBSTEP]
    steps = int(span / substep - 1e-6) + 1
    h_full = span / steps
    events = 0
    limit = 200 + 50 * steps
    rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
    g0 = largest_guard(plan, work, y, signal, torque, modes)
    for _ in range(steps):
        rest = h_full
        while rest > 0.0:
            while g0 > 0.0:
                events += 1
                if events > limit:
                    return TOO_MANY_EVENTS, events
                switch_modes(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
                g0 = largest_guard(plan, work, y, signal, torque, modes)
            done = rest
            stiffness = h_full * fastest_patch(plan, work, y)
            if stiffness > BORNE:
                if stiffness > MOST_PARTS * PART:
                    return SLIDES_TOO_FAST, events
                done = min(rest, h_full / (int(stiffness / PART) + 1))
            try_step(plan, work, y, dy, done, y2, dy2, signal, torque, torque_b, modes, matrix, spare)
            g1 = largest_guard(plan, work, y2, signal, torque, modes)
            if g1 > 0.0:
                done = locate(plan, work, y, dy, 0.0, done, g0, g1, y2, dy2, signal, torque, torque_b,
                              modes, matrix, spare)
                g1 = largest_guard(plan, work, y2, signal, torque, modes)
            g0 = g1  # what guards say at the end of a sub-step they say at the start of the next
            for i in range(n):
                work[y + i] = work[y2 + i]
                work[dy + i] = work[dy2 + i]
            rest -= done
            if rest < 1e-9 * h_full:
                rest = 0.0
    # A mode that ends exactly at the end of the span is switched here, so that what is shown
    # and stored is consistent.
    while g0 > 0.0:
        events += 1
        if events > limit:
            return TOO_MANY_EVENTS, events
        switch_modes(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
        g0 = largest_guard(plan, work, y, signal, torque, modes)
    return OK, events


@kernel
def try_step(plan, work, y, first, h, target, rate, signal, torque, torque_b, modes, matrix, spare):
    """Runge-Kutta of order four over ``h`` [s] from ``work[y:]`` with rates ``work[first:]``.

    The new state goes to ``work[target:]``, its rates to ``work[rate:]``; ``spare`` holds a stage.
    """
    n = plan[CONTINUOUS]
    # target collects the sum; spare is the stage; rate the stage's rates
    for i in range(n):
        work[target + i] = work[y + i] + h / 6.0 * work[first + i]
        work[spare + i] = work[y + i] + 0.5 * h * work[first + i]
    rates(plan, work, spare, rate, signal, torque, torque_b, modes, matrix)
    for i in range(n):
        work[target + i] += h / 3.0 * work[rate + i]
        work[spare + i] = work[y + i] + 0.5 * h * work[rate + i]
    rates(plan, work, spare, rate, signal, torque, torque_b, modes, matrix)
    for i in range(n):
        work[target + i] += h / 3.0 * work[rate + i]
        work[spare + i] = work[y + i] + h * work[rate + i]
    rates(plan, work, spare, rate, signal, torque, torque_b, modes, matrix)
    for i in range(n):
        work[target + i] += h / 6.0 * work[rate + i]
    spring_back(plan, work, y, target, h, modes)
    rates(plan, work, target, rate, signal, torque, torque_b, modes, matrix)


@kernel
def spring_back(plan, work, y, target, h, modes):
    """The shaft of an open lash springs back over ``h`` [s], by its own exact solution."""
    n = plan[CONTINUOUS]
    table = plan[SWITCH_TABLE]
    for i in range(plan[SWITCHES]):
        b = plan[table + i]
        row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
        if plan[row + LAW] == LASH and work[modes + b] == 0.0:
            p = plan[row + PARAMETER]
            x = plan[row + TWIST] + 1
            before = work[y + x]
            after = lash_relaxation(before, h, work[p + 2], work[p + 3])
            work[target + x] = after
            work[target + n - 1] += 0.5 * work[p + 2] * (before * before - after * after)


@kernel
def locate(plan, work, y, first, low, high, g_low, g_high, target, rate, signal, torque, torque_b,
           modes, matrix, spare):
    """The end of the mode inside (low, high] [s]: bracketed, Illinois steps with bisection.

    Leaves state and rates just past the event in ``target`` and ``rate``; returns its time.
    """
    tolerance = 1e-10 * high
    count = 0
    side = 0
    while high - low > tolerance and count < 80:
        h = 0.5 * (low + high)
        if count % 3 != 2 and g_high > g_low:
            h = high - g_high * (high - low) / (g_high - g_low)
            if h <= low or h >= high:
                h = 0.5 * (low + high)
        try_step(plan, work, y, first, h, target, rate, signal, torque, torque_b, modes, matrix, spare)
        g = largest_guard(plan, work, target, signal, torque, modes)
        if g > 0.0:
            high = h
            g_high = g
            if side == 1:
                g_low *= 0.5
            side = 1
        else:
            low = h
            g_low = g
            if side == -1:
                g_high *= 0.5
            side = -1
        count += 1
    try_step(plan, work, y, first, high, target, rate, signal, torque, torque_b, modes, matrix, spare)
    return high


@kernel
def guard(plan, work, y, signal, torque, modes, b):
    """Positive where branch ``b``, one that switches, must leave its mode."""
    row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
    p = plan[row + PARAMETER]
    rate = relative_speed(plan, work, row, y)
    if plan[row + LAW] == LASH:
        x = y + plan[row + TWIST]
        rate += work[p + 5] * work[signal + plan[row + SIGNAL]]
        return lash_guard(work[modes + b], work[x], work[x + 1], rate,
                          work[p + 2], work[p + 3], work[p + 4])
    if plan[row + LAW] == TWO_STAGE:
        return two_stage_guard(work[modes + b], work[y + plan[row + TWIST]], work[p + 5])
    capacity = friction_capacity(plan, work, row, y, signal)
    if plan[row + LAW] == SLIPPING:
        capacity = slipping_capacity(plan, work, row, y, work[modes + b], rate, capacity)
    return friction_guard(work[modes + b], rate, work[torque + b], capacity, capacity * work[p + 3])


@kernel
def largest_guard(plan, work, y, signal, torque, modes):
    """The largest guard of all branches: positive where some mode must change."""
    largest = -1.0
    table = plan[SWITCH_TABLE]
    for i in range(plan[SWITCHES]):
        value = guard(plan, work, y, signal, torque, modes, plan[table + i])
        if value > largest:
            largest = value
    return largest


@kernel
def switch_modes(plan, work, y, dy, signal, torque, torque_b, modes, matrix):
    """Change the mode of every branch whose guard is positive; refresh the rates."""
    table = plan[SWITCH_TABLE]
    for i in range(plan[SWITCHES]):
        b = plan[table + i]
        row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
        if guard(plan, work, y, signal, torque, modes, b) <= 0.0:
            continue
        p = plan[row + PARAMETER]
        mode = work[modes + b]
        if plan[row + LAW] == LASH:
            x = y + plan[row + TWIST]
            if mode != 0.0:
                work[modes + b] = 0.0
            elif work[x] - work[x + 1] > 0.0:
                work[modes + b] = 1.0
                work[x + 1] = work[x] - work[p + 4]
            else:
                work[modes + b] = -1.0
                work[x + 1] = work[x] + work[p + 4]
        elif plan[row + LAW] == TWO_STAGE:
            if mode != 0.0:
                work[modes + b] = 0.0
            elif work[y + plan[row + TWIST]] > 0.0:
                work[modes + b] = 1.0
            else:
                work[modes + b] = -1.0
        elif mode != 0.0:
            # The slip has come to zero: remove what is left of it by the pair of impulses that
            # changes no momentum, then see whether the sticking torque can be carried.
            node_a = plan[row + NODE_A]
            node_b = plan[row + NODE_B]
            inertia = plan[INERTIA]
            slip = work[p] * work[y + node_a]
            mobility = work[p] * work[p] / work[inertia + node_a]
            if node_b >= 0:
                slip -= work[p + 1] * work[y + node_b]
                mobility += work[p + 1] * work[p + 1] / work[inertia + node_b]
            impulse = slip / mobility
            work[y + node_a] -= work[p] * impulse / work[inertia + node_a]
            if node_b >= 0:
                work[y + node_b] += work[p + 1] * impulse / work[inertia + node_b]
            work[modes + b] = 0.0
            rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
            if guard(plan, work, y, signal, torque, modes, b) > 0.0:
                work[modes + b] = -mode
        elif work[torque + b] > 0.0:
            work[modes + b] = 1.0
        else:
            work[modes + b] = -1.0
        rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
