"""Reading a finding, as ``finding.json`` has it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

NOTHING = "nothing"  # for what a missing torque goes with
_ALONG = ("vehicle", "carriage")  # balances of forces


def joint_probability(finding: Mapping[str, Any], effects: Collection[str]) -> float:
    """Probability of effects that explain it together: they divide it among them."""
    return sum(cause["probability"] for cause in finding["causes"] if cause["effect"] in effects)


def missing(unknown: Mapping[str, Any]) -> tuple[str, str]:
    """What an unknown effect is, a torque or a force, and its unit."""
    return ("force", "N") if unknown["balance"] in _ALONG else ("torque", "N.m")


def goes_with_words(unknown: Mapping[str, Any]) -> str:
    """What the torque or force of an unknown effect goes with, in words."""
    variable = unknown["driving_variable"]
    return "nothing that was looked at" if variable == NOTHING else f"{variable.replace('_', ' ')}, {unknown['shape']}"
