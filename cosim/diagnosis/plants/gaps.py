"""What was not recorded, where frames are lost.

A bus that is busy for 60 ms while the driver tips in hides when the torque rose: a straight line through the gap is
off by tens of newton metres. What it was off by is unknown in the run: half a wave, and a whole one, as where the
torque rises in the middle the line is above it first, below it then, and right on average. Of longer gaps more waves. A
speed that leads the simulation does not lead it there: a curve through both ends of 100 ms misses half a swing of the
shuffle.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.measured import Channel

WAVES = 2  # at least: half a turn and a whole one, of what the torque was beside the straight line
_EACH = 0.05  # s of a longer gap to each
_LOST = 1.5  # distances of frames: more, and one is missing
MISSED = 2.5  # and two: more than a curve through the others can follow


@dataclass(frozen=True)
class Gap:
    """A span without frames.

    Attributes:
        begin, end: Of it [s].
        torque: By how much the torque in its middle may be another than a straight line says, one sigma [N.m].
    """

    begin: float
    end: float
    torque: float

    @property
    def waves(self) -> tuple[float, ...]:
        """Of each wave in it the height, one sigma [N.m].

        Those that a torque which steps somewhere within a gap leaves beside the line fall as one over their order. The
        longer it is the more there are, so that what steps is as sharp in all.
        """
        count = max(WAVES, round((self.end - self.begin) / _EACH))
        return tuple(self.torque / order for order in range(1, count + 1))

    @property
    def impulse(self) -> float:
        """What may be lost in it [N.m.s]."""
        return self.torque * (self.end - self.begin)


def gaps(channel: Channel, start: float, stop: float, least: float) -> list[Gap]:
    """The gaps of a torque in which nobody knows what it did.

    As unknown as the straight line is from how either side would go on, within what the channel ever shows.

    Args:
        channel: The torque.
        start, stop: Between which instants [s].
        least: Which impulse is none [N.m.s].
    """
    found, low, high = [], float(channel.values.min()), float(channel.values.max())
    for begin, end in channel.gaps(_LOST):
        before = int(np.searchsorted(channel.time, begin))
        after = before + 1
        if not start < begin < end < stop or before < 1 or after + 1 >= channel.time.size:
            continue
        middle = 0.5 * (begin + end)
        going_on = [value + (middle - at) * slope for at, value, slope in (
            (begin, channel.values[before], _slope(channel, before - 1)),
            (end, channel.values[after], _slope(channel, after)))]
        gap = Gap(begin, end, float(np.abs(np.clip(going_on, low, high) - channel.at(middle)).max()))
        if gap.impulse > least:
            found.append(gap)
    return found


def known(stamps: np.ndarray, instants: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Whether a curve through samples says what was between them.

    Args:
        stamps: Of the samples [s], increasing.
        instants: Within them [s].
        least: However close samples are otherwise, between those that are no further apart it is known [s].
    """
    apart = np.diff(stamps)
    close = apart <= max(least, MISSED * float(np.median(apart)))
    return close[np.clip(np.searchsorted(stamps, instants) - 1, 0, close.size - 1)]


def _slope(channel: Channel, at: int) -> float:
    return float((channel.values[at + 1] - channel.values[at]) / (channel.time[at + 1] - channel.time[at]))


def filled(gaps: Sequence[Gap], heights: Sequence[float], time: np.ndarray) -> np.ndarray:
    """The torque that was in the gaps beside the straight line.

    Args:
        gaps: Which.
        heights: Of the waves [N.m], one gap after the other.
        time: At which instants [s].
    """
    torque, rest = np.zeros(time.size), iter(heights)
    for gap in gaps:
        own = list(itertools.islice(rest, len(gap.waves)))
        inside = (time > gap.begin) & (time < gap.end)
        angle = np.pi * (time[inside] - gap.begin) / (gap.end - gap.begin)
        torque[inside] += sum(height * np.sin(order * angle) for order, height in enumerate(own, start=1))
    return torque
