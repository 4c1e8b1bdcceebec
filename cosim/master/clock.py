"""Time as whole numbers of nanoseconds: it is counted, never added up.

Every step length is a whole number of nanoseconds and all start together; the clock visits only those
nanoseconds at which something is due.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cosim import units
from driveline.model import check_time
from driveline.quantities import InputError

PER_SECOND = 1_000_000_000


def nanoseconds(time: float | str, what: str) -> int:
    """A time in seconds, or as text with its unit, as a whole number of nanoseconds.

    Raises:
        InputError: No time, not finite, too large, or between two nanoseconds; the message starts with ``what``.
    """
    seconds = units.in_unit(time, "s", what)
    check_time(seconds, what)
    scaled = seconds * PER_SECOND
    whole = round(scaled)
    if abs(scaled - whole) > max(1e-3, 4e-16 * abs(scaled)):
        raise InputError(f"{what} is {seconds!r} s: a whole number of nanoseconds is needed, the nearest is "
                         f"{whole / PER_SECOND!r} s")
    return whole


def step_length(time: float | str, what: str) -> int:
    """As ``nanoseconds``, for a length that must be positive."""
    length = nanoseconds(time, what)
    if length <= 0:
        raise InputError(f"{what} is {length / PER_SECOND:g} s: a positive length is needed")
    return length


class Clock:
    """The instants of one run.

    Attributes:
        start, stop: First and last instant [ns].
        periods: The distinct step lengths [ns]; bit ``i`` of an event's mask means that a step of
            ``periods[i]`` ends (and the next one starts) there.
    """

    def __init__(self, start: int, stop: int, periods: Sequence[int]) -> None:
        if stop <= start:
            raise InputError(f"the run stops at {stop / PER_SECOND:g} s, but starts at "
                             f"{start / PER_SECOND:g} s: a later stop is needed")
        self.start, self.stop = start, stop
        self.periods = tuple(sorted(set(periods)))

    def bit(self, period: int) -> int:
        """The bit of ``period`` in an event's mask."""
        return 1 << self.periods.index(period)

    def count(self, period: int) -> int:
        """How many instants of ``period`` lie in the run, the first and the last instant included."""
        whole, rest = divmod(self.stop - self.start, period)
        return whole + 1 + (rest > 0)

    def blocks(self, events: int = 1000) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The instants, in blocks of about ``events``: times [ns, int64] and masks [int64].

        The stop is always the last instant, whether or not a period ends there.
        """
        length = self.periods[0] * max(1, events // len(self.periods))
        for first in range(0, self.stop - self.start + 1, length):
            last = min(first + length, self.stop - self.start + 1)  # exclusive
            due = [np.arange(-(-first // period) * period, last, period, dtype=np.int64)
                   for period in self.periods]
            if last == self.stop - self.start + 1:
                due.append(np.array([self.stop - self.start], dtype=np.int64))
            times = np.unique(np.concatenate(due))
            masks = np.zeros(times.size, dtype=np.int64)
            for position, period in enumerate(self.periods):
                masks |= (times % period == 0).astype(np.int64) << position
            yield times + self.start, masks
