"""The last samples of a signal with their times, and its value between them, as kernels.

A ring is SAMPLES times followed by SAMPLES values in the state array, oldest first; how many are filled
stands elsewhere in the state. At least one sample must be there before a value is asked for.
"""

from __future__ import annotations

from ..kernels.backend import kernel

SAMPLES = 64  # at 1 ms a wheel speed 50 ms late still meets the engine speed of its time
WIDEST = 0.15  # [s]: samples further apart than this say nothing about what lies between them


@kernel
def push(state, ring, count, time, value):
    """Append a sample to one of the short rings, unless it is not newer than the last one."""
    filled = int(state[count])
    if filled > 0 and time <= state[ring + filled - 1] + 1e-5:
        return
    if filled == SAMPLES:
        for i in range(SAMPLES - 1):
            state[ring + i] = state[ring + i + 1]
            state[ring + SAMPLES + i] = state[ring + SAMPLES + i + 1]
        filled -= 1
    state[ring + filled] = time
    state[ring + SAMPLES + filled] = value
    state[count] = filled + 1.0


@kernel
def linear(state, ring, count, time):
    """Value of a short ring at a time, linear between its samples, held before and after them."""
    filled = int(state[count])
    value = state[ring + SAMPLES + filled - 1]
    for i in range(1, filled):
        j = filled - i
        if time < state[ring + j]:
            value = state[ring + SAMPLES + j - 1]
            if time > state[ring + j - 1]:
                part = (time - state[ring + j - 1]) / (state[ring + j] - state[ring + j - 1])
                value += part * (state[ring + SAMPLES + j] - state[ring + SAMPLES + j - 1])
    return value


@kernel
def smooth(state, ring, count, time):
    """Value of a short ring at a time by the cubic through the four samples around it, exact at samples.

    Beyond the last sample its slope goes on.
    """
    filled = int(state[count])
    if filled < 4:
        return linear(state, ring, count, time)
    first = filled - 4
    for i in range(filled - 4):
        j = filled - 5 - i
        if time < state[ring + j + 2]:
            first = j
    last = state[ring + filled - 1]
    if time > last or state[ring + first + 3] - state[ring + first] > WIDEST:
        if time > last:
            slope = ((state[ring + SAMPLES + filled - 1] - state[ring + SAMPLES + filled - 2])
                     / (last - state[ring + filled - 2]))
            return state[ring + SAMPLES + filled - 1] + slope * min(time - last, 0.02)
        return linear(state, ring, count, time)
    value = 0.0
    for i in range(4):
        term = state[ring + SAMPLES + first + i]
        for j in range(4):
            if j != i:
                term *= (time - state[ring + first + j]) / (state[ring + first + i] - state[ring + first + j])
        value += term
    return value
