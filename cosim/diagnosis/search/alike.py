"""Causes that do the same in given recordings, found before anything is fitted.

On a road without turns nothing tells a slope from rolling resistance. Fitting both to find that out costs as much as
finding the cause, and which of them ends up a little better is luck. So of those that the derivatives at the vehicle
file cannot tell apart only one is looked for, that which can be largest to either side; the others are put in its place
when it was found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cosim.diagnosis.fit.evidence import Evidence, prior
from cosim.diagnosis.fit.predict import Coordinate

LARGE = 4.0  # detection limits: what cannot be told apart at this size is not told apart at a smaller one
NEAR = 3.0  # sigma


def alike(evidence: Evidence, coordinates: Sequence[Coordinate], causes: Sequence[str]) -> list[tuple[str, ...]]:
    """Groups of causes any of which imitates any other, nuisances and what healthy cars differ by helping.

    Args:
        evidence: What the runs say at the vehicle file.
        coordinates: Of which.
        causes: Which to compare; those that do nothing while they are small, or differ from run to run, are like no
            other.

    Returns:
        Groups of two or more. First of each is the cause that does most at its bounds, to either side: what drags
        can stand for a slope uphill, not for one downhill.
    """
    sizes = {cause: _sizes(coordinates, cause) for cause in causes}
    plain = prior(coordinates, ())
    shown = [cause for cause in causes if sizes[cause]
             and all(evidence.separation(size, plain) > NEAR for size in sizes[cause])]
    same = {(one, other): _imitates(evidence, coordinates, sizes[one], other)
            for one in shown for other in shown if one != other}
    groups: list[tuple[str, ...]] = []
    for cause in shown:
        for k, group in enumerate(groups):
            if all(same[cause, other] and same[other, cause] for other in group):
                groups[k] = (*group, cause)
                break
        else:
            groups.append((cause,))
    return [tuple(sorted(group, key=lambda cause: _reach(evidence, coordinates, cause), reverse=True))
            for group in groups if len(group) > 1]


def instead(evidence: Evidence, coordinates: Sequence[Coordinate], shared: np.ndarray, gone: str,
            other: str) -> np.ndarray:
    """The change of shared coordinates that puts another cause where one was, doing the same.

    Args:
        evidence: What the runs say at the vehicle file.
        coordinates: Of which.
        shared: With the cause that goes.
        gone, other: Which goes, and which takes its place.
    """
    leaves = np.array([x if c.cause == gone else 0.0 for c, x in zip(coordinates, shared)])
    return evidence.imitated(leaves, prior(coordinates, (other,))) - leaves


def _sizes(coordinates: Sequence[Coordinate], cause: str) -> list[np.ndarray]:
    """The cause alone, large, in each of its parameters; none where derivatives do not say what it does."""
    mine = [i for i, c in enumerate(coordinates) if c.cause == cause]
    if any(coordinates[i].run is not None or coordinates[i].parameter.probes for i in mine):
        return []
    return _alone(coordinates, mine, lambda c: LARGE * c.parameter.detection)


def _reach(evidence: Evidence, coordinates: Sequence[Coordinate], cause: str) -> float:
    """What a cause shows at its nearer bound [sigma], of several parameters the one that shows least there."""
    plain, mine = prior(coordinates, ()), [i for i, c in enumerate(coordinates) if c.cause == cause]
    return min(evidence.separation(end, plain) for end in _alone(coordinates, mine, lambda c: min(-c.low, c.high)))


def _alone(coordinates: Sequence[Coordinate], places: Sequence[int],
           size: Callable[[Coordinate], float]) -> list[np.ndarray]:
    """One coordinate after the other at some size of its own, all others 0."""
    return [size(coordinates[i]) * (np.arange(len(coordinates)) == i) for i in places]


def _imitates(evidence: Evidence, coordinates: Sequence[Coordinate], sizes: Sequence[np.ndarray], other: str) -> bool:
    return all(evidence.separation(size, prior(coordinates, (other,))) < NEAR for size in sizes)
