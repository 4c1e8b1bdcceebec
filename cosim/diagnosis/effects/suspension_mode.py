"""The axle moves fore and aft in the body by more or less than the file says.

Leaf springs and bushings under the axle: the tyres' force reaches the body through a spring, which adds
compliance for the shuffle and a mode of its own that the driver feels. A compliance is added to that of
the file; a rigid axle has none, and less than the file's may be left of it.
"""

from __future__ import annotations

import math

from cosim.diagnosis.effect import Effect, Values, shift

RIGID = 1e-9  # m/N: below, the axle is part of the body


def _compliance(values: Values) -> float:
    return 1.0 / values["suspension.stiffness"] if values["suspension.enabled"] else 0.0


def _possible(values: Values) -> tuple[float, float]:
    return 0.0 - _compliance(values), math.inf


def _compliant(sizes: Values, values: Values) -> dict[str, float]:
    added = sizes["suspension_compliance"]
    if added == 0.0:
        return {}
    compliance = _compliance(values) + added
    if compliance <= RIGID:
        return {"suspension.enabled": 0.0}
    return {"suspension.enabled": 1.0, "suspension.stiffness": 1.0 / compliance}


EFFECT = Effect(
    acts_on="vehicle",
    directly="the axle pushed fore and aft against the body by a jack: force over travel",
    parameters=(
        shift("suspension_compliance", "suspension.stiffness", unit="m/N",
              meaning="fore-aft compliance of the driven axle in the body beyond the file's",
              spread=5e-7, limits=(-1e-5, 1e-5), detection=4e-07, nominal=_compliance, possible=_possible),
    ),
    change=_compliant,
)
