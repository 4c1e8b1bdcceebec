"""Dry friction drags on the axle.

Brakes that do not release, bearing preload, seals: a torque against the rotation of the axle that does
not depend on speed or load, and holds at standstill. On a level road it looks like rolling resistance,
but it does not grow with the weight, and it acts behind the axle shafts' twist.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="axle",
    directly="the lifted driven wheels turned slowly by a torque wrench, in neutral, brakes released",
    pushes_like=("rolling_resistance", "road_grade"),  # but while a lash is crossed: there only the axle is held
    parameters=(
        shift("coulomb_drag_torque", "coulomb_drag.torque", unit="N.m",
              meaning="dry friction torque at the axle",
              spread=25.0, limits=(0.0, 800.0), detection=15),
    ),
    elsewhere=(
        shift("motor_bearing_friction", "motor_bearing.friction", unit="N.m",
              meaning="dry friction of a bench's motor beyond the file's",
              spread=0.1, limits=(-10.0, 100.0), detection=0.005),
        shift("guide_friction", "guide.friction", unit="N",
              meaning="dry friction of a carriage's guide beyond the file's",
              spread=10.0, limits=(-100.0, 500.0), detection=1.0),
    ),
)
