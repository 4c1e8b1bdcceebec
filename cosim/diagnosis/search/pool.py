"""The suppositions that were fitted so far, which of them count, and the noise under which they are compared."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from cosim.diagnosis.fit.fitting import SETTLED, Fit, Fitter
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.fit.predict import amplitude

SMALLEST = 0.9  # of a cause, in detection limits: less is what healthy cars differ by, or an error of another's fit
REFITTED = 4  # of the likeliest that get a fit of their own at once
SWAPPED = 400.0  # log evidence below the leader within which new derivatives may still put one before another: where
# one cause stands for the true one, its run is bent about it, and that is worth more than noise
_UNEXPLAINED = 40.0  # of minus twice the log likelihood of a run: leaves half of what it says
_DOUBTS_ALIKE = 1.2  # ratio of temperatures below which they are the same
_KEPT = 24  # fits


class Pool:
    """Fits of different suppositions, one of each.

    Args:
        fitter: Of the runs.
        noise: Under which they are compared.

    Attributes:
        fits: By their causes.
        judged: The causes of the settled leader whose noise it is; None before there is one.
        plain, noise: That noise, and the same with doubts.
    """

    def __init__(self, fitter: Fitter, noise: Noise) -> None:
        self.fitter, self.coordinates = fitter, fitter.coordinates
        self.fits: dict[tuple[str, ...], Fit] = {}
        self.judged: tuple[str, ...] | None = None
        self.plain = self.noise = noise

    # -- which count ------------------------------------------------------------------------------

    def ranked(self) -> list[Fit]:
        """All, the likeliest first."""
        return sorted(self.fits.values(), key=lambda fit: -fit.score)

    def worthy(self) -> list[Fit]:
        """Those whose causes are large enough to be some, the likeliest first."""
        return [fit for fit in self.ranked() if self.worth(fit)]

    def worth(self, fit: Fit) -> bool:
        """Whether all its causes are large enough to be some, and beside others clear or in more than one recording.

        And plausible, once its derivatives are its own: on its way a fit may touch a limit.
        """
        return (not fit.near or self.plausible(fit)) and self.large(fit) and all(
            self._shows(fit, cause) for cause in fit.causes)

    def large(self, fit: Fit) -> bool:
        """Whether all its causes are large enough to be some."""
        return self.large_of(fit) == fit.causes

    def large_of(self, fit: Fit) -> tuple[str, ...]:
        """Those of its causes that are large enough to be some."""
        return tuple(cause for cause in fit.causes if self.size(fit, cause) >= SMALLEST)

    def plausible(self, fit: Fit) -> bool:
        """Whether no parameter of a cause is at a limit, as far as healthy cars differ: it would have to be beyond."""
        return all(c.plausible(x) for x, c in zip(fit.shared, self.coordinates) if c.cause in fit.causes)

    def size(self, fit: Fit, cause: str) -> float:
        """How large a cause is, in detection limits; the least of its numbers where none does anything alone."""
        places = self.fitter.predictor.index(cause)
        found = [fit.shared[i] / self.coordinates[i].parameter.detection for i in places]
        swings = [x for i, x in zip(places, found) if self.coordinates[i].run is not None]
        if swings:  # two components for each run
            return amplitude(swings)
        return float(np.min(np.abs(found)))

    def _shows(self, fit: Fit, cause: str) -> bool:
        without = self.fits.get(fit.without(cause))
        return without is None or not without.causes or self.fitter.shows(fit, without)

    def is_near(self, causes: tuple[str, ...]) -> bool:
        """Whether a supposition was fitted by derivatives of its own."""
        fit = self.fits.get(causes)
        return fit is not None and fit.near

    # -- in and out -------------------------------------------------------------------------------

    def enter(self, fits: Iterable[Fit]) -> None:
        """Take in suppositions that are new, or fitted better than before; let go of the least likely."""
        for fit in fits:
            if fit.causes not in self.fits or fit.score > self.fits[fit.causes].score:
                self.fits[fit.causes] = fit
        for fit in self.ranked()[_KEPT:]:  # each holds all its derivatives
            if fit.causes:
                del self.fits[fit.causes]

    def refined(self, fit: Fit, noise: Noise | None = None) -> Fit:
        """Fitted by the derivatives it has, under the noise of the comparison or another one."""
        return self.fitter.assess(self.fitter.refine(fit, noise or self.noise, 3), self.noise)

    def brought_near(self, start: Fit) -> Fit:
        """Fitted by derivatives by its causes and the runs' own until they gain no more."""
        return self.fitter.settle(self.refined(start), self.noise, everything=False)

    def settled(self, start: Fit) -> Fit:
        """Fitted by derivatives by everything, taken where it is, until they gain no more."""
        return self.fitter.settle(self.fitter.assess(self.fitter.relinearise(start), self.noise), self.noise)

    def settle(self, fit: Fit, everything: bool = True) -> Fit:
        """Fitted in its place until new derivatives, by everything or as ``brought_near``, gain no more."""
        return self.settle_all([fit], everything)[0]

    def settle_all(self, fits: Iterable[Fit], everything: bool = True) -> list[Fit]:
        """``settle``, of each."""
        settled = self.fitter.predictor.at_once(
            [partial(self.fitter.settle, fit, self.noise, everything) for fit in fits])
        self.fits |= {fit.causes: fit for fit in settled}
        return settled

    # -- the noise --------------------------------------------------------------------------------

    def judge_by(self, leader: Fit) -> None:
        """Compare under the noise of another leader; who is near it is fitted to that."""
        self.judged, self.plain = leader.causes, self.fitter.noise(leader)
        self._compare(self.doubted())
        near = self.nearest()
        for fit, moved in zip(near, self.fitter.predictor.at_once([partial(self.refined, fit) for fit in near])):
            still = moved.score - fit.score < SETTLED
            moved.near, moved.settled = fit.near and still, fit.settled and still
            self.enter([moved])

    def nearest(self) -> list[Fit]:
        """The likeliest, as far as new derivatives may still put one before another."""
        first, *others = self.ranked()[:REFITTED]
        return [first, *(fit for fit in others if first.score - fit.score < SWAPPED)]

    @property
    def doubtful(self) -> bool:
        """Whether a run counts for less than it says."""
        return self.noise.temperatures.max() > _DOUBTS_ALIKE

    def doubted(self) -> Noise:
        """The leader's noise, but a run counts for less that no supposition explains.

        Then its fits are in one minimum or another, and which of them is best is luck.
        """
        costs = []
        for fit in self.fits.values():
            heavy, _ = self.plain.heavy(self.fitter.residuals(fit.predicted))
            costs.append(self.fitter.run_costs(heavy, fit))
        sizes = np.array([run.stacked.size for run in self.fitter.predictor.runs])
        unexplained = np.min(costs, axis=0) - sizes - np.sqrt(2.0 * sizes)  # chi square, one sigma above
        return self.plain.tempered(1.0 + np.maximum(unexplained, 0.0) / _UNEXPLAINED)

    @contextmanager
    def trusting(self) -> Iterator[Noise]:
        """As if no run were doubtful: under a noise by which they all count for what they say."""
        self._compare(self.plain)
        try:
            yield self.plain
        finally:
            self._compare(self.doubted())

    def doubt_again(self) -> None:
        """What came in may explain a run that nothing did before."""
        noise = self.doubted()
        change = noise.temperatures / self.noise.temperatures
        if max(change.max(), 1.0 / change.min()) > _DOUBTS_ALIKE:
            self._compare(noise)

    def _compare(self, noise: Noise) -> None:
        self.noise = noise
        for fit in self.fits.values():
            self.fitter.assess(fit, noise)
