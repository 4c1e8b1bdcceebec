"""A speed as the CAN bus delivers it: sampled in frames, jittered, delayed, quantised, held.

Frame k is due at ``k * period``. It is taken at the tick nearest to ``k * period + jitter``, where
the jitter is drawn from a density per data set (thesis section 3.3.5), and read by the receiver a
constant ``delay`` later. Frames keep their order: one that its jitter would place before its
predecessor is taken together with it, at the same tick and with the same value. Between frames
the receiver holds the last value.

Sampling at the ticks of a 1 ms clock, jittering there, and resampling is how the thesis does it
(figure 3.17). Jitter moves the instant at which the value is taken, not only its arrival: a frame
that comes early cannot know the future.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..kernels.backend import kernel
from ..quantities import InputError, quantity

LARGEST_JITTER = 5e-3  # [s], thesis section 3.3.5
TABLE_SIZE = 257

# Parameters of a channel, in this order: frame period and delay in ticks, resolution, seed, and
# how many frames the buffer holds.
PERIOD, DELAY, RESOLUTION, SEED, CAPACITY = range(5)
PARAMETERS = 5

# State of a channel, in this order: the value the receiver holds; number and tick of the next
# frame to be taken; first entry and entries of the ring buffer. The buffer follows: for each frame
# under way the tick at which it is read, and its value.
HELD, FRAME, FRAME_TICK, FIRST, COUNT = range(5)
BUFFER = 5

_MASK = 0xFFFFFFFF

# How often each jitter from -5 ms to 5 ms in steps of 0.5 ms occurs in a data set. The measured
# sets are not published: the shapes are reconstructed from what section 3.3.5 says of figures 3.15
# and 3.16, not measured. It says: no set is normal, all differ, none exceeds 5 ms; engine set 3
# has two modes, one near 5 ms; wheel sets 3 and 4 are alike in nature, but 4 has more samples at 4
# to 5 ms and more area on the positive side. Set 1 has no jitter.
JITTER_COUNTS = {
    "engine": {
        2: (0, 0, 0, 0, 1, 2, 5, 9, 16, 21, 18, 11, 7, 5, 4, 3, 2, 1, 1, 1, 1),
        3: (0, 0, 0, 0, 0, 1, 3, 6, 12, 15, 12, 7, 4, 3, 2, 2, 3, 4, 7, 12, 16),
        4: (1, 3, 6, 9, 11, 10, 9, 8, 7, 6, 7, 9, 10, 9, 6, 3, 1, 0, 0, 0, 0),
    },
    "wheel": {
        2: (1, 1, 2, 2, 3, 4, 6, 8, 12, 18, 21, 14, 7, 4, 2, 1, 1, 0, 0, 0, 0),
        3: (4, 6, 7, 7, 7, 7, 8, 9, 11, 14, 15, 14, 11, 9, 8, 7, 6, 6, 5, 3, 2),
        4: (2, 3, 4, 5, 5, 6, 7, 9, 11, 14, 15, 14, 11, 9, 8, 8, 9, 10, 11, 10, 7),
    },
}


@dataclass(frozen=True)
class CanSignal:
    """How one speed reaches the control unit."""

    period: float = quantity("s", "time between two frames", start=0.01, minimum=1e-3)
    delay: float = quantity("s", "constant delay from taking a value to reading it", start=0.0,
                            minimum=0.0, maximum=0.2)
    jitter_set: int = quantity("1", "data set of the frames' jitter (1 is none)", start=1, minimum=1,
                           maximum=4, kind="integer")
    resolution: float = quantity("rad/s", "speed of one bit (0 is unquantised)", start=0.0, minimum=0.0)
    seed: int = quantity("1", "seed of the frames' jitter", start=1, minimum=0, maximum=2**31 - 1,
                         kind="integer")


@dataclass(frozen=True)
class CanVehicleSpeed(CanSignal):
    """How the vehicle speed reaches the control unit."""

    resolution: float = quantity("m/s", "speed of one bit (0 is unquantised)", start=0.0, minimum=0.0)


def jitter_cumulative(source: str, number: int, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of frames whose jitter is at most ``x`` [s].

    Gaussian kernel density of the samples, bandwidth by Silverman's rule, cut at the largest
    jitter.

    Args:
        source: ``engine`` or ``wheel``.
        number: Data set, 2 to 4.
    """
    samples, weights, bandwidth = _kernel_density(source, number)
    share = _bell_share(np.subtract.outer(x, samples) / bandwidth) @ weights
    ends = np.subtract.outer((-LARGEST_JITTER, LARGEST_JITTER), samples)
    first, last = _bell_share(ends / bandwidth) @ weights
    return np.clip((share - first) / (last - first), 0.0, 1.0)


