"""Reading a finding, as ``finding.json`` has it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any


def joint_probability(finding: Mapping[str, Any], effects: Collection[str]) -> float:
    """Probability of effects that explain it together: they divide it among them."""
    return sum(cause["probability"] for cause in finding["causes"] if cause["effect"] in effects)
