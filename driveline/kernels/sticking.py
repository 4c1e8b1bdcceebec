"""Dry friction that sticks: the torques that keep all that stick together at rest, as one small system."""

from __future__ import annotations

from .backend import kernel
from .layout import (
    BRANCH_COLUMNS, BRANCH_TABLE, INERTIA, MOST_STUCK, NODE_A, NODE_B, NONE_STUCK, PARAMETER,
)


@kernel
def forget_factors(work, matrix):
    """Nothing is factored, or for inertias that hold no more."""
    work[matrix + MOST_STUCK * (MOST_STUCK + 2)] = NONE_STUCK


@kernel
def stick(plan, work, dy, torque, torque_b, matrix, stuck):
    """Torques that keep every sticking branch at zero slip acceleration.

    With G the rows (ratio_a, -ratio_b) of the sticking branches and J the inertias, the torques
    solve (G J^-1 G^T) T = G a, where a are the accelerations without them.
    """
    table = plan[BRANCH_TABLE]
    inertia = plan[INERTIA]
    system = matrix + MOST_STUCK
    right = system + MOST_STUCK * MOST_STUCK
    if not are_factored(work, matrix, stuck):
        factor_stuck(plan, work, matrix, stuck)
    for i in range(stuck):
        row = table + int(work[matrix + i]) * BRANCH_COLUMNS
        node_b = plan[row + NODE_B]
        acceleration = work[plan[row + PARAMETER]] * work[dy + plan[row + NODE_A]]
        if node_b >= 0:
            acceleration -= work[plan[row + PARAMETER] + 1] * work[dy + node_b]
        work[right + i] = acceleration
    for i in range(stuck):
        for j in range(i + 1, stuck):
            work[right + j] -= work[system + j * MOST_STUCK + i] * work[right + i]
    for m in range(stuck):
        i = stuck - 1 - m
        for k in range(i + 1, stuck):
            work[right + i] -= work[system + i * MOST_STUCK + k] * work[right + k]
        work[right + i] /= work[system + i * MOST_STUCK + i]
    for i in range(stuck):
        b = int(work[matrix + i])
        row = table + b * BRANCH_COLUMNS
        node_a = plan[row + NODE_A]
        node_b = plan[row + NODE_B]
        t = work[right + i]
        work[torque + b] += t
        work[torque_b + b] += t
        work[dy + node_a] -= work[plan[row + PARAMETER]] * t / work[inertia + node_a]
        if node_b >= 0:
            work[dy + node_b] += work[plan[row + PARAMETER] + 1] * t / work[inertia + node_b]


@kernel
def are_factored(work, matrix, stuck):
    """Whether the branches that stick are those whose equations were factored last."""
    factored = matrix + MOST_STUCK * (MOST_STUCK + 2)
    for i in range(stuck):
        if work[factored + i] != work[matrix + i]:
            return False
    return stuck == MOST_STUCK or work[factored + stuck] == NONE_STUCK


@kernel
def factor_stuck(plan, work, matrix, stuck):
    """Equations for the torques of the sticking branches, as upper triangle and factors below it.

    Gauss elimination with pivots on the diagonal: the matrix is symmetric and positive definite, as no two
    sticking branches close a loop. It stays the same until others stick or inertias change.
    """
    table = plan[BRANCH_TABLE]
    inertia = plan[INERTIA]
    system = matrix + MOST_STUCK
    factored = matrix + MOST_STUCK * (MOST_STUCK + 2)
    for i in range(stuck):
        row = table + int(work[matrix + i]) * BRANCH_COLUMNS
        node_a = plan[row + NODE_A]
        node_b = plan[row + NODE_B]
        ratio_a = work[plan[row + PARAMETER]]
        ratio_b = work[plan[row + PARAMETER] + 1]
        for j in range(stuck):
            other = table + int(work[matrix + j]) * BRANCH_COLUMNS
            other_a = plan[other + NODE_A]
            other_b = plan[other + NODE_B]
            entry = 0.0
            if other_a == node_a:
                entry += ratio_a * work[plan[other + PARAMETER]] / work[inertia + node_a]
            if node_b >= 0 and other_a == node_b:
                entry -= ratio_b * work[plan[other + PARAMETER]] / work[inertia + node_b]
            if other_b >= 0:
                if other_b == node_a:
                    entry -= ratio_a * work[plan[other + PARAMETER] + 1] / work[inertia + node_a]
                if other_b == node_b:
                    entry += ratio_b * work[plan[other + PARAMETER] + 1] / work[inertia + node_b]
            work[system + i * MOST_STUCK + j] = entry
    for i in range(stuck):
        pivot = work[system + i * MOST_STUCK + i]
        for j in range(i + 1, stuck):
            factor = work[system + j * MOST_STUCK + i] / pivot
            for k in range(i + 1, stuck):
                work[system + j * MOST_STUCK + k] -= factor * work[system + i * MOST_STUCK + k]
            work[system + j * MOST_STUCK + i] = factor
    for i in range(stuck):
        work[factored + i] = work[matrix + i]
    for i in range(stuck, MOST_STUCK):
        work[factored + i] = NONE_STUCK
