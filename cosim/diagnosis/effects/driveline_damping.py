"""The driveline damps more or less than the file says.

One factor on the viscous damping of transmission, propeller shaft, axle shafts and tyre sidewalls:
rubber, splines, oil. Shuffle decays faster or slower at almost the same frequency.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="axle",
    directly="a torque let go suddenly on the standing driveline, wheels held: how fast the twist decays",
    parameters=(
        factor("driveline_damping", "transmission.damping",
               "propeller_shaft.damping",
               "axle_shaft.damping",
               "tyre.damping", unit="N.m.s/rad",
               meaning="damping of transmission, shafts and tyre sidewalls",
               spread=0.4, limits=(0.1, 8.0), detection=0.35),
    ),
    elsewhere=(
        factor("bearing_damping", "motor_bearing.damping", "load_bearing.damping", unit="N.m.s/rad",
               meaning="viscous friction of a bench's bearings",
               spread=0.4, limits=(0.1, 8.0), detection=0.35),
        factor("guide_damping", "guide.damping", unit="N.s/m",
               meaning="viscous friction of a carriage's guide",
               spread=0.4, limits=(0.1, 8.0), detection=0.2),
    ),
)
