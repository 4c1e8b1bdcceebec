"""The engine's torque follows its request later or earlier than the file says.

Transport delay of the air path, or time stamps of the request that are late. Everything the torque does
comes late together, from the engine to the vehicle.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, no_less_than_none, shift

EFFECT = Effect(
    acts_on="input engine_torque",
    directly="manifold or cylinder pressure recorded beside the torque on the bus",
    parameters=(
        shift("engine_torque_delay", "engine.air_delay", unit="s",
              meaning="delay of the air path beyond the file's",
              spread=0.02, limits=(-0.04, 0.3), detection=0.006, possible=no_less_than_none("engine.air_delay")),
    ),
    elsewhere=(
        shift("drive_delay", "drive.delay", unit="s",
              meaning="delay of a carriage's drive beyond the file's",
              spread=0.02, limits=(-0.04, 0.3), detection=0.006, possible=no_less_than_none("drive.delay")),
    ),
)
