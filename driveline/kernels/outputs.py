"""What a network shows: sums of speeds, torques and angles, and sensors that sample and hold them."""

from __future__ import annotations

from ..sensors.can_signal import can_signal_tick
from ..sensors.torque_meter import filter_sample
from .backend import kernel
from .laws import stored_energy
from .layout import (
    ACCELERATION, BRANCH_COLUMNS, BRANCH_TABLE, CHANNELS, CHANNEL_COLUMNS, CHANNEL_TABLE,
    CONTACT_MODE, FILTERED_OUTPUT, FILTER_TARGET, LEVEL, METER_GAIN, METER_HELD, METER_OFFSET,
    METER_ON, OUTPUTS, SECTIONS, SECTION_VALUES, SPEED, STATE_CLOCK, STATE_SECTIONS, STORED, TERMS,
    TERM_TABLE, TORQUE, TWIST,
)


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
