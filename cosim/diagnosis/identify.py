"""Which effects explain what a simulation gets wrong, how sure that is, and what cannot be told apart.

A *supposition* is a set of causes: their parameters may be anything plausible, all others only what a
healthy car's are. A cause is an effect of the catalogue, or one parameter of an effect whose parameters mean
something alone. Screening is linear and covers every cause added, dropped or swapped; the best are fitted by
simulation, compared under one noise, and the search goes on from the best of them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
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
FIRST, FURTHER = -3.0, -7.0  # log odds that a given effect is there, as the first and beside others
SECOND_PARAMETER = -3.0  # and that a second parameter of an effect is off as well
_ACCEPT = 2.0  # log odds to take a cause in
_ENSEMBLE = 8  # simulations with a wandering torque
_SHORTLIST = 5  # suppositions that are fitted in each round
_RIVAL, _RIVALS = 8.0, 2  # linear log evidence below the best at which a rival is fitted; how many
_CLOSE = 150.0  # log evidence that fits which were not polished may be wrong by
_FAR = 8.0  # tolerances from the file at which a fit without a cause begins without its value
_PROMISING = 12.0  # linear log evidence below the best of the round at which a supposition is not fitted


@dataclass
class Fit:
    """A supposition fitted to all runs.

    Attributes:
        causes: The causes it has.
        shared: Most probable coordinates; those of single runs are 0.
        points: The coordinates of each run: what is shared and deviations from it, and its own.
        predicted: Stacked channels of each run.
        jacobians: Derivatives of them by all coordinates, as fresh as they were needed.
        posterior: Belief about the shared coordinates under the noise of the comparison.
        score: Log evidence and log prior under it.
    """

    causes: tuple[str, ...]
    shared: np.ndarray
    points: list[np.ndarray]
    predicted: list[np.ndarray] = field(repr=False)
    jacobians: list[np.ndarray] = field(repr=False)
    evidence: Evidence | None = field(default=None, repr=False)
    posterior: Posterior | None = field(default=None, repr=False)
    score: float = -np.inf

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
        self.numbers = [i for i, c in enumerate(self.coordinates) if c.run is None and not c.effect]

    # -- one supposition ------------------------------------------------------------------------

    def residuals(self, predicted: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Measured minus predicted of every run."""
        return [y - p for y, p in zip(self.measured, predicted)]

    def noise(self, fit: Fit) -> Noise:
        """The noise that a fitted supposition leaves."""
        return Noise(self.predictor.runs, self.residuals(fit.predicted), self.swayed)

    def least_noise(self, fit: Fit) -> Noise:
        """The noise that is left at a fit when everything may be wrong, as far as derivatives tell.

        What a cause does that is still missing is no noise, however large and however alike from sample to
        sample it is.
        """
        residuals, noise = self.residuals(fit.predicted), self.noise(fit)
        everything = np.array([c.spread for c in self.coordinates])
        for _ in range(2):
            evidence = self.seen(fit, noise, self.slopes(noise, fit.jacobians))
            best = evidence.posterior(everything).mean
            left = [e - j @ (seen.point(best) - point) for e, j, seen, point in zip(
                residuals, fit.jacobians, evidence.seen, fit.points)]
            noise = Noise(self.predictor.runs, left, self.swayed)
        return noise

    def slopes(self, noise: Noise, jacobians: Sequence[np.ndarray]) -> list[Slopes]:
        """Derivatives of all runs under a noise."""
        return [Slopes(self.layout, r, noise.whiten(r, j)) for r, j in enumerate(jacobians)]

    def assess(self, fit: Fit, noise: Noise) -> Fit:
        """Evidence of a fitted supposition under a noise."""
        noise, cost = noise.heavy(self.residuals(fit.predicted))
        fit.evidence = self.seen(fit, noise, self.slopes(noise, fit.jacobians))
        fit.posterior = fit.evidence.posterior(prior(self.coordinates, fit.causes))
        fit.score = fit.posterior.log_evidence - cost + log_prior(fit.causes)
        return fit

    def seen(self, fit: Fit, noise: Noise, slopes: Sequence[Slopes]) -> Evidence:
        """What the runs say at the points of a fit."""
        return Evidence([s.seen(noise.whiten(r, e), point) for r, (s, e, point) in enumerate(
            zip(slopes, self.residuals(fit.predicted), fit.points))])

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

    def refine(self, fit: Fit, noise: Noise, iterations: int = 6) -> Fit:
        """Most probable coordinates, by Gauss-Newton; every run follows as far as it gains.

        Derivatives by the supposed causes are renewed at every step, the others are those of the start.
        """
        spread = prior(self.coordinates, fit.causes)
        own = [i for cause in fit.causes for i in self.predictor.index(cause)]
        noise, _ = noise.heavy(self.residuals(fit.predicted))
        now = self.cost(noise, fit)
        jacobians, stale = [j.copy() for j in fit.jacobians], False
        slopes = self.slopes(noise, jacobians)
        for _ in range(iterations):
            if stale and own:
                for whole, part in zip(jacobians, self.predictor.jacobian(fit.points, fit.predicted, own)):
                    whole[:, own] = part
                slopes = self.slopes(noise, jacobians)
            evidence = self.seen(fit, noise, slopes)
            best = np.zeros(len(self.coordinates))
            best[self.layout.shared] = evidence.posterior(spread).mean
            best = np.clip(best, self.low, self.high)
            goals = [np.clip(seen.point(best[self.layout.shared]), self.low, self.high) for seen in evidence.seen]
            gained = 0.0
            for share in (1.0, 0.3, 0.1):
                moved = self._moved(fit, noise, fit.shared + share * (best - fit.shared), goals, share)
                gained = now - self.cost(noise, moved)
                if gained > 0.0:
                    break
            if gained <= 0.0:
                break
            now, stale, fit = now - gained, True, moved
            if gained < 2.0:
                break
        fit.jacobians = jacobians
        return fit

    def _moved(self, fit: Fit, noise: Noise, shared: np.ndarray, goals: Sequence[np.ndarray],
               share: float) -> Fit:
        """Shared coordinates moved, and each run towards its goal as far as that is better than to stay."""
        runs = range(len(goals))
        points, predicted = list(fit.points), list(fit.predicted)
        staying = [self.run_cost(noise, r, predicted[r], shared, points[r]) for r in runs]
        waiting = list(runs)
        for part in (share, 0.3 * share):
            tries = {r: fit.points[r] + part * (goals[r] - fit.points[r]) for r in waiting}
            found = self.predictor.many([(point, r) for r, point in tries.items()])
            for (r, point), y in zip(tries.items(), found):
                if self.run_cost(noise, r, y, shared, point) < staying[r]:
                    points[r], predicted[r] = point, y
                    waiting.remove(r)
            if not waiting:
                break
        shared = shared.copy()
        for i, c in enumerate(self.coordinates):
            if c.run is not None and c.effect:  # shared in name only
                shared[i] = points[c.run][i]
        return Fit(fit.causes, shared, points, predicted, fit.jacobians)

    def relinearise(self, fit: Fit, columns: Iterable[int] | None = None) -> Fit:
        """Renew derivatives; all but those by the file's numbers unless said otherwise."""
        if columns is None:
            columns = range(len(self.coordinates)) if not fit.jacobians else [
                i for i in range(len(self.coordinates)) if i not in self.numbers]
        columns = list(columns)
        fresh = self.predictor.jacobian(fit.points, fit.predicted, columns)
        if not fit.jacobians:
            fit.jacobians = [np.zeros((y.size, len(self.coordinates)), dtype=np.float32) for y in fit.predicted]
        fit.jacobians = [j.copy() for j in fit.jacobians]
        for whole, part in zip(fit.jacobians, fresh):
            whole[:, columns] = part
        return fit

    def worth(self, fit: Fit) -> bool:
        """Whether all its causes are large enough to be some."""
        sizes = sorted(self.size(fit, cause) for cause in fit.causes)
        return not sizes or sizes[-1] >= SMALLEST and all(size >= SMALLEST_FURTHER for size in sizes[:-1])

    # -- screening ------------------------------------------------------------------------------

    def candidates(self, fit: Fit, noise: Noise) -> list[tuple[float, tuple[str, ...]]]:
        """Every cause added to those of ``fit`` or put in place of one, by linear evidence, best first."""
        evidence = self.seen(fit, noise, self.slopes(noise, fit.jacobians))
        sets: set[tuple[str, ...]] = set()
        for cause in self.causes:
            if cause in fit.causes:
                continue
            sets.add(_key((*fit.causes, cause)))
            for gone in fit.causes:
                sets.add(_key((*(e for e in fit.causes if e != gone), cause)))
        for gone in fit.causes:
            sets.add(_key(e for e in fit.causes if e != gone))
        scored = [(evidence.posterior(prior(self.coordinates, s)).log_evidence + log_prior(s), s)
                  for s in sets]
        return sorted(scored, reverse=True)

    def start(self, best: Fit, causes: tuple[str, ...]) -> Fit:
        """Where the fit of a supposition begins: at another one's, without what a healthy car would not have."""
        shared, points = best.shared.copy(), [p.copy() for p in best.points]
        gone = [i for e in set(best.causes) - set(causes) for i in self.predictor.index(e)
                if abs(shared[i]) > _FAR * self.coordinates[i].tolerance]
        predicted = best.predicted
        if gone:
            shared[gone] = 0.0
            for p in points:
                p[gone] = 0.0
            predicted = self.predictor.all_runs(points)
            if predicted is None:
                return Fit(causes, best.shared, best.points, best.predicted, best.jacobians)
        return Fit(causes, shared, points, predicted, best.jacobians)

    def polished(self, fit: Fit, noise: Noise, rounds: int = 2) -> Fit:
        """Refined with derivatives of its own, renewed ``rounds`` times.

        It starts from where it is and from the file with its causes in, whichever ends better: what a healthy
        car may have was fitted while causes were missing, and may have gone astray for them.
        """
        fit = self.relinearise(fit)
        kept = [i for cause in fit.causes for i in self.predictor.index(cause)]
        shared = np.zeros(len(self.coordinates))
        shared[kept] = fit.shared[kept]
        points = [shared.copy() for _ in fit.points]
        predicted = self.predictor.all_runs(points)
        ends = [self.refine(fit, noise, 4)]
        if predicted is not None:
            ends.append(self.refine(Fit(fit.causes, shared, points, predicted, fit.jacobians), noise, 4))
        fit = max((self.assess(end, noise) for end in ends), key=lambda end: end.score)
        for _ in range(rounds - 1):
            fit = self.refine(self.relinearise(fit), noise, 4)
        return self.assess(fit, noise)

    def size(self, fit: Fit, cause: str) -> float:
        """How large an cause is, in detection limits."""
        found = [fit.shared[i] / self.coordinates[i].parameter.detection for i in self.predictor.index(cause)]
        swings = [x for i, x in zip(self.predictor.index(cause), found) if self.coordinates[i].run is not None]
        if swings:  # two components for each run
            return float(np.sqrt(2.0 * np.mean(np.square(swings))))
        return float(np.linalg.norm(found))

    def probes(self, best: Fit) -> list[Fit]:
        """Starts for causes that do nothing while they are small."""
        starts = []
        for cause in self.causes:
            mine = [i for i in self.predictor.index(cause) if self.coordinates[i].run is None]
            if cause in best.causes or not mine or not self.coordinates[mine[-1]].parameter.probes:
                continue
            count = max(len(self.coordinates[i].parameter.probes) for i in mine)
            for k in range(count):
                shared, points = best.shared.copy(), [p.copy() for p in best.points]
                for i in mine:
                    sizes = self.coordinates[i].parameter.probes
                    if sizes:
                        x = self.coordinates[i].parameter.coordinate(sizes[min(k, len(sizes) - 1)])
                        for vector in (shared, *points):
                            vector[i] = x
                predicted = self.predictor.all_runs(points)
                if predicted is not None:
                    starts.append(Fit(_key((*best.causes, cause)), shared, points, predicted, best.jacobians))
        return starts


    # -- the search -----------------------------------------------------------------------------

    def run(self) -> Identification:
        """Forward, backward and swap until no supposition is better."""
        zero = np.zeros(len(self.coordinates))
        points = [zero.copy() for _ in self.measured]
        predicted = self.predictor.all_runs(points)
        if predicted is None:
            raise ArithmeticError("the plant of the vehicle file cannot be simulated with these inputs")
        self.say(f"sensitivities to {len(self.coordinates)} parameters over {len(self.measured)} runs")
        self.swayed = self.predictor.swayed(points, predicted, _ENSEMBLE)
        first = self.relinearise(Fit((), zero, points, predicted, []))
        best = self.refine(first, self.least_noise(first))
        best = self.refine(best, self.least_noise(best))
        tried: dict[tuple[str, ...], Fit] = {(): best}
        noise = self.noise(best)
        best = self.assess(best, noise)
        for _ in range(MOST_CAUSES + 3):
            found = self._improve(best, tried)
            if found is None:
                break
            best = found
            self.say(f"taken in: {', '.join(best.causes)}")
        noise = min((self.noise(fit) for fit in tried.values()), key=lambda noise: noise.size)
        best = self.assess(best, noise)
        for causes in self._rivals(best, noise, tried):
            tried[causes] = self.polished(self.start(best, causes), noise, 1)
        fits = sorted((self.assess(fit, noise) for fit in tried.values()), key=lambda fit: -fit.score)
        fits = [fit for fit in fits if self.worth(fit)]
        if fits[0].score > tried[best.causes].score + _ACCEPT:
            best = fits[0]
        best = tried[best.causes]
        return Identification(best, [best, *(fit for fit in fits if fit is not best)], tried[()], noise)

    def _rivals(self, best: Fit, noise: Noise, tried: dict[tuple[str, ...], Fit]) -> list[tuple[str, ...]]:
        """Suppositions not yet fitted that may explain as much as the best."""
        own = best.evidence.posterior(prior(self.coordinates, best.causes)).log_evidence + log_prior(best.causes)
        return [s for score, s in self.candidates(best, noise)
                if score > own - _RIVAL and s not in tried and len(s) <= max(1, len(best.causes))][:_RIVALS]

    def _improve(self, best: Fit, tried: dict[tuple[str, ...], Fit]) -> Fit | None:
        """The best supposition one change away from ``best``; None if there is no better.

        The noise that ``best`` leaves holds whatever it cannot explain, so under it nothing counts for much.
        So all are fitted under it, but compared under the noise that the one which explains most leaves.
        """
        noise = self.least_noise(best)
        listed = [(score, s) for score, s in self.candidates(best, noise) if s not in tried
                  and len(s) <= MOST_CAUSES]
        if not listed:
            return None
        starts = [self.start(best, s) for score, s in listed[:_SHORTLIST]
                  if score > max(listed[0][0] - _PROMISING, best.score - _ACCEPT)]
        starts += self._probed(best, noise, tried)
        fits = [self.refine(start, noise, 3) for start in starts]
        if not fits:
            return None
        sharp = min((self.noise(fit) for fit in [best, *fits]), key=lambda noise: noise.size)
        leader = max((self.assess(fit, sharp) for fit in fits), key=lambda fit: fit.score)
        leader = self.polished(leader, sharp)
        sharp = min(sharp, self.noise(leader), key=lambda noise: noise.size)
        # one that is stuck explains less than it could: all shall have started from the best point there is
        self.assess(leader, sharp)
        close = [fit for fit in fits if fit.causes != leader.causes
                 and self.assess(fit, sharp).score > leader.score - _CLOSE]
        close = [best, *sorted(close, key=lambda fit: -fit.score)[:_RIVALS]]
        again = [self.polished(self.start(leader, fit.causes), sharp, 1) for fit in close]
        for fit in [best, *fits, *again, leader]:
            self.assess(fit, sharp)
            if fit.causes not in tried or fit.causes == best.causes or fit.score > tried[fit.causes].score:
                tried[fit.causes] = fit
        best = max((fit for fit in [best, *again] if fit.causes == best.causes), key=lambda fit: fit.score)
        tried[best.causes] = best
        self.say("; ".join(f"{'+'.join(f.causes) or 'healthy'} {f.score - best.score:+.0f}" for f in
                           sorted([leader, *again], key=lambda fit: -fit.score)))
        leader = max([leader, *again], key=lambda fit: fit.score)
        if leader.score < best.score + _ACCEPT or not self.worth(leader):
            return None
        return leader

    def _probed(self, best: Fit, noise: Noise, tried: dict[tuple[str, ...], Fit]) -> list[Fit]:
        """The better probe of each cause, where it explains more than ``best`` does."""
        now = self.cost(noise, best)
        found: dict[tuple[str, ...], tuple[float, Fit]] = {}
        for start in self.probes(best):
            if start.causes in tried:
                continue
            cost = self.cost(noise, start)
            if cost < now and cost < found.get(start.causes, (np.inf,))[0]:
                found[start.causes] = (cost, start)
        return [start for _, start in found.values()]


def log_prior(causes: Iterable[str]) -> float:
    """Log odds of a set of causes before anything was measured."""
    causes = list(causes)
    count = len({cause.partition(":")[0] for cause in causes})
    return FIRST * min(count, 1) + FURTHER * max(count - 1, 0) + SECOND_PARAMETER * (len(causes) - count)


def _key(causes: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(causes))
