"""The gears lose more or less of the torque they carry.

Friction between teeth in proportion to the torque, in the final drive and in the transmission, the
latter with its churning and its pump. Torque is missing while driving and comes back in overrun, hence
not the same as an offset or a drag.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="propeller shaft",
    directly="transmission and final drive on a bench: torque in against torque out, at several loads",
    parameters=(
        factor("final_drive_loss", "final_drive.loss_fraction", unit="1",
               meaning="loss over carried torque in the final drive",
               spread=0.6, limits=(0.05, 6.0), detection=0.8),
        factor("transmission_loss", "transmission.loss_constant[*]",
               "transmission.loss_viscous[*]",
               "transmission.loss_fraction[*]", unit="1",
               meaning="all losses of the transmission, in every gear",
               spread=0.5, limits=(0.05, 6.0), detection=0.6),
    ),
)
