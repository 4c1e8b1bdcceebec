"""One step function for every plant: a network of inertias joined by branches.

A node is an inertia with one speed. A branch joins node a to node b (or to the ground, -1) over
two ratios: its rate is ``ratio_a * speed_a - ratio_b * speed_b``, and a torque T in it acts with
``-ratio_a T`` on a and ``+ratio_b T`` on b. Which law gives T from twist, rate and signals is the
branch's first number. So plants differ in data only, and what is proved for one holds in all.

Time stepping. Within a communication step the inputs are held. The step is cut at every instant
where something in the plant switches by the clock (a delayed input arrives, a noise value ends, a
sensor samples); each piece is cut into equal sub-steps of classical Runge-Kutta of order four. A
lash flank met or left, a clutch that sticks or slips, a shaft that passes from one stage to another
is located inside its sub-step on the sign of its guard, the mode changes there, and integration
goes on from there: order four holds through contacts, and results do not depend on where the
communication steps fall.

Everything is flat: `state` is all that changes in a run (complete to the bit), `plan` the structure
(integers), `constants` the numbers. The code keeps to indexing, arithmetic and while/for/if, the
part of Python that compiles ahead of time; it also runs as it stands.
"""

from __future__ import annotations

from math import cos, sin

from ..elements.asymmetric_friction import directional_drag, flank_loss_fraction
from ..elements.backlash import lash_guard, lash_relaxation, lash_torque
from ..elements.converter import converter_torques
from ..elements.engine_torque import FADE_SPEED, engine_friction, indicated_target
from ..elements.fade import fade
from ..elements.friction import friction_guard, friction_torque
from ..elements.mesh_loss import loss_torque
from ..elements.road_load import aerodynamic_force
from ..elements.shaft import shaft_torque
from ..elements.slip_control import controlled_capacity, held_rate
from ..elements.torque_ripple import ripple_torque
from ..elements.two_stage_stiffness import two_stage_energy, two_stage_guard, two_stage_torque
from ..elements.tyre import contact_deflection_rate
from ..sensors.can_signal import can_signal_tick, standard_normal
from ..sensors.torque_meter import filter_sample
from .backend import F8, I8, entry_point, kernel

# Laws of a branch, and what its parameters are (after ratio_a and ratio_b).
SHAFT = 0      # stiffness, damping
LASH = 1       # stiffness, damping, half_gap, how fast a signal turns one side against the other
FRICTION = 2   # capacity (times a signal and a lag state), static_ratio, drag, base capacity (times cos grade),
               # drag moving backward beyond that moving forward
CONVERTER = 3  # tables
CONTACT = 4    # slip stiffness / relaxation length, relaxation length, deflection limit, radius
LOSS = 5       # constant, viscous, fraction, excess of the fraction on coast; reference branch
AERO = 6       # half density times drag area
ENGINE = 7     # gain, offset, noise, friction 0, 1, accessories, maximum, idle speed, gain, lag
SOURCE = 8     # gain; torque = gain * signal
REACTION = 9   # gain; torque = gain * torque of the reference branch, which does not feel it
TWO_STAGE = 10 # stiffness, damping, ratio of the first stage, its twist
RIPPLE = 11    # amplitude, order, phase; reference: place of the angle
SLIPPING = 12  # as FRICTION, then torque, target and reset time of the control that holds its slip
LEADING = 13   # gain; torque = gain * (rate - signal), as far as the signal of its reference says
DRY = (FRICTION, SLIPPING)  # what may stick

# Columns of a branch in `plan`.
LAW, NODE_A, NODE_B, TWIST, PARAMETER, SIGNAL, REFERENCE, MODE = range(8)
BRANCH_COLUMNS = 8

# Header of `plan`: counts, then where each table starts in `plan`, `constants`, `state` or `work`.
(NODES, BRANCHES, CONTINUOUS, LAGS, INTEGRALS, TERMS, OUTPUTS, GEAR_ROWS, INPUTS, CHANNELS,
 SECTIONS, ACTIVE_SIZE, GEARS,
 BRANCH_TABLE, LAG_TABLE, INTEGRAL_TABLE, TERM_TABLE, GEAR_TABLE, CHANNEL_TABLE,
 INERTIA, GEAR_VALUES, CHANNEL_VALUES, SECTION_VALUES,
 STATE_MODES, STATE_CLOCK, STATE_QUEUE, STATE_SECTIONS, STATE_CHANNELS,
 GEAR_INPUT, DELAYED_INPUT, GRADE_INPUT, FILTERED_OUTPUT, SHIFT_LAG, GEARSET_NODE, GEARSET_BRANCH,
 FILTER_TARGET, SEED, SWITCHES, SWITCH_TABLE,
 ) = range(39)
