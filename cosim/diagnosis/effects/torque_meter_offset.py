"""The propeller shaft torque meter does not show zero at zero torque.

Drift of the strain gauges with temperature, or a zero taken under load. In the lash the true torque is
zero: there it can be read off.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="sensor propeller_shaft_torque",
    directly="the torque meter read with the shaft free, in neutral on a lift",
    parameters=(
        shift("torque_meter_offset", "observe.propeller_shaft_torque.offset", unit="N.m",
              meaning="indicated torque at zero torque",
              spread=10.0, limits=(-200.0, 200.0), detection=3),
    ),
    elsewhere=(
        shift("inline_torque_offset", "observe.inline_torque.offset", unit="N.m",
              meaning="indication of a bench's inline sensor at zero torque",
              spread=0.1, limits=(-10.0, 10.0), detection=0.005),
    ),
)
