"""The engine delivers another share of the torque it is asked for.

Fuel, boost, humidity, or a torque estimate that was calibrated on another engine: a factor on the
indicated torque, so a larger error at larger torque, and none in overrun with the fuel cut.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="input engine_torque",
    directly="the engine on a dynamometer, several loads against the torque on the bus",
    parameters=(
        factor("engine_torque_gain", "engine.torque_gain", unit="1",
               meaning="delivered over estimated indicated torque",
               spread=0.06, limits=(0.6, 1.5), detection=0.03),
    ),
    elsewhere=(
        factor("drive_force_gain", "drive.force_gain", unit="1",
               meaning="delivered over estimated force of a carriage's drive",
               spread=0.06, limits=(0.6, 1.5), detection=0.03),
    ),
)