HEADER = 39

# Columns of a CAN channel in `plan`: the output it samples, the output it shows, its place in
# `state`, its parameters and its jitter table in `constants`.
CHANNEL_COLUMNS = 5

# Single constants, at the start of `constants` (and of the active copy).
DELAY, SUBSTEP, NOISE_PERIOD, TICK, METER_GAIN, METER_OFFSET, METER_ON = range(7)
CONSTANTS_HEAD = 8

# Signals known in every plant; the inputs follow.
ONE, COS_GRADE, SIN_GRADE, DELAYED, NOISE, IN_GEAR, RUNS = range(7)
SIGNALS_HEAD = 7

# Clock part of the state.
GEAR, QUEUE_FIRST, QUEUE_COUNT, METER_HELD, EVENTS = range(5)
CLOCK_SIZE = 5
QUEUE_SIZE = 1024

# What a term of an output reads.
(SPEED, TORQUE, LASH_ANGLE, CONTACT_MODE, ACCELERATION, LEVEL, STORED) = range(7)

# Branches that may stick at the same time.
MOST_STUCK = 8
NONE_STUCK = -1.0  # in place of a branch's number

OK, NOT_FINITE, TOO_MANY_EVENTS, QUEUE_FULL = range(4)

NONE_DRAWN = 1 << 62  # in place of a noise value's number
TIME_TOLERANCE = 1e-9  # [s]; clock instants closer than this are the same


