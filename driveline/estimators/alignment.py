"""Torque and both speeds brought to one time: delays that are known, and the wheel speed's, which is found.

The last frames are kept, and every signal is read as it was when the latest of them was taken. In contact the
twist grows with the shaft's torque and with nothing else. What two measured speeds show beyond that is one of
them late: over any stretch of time, the lag times the speed that was gained. A Kalman filter of one state
learns the lag from that, stretch by stretch, on both flanks. A stretch is one period of shuffle, so that
shuffle says nothing.

``at`` is where the block begins in the state, ``knows`` where its constants begin in the work array.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity
from .estimator import Delays
from .lumped import PLAUSIBLE_SPEED, PLAUSIBLE_TORQUE, plausible

RING = 64  # frames that are kept
ABSENT = -1e9  # in place of what was no measurement

# State: a ring for each signal, then these.
HEAD, FILLED, FOUND, VARIANCE, USED, STRETCH, GROWN, CARRIED_BEGUN, SPEED_BEGUN = range(3 * RING, 3 * RING + 9)
BLOCK = 3 * RING + 9

# Constants.
KNOWN_ENGINE, KNOWN_WHEEL, PRIOR, DRIFT, LEAST, MOST, FRAMES, SPACING = range(8)
KNOWLEDGE = 8

SPREAD = 1.5e-3  # [rad] of a stretch's twist that nothing explains,
SHARE = 0.3  # and as a share of the twist by torque: shuffle, a stiffness that is not quite right
WANDER = 2e-4  # [s] by which the lag may change, per square root of a second in contact
LONGEST = 0.1  # [s]: a longer lag is not looked for
DOUBTED = 16.0  # normalised squared innovation beyond which a stretch tells nothing


@dataclass(frozen=True)
class SoughtDelays(Delays):
    """Delays that are known, and how much is not known of the wheel speed's."""

    wheel_speed_deviation: float = quantity(
        "s", "standard deviation of the wheel speed's delay beyond the known ones, which is found; 0 to seek none",
        start=0.02, minimum=0.0, maximum=0.05)

    def constants(self, period: float, stretch: float) -> list[float]:
        """As the kernels read them, for a sampling period and the length of a stretch [s]."""
        oldest = self.longest(period, RING)
        frames = max(round(stretch / period), 2)
        return [self.engine_speed, self.wheel_speed, self.wheel_speed_deviation * self.wheel_speed_deviation,
                WANDER * WANDER * frames * period, max(self.engine_speed - self.wheel_speed - oldest, -LONGEST),
                min(oldest - self.wheel_speed, LONGEST), frames, period]


@kernel
def keep(state, ring, slot, value, limit):
    """Put what arrived into a ring."""
    state[ring + slot] = ABSENT
    if plausible(value, limit):
        state[ring + slot] = value


@kernel
def recall(state, ring, head, frames):
    """What was measured so many frames ago, linear between frames; ABSENT where nothing was."""
    whole = int(frames + 1e-3)
    part = frames - whole
    value = state[ring + (head + RING - whole) % RING]
    if part > 1e-3:
        before = state[ring + (head + RING - whole - 1) % RING]
        if value > ABSENT and before > ABSENT:
            value += part * (before - value)
        else:
            value = ABSENT
    return value


@kernel
def align(state, work, at, knows, inputs, frame):
    """Take a frame in; write torque, engine and wheel speed of one time to ``work[frame]``; returns its age [s].

    Before the first frame everything is taken to have been as it was then.
    """
    head = (int(state[at + HEAD]) + 1) % RING
    count = 1
    if state[at + FILLED] == 0.0:
        count = RING
        state[at + FILLED] = 1.0
        state[at + VARIANCE] = work[knows + PRIOR]
    for i in range(count):
        slot = (head + i) % RING
        keep(state, at, slot, inputs[0], PLAUSIBLE_TORQUE)
        keep(state, at + RING, slot, inputs[1], PLAUSIBLE_SPEED)
        keep(state, at + 2 * RING, slot, inputs[2], PLAUSIBLE_SPEED)
    state[at + HEAD] = head
    engine = work[knows + KNOWN_ENGINE]
    wheel = work[knows + KNOWN_WHEEL] + state[at + USED]
    age = max(engine, wheel)
    spacing = work[knows + SPACING]
    work[frame] = recall(state, at, head, age / spacing)
    work[frame + 1] = recall(state, at + RING, head, (age - engine) / spacing)
    work[frame + 2] = recall(state, at + 2 * RING, head, (age - wheel) / spacing)
    return age


@kernel
def learn(state, work, at, knows, grown, carried, speed):
    """One more frame in contact, aligned as it is: after a whole stretch of them, learn the lag from it.

    By both speeds the twist has grown by ``grown`` [rad] since the last frame; by its torque it is now
    ``carried`` [rad]; ``speed`` is the wheel's [rad/s]; all at the same shaft. The first stretch after contact was
    made only lets things settle.
    """
    frames = work[knows + FRAMES]
    state[at + STRETCH] += 1.0
    state[at + GROWN] += grown
    if state[at + STRETCH] == 2.0 * frames:
        by_torque = carried - state[at + CARRIED_BEGUN]
        gained = speed - state[at + SPEED_BEGUN]
        surprise = state[at + GROWN] - by_torque - (state[at + FOUND] - state[at + USED]) * gained
        variance = (state[at + VARIANCE] * gained * gained + SPREAD * SPREAD
                    + SHARE * SHARE * by_torque * by_torque)
        if surprise * surprise < DOUBTED * variance:
            gain = state[at + VARIANCE] * gained / variance
            lag = state[at + FOUND] + gain * surprise
            state[at + FOUND] = min(max(lag, work[knows + LEAST]), work[knows + MOST])
            state[at + VARIANCE] -= gain * gained * state[at + VARIANCE]
        state[at + VARIANCE] = min(state[at + VARIANCE] + work[knows + DRIFT], work[knows + PRIOR])
    if state[at + STRETCH] == frames or state[at + STRETCH] == 2.0 * frames:
        state[at + STRETCH] = frames
        state[at + GROWN] = 0.0
        state[at + CARRIED_BEGUN] = carried
        state[at + SPEED_BEGUN] = speed


@kernel
def at_the_end(state, work, at, knows):
    """1 where the lag found is at an end of what is looked for, within three deviations: it may lie beyond; else 0."""
    if work[knows + PRIOR] <= 0.0:
        return 0.0
    margin = 3.0 * math.sqrt(max(state[at + VARIANCE], 0.0))
    if work[knows + LEAST] + margin < state[at + FOUND] < work[knows + MOST] - margin:
        return 0.0
    return 1.0


@kernel
def interrupt(state, at):
    """A frame without contact, or incomplete: the stretch so far says nothing."""
    state[at + STRETCH] = 0.0
