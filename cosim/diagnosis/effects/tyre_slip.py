"""The tyres slip more or less under the same force than the file says.

Slip stiffness of the contact patches: tread, load, a wet road. Driven wheels turn faster than the
vehicle in proportion to the force; in the driveline it acts as a damper between wheel and road.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="wheel",
    directly="the tyre on a flat track; or wheel speed against optical vehicle speed in several steady pulls",
    parameters=(
        factor("slip_stiffness", "tyre.slip_stiffness", unit="N",
               meaning="force over slip at small slip, of one tyre",
               spread=0.3, limits=(0.2, 4.0), detection=0.25),
    ),
)
