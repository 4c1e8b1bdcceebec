"""Crankshaft and flywheel are heavier or lighter than the file says.

The smallest of the two large inertias between which the driveline shuffles, so the frequency goes
almost with its inverse root, and with it the acceleration while the lash is crossed. In shuffle
frequency alone it cannot be told from a stiffness; the speed the engine picks up in the lash tells them
apart.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="engine",
    directly="crankshaft and flywheel or flexplate on a torsional pendulum; or their drawings",
    parameters=(
        factor("engine_inertia", "engine.inertia", unit="kg.m2",
               meaning="crankshaft and flexplate or primary flywheel",
               spread=0.15, limits=(0.5, 2.0), detection=0.08),
    ),
)