def jitter_density(source: str, number: int, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Density [1/s] of the jitter at ``x`` [s]; arguments as for ``jitter_cumulative``."""
    samples, weights, bandwidth = _kernel_density(source, number)
    ends = np.subtract.outer((-LARGEST_JITTER, LARGEST_JITTER), samples)
    first, last = _bell_share(ends / bandwidth) @ weights
    bells = np.exp(-0.5 * (np.subtract.outer(x, samples) / bandwidth) ** 2) @ weights
    inside = np.abs(x) <= LARGEST_JITTER
    return np.where(inside, bells / (bandwidth * math.sqrt(2.0 * math.pi) * (last - first)), 0.0)


def _kernel_density(
    source: str, number: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Sample values [s], their weights (sum 1) and the bandwidth [s] of a data set."""
    counts = np.array(JITTER_COUNTS[source][number])
    values = np.linspace(-LARGEST_JITTER, LARGEST_JITTER, counts.size)
    samples = np.repeat(values, counts)
    low, high = np.percentile(samples, (25, 75))
    spread = min(samples.std(ddof=1), (high - low) / 1.34)
    return values, counts / counts.sum(), 0.9 * spread * samples.size ** -0.2


def _bell_share(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cumulative standard normal distribution; from ``math``, as numpy's functions differ in the
    last bit between processors."""
    return np.vectorize(math.erfc, otypes=[float])(-x / math.sqrt(2.0)) / 2.0


@cache
def _quantiles(source: str, number: int) -> tuple[float, ...]:
    """Jitter [s] at TABLE_SIZE equally spaced shares, by bisection of the cumulative density."""
    if number == 1:
        return (0.0,) * TABLE_SIZE
    wanted = np.linspace(0.0, 1.0, TABLE_SIZE)
    low = np.full(TABLE_SIZE, -LARGEST_JITTER)
    high = np.full(TABLE_SIZE, LARGEST_JITTER)
    for _ in range(30):
        middle = 0.5 * (low + high)
        below = jitter_cumulative(source, number, middle) < wanted
        low = np.where(below, middle, low)
        high = np.where(below, high, middle)
    high[0], high[-1] = -LARGEST_JITTER, LARGEST_JITTER
    return tuple(high)


def jitter_table(source: str, number: int, tick: float) -> NDArray[np.float64]:
    """Jitter in ticks of ``tick`` [s] at TABLE_SIZE equally spaced shares of the frames.

    Args:
        source: ``engine`` or ``wheel``.
        number: Data set, 1 (no jitter) to 4.
    """
    return np.array(_quantiles(source, int(number))) / tick


def can_signal_parameters(
    signal: CanSignal, tick: float, stream: int, name: str = "can_signal"
) -> NDArray[np.float64]:
    """The channel's numbers for the kernel.

    Args:
        signal: The channel.
        tick: Clock period [s] at which ``can_signal_tick`` is called.
        stream: Number of the channel: channels of one seed draw independently.
        name: The channel's name, for the message.

    Raises:
        InputError: The period is shorter than the tick.
    """
    if signal.period < tick * (1.0 - 1e-9):
        raise InputError(f"{name}.period is {signal.period:g} s: at least the tick of {tick:g} s is needed")
    delay = round(signal.delay / tick)
    parameters = np.zeros(PARAMETERS)
    parameters[PERIOD] = signal.period / tick
    parameters[DELAY] = delay
    parameters[RESOLUTION] = signal.resolution
    parameters[SEED] = mix32(mix32(int(signal.seed)) + stream)
    parameters[CAPACITY] = delay + 1  # at most one frame a tick is under way
    return parameters


def can_signal_state(
    parameters: NDArray[np.float64], table: NDArray[np.float64], tick: int, value: float
) -> NDArray[np.float64]:
    """The channel's state at ``tick``, where ``value`` has been there for ever."""
    state = np.zeros(BUFFER + 2 * int(parameters[CAPACITY]))
    state[HELD] = quantised(float(value), float(parameters[RESOLUTION]))
    state[FRAME] = math.floor(tick / parameters[PERIOD]) + 1
    state[FRAME_TICK] = max(
        frame_tick(int(state[FRAME]), parameters.tolist(), 0, table.tolist(), 0), tick + 1)
    return state


@kernel
def mix32(x):
    """A 32-bit integer scrambled so that every input bit changes every output bit in half of all
    cases (Wellons' low-bias construction of xor-shifts and products)."""
    x = x & _MASK
    x = x ^ (x >> 16)
    x = product32(x, 0x7FEB352D)
    x = x ^ (x >> 15)
    x = product32(x, 0x846CA68B)
    return x ^ (x >> 16)


@kernel
def product32(x, y):
    """Lowest 32 bits of a product of two 32-bit integers, without an intermediate above 2**49:
    compiled integers have 63 bits and a sign, Python's have no end."""
    return ((x & 0xFFFF) * y + ((((x >> 16) * y) & 0xFFFF) << 16)) & _MASK


@kernel
def uniform(seed, counter):
    """Random number in (0, 1), exclusive, a pure function of two integers from 0 to 2**31."""
    key = mix32(seed)
    high = mix32(mix32(key ^ (2 * counter)) + key)
    low = mix32(mix32(key ^ (2 * counter + 1)) + key)
    return (high * 1048576.0 + (low >> 12) + 0.5) * 2.220446049250313e-16  # 52 bits, 2**-52


@kernel
def standard_normal(seed, counter):
    """Random number of the standard normal distribution, a pure function of two integers."""
    radius = math.sqrt(-2.0 * math.log(uniform(seed, 2 * counter)))
    return radius * math.cos(6.283185307179586 * uniform(seed, 2 * counter + 1))


@kernel
def quantised(value, resolution):
    """The nearest whole multiple of ``resolution``; the value itself where that is 0."""
    if resolution > 0.0:
        return resolution * math.floor(value / resolution + 0.5)
    return value


@kernel
def frame_tick(frame, parameters, at, table, place):
    """The tick at which frame ``frame`` would be taken if there were no other."""
    share = uniform(int(parameters[at + SEED]), frame) * (TABLE_SIZE - 1)
    i = int(share)
    jitter = table[place + i] + (share - i) * (table[place + i + 1] - table[place + i])
    return math.floor(frame * parameters[at + PERIOD] + jitter + 0.5)


@kernel
def can_signal_tick(state, at, constants, parameters, table, tick, value):
    """One tick of a channel: take a frame where one is due, deliver what has arrived.

    Args:
        state: Float array; the channel's part begins at ``at``.
        constants: Float array; the channel's parameters begin at ``parameters``, its jitter table
            at ``table``.
        tick: Number of this tick; every tick is to be given once, in order.
        value: The true value now.

    Returns:
        The value the receiver holds, also in ``state[at]``.
    """
    capacity = int(constants[parameters + CAPACITY])
    first = int(state[at + FIRST])
    count = int(state[at + COUNT])
    if state[at + FRAME_TICK] <= tick:
        place = at + BUFFER + 2 * ((first + count) % capacity)
        state[place] = tick + constants[parameters + DELAY]
        state[place + 1] = quantised(value, constants[parameters + RESOLUTION])
        count += 1
        frame = int(state[at + FRAME])
        due = tick
        while due <= tick:  # frames that may not overtake this one are taken with it
            frame += 1
            due = frame_tick(frame, constants, parameters, constants, table)
        state[at + FRAME] = frame
        state[at + FRAME_TICK] = due
    if count > 0 and state[at + BUFFER + 2 * first] <= tick:
        state[at + HELD] = state[at + BUFFER + 2 * first + 1]
        first = (first + 1) % capacity
        count -= 1
    state[at + FIRST] = first
    state[at + COUNT] = count
    return state[at + HELD]
