"""The delayed input: a queue of its changes, in the state, until they arrive."""

from __future__ import annotations

from .backend import kernel
from .layout import (
    QUEUE_COUNT, QUEUE_FIRST, QUEUE_SIZE, TIME_TOLERANCE,
)


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
