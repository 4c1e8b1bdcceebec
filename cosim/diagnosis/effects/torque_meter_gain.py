"""The propeller shaft torque meter shows too much or too little.

A wrong calibration of the strain gauges: the indicated torque is off in proportion, and no other
channel is.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="sensor propeller_shaft_torque",
    directly="a known weight on a lever at the shaft; or the amplifier's shunt calibration",
    parameters=(
        factor("torque_meter_gain", "observe.propeller_shaft_torque.gain", unit="1",
               meaning="indicated over true torque",
               spread=0.06, limits=(0.5, 2.0), detection=0.02),
    ),
    elsewhere=(
        factor("inline_torque_gain", "observe.inline_torque.gain", unit="1",
               meaning="indicated over true torque of a bench's inline sensor",
               spread=0.06, limits=(0.5, 2.0), detection=0.02),
    ),
)
