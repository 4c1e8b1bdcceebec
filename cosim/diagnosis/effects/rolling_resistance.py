"""Rolling resistance is not what the file says.

Deformation of tyre and road: a force on the vehicle in proportion to its weight, almost independent of
speed. Temperature, pressure and road surface change it by half. On one road it looks like a grade; only
recordings on other slopes, a slope that is known, or the same road driven the other way tell them apart.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="vehicle",
    directly="the car towed slowly over a level floor by a force gauge, in neutral, less what its lifted wheels drag",
    parameters=(
        factor("rolling_resistance", "tyre.rolling_resistance", unit="1",
               meaning="rolling resistance over vehicle weight",
               spread=0.35, limits=(0.25, 4.0), detection=0.2),
    ),
)
