"""Samples that only repeat the one before: of a sensor that hangs, or is at the end of its range.

What has more noise than it is read to does not show the same number time and again. Taken for measured, such samples
have no noise, and so seem to be surer than all others.
"""

from __future__ import annotations

import numpy as np

_LONG = 8  # repetitions in a row that are not asked how often the others repeat
_CHANCE = 1e-6  # of as many in a row in all of a channel, below which they are none
_MOVES = 30  # changes from sample to sample by which noise and resolution are told
_ROUNDING = 1e-9  # share of a channel by which numbers that are one may differ


def frozen(values: np.ndarray) -> np.ndarray:
    """Which samples of a channel repeat the one before where that cannot be by chance; none where it may be read as
    coarsely as that, or stands still.

    Args:
        values: In the order of time.
    """
    least = _ROUNDING * (1.0 + np.abs(values).max(initial=0.0))
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
    # of a coarse channel that moves steadily a quarter of the steps and more differ from their neighbours by none
    second = np.abs(np.diff(values, 2))[others[1:] & others[:-1]]
    if second.size < _MOVES or np.median(second) <= 1.5 * moves.min():
        return found
    often = (np.sum(again & others) + 1.0) / (np.sum(others) + 2.0)
    for begin, length in zip(begins, lengths):
        if values.size * often**length < _CHANCE and abs(values[begin]) > least:
            found[begin + 1:begin + 1 + length] = True
    return found


def _rows(true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where rows of True begin, and how long they are."""
    edges = np.flatnonzero(np.diff(true.astype(int), prepend=0, append=0))
    return edges[::2], edges[1::2] - edges[::2]
