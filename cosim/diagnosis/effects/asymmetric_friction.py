"""The final drive loses more when the wheels drive the engine than when the engine drives the wheels.

The hypoid gear slides differently on its coast flanks. A loss that changes at each torque reversal: no
symmetric friction and no offset does that.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="propeller shaft",
    directly="the final drive on a bench, driven from either side under load",
    parameters=(
        shift("coast_loss_fraction", "asymmetric_friction.coast_loss_fraction", unit="1",
              meaning="loss over carried torque on the coast side beyond that of the drive side",
              spread=0.08, limits=(0.0, 0.6), detection=0.06),
    ),
    elsewhere=(
        shift("backward_damping", "asymmetric_friction.backward_damping", unit="N.s/m",
              meaning="viscous friction of a guide moving backward beyond that moving forward",
              spread=100.0, limits=(-2000.0, 2000.0), detection=15.0),
    ),
)
