"""Where fits begin: every cause beside those of a supposition, simulated at several sizes before anything is fitted.

A fit that begins without a cause that is there bends everything else towards what is missing, and meets flanks that
are not the right ones; one that begins at a size nearby may do so too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from cosim.diagnosis.fit.fitting import Fit, Fitter
from cosim.diagnosis.fit.noise import Noise

SMALL, LARGE = (-1.5, 1.5), (-4.0, 4.0)  # sizes of probes, in detection limits
_SCANNED = 12  # probes that are fitted
_SIZED = 8  # causes of which the best size is looked for
# The size of a probe is looked for between these multiples of it, by so many simulations; several together by so many,
# which begin with the probe and what has one of its sizes by that smaller.
_AROUND, _TRIED = (0.3, 2.5), 7
_SMALLER, _TRIED_TOGETHER = 0.6, 25
_GAP = ".half_gap"  # how parameters of the plant end that are one
_RESIZED = (0.4, 0.7, 1.5, 2.5)  # times as large as it is a cause that was fitted is tried


class Scan:
    """Starts of fits.

    Args:
        fitter: Of the runs.
    """

    def __init__(self, fitter: Fitter) -> None:
        self.fitter, self.predictor, self.coordinates = fitter, fitter.predictor, fitter.predictor.coordinates

    def starts(self, start: Fit, causes: Iterable[str], noise: Noise) -> list[Fit]:
        """Every cause beside those of a start, where it explains most at once.

        Args:
            start: Whose coordinates the others keep.
            causes: Which; those that ``start`` has already are left out.
            noise: Under which they are compared.

        Returns:
            The dozen that promise most, at most two of a cause, not fitted yet.
        """
        probes = self.probes(start, causes, (*SMALL, *LARGE))
        at_once = self.predictor.at_once
        points = at_once([partial(self.fitter.assess, probe, noise) for probe in probes])
        points += at_once([partial(self.sized, start, fit, noise) for fit in best_of_each(points, 1)[:_SIZED]])
        return best_of_each(points, 2)[:_SCANNED]

    def probes(self, best: Fit, causes: Iterable[str], sizes: Sequence[float]) -> list[Fit]:
        """Starts for causes beside those of a fit, each at several sizes.

        Args:
            best: Whose coordinates the others keep.
            causes: Which.
            sizes: In detection limits; those that do nothing while they are small have sizes of their own.
        """
        placing: list[Callable[[], Fit | None]] = []
        for cause in causes:
            mine = self._sizes_of(cause)
            if cause in best.causes or not mine:
                continue
            declared = {i: self.coordinates[i].parameter for i in mine if self.coordinates[i].parameter.probes}
            tries: list[dict[int, float]] = []
            for k in range(max((len(p.probes) for p in declared.values()), default=0)):
                tries.append({i: p.coordinate(p.probes[min(k, len(p.probes) - 1)]) for i, p in declared.items()})
            if not tries:
                first, c = mine[0], self.coordinates[mine[0]]
                tried = [x * c.parameter.detection for x in sizes]
                tries = [{first: x} for x in tried if c.low <= x <= c.high]
            placing += [partial(self._placed, best, cause, changes) for changes in tries]
        return [start for start in self.predictor.at_once(placing) if start is not None]

    def silent(self, causes: Iterable[str]) -> list[str]:
        """Those of some causes that do nothing while they are small, so that derivatives say nothing of them."""
        return [cause for cause in causes if any(self.coordinates[i].parameter.probes for i in self._sizes_of(cause))]

    def gaps(self, causes: Iterable[str]) -> list[str]:
        """Those of some causes that change how large gaps are, and so when they are crossed."""
        return [cause for cause in causes if any(target.endswith(_GAP) for i in self._sizes_of(cause)
                                                 for target in self.coordinates[i].parameter.targets)]

    def sized(self, start: Fit, probe: Fit, noise: Noise) -> Fit:
        """A probe at the size that explains most, before everything else is fitted to a size that is not right.

        What it would explain with linear nuisances is smooth in the size over many crossings of the lash; what fits
        reach from sizes nearby is not.
        """
        [added] = set(probe.causes) - set(start.causes)
        mine = [i for i in self._sizes_of(added) if probe.shared[i]]
        sizes, tried = probe.shared[mine], [probe]

        def fall(x: np.ndarray) -> float:
            fit = self._placed(start, added, dict(zip(mine, np.atleast_1d(x))))
            if fit is None:
                return np.inf
            tried.append(self.fitter.assess(fit, noise))
            return -fit.hope

        low, high = (np.array([getattr(self.coordinates[i], end) for i in mine]) for end in ("low", "high"))
        least, most = np.sort([np.clip(share * sizes, low, high) for share in _AROUND], axis=0)
        if len(mine) == 1:
            minimize_scalar(fall, bounds=(least[0], most[0]), method="bounded", options={"maxiter": _TRIED})
        else:
            corners = [sizes, *(np.where(np.arange(len(mine)) == k, _SMALLER * sizes, sizes) for k in range(len(mine)))]
            minimize(fall, sizes, method="Nelder-Mead", bounds=list(zip(least, most)),
                     options={"initial_simplex": corners, "maxfev": _TRIED_TOGETHER})
        return max(tried, key=lambda fit: fit.hope)

    def resized(self, fit: Fit) -> list[Fit]:
        """A fit with each size of its causes larger and smaller than it is, and all else as it is."""
        placing: list[Callable[[], Fit | None]] = []
        for cause in fit.causes:
            without = renamed(fit, fit.without(cause))
            for i in self._sizes_of(cause):
                c, here = self.coordinates[i], fit.shared[i]
                sizes = dict.fromkeys(float(np.clip(times * here, c.low, c.high)) for times in _RESIZED)
                placing += [partial(self._placed, without, cause, {i: size}) for size in sizes if size != here]
        return [start for start in self.predictor.at_once(placing) if start is not None]

    def _sizes_of(self, cause: str) -> list[int]:
        """Coordinates of a cause that all runs have in common."""
        return [i for i in self.predictor.index(cause) if self.coordinates[i].run is None]

    def _placed(self, start: Fit, cause: str, changes: Mapping[int, float]) -> Fit | None:
        """A start with a further cause and some coordinates changed; None where that cannot be simulated."""
        shared, *points = (_changed(vector, changes) for vector in (start.shared, *start.points))
        return self.fitter.placed(start, key((*start.causes, cause)), shared, points)


def best_of_each(fits: Iterable[Fit], count: int) -> list[Fit]:
    """Of each supposition the starts that promise most evidence, best first."""
    chosen: list[Fit] = []
    for start in sorted(fits, key=lambda fit: -fit.hope):
        if sum(fit.causes == start.causes for fit in chosen) < count:
            chosen.append(start)
    return chosen


def renamed(fit: Fit, causes: tuple[str, ...]) -> Fit:
    """Other causes, as yet where another fit is."""
    return Fit(causes, fit.shared, fit.points, fit.predicted, fit.tangents)


def key(causes: Iterable[str]) -> tuple[str, ...]:
    """The causes of a supposition, in the order in which they are kept."""
    return tuple(sorted(causes))


def _changed(vector: np.ndarray, changes: Mapping[int, float]) -> np.ndarray:
    vector = vector.copy()
    vector[list(changes)] = list(changes.values())
    return vector
