"""The lock-up clutch slips although it is commanded closed.

Too little pressure, worn or glazed paper: the clutch carries its capacity and no more, the converter
the rest, and the engine runs ahead of the turbine under torque. Nothing happens while the torque stays
below the capacity. Or its control holds it at a small slip, so that it passes on no shuffle: then the
engine runs ahead under any torque, by as much, and behind on the overrun.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor, shift

EFFECT = Effect(
    acts_on="engine",
    directly="a turbine speed sensor beside the engine's; or the pressure at the lock-up clutch",
    parameters=(
        factor("lockup_capacity", "lockup_clutch.capacity", unit="N.m",
               meaning="torque capacity of the lock-up clutch at full command",
               spread=1.0, limits=(0.01, 1.5), detection=1.7, probes=(0.2, 0.1, 0.05)),
        shift("slip_target", "slip_control.target", unit="rad/s",
              meaning="slip that the control of the lock-up clutch holds",
              spread=2.0, limits=(0.0, 10.0), detection=0.5, probes=(0.6, 1.5, 4.0)),
    ),
)
