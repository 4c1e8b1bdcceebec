"""What every branch of a network does, by its law: rates of all states from the state, and the energy it stores.

A branch joins node a to node b (or to the ground, -1) over two ratios: its rate is
``ratio_a * speed_a - ratio_b * speed_b``, and a torque T in it acts with ``-ratio_a T`` on a and
``+ratio_b T`` on b. Which law gives T from twist, rate and signals is the branch's first number; the
laws themselves are in ``elements``.
"""

from __future__ import annotations

from ..elements.asymmetric_friction import directional_drag, flank_loss_fraction
from ..elements.backlash import lash_torque
from ..elements.converter import converter_torques
from ..elements.curved_shaft import curve_torque
from ..elements.engine_torque import FADE_SPEED, engine_friction, indicated_target
from ..elements.fade import fade
from ..elements.friction import friction_torque
from ..elements.mesh_loss import loss_torque
from ..elements.road_load import aerodynamic_force
from ..elements.shaft import shaft_torque
from ..elements.slip_control import controlled_capacity, held_rate
from ..elements.torque_ripple import ripple_torque
from ..elements.two_stage_stiffness import two_stage_energy, two_stage_torque
from ..elements.tyre import contact_deflection_rate, contact_relaxation_rate
from .backend import kernel
from .layout import (
    AERO, BRANCHES, BRANCH_COLUMNS, BRANCH_TABLE, CONTACT, CONTACTS, CONTACT_TABLE, CONTINUOUS, CONVERTER, COS_GRADE,
    CURVE, DELAYED, ENGINE, FRICTION, INERTIA, INTEGRALS, INTEGRAL_TABLE, LAGS, LAG_TABLE, LASH, LAW,
    LEADING, LOSS, NODES, NODE_A, NODE_B, NOISE, PARAMETER, REFERENCE, RIPPLE, RUBBING, RUNS, SHAFT, SIGNAL,
    SLIPPING, SOURCE, TWIST, TWO_STAGE,
)
from .sticking import stick


