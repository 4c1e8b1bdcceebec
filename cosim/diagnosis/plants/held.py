"""Channels that a logger wrote more often than they were measured: every row of its table holds the last value.

Taken for measured, rows between are as many samples without noise, and late by up to the time between two that were.
"""

from __future__ import annotations

import numpy as np

_RUNS = 8  # of one value, at least, to tell it by
_ALIKE, _MOST = 0.25, 0.7  # share by which these may be of other lengths, and of them that has to be as long
_FINE = 1.5  # resolutions by which half of the changes are more: what is read coarsely is regular where it moves evenly
_ROUNDING = 1e-9  # share of a channel


def rounding(values: np.ndarray) -> float:
    """By how much two numbers of a channel may differ that are one."""
    return _ROUNDING * (1.0 + float(np.abs(values).max(initial=0.0)))


def updates(values: np.ndarray, stays: bool = False) -> np.ndarray | None:
    """Where a held channel was measured: the places of the samples; None where it is not held.

    It has as many samples of one value as of the next, however far it moves between.

    Args:
        values: In the order of time.
        stays: Whether one value for longer was measured as often as usual, as of a torque that is asked for. What has
            noise does not stay: there frames were lost.
    """
    steps = np.abs(np.diff(values))
    moved = steps > rounding(values)
    begins = np.flatnonzero(moved) + 1
    lengths = np.diff(begins)  # the first and the last may be cut
    if lengths.size < _RUNS:
        return None
    usual = float(np.median(lengths))
    regular = np.abs(lengths - usual) <= max(1.0, _ALIKE * usual)
    if usual < 2.0 or np.mean(regular) < _MOST or np.median(steps[moved]) <= _FINE * steps[moved].min():
        return None
    if not stays:
        return np.insert(begins, 0, 0)
    starts, ends = np.insert(begins, 0, 0), np.append(begins, values.size)
    return np.concatenate([_within(start, end, usual) for start, end in zip(starts, ends)])


def _within(start: int, end: int, usual: float) -> np.ndarray:
    """Where one value was measured, from its first sample on, as often as usual."""
    count = max(1, round((end - start) / usual))
    return start + np.round(np.arange(count) * (end - start) / count).astype(int)
