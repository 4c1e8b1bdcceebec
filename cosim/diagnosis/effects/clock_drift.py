"""The logger of the analogue channels has a clock of its own that runs fast or slow.

Torque meter and accelerometers are recorded beside the bus by a logger that was synchronised once, at
the start: they are late or early by a time that grows through the recording, all by the same.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="sensor propeller_shaft_torque",
    directly="a pulse given to both loggers, when a recording begins and when it ends",
    parameters=(
        shift("clock_drift", "observe.propeller_shaft_torque.clock_drift",
              "observe.seat_acceleration.clock_drift",
              "observe.differential_acceleration.clock_drift", unit="1",
              meaning="seconds gained in a second",
              spread=1e-3, limits=(-0.02, 0.02), detection=0.0004),
    ),
)
