"""How large causes have to be for given recordings to show them, by the evidence that names them.

Data that are as a cause of some size says have, on average, so much log evidence for it; where that makes up for the
prior, the cause is more likely found than not. So the same search that says "none" says what it would have found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cosim.diagnosis.evidence import Evidence, prior
from cosim.diagnosis.predict import Coordinate


def detectable(evidence: Evidence, coordinates: Sequence[Coordinate], needed: float) -> dict[int, float]:
    """The smallest size of each cause's parameter that the runs would show, of nothing else wrong.

    Args:
        evidence: What the runs say near the vehicle file.
        coordinates: Of which.
        needed: Log evidence over the healthy car that names a cause.

    Returns:
        By the place of its first coordinate: distance from 0 of what is searched, for a swing its amplitude in all
        runs; infinite where the runs do not show it however large it is. Without causes that do nothing while they are
        small: derivatives do not say when these show.
    """
    healthy, found, parameters = prior(coordinates, ()), {}, set()
    for i, c in enumerate(coordinates):
        nothing_yet = bool(c.cause) and c.run is None and bool(c.parameter.probes)  # while it is small
        if not c.cause or nothing_yet or (c.cause, c.name) in parameters:
            continue
        parameters.add((c.cause, c.name))
        unit = np.array([float((other.cause, other.name, other.part) == (c.cause, c.name, 0)) for other in coordinates])
        wide = prior(coordinates, (c.cause,))
        squared = evidence.separation(unit, healthy) ** 2 - evidence.separation(unit, wide) ** 2
        price = evidence.occam(wide) - evidence.occam(healthy)
        found[i] = float(np.sqrt(2.0 * (needed + price) / squared)) if squared > 0.0 else np.inf
    return found


def would_show(smallest: Mapping[int, float], coordinates: Sequence[Coordinate],
               values: Mapping[str, float]) -> list[dict[str, Any]]:
    """The same as ``finding.json`` has it: below and above which value each parameter would have been named.

    None where that would be an implausible value.

    Args:
        smallest: Sizes, as ``detectable`` gives them.
        coordinates: Of these.
        values: Of the vehicle file.
    """
    rows = []
    for i, size in smallest.items():
        c = coordinates[i]
        nominal, _, unit = c.parameter.physical(c.parameter.neutral, values)
        low = 0.0 if c.phase else c.low  # an amplitude
        below, above = (c.parameter.physical(c.parameter.size(x), values)[1] if low <= x <= c.high else None
                        for x in (-size, size))
        rows.append({"effect": c.effect, "parameter": c.name, "nominal": nominal, "below": below, "above": above,
                     "unit": unit})
    return rows
