"""Aerodynamic drag is not what the file says.

A force on the vehicle that grows with the square of speed: open windows, a roof box, a trailer, wind.
Below 40 km/h it is smaller than rolling resistance, so it takes recordings at different speeds to see
it.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="vehicle",
    directly="a wind tunnel; or coasting down from high speed, either way, on a level road without wind",
    parameters=(
        factor("drag_coefficient", "vehicle.drag_coefficient", unit="1",
               meaning="aerodynamic drag coefficient",
               spread=0.2, limits=(0.4, 2.5), detection=0.2),
    ),
)
