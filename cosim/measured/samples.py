"""Samples as a column and its clock have them: which exist, in the order of time, each at an instant of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from driveline.quantities import InputError

# A jump back by more [s] is not jitter of a logger, nor are so many samples in a row that all are late.
_CLOCK_RESTARTED, _MANY = 1.0, 4
_CLOCK_SET = 86400.0  # s: nobody pauses a recording for longer; its clock was set, or does not count seconds
_LARGEST = 1e30  # SI: nothing measured is larger, but what single precision marks an invalid sample with is
_ONE_TURN = 1.01 * 2.0 * np.pi  # rad: an angle that never leaves it may start again after each


def in_order(times: np.ndarray, values: np.ndarray, path: Path, label: str,
              notices: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Samples that exist, in increasing time; small faults are repaired and noted."""
    present = _present(times, values, path, label, notices)
    rows = np.flatnonzero(present)
    times, values = _sorted(times[present], values[present], rows, path, label, notices)
    if times.size > 1 and times[0] == times[-1]:
        raise InputError(f"{path}: the time of column '{label}' reads {times[0]:.15g} s in all its rows: "
                         "is it the right clock?")
    return _apart(times, values, label, notices)


def _present(times: np.ndarray, values: np.ndarray, path: Path, label: str, notices: list[str]) -> np.ndarray:
    """Which samples have a time and a value; some do."""
    untimed = ~np.isfinite(times)
    lost = untimed & np.isfinite(values)  # where both are blank a slower clock has no row, or the file none
    if lost.any():
        notices.append(f"{int(lost.sum())} rows without a time were left out")
    infinite = np.isinf(values)
    if infinite.any():
        notices.append(f"column '{label}': {int(infinite.sum())} infinite values were left out")
    large = np.isfinite(values) & (np.abs(values) > _LARGEST)
    if large.any():
        notices.append(f"column '{label}': {int(large.sum())} values larger than anything measured were left out, up "
                       f"to {np.abs(values[large]).max():.3g}")
    present = np.isfinite(values) & ~large & ~untimed
    if not present.any():
        blank = "the time of column" if lost.any() and untimed.all() else "column"
        raise InputError(f"{path}: {blank} '{label}' holds no values")
    return present


def _sorted(times: np.ndarray, values: np.ndarray, rows: np.ndarray, path: Path, label: str,
            notices: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Samples in the order of their times; a clock that started again or was set is refused.

    Args:
        rows: Of each sample: its row in the table, for messages.
    """
    step = np.diff(times)
    if (step < 0.0).any():
        restarted = np.flatnonzero((step < -_CLOCK_RESTARTED) | _many_late(times))
        if restarted.size:
            at = int(restarted[0])
            alone = _out_of_order(times, at)
            if alone is not None:
                raise InputError(f"{path}: the time of column '{label}' is {times[alone]:g} s at data row "
                                 f"{rows[alone] + 1}, and in order before and after it: leave that row out")
            raise InputError(f"{path}: the time of column '{label}' jumps back by {-step[at]:g} s at data "
                             f"row {rows[at + 1] + 1}: two recordings in one file? Split it there")
        notices.append(f"column '{label}': time steps back {int((step < 0.0).sum())} times, by {-step.min():g} s at "
                       "most; sorted")
        order = np.argsort(times, kind="stable")
        times, values = times[order], values[order]
    if (set_on := np.flatnonzero(step > _CLOCK_SET)).size:
        at = int(set_on[0])
        raise InputError(f"{path}: the time of column '{label}' jumps on by {step[at]:.6g} s at data row "
                         f"{rows[at + 1] + 1}: was its clock set there, or is it not in the unit it is read in?")
    return times, values


def _apart(times: np.ndarray, values: np.ndarray, label: str, notices: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Samples at instants of their own: rows that are there twice once, and those of a clock that is read coarser than
    they are sampled spread evenly about what it read.

    About it: a clock that is rounded is right on average, and one that is cut off early by half a step, in all channels
    of its file alike, also in those that are slower than its steps. The first of a step alone would be late beside
    these, by nearly half of it.
    """
    again = np.diff(times, prepend=-np.inf) == 0.0
    if not again.any():
        return times, values
    read, first, count = np.unique(times, return_index=True, return_counts=True)
    twice = (values == np.repeat(values[first], count)).all()
    distance = np.diff(read)
    step = float(np.quantile(distance, 0.05))
    # a few are no habit of a clock; one that is even has no such short steps, and one that goes stands nowhere
    if twice or again.sum() < _MANY or step < 0.5 * np.median(distance) or count.max() > 2 * np.median(count) + 1:
        notices.append(f"column '{label}': {int(again.sum())} repeated instants, the first value was kept")
        return times[~again], values[~again]
    notices.append(f"column '{label}': {int(again.sum())} of {times.size} samples have the time of another, as of a "
                   f"clock that is read every {step:.2g} s: spread evenly about it")
    notices.append(f"its clock is read every {step:.2g} s: of a channel that is not sampled more often, what is late "
                   "or early by less than half of that may be the clock's")
    share = np.minimum(step, np.minimum(np.append(distance, np.inf), np.append(np.inf, distance)))
    samples, place = count.copy(), np.arange(times.size) - np.repeat(first, count)
    # a recording may begin and end within a step: the first one's samples are its last, at the distance of the next's
    samples[0], samples[-1] = max(count[:2]), max(count[-2:])
    place += np.repeat(np.append(samples[0] - count[0], np.zeros_like(count[1:])), count)
    return times + np.repeat(share, count) * ((place + 0.5) / np.repeat(samples, count) - 0.5), values


def _out_of_order(times: np.ndarray, at: int) -> int | None:
    """Which of the samples before and after a step back at ``at`` is alone in being too late, or too early; or None."""
    first = max(at - _MANY, 0)
    around = times[first:at + _MANY + 2]
    in_order = (place for place in (at, at + 1) if (np.diff(np.delete(around, place - first)) >= 0.0).all())
    return next(in_order, None) if around.size > 2 * _MANY else None


def unwound(values: np.ndarray, label: str, notices: list[str]) -> np.ndarray:
    """An angle [rad] that starts again after every turn, as encoders and resolvers tell it, as one that goes on."""
    again = np.abs(np.diff(values)) > np.pi
    if not again.any() or np.ptp(values) > _ONE_TURN:
        return values
    notices.append(f"column '{label}': the angle starts again after a turn, {int(again.sum())} times; unwound")
    return np.unwrap(values)


def _many_late(times: np.ndarray) -> np.ndarray:
    """Of every step: whether ``_MANY`` samples before it are later than the next, and as many after it all earlier.

    A logger that is late swaps a few neighbours, which sorting puts right. Where a clock starts again, or is set
    back, sorting would shuffle two courses into one.
    """
    late = np.full(max(times.size - 1, 0), False)
    if times.size >= 2 * _MANY:
        around = np.lib.stride_tricks.sliding_window_view(times, 2 * _MANY)
        before, after = around[:, :_MANY], around[:, _MANY:]
        late[_MANY - 1:times.size - _MANY] = (
            (before.min(axis=1) > after[:, 0]) & (after.max(axis=1) < before[:, -1]))
    return late
