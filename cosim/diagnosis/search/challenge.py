"""Whoever leads is challenged by every cause added, dropped or swapped, ranked by derivatives and fitted by simulation.

Derivatives of the leader say what each might explain; those that promise most are simulated where the derivatives
place them, and fitted from there. Rivals that have derivatives of their own are asked as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cosim.diagnosis.fit.evidence import Evidence, prior
from cosim.diagnosis.fit.fitting import Fit
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.search.pool import REFITTED, SWAPPED, Pool
from cosim.diagnosis.search.scan import key, renamed

MOST_CAUSES = 9
_PROMISING = 25.0  # linear log evidence below the leader at which a supposition with a cause more is not looked at
_BESIDE = 3  # further causes that are fitted from where the leader is as well
# Suppositions that are simulated where the leader's tangents place them, with a cause more and without; of which are
# fitted, and as if no run were doubtful. Apart, as every cause that is not there gains its log prior, and one that
# stands for the true one promises less than all of these.
_STARTED = (20, 6)
_SHORTLIST, _SHORTLIST_PLAIN = (6, 3), (3, 2)
# Log evidence below the leader at which a rival gets derivatives of its own. More beside a leader of so many causes
# that nothing is scanned in place of each: there the right cause, 7 behind, stood at 17 as long as it had none.
_RIVAL, _RIVAL_OF_MANY = 12.0, 25.0
SWAPPED_CAUSES = 3
_ADVISERS, _ADVISED = 4, 2  # rivals whose derivatives are asked as well; of what they promise are fitted
_SHORT = 3.0  # log evidence below what the leader's derivatives promise at which a settled rival is fitted again


class Challenge:
    """Lets others take the lead if they can.

    Args:
        pool: Of the search.
        causes: Which are looked for.

    Attributes:
        challenged: The leader that was challenged last.
        tried: Settled rivals that were fitted again from there.
    """

    def __init__(self, pool: Pool, causes: Sequence[str]) -> None:
        self.pool, self.fitter, self.causes = pool, pool.fitter, list(causes)
        self.challenged: Fit | None = None
        self.tried: set[tuple[str, ...]] = set()

    def __call__(self, leader: Fit) -> bool:
        """Whether any came close enough to be settled, or leads now."""
        hopes = self.challengers(leader, self.pool.noise, _SHORTLIST)
        if self.pool.doubtful:  # what it would take to explain the doubtful runs as well
            self.challengers(leader, self.pool.plain, _SHORTLIST_PLAIN)
        self.pool.enter(self.advised(leader, hopes))
        self.pool.doubt_again()
        # what derivatives promise counts as well, its own and the leader's: a fit that fell short may be in another
        # minimum
        behind = {fit.causes: min(leader.score - fit.score, leader.hope - fit.hope) for fit in self.pool.fits.values()}
        behind |= {s: min(behind[s], -hope) for s, hope in hopes.items() if s in behind}
        least = _RIVAL if len(leader.causes) <= SWAPPED_CAUSES else _RIVAL_OF_MANY
        close = [fit for fit in self.pool.worthy() if not fit.near and behind[fit.causes] < least]
        self.pool.settle_all(sorted(close, key=lambda fit: behind[fit.causes])[:REFITTED], everything=False)
        return bool(close) or self.pool.worthy()[0] is not leader

    def candidates(self, fit: Fit, evidence: Evidence) -> list[tuple[float, tuple[str, ...]]]:
        """Every cause added to those of ``fit`` or put in place of one, or taken away, most evident first.

        Args:
            fit: From which.
            evidence: What the runs say at its points.

        Returns:
            Linear log evidence over that of ``fit``, and the causes.
        """
        sets: set[tuple[str, ...]] = set()
        for cause in self.causes:
            if cause not in fit.causes:
                sets.add(key((*fit.causes, cause)))
                sets.update(key((*fit.without(gone), cause)) for gone in fit.causes)
        sets.update(fit.without(gone) for gone in fit.causes)

        def score(causes: tuple[str, ...]) -> float:
            spread = prior(self.fitter.coordinates, causes)
            return evidence.posterior(spread).log_evidence + self.fitter.log_prior(causes)

        own = score(fit.causes)
        return sorted(((score(s) - own, s) for s in sets if len(s) <= MOST_CAUSES), reverse=True)

    def start(self, best: Fit, causes: tuple[str, ...], evidence: Evidence) -> Fit:
        """Where the fit of a supposition begins: where it would be if the tangents of another one's were right.

        A small step that way is no way there: on it the old cause is missing already and the new one not there.
        """
        placed = self.fitter.placed(best, causes, *self.fitter.most_probable(evidence, causes))
        return placed or renamed(best, causes)

    def settled(self, fit: Fit, causes: tuple[str, ...], evidence: Evidence) -> Fit:
        """A supposition fitted from where the derivatives of another place it.

        Its score counts with derivatives of its own, as that of the one it may replace does.
        """
        return self.pool.brought_near(self.fitter.assess(self.start(fit, causes, evidence), self.pool.noise))

    def challengers(self, leader: Fit, noise: Noise, counts: tuple[int, int]) -> dict[tuple[str, ...], float]:
        """Put into the pool what may explain more than the leader does under a noise; returns what was promised.

        Fitted with the derivatives of the leader, which say which these are.
        """
        evidence = self.fitter.judged(leader, noise)
        own = self.fitter.assess(replace(leader), noise).hope
        promising = {s: lead for lead, s in self.candidates(leader, evidence)
                     if lead > -(_PROMISING if len(s) > len(leader.causes) else SWAPPED)}
        fresh = [s for s in promising if not self.pool.is_near(s)]
        further = [s for s in fresh if len(s) > len(leader.causes)]
        starts, at_once = [], self.fitter.predictor.at_once
        for sets, tried, count in zip((further, [s for s in fresh if s not in further]), _STARTED, counts):
            tries = at_once([lambda s=s: self.fitter.assess(self.start(leader, s, evidence), noise)
                             for s in sets[:tried]])
            starts += sorted(tries, key=lambda fit: -max(fit.hope - own, promising[fit.causes]))[:count]
        # where the derivatives place them all at once, single runs may be in worse minima than the leader's
        starts += [renamed(leader, s) for s in further[:_BESIDE]]
        stuck = self.stuck(leader, promising) if noise is self.pool.noise else []
        self.pool.enter(at_once([partial(self.pool.refined, start, noise) for start in starts]))
        self.pool.enter(at_once([partial(self.settled, leader, causes, evidence) for causes in stuck]))
        return promising

    def advised(self, leader: Fit, promising: Mapping[tuple[str, ...], float]) -> list[Fit]:
        """Fits of what others with derivatives of their own promise, and the leader's do not, each once for a leader.

        A cause in place of the leader's may be where lashes are crossed at other moments. From where it is alone it is
        seen what it would do beside the others. Only what promises more than the leader, or does with as few causes.
        """
        advice: dict[tuple[str, ...], tuple[float, Fit, Evidence]] = {}
        for fit in [fit for fit in self.pool.ranked() if fit.near and fit is not leader][:_ADVISERS]:
            evidence = self.fitter.judged(fit, self.pool.noise)
            for lead, causes in self.candidates(fit, evidence):
                lead += fit.hope - leader.hope
                known = max(promising.get(causes, -np.inf), advice.get(causes, (-np.inf,))[0])
                least = -_RIVAL if len(causes) <= len(leader.causes) else 0.0
                if not self.pool.is_near(causes) and causes not in self.tried and lead > max(least, known + _SHORT):
                    advice[causes] = lead, fit, evidence
        best = sorted(advice, key=lambda causes: -advice[causes][0])[:_ADVISED]
        self.tried.update(best)
        return self.fitter.predictor.at_once([partial(self.settled, fit, causes, evidence)
                                              for causes in best for _, fit, evidence in [advice[causes]]])

    def stuck(self, leader: Fit, promising: Mapping[tuple[str, ...], float]) -> list[tuple[str, ...]]:
        """Settled rivals that fall short of what the leader's derivatives or their own promise, each once for a leader.

        They are in another minimum than the leader: lashes are crossed at other moments.
        """
        if leader is not self.challenged:
            self.challenged, self.tried = leader, set()
        near = {s: self.pool.fits[s] for s in promising if self.pool.is_near(s) and s not in self.tried}
        leads = {s: max(promising[s], fit.hope - leader.hope) for s, fit in near.items()}
        stuck = [s for s, lead in leads.items() if lead > -_RIVAL and leader.score + lead > near[s].score + _SHORT]
        self.tried.update(stuck[:REFITTED])
        return stuck[:REFITTED]
