"""The engine speed arrives late.

Averaging over teeth, a slow bus, a gateway: the samples show the speed of some milliseconds ago; all
other channels are on time.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="sensor engine_speed",
    directly="a crankshaft sensor wired to the logger beside the value on the bus",
    parameters=(
        shift("engine_speed_delay", "observe.engine_speed.delay", unit="s",
              meaning="age of the shown engine speed",
              spread=0.015, limits=(-0.05, 0.2), detection=0.003),
    ),
)
