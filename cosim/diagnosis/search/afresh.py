"""Fits that begin in the vehicle file anew, with some causes in it and nothing else.

On the way from where a cause was missing everything else was bent towards it, and may be so still; so are the
derivatives on that way. Here they are taken anew, and everything is scanned beside those causes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from cosim.diagnosis.fit.fitting import Fit, as_found
from cosim.diagnosis.search.pool import SWAPPED, Pool
from cosim.diagnosis.search.scan import SMALL, Scan, best_of_each, renamed

_AFRESH = 2  # suppositions that are fitted by derivatives of their own where a search begins anew


class Afresh:
    """Begins in the vehicle file.

    Args:
        pool: Of the search.
        scan: Of its fitter.
        file: The vehicle file as it is, with derivatives by everything.
        causes: Which are looked for.
        opened: These alone, where each explained most in the file; none yet.

    Attributes:
        scanned: Causes beside which every other was scanned, and fitted by derivatives of its own.
    """

    def __init__(self, pool: Pool, scan: Scan, file: Fit, causes: Sequence[str], opened: Sequence[Fit]) -> None:
        self.pool, self.fitter, self.predictor = pool, pool.fitter, pool.fitter.predictor
        self.scan, self.file, self.causes, self.opened = scan, file, list(causes), list(opened)
        self.scanned: set[tuple[str, ...]] = set()

    def __call__(self, fit: Fit, causes: tuple[str, ...]) -> list[Fit]:
        """Some causes of a fit once more, with them as found; and a scan there. Once for the same causes."""
        if causes in self.scanned:
            return []
        self.scanned.add(causes)
        if not causes:  # each alone was scanned when the search began
            opened = [self.fitter.assess(fit, self.pool.noise) for fit in self.opened]
            starts = self.by_their_own(opened) + self.of_gaps(fit)
            return self.predictor.at_once([partial(self.from_file, self.file), *starts])
        start = self.in_file(fit, causes)
        if start is None:
            return []
        scanned = self.scan.starts(start, self.causes, self.pool.noise)
        others = [partial(self.pool.refined, other) for other in scanned]
        return self.predictor.at_once([partial(self.from_file, start), *self.as_scanned(causes),
                                       *self.by_their_own(scanned), *others])

    def as_scanned(self, causes: tuple[str, ...]) -> list[Callable[[], Fit]]:
        """A fit of one cause that does nothing while it is small from where it explained most in the file.

        Derivatives of the file know nothing of it, so by these its fit may have left that size for another minimum: of
        a clutch that slips in a cruise they made one that holds there, 207 units of log evidence behind.
        """
        opened = [fit for fit in self.opened if fit.causes == causes and self.scan.silent(causes)][:1]
        return [partial(self._from_there, fit) for fit in opened]

    def by_their_own(self, starts: Iterable[Fit]) -> list[Callable[[], Fit]]:
        """Fits of the best of some starts whose causes are not settled yet, by derivatives taken there.

        Where a cause moves crossings of the lash the derivatives are others, and a fit by those of the start is stuck.
        """
        fresh = [fit for fit in best_of_each(starts, 1) if not self.pool.is_near(fit.causes)][:_AFRESH]
        leader = self.pool.worthy()[0]
        return [partial(self.by_its_own, fit, leader) for fit in fresh]

    def by_its_own(self, start: Fit, leader: Fit) -> Fit:
        """A start fitted from the vehicle file by derivatives taken there; by everything where it may stand in the
        leader's place.

        By those of its causes alone a loss of the transmission was 57 units of log evidence behind an offset of the
        engine torque, and so 31 behind neither; by everything it leads by 28.
        """
        fit = self._from_there(start)
        instead = fit.score > leader.score - SWAPPED and not set(leader.causes) <= set(fit.causes)
        return self.pool.settled(fit) if instead and self.pool.large(fit) else fit

    def of_gaps(self, leader: Fit) -> list[Callable[[], Fit]]:
        """Fits of what changes gaps, from the vehicle file with it larger and smaller, by derivatives taken there.

        Until much else is fitted no size of it explains anything, as impacts are elsewhere: a scan does not show it. A
        lash elsewhere by 21 mrad was a smaller one, by 208 units of log evidence. So where nothing leads, or another
        of them.
        """
        gaps = self.scan.gaps(self.causes)
        if leader.causes and not set(leader.causes) & set(gaps):
            return []
        fresh = [cause for cause in gaps if not self.pool.is_near((cause,))]
        return [partial(self._from_there, fit) for fit in self.scan.probes(self.file, fresh, SMALL)]

    def in_file(self, fit: Fit, causes: tuple[str, ...]) -> Fit | None:
        """Some causes of a fit in the vehicle file, with derivatives taken there; None where it cannot be simulated."""
        only = renamed(fit, causes)
        shared, *points = (as_found(self.predictor, only, x) for x in (fit.shared, *fit.points))
        start = self.fitter.placed(fit, causes, shared, points)
        return start and self.fitter.assess(self.fitter.relinearise(start), self.pool.noise)

    def from_file(self, start: Fit, everything: bool = False) -> Fit:
        """Fitted from the vehicle file with its causes in it, by everything or as ``brought_near``."""
        cooled = self.fitter.cooled(start, self.pool.noise)
        return self.pool.settled(cooled) if everything else self.pool.brought_near(cooled)

    def by_everything(self, starts: Iterable[Fit]) -> list[Fit]:
        """Some starts with nothing but their causes, by everything; without those that cannot be simulated."""
        anew = [there for start in starts if (there := self.in_file(start, start.causes))]
        return self.predictor.at_once([partial(self.from_file, fit, everything=True) for fit in anew])

    def _from_there(self, start: Fit) -> Fit:
        """As ``from_file``, by derivatives taken where it starts."""
        return self.from_file(self.fitter.relinearise(start))
