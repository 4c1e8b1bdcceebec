"""Which effects explain what a simulation gets wrong, how sure that is, and what cannot be told apart.

A *supposition* is a set of causes: their parameters may be anything plausible, all others only what a
healthy car's are. A cause is an effect of the catalogue, or one parameter of an effect whose parameters mean
something alone. Screening is linear and covers every cause added, dropped or swapped; the best are fitted by
simulation, compared under one noise, and the search goes on from the best of them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cosim.diagnosis.evidence import Evidence, Layout, Posterior, Slopes, prior
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.predict import Predictor

log = logging.getLogger("cosim")

MOST_CAUSES = 9
# Of a cause, in detection limits: less is what healthy cars differ by. Beside another cause errors of its fit
# are as large.
SMALLEST, SMALLEST_FURTHER = 0.6, 0.9
FIRST, FURTHER = -8.0, -25.0  # log odds that a given effect is there, as the first and beside others
SECOND_PARAMETER = -3.0  # and that a second parameter of an effect is off as well
_ENSEMBLE = 8  # simulations with a wandering torque
_SHORTLIST = 6  # suppositions that are fitted from the point of each leader
# Linear log evidence below the leader at which a supposition is not looked at: with a cause more, and without;
# where another cause stands for the true one its run is bent about it, and that is worth more than noise.
_PROMISING, _SWAPPED = 25.0, 400.0
_STARTED = 20  # suppositions that are simulated where the leader's tangents place them
_RIVAL, _RIVALS = 12.0, 4  # log evidence below the leader at which a rival gets derivatives of its own; how many
_SETTLED = 1.0  # log evidence that a fit with new derivatives may still gain
_BENT = 2.0  # squared distance [sigma] between a run and its tangent at which derivatives are renewed
_JUDGED = 2.0  # power of the heavy tail where suppositions are compared
_UNEXPLAINED = 40.0  # of minus twice the log likelihood of a run: leaves half of what it says
_ROUNDS = 3  # of new derivatives for a fit
_TURNS = 8  # steps of the search, at most
_SIZES = (-4.0, -1.5, 1.5, 4.0)  # of probes, in detection limits
_SCANNED = 12  # probes that are fitted
_KEPT = 24  # fits


@dataclass(frozen=True)
class Tangent:
    """The derivatives of a run's stacked channels by the coordinates it depends on.

    Attributes:
        jacobian: Samples x ``Layout.columns`` of the run.
        bent: What moves since they were taken have shown beyond them: squared distance [sigma].
    """

    jacobian: np.ndarray = field(repr=False)
    bent: float = 0.0

    def moved(self, step: np.ndarray, change: np.ndarray, scale: np.ndarray, noise: Noise, run: int) -> Tangent:
        """After a step that changed the prediction: derivatives corrected along the step (Broyden 1965).

        Args:
            step: Of these coordinates, which have sizes ``scale``.
            change: Of the stacked channels.
        """
        direction = step / scale**2
        length = float(step @ direction)
        if length == 0.0:
            return self
        missed = change - self.jacobian @ step
        bent = self.bent + float(np.sum(noise.whiten(run, missed) ** 2))
        return Tangent(self.jacobian + np.outer(missed, direction / length).astype(np.float32), bent)


@dataclass
class Fit:
    """A supposition fitted to all runs.

    Attributes:
        causes: The causes it has.
        shared: Most probable coordinates; those of single runs are 0.
        points: The coordinates of each run: what is shared and deviations from it, and its own.
        predicted: Stacked channels of each run.
        tangents: Of each run.
        posterior: Belief about the shared coordinates under the noise of the comparison.
        score: Log evidence and log prior under it.
        settled: Whether derivatives of its own gained nothing more.
    """

    causes: tuple[str, ...]
    shared: np.ndarray
    points: list[np.ndarray]
    predicted: list[np.ndarray] = field(repr=False)
    tangents: list[Tangent] = field(repr=False)
    posterior: Posterior | None = field(default=None, repr=False)
    score: float = -np.inf
    settled: bool = False

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects of the catalogue that its causes belong to."""
        return tuple(dict.fromkeys(cause.partition(":")[0] for cause in self.causes))


@dataclass
class Identification:
    """What the search found.

    Attributes:
        best: The most probable supposition; no causes where nothing is wrong.
        alternatives: All suppositions that were fitted, ``best`` first, then by evidence.
        healthy: The supposition without causes.
        noise: Under which they were compared.
    """

    best: Fit
    alternatives: list[Fit]
    healthy: Fit
    noise: Noise


