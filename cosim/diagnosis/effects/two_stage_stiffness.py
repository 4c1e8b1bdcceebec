"""The axle shafts are softer at small twist than at large, or stiffer.

Loose splines, rubber in series that bottoms, or that is preloaded: a first stage of stiffness up to a certain
twist, the shafts' own beyond it. Shuffle about zero torque is slower (faster) than under load, and the
frequency depends on the amplitude; neither of its two numbers does anything alone.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor, shift

_PROBES = (  # stiffness ratio, twist [rad]
    (0.4, 0.015),  # a deep soft stage
    (0.75, 0.008), (0.75, 0.005),  # two of two detection limits, which a search from the deep one does not reach
    (0.85, 0.006), (1.2, 0.006),  # of one limit, short, beside which all others may be worse than none
    (1.35, 0.012),  # a long stiff one
)
_RATIOS, _TWISTS = zip(*_PROBES)
EFFECT = Effect(
    acts_on="axle",
    directly="the axle shaft twisted slowly through all its range by a lever: where the slope changes",
    joint=True,
    parameters=(
        factor("first_stage_stiffness", "axle_first_stage.stiffness_ratio", unit="1",
               meaning="stiffness of the first stage over the second",
               spread=0.5, limits=(0.03, 1.5), detection=0.15, probes=_RATIOS,
               same_as="axle_shaft_stiffness"),
        shift("first_stage_twist", "axle_first_stage.twist", unit="rad",
              meaning="twist of an axle shaft at which the first stage ends",
              spread=0.015, limits=(0.0, 0.1), detection=0.004, probes=_TWISTS),
    ),
)
