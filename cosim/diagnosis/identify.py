"""Which effects explain what a simulation gets wrong, how sure that is, and what cannot be told apart.

A *supposition* is a set of causes: their parameters may be anything plausible, all others only what a
healthy car's are. A cause is an effect of the catalogue, or one parameter of an effect whose parameters mean
something alone. Of causes that do the same in these recordings one is looked for (``alike``). Every cause alone is
simulated at several sizes, and the best of these are fitted (``scan``); so is every cause beside whoever leads
then, and in place of each of its causes, from the vehicle file anew. Whoever leads is challenged by every cause added,
dropped or swapped, which its derivatives rank; those that may win are fitted by simulation and compared under one
noise. At last those that do the same take the places of what was found. ``docs/diagnosis.md`` says why.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.diagnosis.alike import alike, instead
from cosim.diagnosis.detectable import detectable
from cosim.diagnosis.evidence import Evidence, prior
from cosim.diagnosis.fitting import EFFECT, SETTLED, Fit, Fitter, as_found
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.predict import Predictor
from cosim.diagnosis.scan import Scan, best_of_each, key

log = logging.getLogger("cosim")

MOST_CAUSES = 9
APART = 3.0  # sigma: rivals closer than this cannot be told from the best
SMALLEST = 0.9  # of a cause, in detection limits: less is what healthy cars differ by, or an error of another's fit
_AFRESH = 2  # suppositions that are fitted by derivatives of their own where a search begins anew
# Linear log evidence below the leader at which a supposition is not looked at: with a cause more, and without;
# where another cause stands for the true one its run is bent about it, and that is worth more than noise.
_PROMISING, _SWAPPED = 25.0, 400.0
_SWAPPED_CAUSES = 3  # of a leader, at most, where everything is scanned in place of each
_BESIDE = 3  # further causes that are fitted from where the leader is as well
# Suppositions that are simulated where the leader's tangents place them, with a cause more and without; of which are
# fitted, and as if no run were doubtful. Apart, as every cause that is not there gains its log prior, and one that
# stands for the true one promises less than all of these.
_STARTED = (20, 6)
_SHORTLIST, _SHORTLIST_PLAIN = (6, 3), (3, 2)
_RIVAL, _RIVALS = 12.0, 4  # log evidence below the leader at which a rival gets derivatives of its own; how many
_ADVISERS, _ADVISED = 4, 2  # rivals whose derivatives are asked as well; of what they promise are fitted
_SHORT = 3.0  # log evidence below what the leader's derivatives promise at which a settled rival is fitted again
_UNEXPLAINED = 40.0  # of minus twice the log likelihood of a run: leaves half of what it says
_DOUBTS_ALIKE = 1.2  # ratio of temperatures below which they are the same
_TEMPER = 2.0  # of differences in evidence: a plant of another structure errs by some units
_TURNS = 30  # steps of the search, at most; some three a cause
_KEPT = 24  # fits


@dataclass
class Identification:
    """What the search found.

    Attributes:
        best: The most probable supposition; no causes where nothing is wrong. Of those that do the same the best, where
            they are together more probable than any other.
        alternatives: All suppositions that were fitted, ``best`` first, then by evidence.
        healthy: The supposition without causes.
        noise: Under which they were compared.
        alike: Groups of causes that do the same in these recordings.
        detectable: Smallest size of every cause that they would show, by its place among the coordinates.
    """

    best: Fit
    alternatives: list[Fit]
    healthy: Fit
    noise: Noise
    alike: list[tuple[str, ...]]
    detectable: dict[int, float]

    def shares(self) -> np.ndarray:
        """Of the suppositions in the evidence of all, which add up to 1."""
        weights = np.exp([-self.lead(fit) / _TEMPER for fit in self.alternatives])
        return weights / weights.sum()

    def lead(self, fit: Fit) -> float:
        """Log evidence of the best over another supposition.

        By what the fits reached, or by what their derivatives promise if that is less: a settled fit that falls short
        of the promise is in a worse minimum, and so not refuted.
        """
        reached = self.best.score - fit.score
        return min(reached, max(self.best.hope - fit.hope, 0.0)) if fit.near else reached

    def apart(self, fit: Fit) -> float:
        """How far a supposition is from the best [sigma]."""
        return separation(self.lead(fit))


class Search:
    """Finds the suppositions that explain the runs of a predictor.

    Args:
        predictor: Over all runs.
        say: Told what happens.

    Attributes:
        pool: What was fitted so far, by its causes.
        file: The vehicle file as it is, ``first``, what the runs say there, and ``opened``, every cause at its best.
        causes: Which are looked for: of each group of ``alike`` the first.
        judged: The causes of the settled leader whose noise it is compared under; None before there is one.
        plain, noise: That noise, and the same with doubts.
        challenged: The leader that was challenged last.
        tried: Settled rivals that were fitted again from there.
        scanned: Causes beside which every other was scanned.
        cooled: Whether no cause was fitted from the vehicle file as those with causes are.
    """

    file: Fit
    first: Evidence
    opened: list[Fit]
    alike: list[tuple[str, ...]]
    judged: tuple[str, ...] | None
    plain: Noise
    noise: Noise

    def __init__(self, predictor: Predictor, say: Callable[[str], None] = log.info) -> None:
        self.predictor, self.fitter, self.say = predictor, Fitter(predictor), say
        self.scan = Scan(self.fitter)
        self.coordinates = predictor.coordinates
        self.pool: dict[tuple[str, ...], Fit] = {}
        self.challenged: Fit | None = None
        self.tried: set[tuple[str, ...]] = set()
        self.scanned: set[tuple[str, ...]] = set()
        self.cooled = False
        self.causes = list(dict.fromkeys(c.cause for c in self.coordinates if c.cause))

    def worth(self, fit: Fit) -> bool:
        """Whether all its causes are large enough to be some, and beside others clear or in more than one recording.

        And plausible, once its derivatives are its own: on its way a fit may touch a limit.
        """
        return (not fit.near or self._plausible(fit)) and all(
            self.size(fit, cause) >= SMALLEST and self._shows(fit, cause) for cause in fit.causes)

    def _plausible(self, fit: Fit) -> bool:
        """Whether no parameter of a cause is at a limit, as far as healthy cars differ: it would have to be beyond."""
        return all(c.low + c.tolerance < x < c.high - c.tolerance or abs(x) < c.tolerance
                   for x, c in zip(fit.shared, self.coordinates) if c.cause in fit.causes)

    def _shows(self, fit: Fit, cause: str) -> bool:
        without = self.pool.get(fit.without(cause))
        return without is None or not without.causes or self.fitter.shows(fit, without)

    # -- screening ------------------------------------------------------------------------------

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
            return evidence.posterior(prior(self.coordinates, causes)).log_evidence + self.fitter.log_prior(causes)

        own = score(fit.causes)
        return sorted(((score(s) - own, s) for s in sets if len(s) <= MOST_CAUSES), reverse=True)

    def start(self, best: Fit, causes: tuple[str, ...], evidence: Evidence) -> Fit:
        """Where the fit of a supposition begins: where it would be if the tangents of another one's were right.

        A small step that way is no way there: on it the old cause is missing already and the new one not there.
        """
        placed = self.fitter.placed(best, causes, *self.fitter.most_probable(evidence, causes))
        return placed or _renamed(best, causes)

    def size(self, fit: Fit, cause: str) -> float:
        """How large a cause is, in detection limits."""
        found = [fit.shared[i] / self.coordinates[i].parameter.detection for i in self.predictor.index(cause)]
        swings = [x for i, x in zip(self.predictor.index(cause), found) if self.coordinates[i].run is not None]
        if swings:  # two components for each run
            return float(np.sqrt(2.0 * np.mean(np.square(swings))))
        return float(np.linalg.norm(found))

    # -- the search -----------------------------------------------------------------------------

    def run(self) -> Identification:
        """Whoever leads gets derivatives of its own and is challenged from there, until nobody takes the lead."""
        self._open()
        for _ in range(_TURNS):
            leader = self.worthy()[0]
            if leader.causes and leader.causes not in self.scanned:  # by everything it is settled after that
                leader = self.pool[leader.causes] = self.fitter.settle(leader, self.noise, everything=False)
                self._enter(self._afresh(leader, leader.causes))
            elif not leader.causes and not self.cooled:
                self._enter(self._healthy())
            elif not leader.settled:
                self.pool[leader.causes] = self.fitter.settle(leader, self.noise)
            elif leader.causes != self.judged:
                self._judge(leader)
            elif not self.challenge(leader) and not self._swapped(leader) and not self._rivals_settled(leader):
                break
        self._put_instead()
        leader, *others = self._likeliest([fit for fit in self.worthy() if self._plausible(fit)])
        shown = detectable(self.fitter.seen(self.file, self.noise), self.coordinates, -EFFECT)
        return Identification(leader, [leader, *others], self.pool[()], self.noise, self.alike, shown)

    def part(self, fit: Fit, causes: tuple[str, ...]) -> Fit:
        """Some causes of a fit, fitted without its others."""
        return self._settled(fit, causes, self.fitter.judged(fit, self.noise))

    def worthy(self) -> list[Fit]:
        """The suppositions whose causes are large enough to be some, the likeliest first."""
        return [fit for fit in self._ranked() if self.worth(fit)]

    def _likeliest(self, fits: Sequence[Fit]) -> list[Fit]:
        """First the best of those that do the same, where they are together the likeliest; then the others as before.

        Three causes that do the same are three chances that one of them is there.
        """
        same = {cause: group[0] for group in self.alike for cause in group}
        kinds = [key(same.get(cause, cause) for cause in fit.causes) for fit in fits]
        together: dict[tuple[str, ...], float] = {}
        for kind, fit in zip(kinds, fits):
            together[kind] = together.get(kind, 0.0) + float(np.exp((fit.score - fits[0].score) / _TEMPER))
        first = kinds.index(max(together, key=lambda kind: together[kind]))
        return [fits[first], *fits[:first], *fits[first + 1:]]

    def _ranked(self) -> list[Fit]:
        return sorted(self.pool.values(), key=lambda fit: -fit.score)

    def _nearest(self) -> list[Fit]:
        """The likeliest, as far as new derivatives may still put one before another."""
        first, *others = self._ranked()[:_RIVALS]
        return [first, *(fit for fit in others if first.score - fit.score < _SWAPPED)]

    def _enter(self, fits: Iterable[Fit]) -> None:
        """Take in suppositions that are new, or fitted better than before; let go of the least likely."""
        for fit in fits:
            if fit.causes not in self.pool or fit.score > self.pool[fit.causes].score:
                self.pool[fit.causes] = fit
        for fit in self._ranked()[_KEPT:]:  # each holds all its derivatives
            if fit.causes:
                del self.pool[fit.causes]

    def _judge(self, leader: Fit) -> None:
        """Compare under the noise of another leader; who is near it is fitted to that."""
        self.judged, self.plain = leader.causes, self.fitter.noise(leader)
        self._compare(self.doubted())
        for fit in self._nearest():
            moved = self._refined(fit, self.noise)
            still = moved.score - fit.score < SETTLED
            moved.near, moved.settled = fit.near and still, fit.settled and still
            self._enter([moved])

    def _compare(self, noise: Noise) -> None:
        self.noise = noise
        for fit in self.pool.values():
            self.fitter.assess(fit, noise)

    def doubted(self) -> Noise:
        """The leader's noise, but a run counts for less that no supposition explains.

        Then its fits are in one minimum or another, and which of them is best is luck.
        """
        costs = []
        for fit in self.pool.values():
            heavy, _ = self.plain.heavy(self.fitter.residuals(fit.predicted))
            costs.append(self.fitter.run_costs(heavy, fit))
        sizes = np.array([run.stacked.size for run in self.predictor.runs])
        unexplained = np.min(costs, axis=0) - sizes - np.sqrt(2.0 * sizes)  # chi square, one sigma above
        return self.plain.tempered(1.0 + np.maximum(unexplained, 0.0) / _UNEXPLAINED)

    def _doubt_again(self) -> None:
        """What came into the pool may explain a run that nothing did before."""
        noise = self.doubted()
        change = noise.temperatures / self.noise.temperatures
        if max(change.max(), 1.0 / change.min()) > _DOUBTS_ALIKE:
            self._compare(noise)

    def _open(self) -> None:
        """No cause, and every cause alone, as far as they are worth a fit; and a noise for them."""
        self.say(f"sensitivities to {len(self.coordinates)} parameters over {len(self.predictor.runs)} runs")
        self.file = self.fitter.nominal()
        self.judged, self.plain = None, self.fitter.noise(self.file)
        self.noise = self.plain
        self.first = self.fitter.judged(self.file, self.noise)
        self.alike = alike(self.first, self.coordinates, self.causes)
        for first, *others in self.alike:
            self.say(f"{first} does the same here as {', '.join(others)}")
            self.causes = [cause for cause in self.causes if cause not in others]
        self._enter([self.fitter.assess(self.fitter.refine(self.file, self.noise, 5), self.noise)])
        self.say("every cause alone, at several sizes")
        self.opened = self.scan.starts(self.file, self.causes, self.noise)
        self._enter(self._refined(fit, self.noise) for fit in self.opened)
        for fit in self._nearest():
            self.pool[fit.causes] = self.fitter.renewed(fit, self.noise, everything=False)
        self._doubt_again()

    def _put_instead(self) -> None:
        """What does the same as a cause of the leader or of a rival, in its place: fitted from where it does.

        By derivatives these recordings do not tell them apart. So what their scores and hopes differ by is how far each
        fit got, and counts for neither; but for one that would have to be larger than it can be.
        """
        leader, *others = self.worthy()
        layout = self.fitter.layout
        rivals = [fit for fit in others if separation(leader.score - fit.score) < APART]
        for fit in (leader, *rivals):
            same = [fit]
            for gone, other in self._swaps(fit):
                change = instead(self.first, self.coordinates, fit.shared, gone, other)
                wanted = [x + change for x in (fit.shared, *fit.points)]
                there = [np.clip(x, layout.low, layout.high) for x in wanted]
                causes = key((*fit.without(gone), other))
                start = self.fitter.placed(fit, causes, there[0], there[1:])
                if start is not None:
                    twin = self._refined(start, self.noise)
                    twin = self.fitter.settle(twin, self.noise, everything=False) if fit is leader else twin
                    self.pool[causes] = twin
                    mine = self.predictor.index(other)
                    if np.array_equal(there[0][mine], wanted[0][mine]):
                        same.append(twin)
            score, hope = max(twin.score for twin in same), max(twin.hope for twin in same)
            for twin in same:
                twin.score, twin.hope = score, hope

    def _swaps(self, fit: Fit) -> list[tuple[str, str]]:
        return [(gone, other) for group in self.alike for gone in group if gone in fit.causes
                for other in group if other != gone]

    def _afresh(self, fit: Fit, causes: tuple[str, ...]) -> list[Fit]:
        """Some causes of a fit once more, from the vehicle file with them as found and nothing else; and a scan there.

        On the way from where a cause was missing everything else was bent towards it, and may be so still. So are the
        derivatives on that way: here they are taken anew. Once for the same causes.
        """
        if causes in self.scanned:
            return []
        self.scanned.add(causes)
        if not causes:  # no cause, and each alone, were fitted when the search began
            opened = [self.fitter.assess(fit, self.noise) for fit in self.opened]
            return [*self._healthy(), *self._by_their_own(opened)]
        start = self._in_file(fit, causes)
        if start is None:
            return []
        scanned = self.scan.starts(start, self.causes, self.noise)
        others = (self._refined(other, self.noise) for other in scanned)
        return [self._from_file(start), *self._by_their_own(scanned), *others]

    def _healthy(self) -> list[Fit]:
        """No cause, from the vehicle file as those with causes are, as soon as it is compared with these; once."""
        first, self.cooled = not self.cooled, True
        return [self._from_file(self.file)] if first else []

    def _by_their_own(self, starts: Iterable[Fit]) -> list[Fit]:
        """The best of some starts whose causes are not settled yet, fitted by derivatives taken there.

        Where a cause moves crossings of the lash the derivatives are others, and a fit by those of the start is stuck.
        """
        near = {causes for causes, fit in self.pool.items() if fit.near}
        fresh = [fit for fit in best_of_each(starts, 1) if fit.causes not in near][:_AFRESH]
        return [self._from_file(self.fitter.relinearise(fit)) for fit in fresh]

    def _in_file(self, fit: Fit, causes: tuple[str, ...]) -> Fit | None:
        """Some causes of a fit in the vehicle file, with derivatives taken there; None where it cannot be simulated."""
        only = _renamed(fit, causes)
        shared, *points = (as_found(self.predictor, only, x) for x in (fit.shared, *fit.points))
        start = self.fitter.placed(fit, causes, shared, points)
        return start and self.fitter.assess(self.fitter.relinearise(start), self.noise)

    def _swapped(self, leader: Fit) -> bool:
        """Whether there was still something to put in place of a cause of the leader: scanned beside its others.

        Derivatives at the leader say little of what a cause would do in place of one that moved crossings of the lash.
        """
        fits = []
        if len(leader.causes) <= _SWAPPED_CAUSES:
            for gone in leader.causes:
                fits += self._afresh(leader, leader.without(gone))
        self._enter(fits)
        return bool(fits)

    def _rivals_settled(self, leader: Fit) -> bool:
        """Whether rivals that cannot be told from the leader had yet to be settled by everything, as it is.

        Those with all of its causes and more are not: they are where it is.
        """
        rivals = [fit for fit in self.worthy() if not fit.settled and not set(leader.causes) <= set(fit.causes)
                  and separation(leader.score - fit.score) < APART][:_RIVALS]
        for fit in rivals:
            self.pool[fit.causes] = self.fitter.settle(fit, self.noise)
        return bool(rivals)

    def challenge(self, leader: Fit) -> bool:
        """Let others take the lead if they can; whether any came close enough to be settled, or leads."""
        self.say("; ".join(f"{'+'.join(fit.causes) or 'healthy'} {fit.score - leader.score:+.0f}"
                           for fit in self.worthy()[:4]))
        hopes = self._challengers(leader, self.noise, _SHORTLIST)
        if self.noise.temperatures.max() > _DOUBTS_ALIKE:  # what it would take to explain the doubtful runs as well
            self._challengers(leader, self.plain, _SHORTLIST_PLAIN)
        self._enter(self._advised(leader, hopes))
        self._doubt_again()
        # what derivatives promise counts as well, its own and the leader's: a fit that fell short may be in another
        # minimum
        behind = {fit.causes: min(leader.score - fit.score, leader.hope - fit.hope) for fit in self.pool.values()}
        behind |= {s: min(behind[s], -hope) for s, hope in hopes.items() if s in behind}
        close = [fit for fit in self.worthy() if not fit.near and behind[fit.causes] < _RIVAL]
        for fit in sorted(close, key=lambda fit: behind[fit.causes])[:_RIVALS]:
            self.pool[fit.causes] = self.fitter.settle(fit, self.noise, everything=False)
        return bool(close) or self.worthy()[0] is not leader

    def _refined(self, fit: Fit, noise: Noise) -> Fit:
        return self.fitter.assess(self.fitter.refine(fit, noise, 3), self.noise)

    def _from_file(self, start: Fit) -> Fit:
        """Fitted from the vehicle file with its causes in it."""
        return self._brought_near(self.fitter.cooled(start, self.noise))

    def _brought_near(self, start: Fit) -> Fit:
        """Fitted by derivatives by its causes and the runs' own until they gain no more."""
        return self.fitter.settle(self._refined(start, self.noise), self.noise, everything=False)

    def _challengers(self, leader: Fit, noise: Noise, counts: tuple[int, int]) -> dict[tuple[str, ...], float]:
        """Put into the pool what may explain more than the leader does under a noise; returns what was promised.

        Fitted with the derivatives of the leader, which say which these are.
        """
        evidence = self.fitter.judged(leader, noise)
        own = self.fitter.assess(replace(leader), noise).hope
        promising = {s: lead for lead, s in self.candidates(leader, evidence)
                     if lead > -(_PROMISING if len(s) > len(leader.causes) else _SWAPPED)}
        fresh = [s for s in promising if not (s in self.pool and self.pool[s].near)]
        further = [s for s in fresh if len(s) > len(leader.causes)]
        starts: list[Fit] = []
        for sets, tried, count in zip((further, [s for s in fresh if s not in further]), _STARTED, counts):
            tries = [self.fitter.assess(self.start(leader, s, evidence), noise) for s in sets[:tried]]
            starts += sorted(tries, key=lambda fit: -max(fit.hope - own, promising[fit.causes]))[:count]
        # where the derivatives place them all at once, single runs may be in worse minima than the leader's
        starts += [_renamed(leader, s) for s in further[:_BESIDE]]
        stuck = self._stuck(leader, promising) if noise is self.noise else []
        self._enter([self._refined(start, noise) for start in starts])
        for causes in stuck:
            self._enter([self._settled(leader, causes, evidence)])
        return promising

    def _advised(self, leader: Fit, promising: Mapping[tuple[str, ...], float]) -> list[Fit]:
        """Fits of what others with derivatives of their own promise, and the leader's do not, each once for a leader.

        A cause in place of the leader's may be where lashes are crossed at other moments. From where it is alone it is
        seen what it would do beside the others. Only what promises more than the leader, or does with as few causes.
        """
        advice: dict[tuple[str, ...], tuple[float, Fit, Evidence]] = {}
        for fit in [fit for fit in self._ranked() if fit.near and fit is not leader][:_ADVISERS]:
            evidence = self.fitter.judged(fit, self.noise)
            for lead, causes in self.candidates(fit, evidence):
                lead += fit.hope - leader.hope
                known = max(promising.get(causes, -np.inf), advice.get(causes, (-np.inf,))[0])
                least = -_RIVAL if len(causes) <= len(leader.causes) else 0.0
                near = causes in self.pool and self.pool[causes].near
                if not near and causes not in self.tried and lead > max(least, known + _SHORT):
                    advice[causes] = lead, fit, evidence
        best = sorted(advice, key=lambda causes: -advice[causes][0])[:_ADVISED]
        self.tried.update(best)
        return [self._settled(fit, causes, evidence) for causes in best for _, fit, evidence in [advice[causes]]]

    def _settled(self, fit: Fit, causes: tuple[str, ...], evidence: Evidence) -> Fit:
        """A supposition fitted from where the derivatives of another place it.

        Its score counts with derivatives of its own, as that of the one it may replace does.
        """
        return self._brought_near(self.fitter.assess(self.start(fit, causes, evidence), self.noise))

    def _stuck(self, leader: Fit, promising: Mapping[tuple[str, ...], float]) -> list[tuple[str, ...]]:
        """Settled rivals that fall short of what the leader's derivatives or their own promise, each once for a leader.

        They are in another minimum than the leader: lashes are crossed at other moments.
        """
        if leader is not self.challenged:
            self.challenged, self.tried = leader, set()
        near = {s: self.pool[s] for s in promising if s in self.pool and self.pool[s].near and s not in self.tried}
        leads = {s: max(promising[s], fit.hope - leader.hope) for s, fit in near.items()}
        stuck = [s for s, lead in leads.items() if lead > -_RIVAL and leader.score + lead > near[s].score + _SHORT]
        self.tried.update(stuck[:_RIVALS])
        return stuck[:_RIVALS]


def separation(lead: float) -> float:
    """A lead in log evidence as a distance [sigma]."""
    return float(np.sqrt(2.0 * max(lead, 0.0) / _TEMPER))


def _renamed(fit: Fit, causes: tuple[str, ...]) -> Fit:
    """Other causes, as yet where another fit is."""
    return Fit(causes, fit.shared, fit.points, fit.predicted, fit.tangents)
