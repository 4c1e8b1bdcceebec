"""The vehicle is heavier or lighter than its file says.

Passengers, load and instrumentation. Acceleration falls with the mass, and so does, weakly, the shuffle
frequency, because the vehicle is the large inertia at the far end; rolling resistance and the force of
a grade grow with it.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="vehicle",
    directly="a weighbridge, with fuel and all aboard as driven",
    parameters=(
        factor("vehicle_mass", "vehicle.mass", unit="kg",
               meaning="mass of the whole vehicle",
               spread=0.12, limits=(0.7, 1.6), detection=0.05),
    ),
)
