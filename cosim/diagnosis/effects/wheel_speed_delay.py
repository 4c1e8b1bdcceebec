"""The wheel speed arrives late.

Filters of the brake control unit and its bus: the samples show the speed of some milliseconds ago; all
other channels are on time.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="sensor wheel_speed",
    directly="a wheel sensor wired to the logger beside the value on the bus",
    parameters=(
        shift("wheel_speed_delay", "observe.wheel_speed.delay", unit="s",
              meaning="age of the shown wheel speed",
              spread=0.02, limits=(-0.05, 0.3), detection=0.005),
    ),
)