@kernel
def rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix):
    """Rates of all continuous states at ``work[y:]`` into ``work[dy:]``; torques beside them."""
    nodes = plan[NODES]
    branches = plan[BRANCHES]
    continuous = plan[CONTINUOUS]
    table = plan[BRANCH_TABLE]
    inertia = plan[INERTIA]
    supplied = 0.0
    dissipated = 0.0
    stuck = 0
    for i in range(continuous):
        work[dy + i] = 0.0
    for b in range(branches):
        row = table + b * BRANCH_COLUMNS
        law = plan[row + LAW]
        node_a = plan[row + NODE_A]
        node_b = plan[row + NODE_B]
        p = plan[row + PARAMETER]
        x = y + plan[row + TWIST]
        dx = dy + plan[row + TWIST]
        ratio_a = work[p]
        ratio_b = work[p + 1]
        speed_a = work[y + node_a]
        speed_b = 0.0
        if node_b >= 0:
            speed_b = work[y + node_b]
        rate = ratio_a * speed_a - ratio_b * speed_b
        t = 0.0
        t_b = 0.0
        if law == SHAFT:
            t = shaft_torque(work[x], rate, work[p + 2], work[p + 3])
            t_b = t
            work[dx] = rate
            dissipated += work[p + 3] * rate * rate
        elif law == LASH:
            mode = work[modes + b]
            turned = work[p + 5] * work[signal + plan[row + SIGNAL]]
            rate += turned
            t = lash_torque(mode, work[x + 1], rate, work[p + 2], work[p + 3])
            t_b = t
            work[dx] = rate
            if mode != 0.0:
                work[dx + 1] = rate
                dissipated += work[p + 3] * rate * rate
            supplied += t * turned
        elif law == FRICTION or law == SLIPPING:
            mode = work[modes + b]
            capacity = friction_capacity(plan, work, row, y, signal)
            if law == SLIPPING:
                full = capacity
                capacity = slipping_capacity(plan, work, row, y, mode, rate, full)
                work[dx] = held_rate(mode, rate, work[x], capacity, work[p + 8], work[p + 7], work[p + 9], full)
            t = friction_torque(mode, rate, capacity, directional_drag(rate, work[p + 4], work[p + 6]))
            t_b = t
            dissipated += t * rate
            if mode == 0.0:
                work[matrix + stuck] = b
                stuck += 1
        elif law == CONVERTER:
            t, t_b = converter_torques(work, p + 2, speed_a, speed_b)
            dissipated += t * speed_a - t_b * speed_b
        elif law == CONTACT or law == RUBBING:
            u_rate = contact_deflection_rate(
                work[x], rate, work[p + 5] * speed_a, work[p + 3], work[p + 4])
            t = work[p + 2] * work[x]
            t_b = t
            work[dx] = u_rate
            dissipated += t * (rate - u_rate)
        elif law == LOSS:
            carried = work[torque + plan[row + REFERENCE]]
            t = loss_torque(rate, carried, work[p + 2], work[p + 3],
                            flank_loss_fraction(rate, carried, work[p + 4], work[p + 5]))
            dissipated += t * rate
        elif law == AERO:
            t = aerodynamic_force(rate, work[p + 2])
            dissipated += t * rate
        elif law == ENGINE:
            drive, drag, air_rate = engine_torques(work, p, work[x], rate, signal, plan[row + SIGNAL])
            if work[p + 11] > 0.0:
                work[dx] = air_rate
            t = drag - drive
            supplied += drive * rate
            dissipated += drag * rate
        elif law == SOURCE:
            t = source_torque(plan, work, row, signal)
            supplied -= t * rate
        elif law == TWO_STAGE:
            t = two_stage_torque(
                work[modes + b], work[x], rate, work[p + 2], work[p + 3], work[p + 4], work[p + 5])
            t_b = t
            work[dx] = rate
            dissipated += work[p + 3] * rate * rate
        elif law == RIPPLE:
            t = swinging_torque(work, p, rate, work[y + plan[row + REFERENCE]], signal)
            supplied -= t * rate
        elif law == LEADING:
            t = leading_torque(plan, work, row, rate, signal)
            supplied -= t * rate
        elif law == CURVE:
            t = work[p + 2] * curve_torque(work, signal + plan[row + SIGNAL], work[y + plan[row + REFERENCE]])
            t_b = t
            supplied -= t * rate
        else:  # REACTION
            t = -work[p + 2] * work[torque + plan[row + REFERENCE]]
            supplied -= t * rate
        work[torque + b] = t
        work[torque_b + b] = t_b
        work[dy + node_a] -= ratio_a * t
        if node_b >= 0:
            work[dy + node_b] += ratio_b * t_b
    for i in range(nodes):
        work[dy + i] /= work[inertia + i]
    if stuck > 0:
        stick(plan, work, dy, torque, torque_b, matrix, stuck)
    lag_table = plan[LAG_TABLE]
    for i in range(plan[LAGS]):
        place = plan[lag_table + 3 * i]
        lag = work[plan[lag_table + 3 * i + 2]]
        if lag > 0.0:
            work[dy + place] = (work[signal + plan[lag_table + 3 * i + 1]] - work[y + place]) / lag
    integral_table = plan[INTEGRAL_TABLE]
    for i in range(plan[INTEGRALS]):
        work[dy + plan[integral_table + 2 * i]] = work[y + plan[integral_table + 2 * i + 1]]
    work[dy + continuous - 2] = supplied
    work[dy + continuous - 1] = dissipated


@kernel
def engine_torques(work, p, air, rate, signal, spark):
    """Torque [N.m] that drives an ENGINE branch, torque that drags, and how fast its air torque changes."""
    friction = engine_friction(rate, work[p + 5], work[p + 6])
    target = indicated_target(work[signal + DELAYED], rate, friction, work[p + 8], work[p + 9], work[p + 10])
    air_rate = 0.0
    if work[p + 11] > 0.0:
        air_rate = (target - air) / work[p + 11]
    else:
        air = target
    running = fade(rate / FADE_SPEED)
    drive = work[p + 2] * work[signal + spark] * air + running * (work[p + 3] + work[p + 4] * work[signal + NOISE])
    return drive, friction + work[p + 7] * running, air_rate


