"""One step function for every plant: a network of inertias joined by branches.

A node is an inertia with one speed, a branch a law between two nodes over ratios. So plants differ
in data only, and what is proved for one holds in all.

Within a communication step the inputs are held. The step is cut at every instant where something in
the plant switches by the clock (a delayed input arrives, a noise value ends, a sensor samples); each
piece is integrated by ``stepping``. So results do not depend on where the communication steps fall.

Everything is flat (``layout``). The code keeps to indexing, arithmetic and while/for/if, the part of
Python that compiles ahead of time; it also runs as it stands.
"""

from __future__ import annotations

from math import cos, floor, sin

from ..sensors.can_signal import standard_normal
from .backend import F8, I8, entry_point, kernel
from .delay import next_change, recall, remember
from .derivatives import forget_derivatives
from .layout import (
    ACTIVE_SIZE, BRANCHES, BRANCH_COLUMNS, BRANCH_TABLE, CONTINUOUS, COS_GRADE, DELAY, DELAYED,
    DELAYED_INPUT, EVENTS, FRICTION, GEAR, GEARS, GEARSET_BRANCH, GEARSET_NODE, GEAR_INPUT,
    GEAR_ROWS, GEAR_TABLE, GEAR_VALUES, GRADE_INPUT, INERTIA, INPUTS, IN_GEAR, LAGS, LAG_TABLE, LAW,
    NODE_A, NODE_B, NOISE, NOISE_PERIOD, NONE_DRAWN, NOT_FINITE, OK, ONE, OUTPUTS, PARAMETER, PROPAGATED,
    QUEUE_FULL, RUNS, SEED, SHIFT_LAG, SIGNALS_HEAD, SIN_GRADE, STATE_CLOCK, STATE_MODES,
    STATE_QUEUE, SWITCHES, SWITCH_TABLE, TICK, TIME_TOLERANCE, work_places,
)
from .laws import rates
from .outputs import observe, run_sensors
from .propagation import propagate
from .stepping import integrate
from .sticking import forget_factors


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
        OK, NOT_FINITE, TOO_MANY_EVENTS, QUEUE_FULL or SLIDES_TOO_FAST.
    """
    n = plan[CONTINUOUS]
    branches = plan[BRANCHES]
    n_inputs = plan[INPUTS]
    n_outputs = plan[OUTPUTS]
    active = plan[ACTIVE_SIZE]
    clock = plan[STATE_CLOCK]
    queue = plan[STATE_QUEUE]
    signal, y, dy, y2, dy2, spare, torque, torque_b, modes, observed, matrix, kept = work_places(plan)
    forget_factors(work, matrix)
    forget_derivatives(plan, work, kept)
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
    work[signal + COS_GRADE] = 1.0
    work[signal + SIN_GRADE] = 0.0
    grade = 0.0
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
        if plan[GRADE_INPUT] >= 0 and inputs[base + plan[GRADE_INPUT]] != grade:
            grade = inputs[base + plan[GRADE_INPUT]]
            work[signal + COS_GRADE] = cos(grade)
            work[signal + SIN_GRADE] = sin(grade)
        work[signal + IN_GEAR] = 1.0
        if plan[GEARS] > 0:
            gear = int(inputs[base + plan[GEAR_INPUT]])
            if gear != int(state[clock + GEAR]):
                shift(plan, state, work, constants, y, modes, gear)
                forget_factors(work, matrix)
                forget_derivatives(plan, work, kept)
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
                k = int(floor((time + TIME_TOLERANCE) / period))
                if k != drawn:
                    work[signal + NOISE] = standard_normal(plan[SEED], k)
                    drawn = k
                if (k + 1) * period < end - TIME_TOLERANCE:
                    end = (k + 1) * period
            ticks = 0
            if tick > 0.0:
                ticks = int(floor((time + TIME_TOLERANCE) / tick)) + 1
                if ticks * tick < end - TIME_TOLERANCE:
                    end = ticks * tick
            whole = work[PROPAGATED] > 0.0 and time == start + step * dt and end == stop
            lag_table = plan[LAG_TABLE]
            for i in range(plan[LAGS]):
                if work[plan[lag_table + 3 * i + 2]] <= 0.0:
                    work[y + plan[lag_table + 3 * i]] = work[signal + plan[lag_table + 3 * i + 1]]
            if steps == 0:
                rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
            elif not (whole and propagate(plan, work, y, dy, y2, dy2, spare, dt, signal, torque, torque_b, modes,
                                          matrix, kept)):
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


@entry_point
def network_rates(states: F8, plan: I8, constants: F8, work: F8, inputs: F8, result: F8, rows: int) -> int:
    """Rates of the continuous states at some states, each with its modes, and the first row of ``inputs``.

    For equilibria and linearisation: the torque request counts as arrived, noise and ripple as zero.

    Args:
        states: rows x (CONTINUOUS + BRANCHES): continuous states, then modes, as the state begins.
        result: As large: their rates, then the torques of the branches.
    """
    n = plan[CONTINUOUS]
    branches = plan[BRANCHES]
    signal, y, dy, _, _, _, torque, torque_b, modes, _, matrix, _ = work_places(plan)
    forget_factors(work, matrix)
    for i in range(plan[ACTIVE_SIZE]):
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
    for row in range(rows):
        at = row * (n + branches)
        for i in range(n):
            work[y + i] = states[at + i]
        for b in range(branches):
            work[modes + b] = states[at + n + b]
        rates(plan, work, y, dy, signal, torque, torque_b, modes, matrix)
        for i in range(n):
            result[at + i] = work[dy + i]
        for b in range(branches):
            result[at + n + b] = work[torque + b]
    return OK


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
