"""A torque over time as a row of hats, and what each does to all channels of a run.

Led along the measured speeds a driveline forgets within ``MEMORY``, so hats that far apart share a simulation.
"""

from __future__ import annotations

import numpy as np

from cosim.diagnosis.plants.run import STEP, Run

EVERY = 0.1  # s between hats
MEMORY = 1.5  # s after which a led driveline has forgotten a hat
TEETH = round(MEMORY / EVERY)  # simulations for all hats


def hats(run: Run) -> np.ndarray:
    """Instants [s] at which the hats of a run peak."""
    return run.start + EVERY * np.arange(1, int(len(run.inputs) * STEP / EVERY))


def comb(count: int, first: int) -> np.ndarray:
    """Heights of ``count`` hats that share a simulation: every ``TEETH``-th one from ``first``, of unit height."""
    heights = np.zeros(count)
    heights[first::TEETH] = 1.0
    return heights


def row(run: Run, heights: np.ndarray) -> np.ndarray:
    """The torque at every step of a run whose hats have these heights."""
    return np.interp(run.time - STEP, hats(run), heights, left=0.0, right=0.0)


def parted(run: Run, first: int, change: np.ndarray) -> np.ndarray:
    """What each tooth of a comb does: samples x all hats, those of other combs 0.

    Args:
        run: Which.
        first: Of the comb.
        change: Stacked, what the whole comb does.
    """
    moved = np.zeros((change.size, hats(run).size), dtype=np.float32)
    for h in range(first, hats(run).size, TEETH):
        begin = hats(run)[h] - EVERY
        for name, place in run.slices.items():
            clock = run.clocks[name]
            moved[place, h] = np.where((clock >= begin) & (clock < begin + MEMORY), change[place], 0.0)
    return moved


def correlation(count: int, lasts: float) -> np.ndarray:
    """Of the heights of ``count`` hats: an Ornstein-Uhlenbeck process that stays alike for ``lasts`` [s]."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) * EVERY
    return np.exp(-apart / lasts) + 1e-9 * np.eye(count)


def fast(run: Run, torque: np.ndarray) -> np.ndarray:
    """What no row of hats can follow of a torque at every step."""
    hat = np.linspace(-1.0, 1.0, 2 * round(EVERY / STEP) + 1)
    weight = (1.0 - np.abs(hat)) / np.sum(1.0 - np.abs(hat))
    smooth = np.convolve(torque, weight, mode="same")
    return torque - row(run, np.interp(hats(run), run.time - STEP, smooth))
