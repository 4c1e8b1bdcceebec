"""Dry friction drags on the axle.

Brakes that do not release, bearing preload, seals: a torque against the rotation of the axle that does
not depend on speed or load, and holds at standstill. On a level road it looks like rolling resistance,
but it does not grow with the weight, and it acts behind the axle shafts' twist.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="axle",
    parameters=(
        shift("coulomb_drag_torque", "coulomb_drag.torque", unit="N.m",
              meaning="dry friction torque at the axle",
              spread=25.0, limits=(0.0, 800.0), detection=15),
    ),
)