@kernel
def source_torque(plan, work, row, signal):
    """Torque [N.m or N] of a SOURCE branch."""
    return -work[plan[row + PARAMETER] + 2] * work[signal + plan[row + SIGNAL]]


@kernel
def leading_torque(plan, work, row, rate, signal):
    """Torque [N.m or N] of a LEADING branch."""
    gain = work[plan[row + PARAMETER] + 2] * work[signal + plan[row + REFERENCE]]
    return gain * (rate - work[signal + plan[row + SIGNAL]])


@kernel
def swinging_torque(work, p, rate, angle, signal):
    """Torque [N.m] at an ``angle`` [rad] of a RIPPLE branch with parameters at ``p``, turning at ``rate`` [rad/s]."""
    return -work[signal + RUNS] * fade(rate / FADE_SPEED) * ripple_torque(
        angle, work[p + 2], work[p + 3], work[p + 4])


@kernel
def friction_capacity(plan, work, row, y, signal):
    """Kinetic torque capacity [N.m or N] of a dry friction branch, if no control makes it less."""
    p = plan[row + PARAMETER]
    capacity = work[p + 2] * work[signal + plan[row + SIGNAL]]
    if plan[row + REFERENCE] >= 0:
        capacity *= work[y + plan[row + REFERENCE]]
    return capacity + work[p + 5] * work[signal + COS_GRADE]


@kernel
def slipping_capacity(plan, work, row, y, mode, slip, full):
    """What the control of a SLIPPING branch makes of its capacity."""
    p = plan[row + PARAMETER]
    return controlled_capacity(mode, slip, work[y + plan[row + TWIST]], work[p + 8], work[p + 7], full)


@kernel
def relative_speed(plan, work, row, y):
    """How fast a branch is twisted by its nodes, each at its ratio; the second may be the ground."""
    p = plan[row + PARAMETER]
    rate = work[p] * work[y + plan[row + NODE_A]]
    if plan[row + NODE_B] >= 0:
        rate -= work[p + 1] * work[y + plan[row + NODE_B]]
    return rate


@kernel
def fastest_patch(plan, work, y):
    """The largest rate [1/s] at which a contact patch forgets its deflection; it grows with the slip."""
    fastest = 0.0
    table = plan[CONTACT_TABLE]
    for i in range(plan[CONTACTS]):
        row = plan[BRANCH_TABLE] + plan[table + i] * BRANCH_COLUMNS
        p = plan[row + PARAMETER]
        rolls = work[p + 5] * work[y + plan[row + NODE_A]]
        fastest = max(fastest, contact_relaxation_rate(
            relative_speed(plan, work, row, y), rolls, work[p + 3], work[p + 4]))
    return fastest


@kernel
def stored_energy(plan, work, y, modes):
    """Kinetic energy of all nodes plus what shafts, lashes and tyre contacts hold [J]."""
    energy = 0.0
    inertia = plan[INERTIA]
    for i in range(plan[NODES]):
        energy += 0.5 * work[inertia + i] * work[y + i] * work[y + i]
    for b in range(plan[BRANCHES]):
        row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
        law = plan[row + LAW]
        x = y + plan[row + TWIST]
        k = work[plan[row + PARAMETER] + 2]
        if law == SHAFT or law == CONTACT or law == RUBBING:
            energy += 0.5 * k * work[x] * work[x]
        elif law == LASH:
            energy += 0.5 * k * work[x + 1] * work[x + 1]
        elif law == TWO_STAGE:
            p = plan[row + PARAMETER]
            energy += two_stage_energy(work[modes + b], work[x], k, work[p + 4], work[p + 5])
    return energy
