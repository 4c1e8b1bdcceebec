"""The lash in transmission and final drive is larger or smaller than the file says.

Wear, or another setting of the hypoid gear: one factor on both gaps. The dead time in a torque reversal
grows with its root, and the speed with which the flanks meet with it.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="propeller shaft",
    directly="a dial gauge at a lifted driven wheel turned to and fro, in gear, engine and other wheel held",
    parameters=(
        factor("backlash", "transmission.half_gap", "final_drive.half_gap", unit="rad",
               meaning="lash of transmission and final drive",
               spread=0.3, limits=(0.1, 4.0), detection=0.08),
    ),
)
