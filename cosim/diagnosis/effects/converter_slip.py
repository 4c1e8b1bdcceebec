"""The lock-up clutch slips although it is commanded closed.

Too little pressure, worn or glazed paper: the clutch carries its capacity and no more, the converter
the rest, and the engine runs ahead of the turbine under torque. Nothing happens while the torque stays
below the capacity.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="engine",
    parameters=(
        factor("lockup_capacity", "lockup_clutch.capacity", unit="N.m",
               meaning="torque capacity of the lock-up clutch at full command",
               spread=1.0, limits=(0.01, 1.5), detection=1.7, probes=(0.2, 0.1, 0.05)),
    ),
)
