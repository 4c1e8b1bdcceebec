"""What is the same as a cause as far as recordings reach, and would not be in livelier ones.

A shaft with two stages is a stiffer one as long as its second is not reached (``same_as`` of a parameter). Derivatives
at the vehicle file do not say so, as stages have no width there, and fits from a width that is too small do not get to
it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.diagnosis.fit.fitting import Fit, Fitter
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.fit.predict import Coordinate
from cosim.diagnosis.search.scan import key

_NARROWEST, _WIDTHS = 0.04, 9  # shares of the limit that are tried


def twins(coordinates: Sequence[Coordinate], fit: Fit) -> list[tuple[int, int]]:
    """Coordinates of a fit's causes, and those of others that are the same where their cause's others are wide."""
    suspected = [(i, c) for i, c in enumerate(coordinates) if c.cause]
    return [(gone, place) for place, c in suspected for gone, other in suspected
            if c.parameter.same_as == other.name and other.cause in fit.causes and c.cause not in fit.causes]


def instead_of(coordinates: Sequence[Coordinate], fit: Fit, gone: int, place: int) -> tuple[str, ...]:
    """The causes of a fit, that of one coordinate in place of that of another."""
    return key((*fit.without(coordinates[gone].cause), coordinates[place].cause))


def around(fitter: Fitter, noise: Noise, fit: Fit, gone: int, place: int) -> list[Fit]:
    """A coordinate's size given to another that is the same where its cause's others are wide; for some widths.

    Args:
        fitter, noise: By which they are judged.
        fit: Which has it.
        gone, place: Whose size, and whose it becomes.
    """
    coordinates, starts = fitter.coordinates, []
    c, others = coordinates[place], [i for i in fitter.predictor.index(coordinates[place].cause) if i != place]
    for share in np.geomspace(_NARROWEST, 1.0, _WIDTHS):
        points = [x.copy() for x in (fit.shared, *fit.points)]
        for x in points:
            x[place], x[gone] = np.clip(x[gone], c.low, c.high), 0.0
            x[others] = [share * coordinates[i].high for i in others]
        start = fitter.placed(fit, instead_of(coordinates, fit, gone, place), points[0], points[1:])
        if start is not None:
            starts.append(fitter.assess(start, noise))
    return starts
