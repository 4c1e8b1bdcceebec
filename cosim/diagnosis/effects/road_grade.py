"""The road climbs or falls by more than was recorded.

A constant part of the weight along the road, in recordings where the grade was not measured or its
sensor was not levelled. It accelerates the vehicle without any torque in the driveline. Driven the
other way, the same road slopes the other way.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="input road_grade",
    directly="a survey of the road; or an inclinometer in the standing car, at several places",
    parameters=(
        shift("road_grade_offset", "input.road_grade.offset", unit="rad",
              meaning="slope beyond the recorded one, uphill positive",
              spread=0.01, limits=(-0.1, 0.1), detection=0.002),
    ),
)
