"""Derivatives of the rates in one set of modes, and what they say of a whole step; for ``propagation``.

Kept are, for each of the last sets of modes, the derivatives A themselves, the functions phi1 and phi2 of h A by which
rates and what changes them move the state in a step of h, and what torques do that signals drive, or that swing within
a step. Twists of shafts change as fast as speeds differ, whatever the torques: of A and phi2 the rest is kept, what may
be *bent*.
"""

from __future__ import annotations

from .backend import kernel
from .layout import (
    BENT, BENT_TABLE, BRANCHES, BRANCH_COLUMNS, BRANCH_TABLE, CALM, CONTACT, CONTINUOUS, DRIVERS, DRIVER_TABLE, FAILED,
    FRICTION, INERTIA, KEPT, LAW, MOST_KEPT, NODES, NODE_A, NOT_A_MODE, PARAMETER, PROPAGATION_HEAD, REFUSED,
    RIPPLE, RUBBING, SLIPPING, SLOT_HEAD, SUBSTEP, SWINGING, SWINGS, TWIST, USED, WHOLE, kept_places, moving, slot_size,
)
from .laws import rates
from .sticking import stick

SMALL = 1e-6  # change of a state for a derivative, of what it is, or of 1 rad, rad/s, m ...
PART = 1.0 / 16.0  # of a sub-step of Runge-Kutta, for which the functions are series; doubled to a step from there
TERMS = 7  # of the series of phi2


@kernel
def forget_derivatives(plan, work, kept):
    """None are kept."""
    work[kept + KEPT] = 0.0
    work[kept + USED] = -1.0
    work[kept + CALM] = 0.0
    work[kept + FAILED] = 0.0
    work[kept + WHOLE] = 0.0
    work[kept + PROPAGATION_HEAD] = NOT_A_MODE


@kernel
def used_slot(plan, work, kept):
    """Where the derivatives in use lie, or are to lie: their head, then modes, then ``slot_places``."""
    _, _, _, slots = kept_places(plan, kept)
    return slots + int(work[kept + USED]) * slot_size(plan)


@kernel
def slot_places(plan, slot):
    """What follows the modes: energy of a unit of each state that is bent; rates by each torque that drives; what a
    unit of the one that swings leaves at the end of a step, by instant; phi1, and of phi2 what is bent, by columns; of
    the derivatives the same by rows, each as how many there are, then columns and values."""
    m = moving(plan)
    weights = slot + SLOT_HEAD + plan[BRANCHES]
    driving = weights + plan[BENT]
    response = driving + plan[DRIVERS] * m
    phi1 = response + SWINGS * m
    phi2 = phi1 + m * m
    return weights, driving, response, phi1, phi2, phi2 + plan[BENT] * m


@kernel
def linearise(plan, work, y, dy, y2, dy2, h, signal, torque, torque_b, modes, matrix, kept):
    """Keep derivatives of the rates ``work[dy:]``, and their functions over a step of ``h`` [s], in the slot in use."""
    m = moving(plan)
    branches = plan[BRANCHES]
    slot = used_slot(plan, work, kept)
    weights, driving, response, phi1, phi2, entries = slot_places(plan, slot)
    _, _, _, slots = kept_places(plan, kept)
    scaled = slots + MOST_KEPT * slot_size(plan)
    full = scaled + 3 * m * m  # phi2 with all columns
    for b in range(branches):
        work[slot + SLOT_HEAD + b] = work[modes + b]
    weigh(plan, work, weights)
    drive(plan, work, dy2, torque, torque_b, modes, matrix, driving)
    for i in range(plan[CONTINUOUS]):
        work[y2 + i] = work[y + i]
    for j in range(m):
        change = SMALL * (1.0 + abs(work[y + j]))
        work[y2 + j] += change
        rates(plan, work, y2, dy2, signal, torque, torque_b, modes, matrix)
        work[y2 + j] = work[y + j]
        for i in range(m):
            work[scaled + j * m + i] = (work[dy2 + i] - work[dy + i]) / change
    bent = plan[BENT_TABLE]
    at = entries
    for i in range(plan[BENT]):
        head = at
        work[head] = 0.0
        for j in range(m):
            value = work[scaled + j * m + plan[bent + i]]
            if value != 0.0:
                work[head] += 1.0
                work[at + 1] = float(j)
                work[at + 2] = value
                at += 2
        at += 1
    for i in range(m * m):
        work[scaled + i] *= h
    work[slot + REFUSED] = 0.0
    doublings = 2
    part = 0.25 * h
    while part > PART * work[SUBSTEP]:
        part *= 0.5
        doublings += 1
    exponential(work, scaled, phi1, full, m, doublings)
    for i in range(m * m):
        work[phi1 + i] *= h
    for i in range(plan[BENT]):
        for j in range(m):
            work[phi2 + i * m + j] = h * work[full + plan[bent + i] * m + j]
    work[slot + SWINGING] = -1.0
    for i in range(plan[DRIVERS]):
        row = plan[BRANCH_TABLE] + plan[plan[DRIVER_TABLE] + i] * BRANCH_COLUMNS
        if plan[row + LAW] == RIPPLE and work[plan[row + PARAMETER] + 2] > 0.0:
            work[slot + SWINGING] = float(i)
            respond(work, dy2, h, driving + i * m, response, phi1, scaled, m)
    # torques as they were
    rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)


