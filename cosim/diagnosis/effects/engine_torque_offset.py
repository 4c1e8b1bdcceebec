"""The engine delivers a constant torque more or less than it is asked for.

Accessories, friction of a cold engine, a wrong zero of the estimate: the same error at every torque.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="input engine_torque",
    directly="the engine on a dynamometer, without load and motored, against the torque on the bus",
    parameters=(
        shift("engine_torque_offset", "engine.torque_offset", unit="N.m",
              meaning="torque at the crankshaft beyond the estimated one",
              spread=8.0, limits=(-80.0, 80.0), detection=2),
    ),
    elsewhere=(
        shift("drive_force_offset", "drive.force_offset", unit="N",
              meaning="force of a carriage's drive beyond the estimated one",
              spread=5.0, limits=(-50.0, 50.0), detection=1.0),
    ),
)
