"""Where a recording is cut: where nobody knows what drove it, and a long one where that has been calm for a while."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from cosim.diagnosis.plants.base import SLOWEST
from cosim.diagnosis.plants.gaps import MISSED
from cosim.measured import Channel

_GRID = 0.02  # s
_BEFORE, _AFTER = 2.0, 0.5  # s: what a step of torque shakes up rings down before a cut, and is whole where it follows
_ALIKE = 0.05  # of what the torque moves by in the whole stretch: what moves by so much more is as calm


def pauses(driver: Channel, begin: float, end: float) -> list[tuple[float, float]]:
    """Where within a stretch [s] what drives the plant was not recorded for so long that nobody knows what it did."""
    long = [(max(a, begin), min(b, end)) for a, b in driver.gaps(MISSED) if b - a > SLOWEST]
    return [(a, b) for a, b in long if b > a]


def calm_parts(driver: Channel, begin: float, end: float, longest: float) -> list[tuple[float, float]]:
    """Parts of a stretch, one after the other, none longer than a length; the last at least a quarter of that.

    A simulation begins rolling steadily, as a car does where the torque has not moved for a while. Where that is so in
    several places the last of them is taken.

    Args:
        driver: What drives the plant.
        begin, end: Of the stretch [s].
        longest: Part [s].
    """
    if end - begin <= longest:
        return [(begin, end)]
    times = np.arange(begin, end, _GRID)
    torque = driver.at(times)
    moves, alike = _moves(torque), _ALIKE * float(np.ptp(torque))
    parts, first = [], begin
    while end - first > longest:
        latest = min(first + longest, end - 0.25 * longest)
        reached = np.flatnonzero((times >= first + 0.5 * longest) & (times <= latest))
        calm = reached[moves[reached] <= moves[reached].min() + alike]
        cut = float(times[calm[-1]])
        parts.append((first, cut))
        first = cut
    return [*parts, (first, end)]


def _moves(torque: np.ndarray) -> np.ndarray:
    """By how much the torque moves around every instant of the grid, more before than after."""
    before, after = round(_BEFORE / _GRID), round(_AFTER / _GRID)
    size = before + after + 1
    shift = (before - after) // 2  # of the window's middle, earlier
    highest, lowest = (of(torque, size, origin=shift, mode="nearest") for of in (maximum_filter1d, minimum_filter1d))
    return highest - lowest
