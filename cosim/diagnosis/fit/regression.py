"""Least squares on inverse dynamics: blocks of time that stand for samples.

What is left of a filtered and thinned error (``plants.band``) is not quite white, so nothing is decided sample by
sample: neighbouring ones stand together as a block.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

_FEWEST, _ALONE = 8, 4.0  # blocks that say what is left of an error; of those that count, to say how surely


def least_squares(regressors: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Coefficients with the least squared error of ``regressors @ coefficients``."""
    return np.linalg.lstsq(regressors, target, rcond=None)[0]


def relative_error(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Root of the squared error over that of the measured values."""
    return float(np.linalg.norm(measured - predicted) / np.linalg.norm(measured))


def block_sums(errors: np.ndarray, blocks: int) -> np.ndarray:
    """Sum of squares in equal consecutive blocks; a remainder goes with the last."""
    bounds = np.arange(blocks) * (errors.size // blocks)
    return np.add.reduceat(np.asarray(errors) ** 2, bounds)


def paired(before: np.ndarray, after: np.ndarray) -> float:
    """p-value that squared errors ``after`` are no smaller than ``before`` (one-sided, Student's t).

    Of the logarithm of their ratio block by block, so that a lively block counts as much as a quiet one.
    """
    gain = np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))
    if gain.size < 3 or not np.std(gain) > 0.0:
        return 1.0
    return float(student.sf(gain.mean() / (gain.std(ddof=1) / np.sqrt(gain.size)), gain.size - 1))


@dataclass(frozen=True)
class Remaining:
    """What is left of an error: ratio of root mean squares after and before, geometric mean over blocks of time.

    Attributes:
        share: That ratio; 1 where nothing was gained.
        low, high: 95 % interval, wider for having tried many; None where too few blocks count to give one.
        blocks: How many there are.
        alone: How many of them count, as neighbours are alike.
    """

    share: float
    low: float | None
    high: float | None
    blocks: int
    alone: float


def remaining(change: np.ndarray, tried: int = 1) -> Remaining | None:
    """What is left of errors in pairs of blocks; None for fewer than ``_FEWEST``.

    Neighbours that are alike count as fewer, as those of a first order process; of a few blocks that is seen too small
    (Kendall 1954 says by how much).

    Args:
        change: Logarithm of the ratio of root mean squares, block by block.
        tried: Of how many explanations the errors after are those of the one chosen (Bonferroni).
    """
    count = change.size
    if count < _FEWEST:
        return None
    e = change - change.mean()
    alike = float(e[1:] @ e[:-1]) / max(float(e @ e), np.finfo(float).tiny)
    alike = float(np.clip((count * alike + 1.0) / (count - 4.0), 0.0, 0.9))
    alone, mean = count * (1.0 - alike) / (1.0 + alike), float(change.mean())
    if alone < _ALONE:
        return Remaining(float(np.exp(mean)), None, None, count, alone)
    reach = float(student.isf(0.025 / tried, alone - 1.0)) * float(change.std(ddof=1)) / np.sqrt(alone)
    return Remaining(*(float(np.exp(mean + side * reach)) for side in (0.0, -1.0, 1.0)), count, alone)


def dependence(errors: np.ndarray, lags: int = 10) -> float:
    """How many samples count as one: 1 for white errors, more where neighbours are alike."""
    e = errors - errors.mean()
    power = float(e @ e)
    if not power > 0.0 or e.size <= 2 * lags:
        return 1.0
    alike = [float(e[:-lag] @ e[lag:]) / power for lag in range(1, lags + 1)]
    return max(1.0, 1.0 + 2.0 * sum(r * (1.0 - lag / (lags + 1)) for lag, r in enumerate(alike, start=1)))
