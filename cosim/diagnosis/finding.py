"""What a finding is made of and read by, as ``finding.json`` has it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

NOTHING = "nothing"  # for what a missing torque goes with
_WHAT = {"N": "force", "N.m": "torque", "rad": "twist"}  # that is missing, by its unit


def joint_probability(finding: Mapping[str, Any], effects: Collection[str]) -> float:
    """Probability of effects that explain it together: they divide it among them."""
    return sum(cause["probability"] for cause in finding["causes"] if cause["effect"] in effects)


def missing(unknown: Mapping[str, Any]) -> tuple[str, str]:
    """What an unknown effect is, a torque, a force or a twist, and its unit."""
    return _WHAT[unknown["unit"]], unknown["unit"]


def goes_with_words(unknown: Mapping[str, Any]) -> str:
    """What the torque or force of an unknown effect goes with, in words."""
    variable = unknown["driving_variable"]
    return "nothing that was looked at" if variable == NOTHING else f"{variable.replace('_', ' ')}, {unknown['shape']}"


@dataclass(frozen=True)
class Gain:
    """How far one channel of a recording is from the plant before and after it was extended.

    Attributes:
        run, signal: Which.
        nrmse_before, nrmse_after, noise_floor: Root mean square error over the measured range.
    """

    run: str
    signal: str
    nrmse_before: float
    nrmse_after: float
    noise_floor: float

    @classmethod
    def of(cls, run: str, signal: str, measured: np.ndarray, before: np.ndarray, after: np.ndarray,
           floor: float) -> Gain:
        """From the channel and what was simulated, alike in clock and unit; ``floor`` is its noise in that unit."""
        span = float(np.ptp(measured))
        errors = (float(np.sqrt(np.mean((measured - simulated) ** 2))) / span for simulated in (before, after))
        return cls(run, signal, *errors, floor / span)


def gained(rows: Sequence[Gain]) -> dict[str, Any]:
    """The part ``gain`` of a finding."""
    return {"held_out": [{"manoeuvre": row.run, "signal": row.signal, "nrmse_before": row.nrmse_before,
                          "nrmse_after": row.nrmse_after, "noise_floor": row.noise_floor} for row in rows],
            "fraction_of_noise_floor": float(np.median([row.nrmse_after / row.noise_floor for row in rows]))}
