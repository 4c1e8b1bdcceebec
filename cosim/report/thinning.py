"""Which of too many samples a picture shows."""

from __future__ import annotations

import numpy as np


def extremes(values: np.ndarray, stretches: int) -> np.ndarray:
    """Places of the least and the largest of every stretch of samples, in order, so that no peak gets lost.

    Args:
        values: Of which there are as many as ``stretches``, at least.
        stretches: How many there are; what does not divide makes some more.
    """
    size = values.size // stretches
    rows = np.pad(values, (0, -values.size % size), "edge").reshape(-1, size)  # the first of equals is taken: no pad is
    ends = np.sort(np.stack([rows.argmin(axis=1), rows.argmax(axis=1)]), axis=0)
    return (ends + size * np.arange(len(rows))).T.ravel()
