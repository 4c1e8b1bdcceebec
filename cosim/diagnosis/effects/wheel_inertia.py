"""Wheels, rims or brake discs are heavier or lighter than the file says.

Other rims and tyres: one factor on the hubs and the tyre belts. They turn with the vehicle, so most of
it looks like vehicle mass (some 5 percent of it); what differs is the mode of the hub between axle
shaft and tyre sidewall, and that grades and rolling resistance do not grow with it.
"""

from __future__ import annotations

from cosim.diagnosis.effect import Effect, factor

EFFECT = Effect(
    acts_on="wheel",
    directly="wheel and tyre as a pendulum; or the lifted wheel spun up by a falling weight",
    parameters=(
        factor("wheel_inertia", "hub.inertia", "tyre.belt_inertia", unit="kg.m2",
               meaning="inertia of hubs, rims and tyre belts",
               spread=0.15, limits=(0.4, 2.5), detection=0.15),
    ),
)