class Search:
    """Fits suppositions to the runs of a predictor.

    Args:
        predictor: Over all runs.
        say: Told what happens.
    """

    def __init__(self, predictor: Predictor, say: Callable[[str], None] = log.info) -> None:
        self.predictor, self.say = predictor, say
        self.coordinates = predictor.coordinates
        self.layout = Layout(self.coordinates, len(predictor.runs))
        self.measured = [run.stacked for run in predictor.runs]
        self.causes = list(dict.fromkeys(c.cause for c in self.coordinates if c.cause))
        self.low = np.array([c.low for c in self.coordinates])
        self.high = np.array([c.high for c in self.coordinates])
        self.scale = np.array([c.tolerance for c in self.coordinates])
        self.numbers = {i for i, c in enumerate(self.coordinates) if c.run is None and not c.effect}

    # -- one supposition ------------------------------------------------------------------------

    def residuals(self, predicted: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Measured minus predicted of every run."""
        return [y - p for y, p in zip(self.measured, predicted)]

    def noise(self, fit: Fit) -> Noise:
        """What is left of the residuals where a fitted supposition is right."""
        return Noise(self.predictor.runs, self.predictor.strays(fit.points, fit.predicted, _ENSEMBLE))

    def doubted(self, noise: Noise, pool: Mapping[tuple[str, ...], Fit]) -> Noise:
        """A noise under which a run counts for less that no supposition explains.

        Then its fits are in one minimum or another, and which of them is best is luck.
        """
        costs = []
        for fit in pool.values():
            heavy, _ = noise.heavy(self.residuals(fit.predicted))
            costs.append([self.run_cost(heavy, r, predicted, fit.shared, point)
                          for r, (predicted, point) in enumerate(zip(fit.predicted, fit.points))])
        sizes = np.array([measured.size for measured in self.measured])
        unexplained = np.min(costs, axis=0) - sizes - np.sqrt(2.0 * sizes)  # chi square, one sigma above
        return noise.tempered(1.0 + np.maximum(unexplained, 0.0) / _UNEXPLAINED)

    def assess(self, fit: Fit, noise: Noise) -> Fit:
        """Evidence of a fitted supposition under a noise."""
        noise, cost = noise.heavy(self.residuals(fit.predicted), _JUDGED)
        fit.posterior = self.seen(fit, noise).posterior(prior(self.coordinates, fit.causes))
        fit.score = fit.posterior.log_evidence - cost + log_prior(fit.causes)
        return fit

    def seen(self, fit: Fit, noise: Noise) -> Evidence:
        """What the runs say at the points of a fit."""
        seen = []
        for r, (tangent, point) in enumerate(zip(fit.tangents, fit.points)):
            slopes = Slopes(self.layout, r, noise.whiten(r, tangent.jacobian))
            seen.append(slopes.seen(noise.whiten(r, self.measured[r] - fit.predicted[r]), point))
        return Evidence(seen)

    def run_cost(self, noise: Noise, run: int, predicted: np.ndarray | None, shared: np.ndarray,
                 point: np.ndarray) -> float:
        """A run's part of minus twice the log posterior density."""
        if predicted is None:
            return np.inf
        layout = self.layout
        own = point[layout.own[run]]
        loose = layout.deviation > 0.0
        apart = (point - shared)[layout.shared][loose] / layout.deviation[loose]
        return (float(np.sum(noise.whiten(run, self.measured[run] - predicted) ** 2))
                + float(own @ layout.precision[run] @ own) + float(apart @ apart))

    def cost(self, noise: Noise, fit: Fit) -> float:
        """Minus twice the log posterior density of a fit's coordinates, up to a constant."""
        return self._prior_cost(fit.shared, fit.causes) + sum(
            self.run_cost(noise, r, predicted, fit.shared, point)
            for r, (predicted, point) in enumerate(zip(fit.predicted, fit.points)))

    def _prior_cost(self, shared: np.ndarray, causes: tuple[str, ...]) -> float:
        spread = prior(self.coordinates, causes)[self.layout.shared]
        return float(np.sum((shared[self.layout.shared] / spread) ** 2))

    def refine(self, fit: Fit, noise: Noise, iterations: int = 12) -> Fit:
        """Most probable coordinates, by Gauss-Newton with derivatives that follow the steps."""
        spread = prior(self.coordinates, fit.causes)
        for _ in range(iterations):
            heavy, _ = noise.heavy(self.residuals(fit.predicted))
            evidence = self.seen(fit, heavy)
            best = np.zeros(len(self.coordinates))
            best[self.layout.shared] = evidence.posterior(spread).mean
            best = np.clip(best, self.low, self.high)
            goals = [np.clip(seen.point(best[self.layout.shared]), self.low, self.high) for seen in evidence.seen]
            now, gained = self.cost(heavy, fit), 0.0
            for share in (1.0, 0.3, 0.1):
                moved = self._moved(fit, heavy, fit.shared + share * (best - fit.shared), goals, share)
                gained = now - self.cost(heavy, moved)
                if gained > 0.0:
                    break
            if gained <= 0.0:
                break
            fit = moved
            if gained < _SETTLED:
                break
        return fit

    def _moved(self, fit: Fit, noise: Noise, shared: np.ndarray, goals: Sequence[np.ndarray],
               share: float) -> Fit:
        """Shared coordinates moved, and each run towards its goal as far as that is better than to stay."""
        runs = range(len(goals))
        points, predicted, tangents = list(fit.points), list(fit.predicted), list(fit.tangents)
        staying = [self.run_cost(noise, r, predicted[r], shared, points[r]) for r in runs]
        waiting = list(runs)
        for part in (share, 0.3 * share, 0.1 * share):
            tries = {r: fit.points[r] + part * (goals[r] - fit.points[r]) for r in waiting}
            found = self.predictor.many([(point, r) for r, point in tries.items()])
            for (r, point), y in zip(tries.items(), found):
                if y is None:
                    continue
                # even where nothing is gained something is learnt
                learnt = self._bent(tangents[r], point - fit.points[r], y - fit.predicted[r], noise, r)
                tangents[r] = Tangent(learnt.jacobian, tangents[r].bent)
                if self.run_cost(noise, r, y, shared, point) < staying[r]:
                    tangents[r] = learnt
                    points[r], predicted[r] = point, y
                    waiting.remove(r)
            if not waiting:
                break
        shared = shared.copy()
        for i, c in enumerate(self.coordinates):
            if c.run is not None and c.effect:  # shared in name only
                shared[i] = points[c.run][i]
        return Fit(fit.causes, shared, points, predicted, tangents)

    def _bent(self, tangent: Tangent, step: np.ndarray, change: np.ndarray, noise: Noise, run: int) -> Tangent:
        columns = self.layout.columns[run]
        return tangent.moved(step[columns], change, self.scale[columns], noise, run)

    def relinearise(self, fit: Fit, everything: bool = True) -> Fit:
        """Renew the derivatives of runs that have left their tangents.

        Args:
            fit: Where.
            everything: By all coordinates but the file's numbers; or only by its causes and the runs' own.
        """
        needed = {int(i) for own in self.layout.own for i in own}
        needed.update(i for cause in fit.causes for i in self.predictor.index(cause))
        tangents = list(fit.tangents)
        wanted = {r: [int(i) for i in self.layout.columns[r]
                      if (i not in self.numbers if everything else i in needed)]
                  for r, tangent in enumerate(tangents) if tangent.bent > _BENT}
        for (r, renewed), part in zip(wanted.items(), self.predictor.jacobian(fit.points, fit.predicted, wanted)):
            jacobian = tangents[r].jacobian.copy()
            jacobian[:, np.isin(self.layout.columns[r], renewed)] = part
            tangents[r] = Tangent(jacobian, 0.0 if everything else tangents[r].bent)
        return Fit(fit.causes, fit.shared, fit.points, fit.predicted, tangents)

    def renewed(self, fit: Fit, noise: Noise, everything: bool = True) -> Fit:
        """Refined with derivatives of its own; settled where they gained no more."""
        was = fit.score
        fit = self.assess(self.refine(self.relinearise(fit, everything), noise), noise)
        fit.settled = everything and fit.score - was < _SETTLED
        return fit

    def settle(self, fit: Fit, noise: Noise) -> Fit:
        """Refined with derivatives of its own until they gain no more, at most ``_ROUNDS`` times."""
        for _ in range(_ROUNDS):
            if fit.settled:
                break
            fit = self.renewed(fit, noise)
        fit.settled = True
        return fit

    def worth(self, fit: Fit) -> bool:
        """Whether all its causes are large enough to be some."""
        sizes = sorted(self.size(fit, cause) for cause in fit.causes)
        return not sizes or sizes[-1] >= SMALLEST and all(size >= SMALLEST_FURTHER for size in sizes[:-1])

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
                sets.add(_key((*fit.causes, cause)))
                sets.update(_key((*(e for e in fit.causes if e != gone), cause)) for gone in fit.causes)
        sets.update(_key(e for e in fit.causes if e != gone) for gone in fit.causes)

        def score(causes: tuple[str, ...]) -> float:
            return evidence.posterior(prior(self.coordinates, causes)).log_evidence + log_prior(causes)

        own = score(fit.causes)
        return sorted(((score(s) - own, s) for s in sets if len(s) <= MOST_CAUSES), reverse=True)

    def start(self, best: Fit, causes: tuple[str, ...], evidence: Evidence) -> Fit:
        """Where the fit of a supposition begins: where it would be if the tangents of another one's were right.

        A small step that way is no way there: on it the old cause is missing already and the new one not there.
        """
        mean = evidence.posterior(prior(self.coordinates, causes)).mean
        shared = np.zeros(len(self.coordinates))
        shared[self.layout.shared] = mean
        shared = np.clip(shared, self.low, self.high)
        points = [np.clip(seen.point(shared[self.layout.shared]), self.low, self.high) for seen in evidence.seen]
        predicted = self.predictor.all_runs(points)
        if predicted is None:
            return Fit(causes, best.shared, best.points, best.predicted, best.tangents)
        return Fit(causes, shared, points, predicted, [Tangent(t.jacobian, np.inf) for t in best.tangents])

    def _at(self, fit: Fit, causes: tuple[str, ...], changes: Mapping[int, float]) -> Fit | None:
        """A fit with some coordinates changed in all runs; None where that cannot be simulated."""
        shared, points = fit.shared.copy(), [p.copy() for p in fit.points]
        for i, x in changes.items():
            for vector in (shared, *points):
                vector[i] = x
        predicted = self.predictor.all_runs(points)
        if predicted is None:
            return None
        return Fit(causes, shared, points, predicted, [Tangent(t.jacobian, np.inf) for t in fit.tangents])

    def size(self, fit: Fit, cause: str) -> float:
        """How large an cause is, in detection limits."""
        found = [fit.shared[i] / self.coordinates[i].parameter.detection for i in self.predictor.index(cause)]
        swings = [x for i, x in zip(self.predictor.index(cause), found) if self.coordinates[i].run is not None]
        if swings:  # two components for each run
            return float(np.sqrt(2.0 * np.mean(np.square(swings))))
        return float(np.linalg.norm(found))

    def probes(self, best: Fit, everything: bool) -> list[Fit]:
        """Starts for causes beside those of a fit, each at several sizes.

        Args:
            best: Whose coordinates the others keep.
            everything: Or only for causes that do nothing while they are small.
        """
        starts = []
        for cause in self.causes:
            mine = [i for i in self.predictor.index(cause) if self.coordinates[i].run is None]
            if cause in best.causes or not mine:
                continue
            declared = {i: self.coordinates[i].parameter for i in mine if self.coordinates[i].parameter.probes}
            tries: list[dict[int, float]] = []
            for k in range(max((len(p.probes) for p in declared.values()), default=0)):
                tries.append({i: p.coordinate(p.probes[min(k, len(p.probes) - 1)]) for i, p in declared.items()})
            if everything and not tries:
                first, parameter = mine[0], self.coordinates[mine[0]].parameter
                sizes = [x * parameter.detection for x in _SIZES]
                tries = [{first: x} for x in sizes if self.low[first] <= x <= self.high[first]]
            for changes in tries:
                start = self._at(best, _key((*best.causes, cause)), changes)
                if start is not None:
                    starts.append(start)
        return starts

    # -- the search -----------------------------------------------------------------------------

    def run(self) -> Identification:
        """Whoever leads gets derivatives of its own and is challenged from there, until nobody takes the lead."""
        zero = np.zeros(len(self.coordinates))
        points = [zero.copy() for _ in self.measured]
        predicted = self.predictor.all_runs(points)
        if predicted is None:
            raise ArithmeticError("the plant of the vehicle file cannot be simulated with these inputs")
        self.say(f"sensitivities to {len(self.coordinates)} parameters over {len(self.measured)} runs")
        columns = dict(enumerate(self.layout.columns))
        tangents = [Tangent(j) for j in self.predictor.jacobian(points, predicted, columns)]
        start = Fit((), zero, points, predicted, tangents)
        noise = self.noise(start)
        healthy = self.assess(self.refine(start, noise, 5), noise)
        pool = {(): healthy}
        self.say("every cause alone, at several sizes")
        self._enter(pool, self._scanned(start, noise))
        for fit in self._ranked(pool)[:_RIVALS]:
            pool[fit.causes] = self.renewed(fit, noise, everything=False)
        judged, noise = healthy, self.doubted(noise, pool)
        for fit in pool.values():
            self.assess(fit, noise)
        for _ in range(_TURNS):
            leader = self._first(pool)
            if not leader.settled:
                pool[leader.causes] = self.settle(leader, noise)
                continue
            if leader.causes != judged.causes:
                judged, noise = leader, self.doubted(self.noise(leader), pool)
                for fit in pool.values():
                    self.assess(fit, noise)
                continue
            self.say("; ".join(f"{'+'.join(fit.causes) or 'healthy'} {fit.score - leader.score:+.0f}"
                               for fit in list(filter(self.worth, self._ranked(pool)))[:4]))
            challengers, hopes = self._challengers(leader, noise, pool)
            self._enter(pool, challengers)
            # what the derivatives promise counts as well: a fit that fell short of it is in another minimum
            behind = {fit.causes: leader.score - fit.score for fit in pool.values()}
            behind |= {s: min(behind[s], -hope) for s, hope in hopes.items() if s in behind}
            close = [fit for fit in pool.values()
                     if not fit.settled and behind[fit.causes] < _RIVAL and self.worth(fit)]
            if not close:
                break
            for fit in sorted(close, key=lambda fit: behind[fit.causes])[:_RIVALS]:
                pool[fit.causes] = self.settle(fit, noise)
        leader = self._first(pool)
        fits = sorted((fit for fit in pool.values() if self.worth(fit)), key=lambda fit: -fit.score)
        return Identification(leader, [leader, *(fit for fit in fits if fit is not leader)], pool[()], noise)

    @staticmethod
    def _ranked(pool: Mapping[tuple[str, ...], Fit]) -> list[Fit]:
        return sorted(pool.values(), key=lambda fit: -fit.score)

    def _first(self, pool: Mapping[tuple[str, ...], Fit]) -> Fit:
        return max((fit for fit in pool.values() if self.worth(fit)), key=lambda fit: fit.score)

    @staticmethod
    def _enter(pool: dict[tuple[str, ...], Fit], fits: Iterable[Fit]) -> None:
        for fit in fits:
            if fit.causes not in pool or fit.score > pool[fit.causes].score:
                pool[fit.causes] = fit
        for fit in Search._ranked(pool)[_KEPT:]:  # each holds all its derivatives
            if fit.causes:
                del pool[fit.causes]

    def _scanned(self, start: Fit, noise: Noise) -> list[Fit]:
        """Every cause alone, fitted from where it explains most at once.

        A fit that begins without a cause that is there bends everything else towards what is missing, and meets
        flanks that are not the right ones.
        """
        points = [self.assess(probe, noise) for probe in self.probes(start, everything=True)]
        chosen: list[Fit] = []
        for probe in sorted(points, key=lambda fit: -fit.score):
            if sum(fit.causes == probe.causes for fit in chosen) < 2:
                chosen.append(probe)
        return [self.assess(self.refine(fit, noise, 3), noise) for fit in chosen[:_SCANNED]]

    def _challengers(self, leader: Fit, noise: Noise,
                     pool: Mapping[tuple[str, ...], Fit]) -> tuple[list[Fit], dict[tuple[str, ...], float]]:
        """What may explain more than the leader does, fitted with its derivatives; and what these promised."""
        evidence = self.seen(leader, noise.heavy(self.residuals(leader.predicted), _JUDGED)[0])
        promising = {s: lead for lead, s in self.candidates(leader, evidence)
                     if lead > -(_PROMISING if len(s) > len(leader.causes) else _SWAPPED)
                     and not (s in pool and pool[s].settled)}
        starts = [self.assess(self.start(leader, s, evidence), noise) for s in list(promising)[:_STARTED]]
        starts = sorted(starts, key=lambda fit: -max(fit.score - leader.score, promising[fit.causes]))[:_SHORTLIST]
        starts += self._probed(leader, noise, pool)
        return [self.assess(self.refine(start, noise, 3), noise) for start in starts], promising

    def _probed(self, leader: Fit, noise: Noise, pool: Mapping[tuple[str, ...], Fit]) -> list[Fit]:
        """The better probe of each cause, where it explains more than the leader does."""
        noise, _ = noise.heavy(self.residuals(leader.predicted))
        now = self.cost(noise, leader)
        found: dict[tuple[str, ...], tuple[float, Fit]] = {}
        for start in self.probes(leader, everything=False):
            cost = self.cost(noise, start)
            if start.causes not in pool and cost < min(now, found.get(start.causes, (np.inf,))[0]):
                found[start.causes] = (cost, start)
        return [start for _, start in found.values()]


def log_prior(causes: Iterable[str]) -> float:
    """Log odds of a set of causes before anything was measured."""
    causes = list(causes)
    count = len({cause.partition(":")[0] for cause in causes})
    return FIRST * min(count, 1) + FURTHER * max(count - 1, 0) + SECOND_PARAMETER * (len(causes) - count)


def _key(causes: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(causes))
