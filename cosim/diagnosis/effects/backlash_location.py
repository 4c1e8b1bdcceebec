"""The lash sits elsewhere along the driveline than the file says.

The same sum, but part of the final drive's gap is in the transmission, or the other way round. The
small inertia of the propeller shaft between the two gaps goes with the engine or with the wheels while
the lash is crossed: two impacts instead of one, at other instants.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, Values, shift
from driveline.elements.driveline_parts import in_gear


def _ratio(values: Values) -> float:
    """Of the gear in which the sum stays the same: the fifth, that of the validation, or the highest below."""
    return next(ratio for gear in range(5, 0, -1) if (ratio := values.get(in_gear("ratio", gear), 0.0)) > 0.0)


def _possible(values: Values) -> tuple[float, float]:
    """All that there is of either gap."""
    return -values["transmission.half_gap"] / _ratio(values), values["final_drive.half_gap"]


def _moved(sizes: Values, values: Values) -> dict[str, float]:
    moved, ratio = sizes["backlash_shift"], _ratio(values)
    return {"final_drive.half_gap": values["final_drive.half_gap"] - moved,
            "transmission.half_gap": max(0.0, values["transmission.half_gap"] + moved * ratio)}  # rounding may go below


def _moved_already(values: Values) -> float:
    return 0.0


EFFECT = Effect(
    acts_on="propeller shaft",
    directly="a dial gauge: the propeller shaft against held wheels, and against a held engine in gear",
    parameters=(
        shift("backlash_shift", "transmission.half_gap", "final_drive.half_gap", unit="rad",
              meaning="half gap moved from the final drive to the transmission, at the propeller shaft",
              spread=0.015, limits=(-0.1, 0.1), detection=0.008, nominal=_moved_already, possible=_possible),
    ),
    change=_moved,
)
