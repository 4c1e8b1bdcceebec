"""Propeller shaft or axle shafts are softer or stiffer than the file says.

Joints, splines and flanges in series with the tubes and bars: the sum of the compliances sets the
shuffle frequency, and how far the engine turns ahead of the wheels under torque. The two act in series;
which of them it is shows only where the propeller shaft's own inertia matters.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="axle",
    directly="a lever and an angle gauge at either end of the shaft, wheels held and lash taken up",
    parameters=(
        factor("propeller_shaft_stiffness", "propeller_shaft.stiffness", unit="N.m/rad",
               meaning="torsional stiffness of the propeller shaft",
               spread=0.2, limits=(0.3, 3.0), detection=0.15),
        factor("axle_shaft_stiffness", "axle_shaft.stiffness", unit="N.m/rad",
               meaning="torsional stiffness of one axle shaft",
               spread=0.2, limits=(0.3, 3.0), detection=0.08),
    ),
)
