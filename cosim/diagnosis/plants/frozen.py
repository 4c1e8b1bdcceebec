"""Samples that only repeat the one before: of a sensor that hangs, or is at the end of its range.

What has more noise than it is read to does not show the same number time and again. Taken for measured, such samples
have no noise, and so seem to be surer than all others.
"""

from __future__ import annotations

import math

import numpy as np

from cosim.diagnosis.plants.held import rounding

_LONG = 8  # repetitions in a row that are not asked how often the others repeat
_CHANCE = 1e-6  # of as many in a row in all of a channel, below which they are none
_MOVES = 30  # changes from sample to sample by which noise and resolution are told
# Differences of these orders show noise alike, as large for their weights, but motion slower than the samples the less
# the higher they are: shuffle is more than what a smooth speed that stands still in a cruise is read to.
_ORDERS = (2, 3, 4, 5)
_NORMAL = 0.6745  # standard deviations that half of what is normal stays within


def frozen(values: np.ndarray) -> np.ndarray:
    """Which samples of a channel repeat the one before where that cannot be by chance; none where it may be read as
    coarsely as that, or stands still.

    Args:
        values: In the order of time.
    """
    least = rounding(values)
    steps = np.abs(np.diff(values))
    again = steps <= least
    begins, lengths = _rows(again)
    found = np.zeros(values.size, dtype=bool)
    others = np.ones(steps.size, dtype=bool)
    for begin, length in zip(begins, lengths):
        others[begin:begin + length] = length < _LONG
    moves = steps[~again]
    if moves.size < _MOVES or not others.any() or not np.any(lengths >= _LONG):
        return found
    # rounding alone, of a coarse channel that moves, is noise of 0.3 resolutions
    if _noise(values, others) <= moves.min():
        return found
    often = (np.sum(again & others) + 1.0) / (np.sum(others) + 2.0)
    for begin, length in zip(begins, lengths):
        if values.size * often**length < _CHANCE and abs(values[begin]) > least:
            found[begin + 1:begin + 1 + length] = True
    return found


def _noise(values: np.ndarray, steps: np.ndarray) -> float:
    """The standard deviation of what is faster than the samples, by the steps that are True; none by too few."""
    sizes = []
    for order in _ORDERS:
        some = np.diff(values, order)[np.lib.stride_tricks.sliding_window_view(steps, order).all(axis=1)]
        if some.size < _MOVES:
            return 0.0
        sizes.append(float(np.median(np.abs(some))) / (_NORMAL * math.sqrt(math.comb(2 * order, order))))
    return min(sizes)


def _rows(true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where rows of True begin, and how long they are."""
    edges = np.flatnonzero(np.diff(true.astype(int), prepend=0, append=0))
    return edges[::2], edges[1::2] - edges[::2]
