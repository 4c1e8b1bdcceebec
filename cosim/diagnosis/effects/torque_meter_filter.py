"""The torque meter has another low-pass filter in its path than the file says.

The supplier's Chebyshev filter of thesis table 2.2, its bands scaled together: with the period of its
stop band edge (1/30 s in the table) grow its delay and what it takes from the impacts. The shown torque
is late and smooth while no other channel is; unlike a mere delay it spares the slow parts.
"""

from __future__ import annotations

import math

from cosim.diagnosis.effect import Effect, Values, shift

_PERIOD = "observe.propeller_shaft_torque.filter_period"


def _possible(values: Values) -> tuple[float, float]:
    """A filter can be taken away, but not more than that."""
    there = 1.0 / values["torque_meter.stopband_frequency"] if values["torque_meter.enabled"] else 0.0
    return 0.0 - there - values.get(_PERIOD, 0.0), math.inf


def _filtered(sizes: Values, values: Values) -> dict[str, float]:
    return {_PERIOD: values.get(_PERIOD, 0.0) + sizes["torque_meter_filter_period"]}


EFFECT = Effect(
    acts_on="sensor propeller_shaft_torque",
    directly="the settings of the amplifier; or a step given to its input",
    parameters=(
        shift("torque_meter_filter_period", _PERIOD, unit="s",
              meaning="period of the stop band edge of the filter beyond the file's, 0 without a filter",
              spread=0.02, limits=(-0.2, 0.2), detection=0.004, probes=(0.03333,), possible=_possible),
    ),
    elsewhere=(
        shift("inline_torque_filter_period", "observe.inline_torque.filter_period", unit="s",
              meaning="period of the stop band edge of a filter behind a bench's inline sensor, 0 without",
              spread=0.02, limits=(0.0, 0.2), detection=0.004, probes=(0.03333,)),
    ),
    change=_filtered,
)
