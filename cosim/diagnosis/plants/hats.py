"""A torque over time as a row of hats, and what each does to all channels of a run.

Led along the measured speeds a driveline forgets, so hats that are apart by its *memory* share a simulation.
"""

from __future__ import annotations

import numpy as np

from cosim.diagnosis.plants.run import STEP, Run

EVERY = 0.1  # s between hats
# s after which a led driveline has forgotten a hat. After the first shuffle and twists are gone and the speed of the
# whole car is back by two thirds: what a wandering torque did is far below the noise then. A torque that is missing
# may be large, and takes the second.
MEMORY, LONG_MEMORY = 1.5, 3.0


def hats(run: Run) -> np.ndarray:
    """Instants [s] at which the hats of a run peak."""
    return run.start + EVERY * np.arange(1, int(len(run.inputs) * STEP / EVERY))


def lasting(run: Run, memory: float) -> float:
    """How long [s] a run remembers a hat that it forgets in ``memory`` where the speed of the whole car leads it."""
    return memory if "vehicle_speed" in run.anchors else len(run.inputs) * STEP


def teeth(memory: float) -> int:
    """From one hat to the next that shares its simulation; and how many simulations all hats take."""
    return round(memory / EVERY)


def comb(count: int, first: int, memory: float) -> np.ndarray:
    """Heights of ``count`` hats that share a simulation: one every ``memory`` [s] from ``first``, of unit height."""
    heights = np.zeros(count)
    heights[first::teeth(memory)] = 1.0
    return heights


def row(run: Run, heights: np.ndarray) -> np.ndarray:
    """The torque at every step of a run whose hats have these heights."""
    return np.interp(run.time - STEP, hats(run), heights, left=0.0, right=0.0)


def parted(run: Run, first: int, memory: float, change: np.ndarray) -> np.ndarray:
    """What each tooth of a comb does: samples x all hats, those of other combs 0.

    Args:
        run: Which.
        first, memory: Of the comb.
        change: Stacked, what the whole comb does.
    """
    moved = np.zeros((change.size, hats(run).size), dtype=np.float32)
    for h in range(first, hats(run).size, teeth(memory)):
        begin = hats(run)[h] - EVERY
        for name, place in run.slices.items():
            clock = run.clocks[name]
            moved[place, h] = np.where((clock >= begin) & (clock < begin + memory), change[place], 0.0)
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
