"""The tyres' rolling radius is not what the file says.

Another tyre, wear, pressure. The ratio of vehicle speed to wheel speed, and the force on the road for a
torque at the wheel, both in proportion.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="wheel",
    directly="ten turns of a driven wheel, loaded as it is driven, along a tape measure",
    parameters=(
        factor("tyre_radius", "tyre.radius", unit="m",
               meaning="rolling radius of the tyres",
               spread=0.02, limits=(0.85, 1.15), detection=0.004),
    ),
)
