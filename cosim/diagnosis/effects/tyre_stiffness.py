"""The tyres' sidewalls are softer or stiffer in torsion than the file says.

Pressure, temperature and make of the tyre. In series with the axle shafts, so mostly a softer or
stiffer driveline; unlike these it sits outside the hub, and moves the mode of hub against belt.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="wheel",
    directly="the rim of the standing, loaded wheel twisted by a lever, well below where the tread slides",
    parameters=(
        factor("tyre_stiffness", "tyre.stiffness", unit="N.m/rad",
               meaning="torsional stiffness of one sidewall",
               spread=0.3, limits=(0.3, 3.0), detection=0.25),
    ),
)