@kernel
def weigh(plan, work, weights):
    """Twice the energy of a unit of each state that is bent; 0 where it stores none."""
    nodes = plan[NODES]
    for i in range(plan[BENT]):
        work[weights + i] = 0.0
        place = plan[plan[BENT_TABLE] + i]
        if place < nodes:
            work[weights + i] = work[plan[INERTIA] + place]
        for b in range(plan[BRANCHES]):
            row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
            law = plan[row + LAW]
            if (law == CONTACT or law == RUBBING) and plan[row + TWIST] == place:
                work[weights + i] = work[plan[row + PARAMETER] + 2]


@kernel
def drive(plan, work, dy, torque, torque_b, modes, matrix, driving):
    """What a unit of the torque of each branch that drives does to the rates, by way of what sticks."""
    m = moving(plan)
    stuck = 0  # as many as ``rates`` has listed
    for b in range(plan[BRANCHES]):
        law = plan[plan[BRANCH_TABLE] + b * BRANCH_COLUMNS + LAW]
        if (law == FRICTION or law == SLIPPING) and work[modes + b] == 0.0:
            stuck += 1
    for i in range(plan[DRIVERS]):
        row = plan[BRANCH_TABLE] + plan[plan[DRIVER_TABLE] + i] * BRANCH_COLUMNS
        node = plan[row + NODE_A]
        for j in range(m):
            work[dy + j] = 0.0
        work[dy + node] = -work[plan[row + PARAMETER]] / work[plan[INERTIA] + node]
        if stuck > 0:
            stick(plan, work, dy, torque, torque_b, matrix, stuck)
        for j in range(m):
            work[driving + i * m + j] = work[dy + j]


@kernel
def respond(work, spare, h, driving, response, phi1, quarter, m):
    """What a unit of a torque with ``work[driving:]`` leaves at the end of a step of ``h`` [s] by its part at each of
    its instants, for which ``work[quarter:]`` has exp(h A / 4) - 1.

    That of the first instant goes without what ``phi1`` times the rates there has of it already.
    """
    last = response + (SWINGS - 1) * m
    for i in range(m):
        work[last + i] = work[driving + i]
    for s in range(1, SWINGS):
        at = last - s * m
        for i in range(m):
            work[at + i] = work[at + m + i]
        add_product(work, at, quarter, at + m, m, m)
    for s in range(SWINGS):
        weight = h * 7.0 / 90.0
        if s == 1 or s == 3:
            weight = h * 32.0 / 90.0
        elif s == 2:
            weight = h * 12.0 / 90.0
        for i in range(m):
            work[response + s * m + i] *= weight
    for i in range(m):
        work[spare + i] = 0.0
    add_product(work, spare, phi1, driving, m, m)
    for i in range(m):
        work[response + i] -= work[spare + i]


@kernel
def exponential(work, matrix, phi1, phi2, m, doublings):
    """Both functions of a matrix of m columns; of a quarter of it, exp - 1 takes its place, and twice as many numbers
    behind it are overwritten.

    By their series over a small part of it, 1/2! + z/3! + z^2/4! ... for phi2, and from there by what doubling does:
    phi2(2 z) = (2 phi2 + phi1 + e phi2) / 4, phi1(2 z) = phi1 + e phi1 / 2, e(2 z) = 2 e + e e, with e = exp(z) - 1.
    """
    size = m * m
    e = matrix + size
    product = e + size
    coefficient = 1.0
    for i in range(2, TERMS + 2):
        coefficient /= i
    for i in range(size):
        for _ in range(doublings):
            work[matrix + i] *= 0.5
        work[phi2 + i] = 0.0
    for i in range(m):
        work[phi2 + i * m + i] = coefficient
    for k in range(1, TERMS):
        coefficient *= TERMS + 2 - k
        for i in range(size):
            work[product + i] = 0.0
        add_matrices(work, product, matrix, phi2, m)
        for i in range(size):
            work[phi2 + i] = work[product + i]
        for i in range(m):
            work[phi2 + i * m + i] += coefficient
    for i in range(size):
        work[phi1 + i] = 0.0
        work[e + i] = 0.0
    for i in range(m):
        work[phi1 + i * m + i] = 1.0
    add_matrices(work, phi1, matrix, phi2, m)
    add_matrices(work, e, matrix, phi1, m)
    for k in range(doublings):
        for i in range(size):
            if k == doublings - 2:
                work[matrix + i] = work[e + i]
            work[product + i] = 2.0 * work[phi2 + i] + work[phi1 + i]
        add_matrices(work, product, e, phi2, m)
        for i in range(size):
            work[phi2 + i] = 0.25 * work[product + i]
            work[product + i] = 2.0 * work[phi1 + i]
        add_matrices(work, product, e, phi1, m)
        for i in range(size):
            work[phi1 + i] = 0.5 * work[product + i]
            work[product + i] = 2.0 * work[e + i]
        add_matrices(work, product, e, e, m)
        for i in range(size):
            work[e + i] = work[product + i]


@kernel
def add_matrices(work, target, left, right, m):
    """``work[target:]`` += the product of two matrices of m columns."""
    for j in range(m):
        add_product(work, target + j * m, left, right + j * m, m, m)


@kernel
def add_product(work, target, matrix, vector, m, columns):
    """``work[target:]`` += a matrix of m rows times a vector; four columns at once, as the target is read less."""
    j = 0
    while j + 3 < columns:
        a = work[vector + j]
        b = work[vector + j + 1]
        c = work[vector + j + 2]
        d = work[vector + j + 3]
        at = matrix + j * m
        for i in range(m):
            work[target + i] += ((a * work[at + i] + b * work[at + m + i])
                                 + (c * work[at + 2 * m + i] + d * work[at + 3 * m + i]))
        j += 4
    while j < columns:
        a = work[vector + j]
        at = matrix + j * m
        for i in range(m):
            work[target + i] += a * work[at + i]
        j += 1