@kernel
def work_size(nodes, branches, continuous, signals, active, outputs):
    """Length of `work` for a network of these counts."""
    return (active + signals + 6 * continuous + 4 * branches + 2 * nodes + outputs
            + MOST_STUCK * (MOST_STUCK + 3) + 16)


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
        elif law == CONTACT:
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
            friction = engine_friction(rate, work[p + 5], work[p + 6])
            target = indicated_target(
                work[signal + DELAYED], rate, friction, work[p + 8], work[p + 9], work[p + 10])
            air = target
            if work[p + 11] > 0.0:
                air = work[x]
                work[dx] = (target - air) / work[p + 11]
            running = fade(rate / FADE_SPEED)
            drive = (work[p + 2] * work[signal + plan[row + SIGNAL]] * air
                     + running * (work[p + 3] + work[p + 4] * work[signal + NOISE]))
            drag = friction + work[p + 7] * running
            t = drag - drive
            supplied += drive * rate
            dissipated += drag * rate
        elif law == SOURCE:
            t = -work[p + 2] * work[signal + plan[row + SIGNAL]]
            supplied -= t * rate
        elif law == TWO_STAGE:
            t = two_stage_torque(
                work[modes + b], work[x], rate, work[p + 2], work[p + 3], work[p + 4], work[p + 5])
            t_b = t
            work[dx] = rate
            dissipated += work[p + 3] * rate * rate
        elif law == RIPPLE:
            t = -work[signal + RUNS] * fade(rate / FADE_SPEED) * ripple_torque(
                work[y + plan[row + REFERENCE]], work[p + 2], work[p + 3], work[p + 4])
            supplied -= t * rate
        elif law == LEADING:
            t = work[p + 2] * work[signal + plan[row + REFERENCE]] * (rate - work[signal + plan[row + SIGNAL]])
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
def guard(plan, work, y, signal, torque, modes, b):
    """Positive where branch ``b``, one that switches, must leave its mode."""
    row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
    p = plan[row + PARAMETER]
    rate = work[p] * work[y + plan[row + NODE_A]]
    if plan[row + NODE_B] >= 0:
        rate -= work[p + 1] * work[y + plan[row + NODE_B]]
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
    # The shaft of an open lash springs back by its own exact solution.
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
    rates(plan, work, target, rate, signal, torque, torque_b, modes, matrix)


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
            try_step(plan, work, y, dy, rest, y2, dy2, signal, torque, torque_b, modes, matrix, spare)
            g1 = largest_guard(plan, work, y2, signal, torque, modes)
            done = rest
            if g1 > 0.0:
                done = locate(plan, work, y, dy, 0.0, rest, g0, g1, y2, dy2, signal, torque, torque_b,
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
        if law == SHAFT or law == CONTACT:
            energy += 0.5 * k * work[x] * work[x]
        elif law == LASH:
            energy += 0.5 * k * work[x + 1] * work[x + 1]
        elif law == TWO_STAGE:
            p = plan[row + PARAMETER]
            energy += two_stage_energy(work[modes + b], work[x], k, work[p + 4], work[p + 5])
    return energy


@kernel
def observe(plan, work, y, dy, torque, modes, observed):
    """Every output that is a linear combination of speeds, torques, angles ... into ``observed``."""
    for i in range(plan[OUTPUTS]):
        work[observed + i] = 0.0
    table = plan[TERM_TABLE]
    for i in range(plan[TERMS]):
        row = table + 4 * i
        kind = plan[row + 1]
        what = plan[row + 2]
        value = 0.0
        if kind == SPEED or kind == LEVEL:
            value = work[y + what]
        elif kind == TORQUE:
            value = work[torque + what]
        elif kind == ACCELERATION:
            value = work[dy + what]
        elif kind == CONTACT_MODE:
            value = work[modes + what]
        elif kind == STORED:
            value = stored_energy(plan, work, y, modes)
        else:  # LASH_ANGLE
            x = y + plan[plan[BRANCH_TABLE] + what * BRANCH_COLUMNS + TWIST]
            value = work[x] - work[x + 1]
        work[observed + plan[row]] += work[plan[row + 3]] * value


@kernel
def apply_gear(plan, work, constants, gear):
    """Put the gear's column of every gear-dependent number into the active copy."""
    table = plan[GEAR_TABLE]
    for i in range(plan[GEAR_ROWS]):
        work[plan[table + i]] = constants[plan[GEAR_VALUES] + i * plan[GEARS] + gear + 1]


@kernel
def shift(plan, state, work, constants, y, modes, gear):
    """Engage ``gear`` [-1, 0, 1 ...]: the gear set turns with its output at once, its shift
    element starts open and slips until the input has followed."""
    node = plan[GEARSET_NODE]
    branch = plan[BRANCH_TABLE] + plan[GEARSET_BRANCH] * BRANCH_COLUMNS
    inertia = plan[INERTIA]
    before = 0.5 * work[inertia + node] * work[y + node] * work[y + node]
    apply_gear(plan, work, constants, gear)
    ratio = work[plan[branch + PARAMETER] + 1]
    work[y + node] = ratio * work[y + plan[branch + NODE_B]]
    after = 0.5 * work[inertia + node] * work[y + node] * work[y + node]
    work[y + plan[CONTINUOUS] - 2] += after - before  # the hydraulics' work on the small parts
    work[y + plan[SHIFT_LAG]] = 0.0
    for i in range(plan[SWITCHES]):
        b = plan[plan[SWITCH_TABLE] + i]
        row = plan[BRANCH_TABLE] + b * BRANCH_COLUMNS
        if plan[row + LAW] == FRICTION and plan[row + NODE_B] == node:
            slip = work[plan[row + PARAMETER]] * work[y + plan[row + NODE_A]]
            slip -= work[plan[row + PARAMETER] + 1] * work[y + node]
            if slip > 0.0:
                work[modes + b] = 1.0
            elif slip < 0.0:
                work[modes + b] = -1.0
    state[plan[STATE_CLOCK] + GEAR] = gear


@kernel
def run_sensors(plan, state, work, constants, observed, tick, sample):
    """Torque meter and CAN channels: sample them at this tick if asked to, show what they hold."""
    if plan[SECTIONS] > 0:
        held = plan[STATE_CLOCK] + METER_HELD
        if sample:
            raw = work[METER_GAIN] * work[observed + plan[FILTERED_OUTPUT]] + work[METER_OFFSET]
            state[held] = raw
            if work[METER_ON] > 0.0:
                state[held] = filter_sample(
                    state, plan[STATE_SECTIONS], constants, plan[SECTION_VALUES], plan[SECTIONS], raw)
        work[observed + plan[FILTER_TARGET]] = state[held]
    table = plan[CHANNEL_TABLE]
    for i in range(plan[CHANNELS]):
        row = table + CHANNEL_COLUMNS * i
        at = plan[row + 2]
        if sample:
            can_signal_tick(state, at, constants, plan[row + 3], plan[row + 4], tick,
                            work[observed + plan[row]])
        work[observed + plan[row + 1]] = state[at]


@entry_point
def network_run(state: F8, plan: I8, constants: F8, work: F8, inputs: F8, outputs: F8,
                start: float, dt: float, steps: int) -> int:
    """Advance a network by ``steps`` communication steps of ``dt`` [s] from time ``start`` [s].

    Args:
        state: Complete state; changed in place.
        plan, constants: Structure and numbers, from the assembly.
        work: Scratch of ``work_size`` entries; nothing in it outlives the call.
        inputs: steps x INPUTS, row by row, each held over its step.
        outputs: steps x OUTPUTS, row by row, at the end of each step.
        steps: 0 evaluates the outputs at ``start`` into the first row and moves nothing.

    Returns:
        OK, NOT_FINITE, TOO_MANY_EVENTS or QUEUE_FULL.
    """
    n = plan[CONTINUOUS]
    branches = plan[BRANCHES]
    n_inputs = plan[INPUTS]
    n_outputs = plan[OUTPUTS]
    active = plan[ACTIVE_SIZE]
    clock = plan[STATE_CLOCK]
    queue = plan[STATE_QUEUE]
    # work: active constants, signals, y, dy, y2, dy2, stage, torques, modes, outputs, solver
    signal = active
    y = signal + SIGNALS_HEAD + n_inputs
    dy = y + n
    y2 = dy + n
    dy2 = y2 + n
    spare = dy2 + n
    torque = spare + n
    torque_b = torque + branches
    modes = torque_b + branches
    observed = modes + branches
    matrix = observed + n_outputs
    forget_factors(work, matrix)
    for i in range(active):
        work[i] = constants[i]
    if plan[GEARS] > 0:
        apply_gear(plan, work, constants, int(state[clock + GEAR]))
    for i in range(n):
        work[y + i] = state[i]
    for b in range(branches):
        work[modes + b] = state[plan[STATE_MODES] + b]
    work[signal + ONE] = 1.0
    work[signal + RUNS] = 1.0
    work[signal + DELAYED] = 0.0
    work[signal + NOISE] = 0.0
    drawn = NONE_DRAWN  # number of the noise value that is held
    delay = work[DELAY]
    tick = work[TICK]
    status = OK
    rows = steps
    if rows == 0:
        rows = 1
    for step in range(rows):
        time = start + step * dt
        stop = start + (step + 1) * dt
        if steps == 0:
            stop = time
        base = step * n_inputs
        for i in range(n_inputs):
            work[signal + SIGNALS_HEAD + i] = inputs[base + i]
        grade = 0.0
        if plan[GRADE_INPUT] >= 0:
            grade = inputs[base + plan[GRADE_INPUT]]
        work[signal + COS_GRADE] = cos(grade)
        work[signal + SIN_GRADE] = sin(grade)
        work[signal + IN_GEAR] = 1.0
        if plan[GEARS] > 0:
            gear = int(inputs[base + plan[GEAR_INPUT]])
            if gear != int(state[clock + GEAR]):
                shift(plan, state, work, constants, y, modes, gear)
                forget_factors(work, matrix)
            if gear == 0:
                work[signal + IN_GEAR] = 0.0
        # the delayed input: remember the new value, look up the old one
        if plan[DELAYED_INPUT] >= 0 and not remember(
                state, clock, queue, time, time - delay, inputs[base + plan[DELAYED_INPUT]]):
            return QUEUE_FULL
        while True:
            # signals of this piece, and where it ends
            end = stop
            if plan[DELAYED_INPUT] >= 0:
                work[signal + DELAYED] = recall(state, clock, queue, time - delay)
                change = next_change(state, clock, queue, time - delay) + delay
                if change > time + TIME_TOLERANCE and change < end - TIME_TOLERANCE:
                    end = change
                period = work[NOISE_PERIOD]
                k = int((time + TIME_TOLERANCE) / period)
                if k != drawn:
                    work[signal + NOISE] = standard_normal(plan[SEED], k)
                    drawn = k
                if (k + 1) * period < end - TIME_TOLERANCE:
                    end = (k + 1) * period
            ticks = 0
            if tick > 0.0:
                ticks = int((time + TIME_TOLERANCE) / tick) + 1
                if ticks * tick < end - TIME_TOLERANCE:
                    end = ticks * tick
            lag_table = plan[LAG_TABLE]
            for i in range(plan[LAGS]):
                if work[plan[lag_table + 3 * i + 2]] <= 0.0:
                    work[y + plan[lag_table + 3 * i]] = work[signal + plan[lag_table + 3 * i + 1]]
            if steps == 0:
                rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
            else:
                status, events = integrate(plan, work, y, dy, y2, dy2, spare, end - time,
                                           signal, torque, torque_b, modes, matrix)
                state[clock + EVENTS] += events
                if status != OK:
                    return status
            time = end
            # the last piece may end on a tick too
            on_tick = tick > 0.0 and abs(time - ticks * tick) <= TIME_TOLERANCE
            last = time >= stop - TIME_TOLERANCE
            if on_tick or last:
                observe(plan, work, y, dy, torque, modes, observed)
            if tick > 0.0:
                run_sensors(plan, state, work, constants, observed, ticks, on_tick and steps > 0)
            if last:
                break
        for i in range(n_outputs):
            outputs[step * n_outputs + i] = work[observed + i]
        total = 0.0
        for i in range(n):
            total += work[y + i] - work[y + i]
        if total != 0.0:  # only NaN and infinity differ from themselves
            return NOT_FINITE
    for i in range(n):
        state[i] = work[y + i]
    for b in range(branches):
        state[plan[STATE_MODES] + b] = work[modes + b]
    return status


@kernel
def remember(state, clock, queue, time, oldest, value):
    """Keep (time, value) of an input that changed; False if more than QUEUE_SIZE are on their way.

    Entries that no one at ``oldest`` or later asks for make room first.
    """
    recall(state, clock, queue, oldest)
    count = int(state[clock + QUEUE_COUNT])
    first = int(state[clock + QUEUE_FIRST])
    if count > 0 and state[queue + 2 * ((first + count - 1) % QUEUE_SIZE) + 1] == value:
        return True
    if count == QUEUE_SIZE:
        return False
    place = (first + count) % QUEUE_SIZE
    state[queue + 2 * place] = time
    state[queue + 2 * place + 1] = value
    state[clock + QUEUE_COUNT] = count + 1
    return True


@kernel
def recall(state, clock, queue, time):
    """The value that held at ``time``; entries older than that one are dropped."""
    first = int(state[clock + QUEUE_FIRST])
    count = int(state[clock + QUEUE_COUNT])
    while count > 1 and state[queue + 2 * ((first + 1) % QUEUE_SIZE)] <= time + TIME_TOLERANCE:
        first = (first + 1) % QUEUE_SIZE
        count -= 1
    state[clock + QUEUE_FIRST] = first
    state[clock + QUEUE_COUNT] = count
    return state[queue + 2 * first + 1]


@kernel
def next_change(state, clock, queue, time):
    """When the value that holds at ``time`` is followed by another; far away if it is not."""
    if int(state[clock + QUEUE_COUNT]) < 2:
        return 1e300
    return state[queue + 2 * ((int(state[clock + QUEUE_FIRST]) + 1) % QUEUE_SIZE)]


@entry_point
def network_rates(state: F8, plan: I8, constants: F8, work: F8, inputs: F8,
                  result: F8) -> int:
    """Rates of the continuous states at ``state`` with its modes and the first row of ``inputs``.

    For equilibria and linearisation: the torque request counts as arrived, noise and ripple as zero.

    Args:
        result: 2 x CONTINUOUS: the rates, then room for the torques of the branches.
    """
    n = plan[CONTINUOUS]
    branches = plan[BRANCHES]
    active = plan[ACTIVE_SIZE]
    signal = active
    y = signal + SIGNALS_HEAD + plan[INPUTS]
    dy = y + n
    torque = y + 5 * n
    torque_b = torque + branches
    modes = torque_b + branches
    matrix = modes + branches + plan[OUTPUTS]
    forget_factors(work, matrix)
    for i in range(active):
        work[i] = constants[i]
    work[signal + IN_GEAR] = 1.0
    if plan[GEARS] > 0:
        gear = int(inputs[plan[GEAR_INPUT]])
        apply_gear(plan, work, constants, gear)
        if gear == 0:
            work[signal + IN_GEAR] = 0.0
    for i in range(plan[INPUTS]):
        work[signal + SIGNALS_HEAD + i] = inputs[i]
    grade = 0.0
    if plan[GRADE_INPUT] >= 0:
        grade = inputs[plan[GRADE_INPUT]]
    work[signal + ONE] = 1.0
    work[signal + COS_GRADE] = cos(grade)
    work[signal + SIN_GRADE] = sin(grade)
    work[signal + DELAYED] = 0.0
    if plan[DELAYED_INPUT] >= 0:
        work[signal + DELAYED] = inputs[plan[DELAYED_INPUT]]
    work[signal + NOISE] = 0.0
    work[signal + RUNS] = 0.0
    for i in range(n):
        work[y + i] = state[i]
    for b in range(branches):
        work[modes + b] = state[plan[STATE_MODES] + b]
    rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
    for i in range(n):
        result[i] = work[dy + i]
    for b in range(branches):
        result[n + b] = work[torque + b]
    return OK
