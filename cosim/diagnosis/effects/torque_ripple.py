"""The firing of the cylinders shakes the crankshaft.

The torque the estimate gives is a mean over a firing; on it stands an oscillation with the angle of the
crankshaft, at the engine's firing order. It shows as an order line in engine speed and torque, aliased
where the sampling is slow.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, shift

EFFECT = Effect(
    acts_on="engine",
    directly="cylinder pressures; or crankshaft speed by the tooth",
    nuisances=("torque_ripple.phase",),
    parameters=(
        shift("torque_ripple_amplitude", "torque_ripple.amplitude", unit="N.m",
              meaning="amplitude of the torque at the firing order",
              spread=30.0, limits=(0.0, 400.0), detection=8.0, probes=(40.0,)),
    ),
)
