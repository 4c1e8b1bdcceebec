"""How a powertrain may roll on its mounts, whose numbers nobody knows: what turns its gears.

The housing bears the engine's torque and what the gearbox adds to it, and it carries the gears. On soft mounts it rolls
with that; it is a mass on springs, so it rings at a frequency of its own, and mounts that harden ring faster the more
they bear. A curve over the torque knows nothing of that. So a few frequencies and hardnesses are supposed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

# Hz, at rest: as powertrains are mounted to roll, close enough for what is between two to be seen by one of them
_FREQUENCIES = (5.0, 6.3, 8.0, 10.0, 12.6)
_DOUBLED = (np.inf, 100.0, 27.0, 7.0)  # N.m that the housing bears where its mounts are twice as stiff as at rest
_DAMPING = 0.12  # ratio, as that of hydraulic mounts
SUPPOSED = tuple(itertools.product(_FREQUENCIES, _DOUBLED))


def turned(borne: Sequence[np.ndarray], ratios: Sequence[float], step: float) -> list[np.ndarray]:
    """By how much the housing turns the gears by each of ``SUPPOSED``, of each run: steps x suppositions.

    How far the mounts let it roll is not supposed: the largest of all runs is 1. None of it in a direct gear, whose
    shafts turn as one whatever the housing does.

    Args:
        borne: Of each run, torque on the housing at every step [N.m].
        ratios: Of each run, of its gear.
        step: [s].
    """
    found = [(ratio - 1.0) * _rolled(torque, step) for torque, ratio in zip(borne, ratios)]
    top = np.max([np.abs(run).max(axis=0) for run in found], axis=0)
    return [run / np.where(top > 0.0, top, 1.0) for run in found]


def words(supposed: int) -> str:
    """One of ``SUPPOSED`` as a shape."""
    frequency, doubled = SUPPOSED[supposed]
    return f"as a powertrain that rolls at {frequency:g} Hz on mounts" + " that harden" * bool(np.isfinite(doubled))


def _rolled(torque: np.ndarray, step: float) -> np.ndarray:
    """Roll over that at which stiffness has doubled; of mounts that do not harden, over that by 1 N.m."""
    frequency, doubled = np.array(SUPPOSED).T
    hardens, rate = np.isfinite(doubled), 2.0 * np.pi * frequency
    # where x is that ratio, mounts bear x (1 + x) times as much as one that stays soft would at x = 1
    loads = torque[:, None] * np.where(hardens, 2.0 / doubled, 1.0)
    first = np.abs(loads[0])
    roll = np.sign(loads[0]) * np.where(hardens, 0.5 * (np.sqrt(1.0 + 4.0 * first) - 1.0), first)
    speed, found = np.zeros_like(roll), np.empty_like(loads)
    for i, load in enumerate(loads):
        found[i] = roll
        unborne = load - (1.0 + hardens * np.abs(roll)) * roll
        speed = speed + step * rate * (rate * unborne - 2.0 * _DAMPING * speed)
        roll = roll + step * speed
    return found
