"""What a search found: the most probable supposition, what cannot be told from it, and how sure that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.diagnosis.catalogue import push_alike
from cosim.diagnosis.fit.fitting import EFFECT, Fit
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.fit.predict import Coordinate
from cosim.diagnosis.search.detectable import Shown, told

APART = 3.0  # sigma: rivals closer than this cannot be told from the best
# sigma: a rival that lacks a cause of the best cannot be told from it where it is closer than this, one chance in four
# (a judgement). Whether a further cause is there is no choice between two, for which as much is asked as above.
LACKING = 1.5
_TEMPER = 2.0  # of differences in evidence, at least: a plant of another structure errs by some units
# More of that between effects that push alike: dry drag of the axle is told from rolling resistance and slope only
# while a lash is crossed, where a plant of another structure does otherwise as well. By 11 and 17 units the wrong one
# stood first.
_PUSH_ALIKE = 2.0
# Probability of nothing wrong from which on no cause is named, even if one leads: one chance in three, a judgement.
_NOTHING = 1.0 / 3.0


@dataclass
class Identification:
    """What the search found.

    Attributes:
        best: The most probable supposition; no causes where nothing is significantly wrong. Of those that do the same
            the best, where they are together more probable than any other.
        alternatives: All suppositions that were fitted, ``best`` first, then by evidence.
        healthy: The supposition without causes.
        noise: Under which they were compared.
        alike: Groups of causes that do the same in these recordings.
        coordinates: All that was fitted.
        detectable: Smallest sizes of every cause that they would show, by its place among the coordinates.
        temper: By what differences in evidence are divided before they are odds (``tempered``).
    """

    best: Fit
    alternatives: list[Fit]
    healthy: Fit
    noise: Noise
    alike: list[tuple[str, ...]]
    coordinates: Sequence[Coordinate]
    detectable: dict[int, Shown]
    temper: float = _TEMPER

    def shares(self) -> np.ndarray:
        """Of the suppositions in the evidence of all, which add up to 1."""
        weights = np.array([self.odds(fit) for fit in self.alternatives])
        return weights / weights.sum()

    def odds(self, fit: Fit) -> float:
        """Of a supposition over the best; more than 1 where the best is one of several that do the same."""
        return float(np.exp(-self.lead(fit) / self.temper))

    def lead(self, fit: Fit) -> float:
        """Log evidence of the best over another supposition, as far as it tells them apart.

        By what the fits reached, or by what their derivatives promise if that is less: a settled fit that falls short
        of the promise is in a worse minimum, and so not refuted.
        """
        reached = self.best.score - fit.score
        return trusted(min(reached, max(self.best.hope - fit.hope, 0.0)) if fit.near else reached, self.best, fit)

    def apart(self, fit: Fit) -> float:
        """How far a supposition is from the best [sigma]."""
        return separation(self.lead(fit), self.temper)

    def significant(self) -> Identification:
        """The same, with nothing wrong as the best where no cause is significant.

        That is where nothing has one chance in three, or no cause is as large as these runs would show: more evidence
        than such a size has is none for it, but that one fit got further than another.
        """
        nothing = sum(share for fit, share in zip(self.alternatives, self.shares()) if not fit.causes)
        if not self.best.causes or nothing < _NOTHING and any(self._shows(cause) for cause in self.best.causes):
            return self
        others = [fit for fit in self.alternatives if fit.causes]
        return replace(self, best=self.healthy, alternatives=[self.healthy, *others])

    def told_without(self, fit: Fit) -> float:
        """How far the best has to be from what lacks some of its causes to be told from it [sigma].

        As far as from any other where each of these is smaller than the runs would show.
        """
        lacking = set(self.best.causes) - set(fit.causes)
        return LACKING if any(self._shows(cause) for cause in lacking) else APART

    def _shows(self, cause: str) -> bool:
        """Whether a cause of the best is large enough to be named; of several that do the same each may be smaller, as
        they are as many chances that one of them is there."""
        same = next((group for group in self.alike if cause in group), (cause,))
        needed = named_from(self.temper)
        return told(self.detectable, self.coordinates, self.best.shared, cause, needed) >= (
            needed - self.temper * np.log(len(same)))


def trusted(lead: float, one: Fit, other: Fit) -> float:
    """A lead of one supposition over another in log evidence, as far as it tells them apart."""
    return lead / _PUSH_ALIKE if push_alike(one.effects, other.effects) else lead


def tempered(scatter: float) -> float:
    """By what differences in evidence are divided before they are odds.

    A plant of another structure errs by some units. And the best of a few fits of a supposition is not the best there
    is, but by about as much short of it as it is better than the next: the odds of a lead with such an error, normally
    distributed (MacKay, *Neural Computation* 4 (1992), 720: of a logistic function's mean).

    Args:
        scatter: By how much the best of some fits of the same supposition is better than the next [log evidence].
    """
    return float(np.hypot(_TEMPER, np.sqrt(np.pi / 8.0) * scatter))


def named_from(temper: float) -> float:
    """Log evidence over the healthy car from which on a cause is named, if no other may be there."""
    return -EFFECT + temper * float(np.log(1.0 / _NOTHING - 1.0))


def separation(lead: float, temper: float = _TEMPER) -> float:
    """A lead in log evidence as a distance [sigma]."""
    return max(float(signed(lead, temper)), 0.0)


def signed(lead: np.ndarray | float, temper: float = _TEMPER) -> np.ndarray:
    """Leads as distances [sigma], negative behind."""
    return np.sign(lead) * np.sqrt(2.0 * np.abs(lead) / temper)
