"""A speed sensor's toothed wheel runs out of true.

Eccentricity over radius: the shown speed swings once a revolution, in proportion to the speed, with a
phase nobody knows. No torque goes with it, which tells it from a true oscillation.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="sensor wheel_speed",
    directly="a dial gauge on the toothed wheel of the sensor",
    nuisances=("observe.wheel_speed.eccentricity_phase",
               "observe.transmission_output_speed.eccentricity_phase"),
    parameters=(
        shift("wheel_speed_eccentricity", "observe.wheel_speed.eccentricity", unit="1",
              meaning="relative swing of the shown wheel speed once a revolution",
              spread=0.004, limits=(0.0, 0.05), detection=0.001, probes=(0.004,)),
        shift("transmission_output_speed_eccentricity", "observe.transmission_output_speed.eccentricity", unit="1",
              meaning="relative swing of the shown transmission output speed once a revolution",
              spread=0.004, limits=(0.0, 0.05), detection=0.001, probes=(0.004,)),
    ),
)
