"""Least squares on inverse dynamics: blocks of time that stand for samples.

What is left of a filtered and thinned error (``plants.band``) is not quite white, so nothing is decided sample by
sample: neighbouring ones stand together as a block.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import t as student

_FEWEST = 8  # blocks that say what is left of an error
_MEMORIES = 0.99 * (np.arange(20) + 0.5) / 20.0  # how alike neighbouring blocks may be
_FARTHEST = 1e3  # standard errors within which any quantile is


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
        low, high: 95 % interval.
        blocks: How many there are.
        alone: How many that stand for themselves would say as much, as neighbours are alike.
    """

    share: float
    low: float
    high: float
    blocks: int
    alone: float


def remaining(change: np.ndarray) -> Remaining | None:
    """What is left of errors in pairs of blocks; None for fewer than ``_FEWEST``.

    Blocks are a first order process of unknown mean, size and memory. How alike neighbours are shows in a dozen blocks
    far too weakly to be put in as if it were known, so what their mean is worth is averaged over all memories, each
    weighed by the likelihood of the contrasts between blocks (restricted likelihood, Harville 1974).

    Args:
        change: Logarithm of the ratio of root mean squares, block by block.
    """
    count = change.size
    if count < _FEWEST:
        return None
    mean = float(change.mean())
    if not np.ptp(change) > np.finfo(float).eps * max(1.0, abs(mean)):
        return Remaining(*[float(np.exp(mean))] * 3, count, float(count))
    errors, weights, alone = np.array([_with_memory(change, memory) for memory in _MEMORIES]).T
    weights = np.exp(weights - weights.max())
    weights /= weights.sum()

    def beyond(reach: float) -> float:
        return float(weights @ student.sf(reach / errors, count - 1)) - 0.025

    reach = brentq(beyond, 0.0, _FARTHEST * errors.max())
    return Remaining(*(float(np.exp(mean + side * reach)) for side in (0.0, -1.0, 1.0)), count,
                     float(1.0 / (weights @ (1.0 / alone))))


def _with_memory(change: np.ndarray, memory: float) -> tuple[float, float, float]:
    """Of a stationary first order process: standard error of its mean, log restricted likelihood, blocks that count."""
    count, drift = change.size, 1.0 - memory**2
    share = np.full(count, (1.0 - memory) ** 2)
    share[[0, -1]] = 1.0 - memory
    e = change - float(share @ change / share.sum())  # from the mean that is likeliest with that memory
    square = float(e[0] ** 2 + np.sum((e[1:] - memory * e[:-1]) ** 2) / drift)
    free = count - 1
    likelihood = -0.5 * (free * np.log(drift) + np.log(share.sum() / drift) + free * np.log(square))
    lags = np.arange(1, count)
    alone = count / (1.0 + 2.0 * float((1.0 - lags / count) @ memory**lags))
    return float(np.sqrt(square / free / alone)), float(likelihood), alone


def dependence(errors: np.ndarray, lags: int = 10) -> float:
    """How many samples count as one: 1 for white errors, more where neighbours are alike."""
    e = errors - errors.mean()
    power = float(e @ e)
    if not power > 0.0 or e.size <= 2 * lags:
        return 1.0
    alike = [float(e[:-lag] @ e[lag:]) / power for lag in range(1, lags + 1)]
    return max(1.0, 1.0 + 2.0 * sum(r * (1.0 - lag / (lags + 1)) for lag, r in enumerate(alike, start=1)))
