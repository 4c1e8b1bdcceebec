"""Which effects explain what a simulation gets wrong, how sure that is, and what cannot be told apart.

A *supposition* is a set of causes: their parameters may be anything plausible, all others only what a healthy car's
are. A cause is an effect of the catalogue, or one parameter of an effect whose parameters mean something alone. Of
causes that do the same in these recordings one is looked for (``alike``). Every cause alone is simulated at several
sizes, and the best of these are fitted (``scan``); so is every cause beside whoever leads then, and in place of
each of its causes, from the vehicle file anew (``afresh``). Whoever leads is challenged by every cause added,
dropped or swapped (``challenge``); all that were fitted are compared under one noise (``pool``). Those that are
near the leader are fitted in further ways, which says what a lead is worth, and where a recording stays unexplained
two causes are tried at once. At last those that do the same, or do as far as the recordings reach, take the places
of what was found. ``docs/diagnosis.md`` says why.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from cosim.diagnosis.catalogue import push_alike
from cosim.diagnosis.fit.evidence import Evidence
from cosim.diagnosis.fit.fitting import SETTLED, Fit, Fitter
from cosim.diagnosis.fit.predict import Predictor, effect_of
from cosim.diagnosis.search.afresh import Afresh
from cosim.diagnosis.search.alike import alike, instead
from cosim.diagnosis.search.challenge import SWAPPED_CAUSES, Challenge
from cosim.diagnosis.search.detectable import detectable
from cosim.diagnosis.search.identification import APART, Identification, named_from, separation, tempered, trusted
from cosim.diagnosis.search.pool import REFITTED, Pool
from cosim.diagnosis.search.reach import around, twins
from cosim.diagnosis.search.scan import Scan, best_of_each, key, renamed

log = logging.getLogger("cosim")

# Of a parameter in the leader, in what healthy cars differ by [sigma]: more, and it is tried as a cause (a judgement).
_STRAINED = 2.5
_FIRST = 3  # causes beside which every other is tried where no cause alone explains a recording
# Log evidence behind the leader within which a rival gets as many fits as it: the true causes, fitted once, were 16
# behind a wrong leader, and gained 27 by further ways.
_AS_MANY = 20.0
_TURNS = 30  # steps of the search, at most; some three a cause


class Search:
    """Finds the suppositions that explain the runs of a predictor.

    Args:
        predictor: Over all runs.
        say: Told what happens.

    Attributes:
        file: The vehicle file as it is; ``first``, what the runs say there.
        pool: What was fitted so far.
        alike: Groups of causes that do the same; of each the first is looked for.
        causes: Which are looked for.
        challenge: Of whoever leads, by these; ``afresh``, fits of these that begin in the vehicle file.
        instead: Suppositions that have what pushes like a cause of a leader in its place, and were fitted for that.
        strained: Those that have what a leader had more of than healthy cars do, and were fitted for that.
        resized: Those whose causes were tried at other sizes than they have.
        probed: Those beside which what does nothing while it is small was tried at its sizes.
        refitted: Suppositions that were fitted in further ways; of each, by how much the best of its fits is better
            than the next [log evidence].
    """

    file: Fit
    first: Evidence
    pool: Pool
    alike: list[tuple[str, ...]]
    causes: list[str]
    challenge: Challenge
    afresh: Afresh

    def __init__(self, predictor: Predictor, say: Callable[[str], None] = log.info) -> None:
        self.predictor, self.fitter, self.say = predictor, Fitter(predictor), say
        self.scan = Scan(self.fitter)
        self.coordinates = predictor.coordinates
        self.refitted: dict[tuple[str, ...], float] = {}
        self.instead: set[tuple[str, ...]] = set()
        self.strained: set[tuple[str, ...]] = set()
        self.probed: set[tuple[str, ...]] = set()
        self.resized: set[tuple[str, ...]] = set()

    def run(self) -> Identification:
        """Every cause alone, and what follows from there; two at once where that leaves a recording unexplained."""
        self._open()
        self._follow()
        if self.pool.doubtful:
            self.say("pairs of causes, for what no cause explains")
            self._two_at_once()
            self._follow()
        self._put_instead()
        self._put_around()
        leader, *others = self._likeliest([fit for fit in self.pool.worthy() if self.pool.plausible(fit)])
        noise = self.pool.noise
        shown = detectable(self.fitter.seen(self.file, noise), self.coordinates, named_from(self.temper),
                           partial(self.fitter.changed, self.file, noise))
        return Identification(leader, [leader, *others], self.pool.fits[()], noise, self.alike, self.coordinates,
                              shown, self.temper).significant()

    @property
    def temper(self) -> float:
        """Of differences in evidence, by how far fits of the same supposition were apart so far."""
        return tempered(float(np.median(list(self.refitted.values()))) if self.refitted else 0.0)

    def _follow(self) -> None:
        """Whoever leads gets derivatives of its own and is challenged from there, until nobody takes the lead."""
        for _ in range(_TURNS):
            leader = self.pool.worthy()[0]
            needed = self._needed(leader)
            if needed.causes not in self.afresh.scanned:
                if needed.causes:  # by everything a leader is settled after that
                    needed = self.pool.settle(needed, everything=False)
                self.pool.enter(self.afresh(needed, needed.causes))
            elif not leader.settled:
                self.pool.settle(leader)
            elif leader.causes != self.pool.judged:
                self.pool.judge_by(leader)
            elif not (self._challenged(leader) or self._probed(leader) or self._resized(leader) or self._swapped(needed)
                      or self._pushed_alike(leader) or self._freed(leader) or self._rivals_settled(leader)
                      or self._once_more(leader)):
                break

    def part(self, fit: Fit, causes: tuple[str, ...]) -> Fit:
        """Some causes of a fit, fitted without its others."""
        return self.challenge.settled(fit, causes, self.fitter.judged(fit, self.pool.noise))

    def _open(self) -> None:
        """No cause, and every cause alone, as far as they are worth a fit; and a noise for them."""
        self.say(f"sensitivities to {len(self.coordinates)} parameters over {len(self.predictor.runs)} runs")
        self.file = self.fitter.nominal()
        self.pool = Pool(self.fitter, self.fitter.noise(self.file))
        noise = self.pool.noise
        self.first = self.fitter.judged(self.file, noise)
        self.causes = list(dict.fromkeys(c.cause for c in self.coordinates if c.cause))
        self.alike = alike(self.first, self.coordinates, self.causes)
        for first, *others in self.alike:
            self.say(f"{first} does the same here as {', '.join(others)}")
            self.causes = [cause for cause in self.causes if cause not in others]
        self.challenge = Challenge(self.pool, self.causes)
        self.pool.enter([self.fitter.assess(self.fitter.refine(self.file, noise, 5), noise)])
        self.say("every cause alone, at several sizes")
        opened = self.scan.starts(self.file, self.causes, noise)
        self.afresh = Afresh(self.pool, self.scan, self.file, self.causes, opened)
        at_once = self.predictor.at_once
        self.pool.enter(at_once([partial(self.pool.refined, fit) for fit in opened]))
        renewed = at_once([partial(self.fitter.renewed, fit, noise, False) for fit in self.pool.nearest()])
        self.pool.fits |= {fit.causes: fit for fit in renewed}
        self.pool.doubt_again()

    def _challenged(self, leader: Fit) -> bool:
        self.say("; ".join(f"{'+'.join(fit.causes) or 'healthy'} {fit.score - leader.score:+.0f}"
                           for fit in self.pool.worthy()[:4]))
        return self.challenge(leader)

    def _probed(self, leader: Fit) -> bool:
        """Whether a cause of which derivatives say nothing promised more than the leader where it has a size, and was
        fitted from there; once for the same leader.

        A scan begins where nothing else is fitted, and may hide it behind what a fit of that removes. Beside the
        leader, which removed it, one simulation at a size says more; of what comes near it the size is looked for.
        """
        if leader.causes in self.probed:
            return False
        self.probed.add(leader.causes)
        at_once, noise = self.predictor.at_once, self.pool.noise
        probes = self.scan.probes(leader, self.scan.silent(self.causes), ())
        near = [fit for fit in best_of_each(at_once([partial(self.fitter.assess, probe, noise) for probe in probes]), 1)
                if fit.hope > leader.score - _AS_MANY]
        sized = at_once([partial(self.scan.sized, leader, fit, noise) for fit in near])
        promising = [fit for fit in sized if fit.hope > leader.score]
        self.pool.enter(at_once([lambda fit=fit: self.pool.brought_near(self.fitter.relinearise(fit, everything=False))
                                 for fit in promising]))
        return bool(promising)

    def _resized(self, leader: Fit) -> bool:
        """Whether the leader is better with a cause larger or smaller than it is, and was fitted from there; once for
        the same leader.

        Derivatives gain no more where a fit is, but that is one minimum of several. A rigid axle was found as one with
        a third of its compliance, with much else bent to make up for that; with none, and nothing else changed, that
        was 45 units of log evidence better, and 103 when it was fitted.
        """
        if leader.causes in self.resized:
            return False
        self.resized.add(leader.causes)
        at_once, noise = self.predictor.at_once, self.pool.noise
        others = at_once([partial(self.fitter.assess, fit, noise) for fit in self.scan.resized(leader)])
        better = [fit for fit in others if fit.score > leader.score + SETTLED]
        if better:
            best = max(better, key=lambda fit: fit.hope)
            self.pool.enter([self._large_enough(self.pool.settled(best))])
        return bool(better)

    def _large_enough(self, fit: Fit) -> Fit:
        """Without those of its causes that are too small to be some, which made up for what is not there any more."""
        kept = self.pool.large_of(fit)
        return fit if kept == fit.causes else self.pool.settled(renamed(fit, kept))

    def _two_at_once(self) -> None:
        """Every cause beside each of those that explain most in the vehicle file, at the size that does.

        Where two are there that shift lashes and frequencies, a fit of one of them ends at a size that is not its own,
        and beside that the other explains nothing. All runs count here for what they say: those that are doubtful have
        to be explained.
        """
        with self.pool.trusting() as noise:
            for fit in best_of_each((self.fitter.assess(fit, noise) for fit in self.afresh.opened), 1)[:_FIRST]:
                start = self.fitter.assess(self.fitter.relinearise(fit), noise)
                self.pool.enter(self.predictor.at_once(
                    self.afresh.by_their_own(self.scan.starts(start, self.causes, noise))))

    # -- what is fitted from the vehicle file anew ------------------------------------------------

    def _swapped(self, leader: Fit) -> bool:
        """Whether there was still something to put in place of a cause of the leader: scanned beside its others.

        Derivatives at the leader say little of what a cause would do in place of one that moved crossings of the lash.
        """
        fits = []
        if len(leader.causes) <= SWAPPED_CAUSES:
            for gone in leader.causes:
                fits += self.afresh(leader, leader.without(gone))
        return self._entered(fits)

    def _pushed_alike(self, leader: Fit) -> bool:
        """Whether what pushes like a cause of the leader had yet to be fitted in its place, as large as does the same.

        A lead over that counts for less, so it has to be as good a fit: from the vehicle file anew, by everything.
        """
        swaps = {key((*leader.without(gone), cause)): (gone, cause) for gone in leader.causes for cause in self.causes
                 if cause not in leader.causes and push_alike([effect_of(gone)], [effect_of(cause)])}
        there = [self._in_place(leader, *swap)[0] for causes, swap in swaps.items() if causes not in self.instead]
        self.instead.update(swaps)
        return self._entered(self.afresh.by_everything(start for start in there if start))

    def _freed(self, leader: Fit) -> bool:
        """Whether what the leader has more of than healthy cars do had yet to be fitted as a cause, as large as it is.

        It may be a part of what is there, with much else bent to make up for the rest: a healthy car with tyres of 1.18
        times their stiffness, where they had 2.07, was 64 units of log evidence behind these. From there derivatives
        lead back; from the vehicle file, with nothing but that part in it, by everything, they do not. Where nothing
        explains a recording all is bent, which says as little of one cause as of another.
        """
        if self.pool.doubtful:
            return False
        more = [c.cause for c, x in zip(self.coordinates, leader.shared)
                if c.cause in self.causes and c.run is None and abs(x) > _STRAINED * c.tolerance]
        fresh = {key((*leader.causes, cause)) for cause in more if cause not in leader.causes} - self.strained
        self.strained.update(fresh)
        return self._entered(self.afresh.by_everything(renamed(leader, causes) for causes in sorted(fresh)))

    def _entered(self, fits: Sequence[Fit]) -> bool:
        """Whether there were any to take into the pool."""
        self.pool.enter(fits)
        return bool(fits)

    # -- who cannot be told from the leader -------------------------------------------------------

    def _close(self, leader: Fit, within: float = 0.0) -> list[Fit]:
        """The leader and those that cannot be told from it, or are less behind than that [log evidence]; best first."""
        leads = [(fit, trusted(leader.score - fit.score, leader, fit)) for fit in self.pool.worthy()]
        return [fit for fit, lead in leads if lead < within or separation(lead, self.temper) < APART]

    def _needed(self, leader: Fit) -> Fit:
        """The fewest of a leader's causes, one at least, with which a supposition cannot be told from it.

        Where something is missing that no cause is, one after the other takes the lead with a further cause, by less
        than fits differ by; a search beside each of these finds the next such.
        """
        fewer = [fit for fit in self._close(leader) if fit.causes and set(fit.causes) < set(leader.causes)]
        return min(fewer, key=lambda fit: len(fit.causes), default=leader)

    def _rivals_settled(self, leader: Fit) -> bool:
        """Whether rivals that cannot be told from the leader had yet to be settled by everything, as it is.

        Those with all of its causes and more are not: they are where it is.
        """
        rivals = [fit for fit in self._close(leader)
                  if not fit.settled and not set(leader.causes) <= set(fit.causes)][:REFITTED]
        self.pool.settle_all(rivals)
        return bool(rivals)

    def _once_more(self, leader: Fit) -> bool:
        """Whether the leader and rivals that are near it were fitted in further ways, each once.

        Their fits end in one minimum or another, which is worth some units of log evidence, as much as they are apart:
        so each begins in the vehicle file anew, and where another of them is. How much it is worth is seen there.
        """
        close = self._close(leader, _AS_MANY)[:REFITTED]
        fresh = [fit for fit in close if fit.causes not in self.refitted] if len(close) > 1 else []
        for fit in fresh:
            other = close[1] if fit is leader else leader
            elsewhere = self.challenge.start(other, fit.causes, self.fitter.judged(other, self.pool.noise))
            anew = self.afresh.in_file(fit, fit.causes) if fit.causes else self.file
            ways = [partial(self.pool.settled, elsewhere)]
            if anew is not None:
                ways.append(partial(self.afresh.from_file, anew, everything=True))
            ends = self.predictor.at_once(ways)
            best, second, *_ = sorted((end.score for end in (fit, *ends)), reverse=True)
            self.refitted[fit.causes] = best - second
            self.pool.enter(ends)
        return bool(fresh)

    def _put_instead(self) -> None:
        """What does the same as a cause of the leader or of a rival, in its place: fitted from where it does.

        By derivatives these recordings do not tell them apart. So what their scores and hopes differ by is how far each
        fit got, and counts for neither; but for one that would have to be larger than it can be.
        """
        leader, *rivals = self._close(self.pool.worthy()[0])
        for fit in (leader, *rivals):
            same = [fit]
            for gone, other in self._swaps(fit):
                start, is_possible = self._in_place(fit, gone, other)
                if start is not None:
                    twin = self.pool.brought_near(start) if fit is leader else self.pool.refined(start)
                    self.pool.fits[start.causes] = twin
                    if is_possible:
                        same.append(twin)
            score, hope = max(twin.score for twin in same), max(twin.hope for twin in same)
            for twin in same:
                twin.score, twin.hope = score, hope

    def _in_place(self, fit: Fit, gone: str, other: str) -> tuple[Fit | None, bool]:
        """Another cause in place of one of a fit, where it does the same, and whether it can be as large as that; None
        where it cannot be simulated."""
        layout = self.fitter.layout
        change = instead(self.first, self.coordinates, fit.shared, gone, other)
        wanted = [x + change for x in (fit.shared, *fit.points)]
        there = [np.clip(x, layout.low, layout.high) for x in wanted]
        mine = self.predictor.index(other)
        return (self.fitter.placed(fit, key((*fit.without(gone), other)), there[0], there[1:]),
                np.array_equal(there[0][mine], wanted[0][mine]))

    def _put_around(self) -> None:
        """In place of a cause of the leader what is the same in these recordings, but would not be in livelier ones."""
        leader = self.pool.worthy()[0]
        for gone, place in twins(self.coordinates, leader):
            starts = around(self.fitter, self.pool.noise, leader, gone, place)
            if starts:
                best = max(starts, key=lambda fit: fit.score)
                wide = self.pool.brought_near(self.fitter.relinearise(best, everything=False))
                wide.hope = min(wide.hope, wide.score)  # by derivatives no width would be as good as that
                self.pool.enter([wide])

    def _swaps(self, fit: Fit) -> list[tuple[str, str]]:
        return [(gone, other) for group in self.alike for gone in group if gone in fit.causes
                for other in group if other != gone]

    def _likeliest(self, fits: Sequence[Fit]) -> list[Fit]:
        """First the best of those that do the same, where they are together the likeliest; then the others as before.

        Three causes that do the same are three chances that one of them is there.
        """
        same = {cause: group[0] for group in self.alike for cause in group}
        kinds = [key(same.get(cause, cause) for cause in fit.causes) for fit in fits]
        together: dict[tuple[str, ...], float] = {}
        for kind, fit in zip(kinds, fits):
            together[kind] = together.get(kind, 0.0) + float(np.exp((fit.score - fits[0].score) / self.temper))
        first = kinds.index(max(together, key=lambda kind: together[kind]))
        return [fits[first], *fits[:first], *fits[first + 1:]]
