"""Which effects explain what a simulation gets wrong, how sure that is, and what cannot be told apart.

A *supposition* is a set of effects: their parameters may be anything plausible, all others only what a
healthy car's are. Screening is linear and covers every effect; the survivors are fitted by simulation; the
decision is their evidence, which projects nuisances out and charges for freedom, together with how well
each run is predicted from the others.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.evidence import Linear, Posterior, prior
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.predict import Coordinate, Predictor

log = logging.getLogger("cosim")

MOST_EFFECTS = 9
_SHORTLIST = 4
PRIOR_EFFECT = -4.0  # log odds that a given effect is there
_ACCEPT = 3.0  # log odds to take an effect in
_ENSEMBLE = 12  # runs with a wandering torque that make the noise
_SETTLED = 20.0  # gain in the logarithm of the noise's determinant that is worth another round


@dataclass
class Fit:
    """A supposition fitted to all runs.

    Attributes:
        effects: The effects it has.
        point: Coordinates, most probable.
        predicted: Stacked channels of each run.
        jacobians: Derivatives, as fresh as they were needed.
        linear: The runs linearised there under the noise of the comparison.
        posterior: Belief about the coordinates.
        score: Log evidence and log prior.
    """

    effects: tuple[str, ...]
    point: np.ndarray
    predicted: list[np.ndarray]
    jacobians: list[np.ndarray] = field(repr=False)
    linear: Linear | None = field(default=None, repr=False)
    posterior: Posterior | None = field(default=None, repr=False)
    score: float = -np.inf


@dataclass
class Identification:
    """What the search found.

    Attributes:
        best: The most probable supposition; no effects where nothing is wrong.
        alternatives: All suppositions that were fitted, the best first, ``best`` among them.
        healthy: The supposition without effects.
        nominal: Predictions by the vehicle file as it is, start speeds fitted.
        noise: Under which they were compared.
    """

    best: Fit
    alternatives: list[Fit]
    healthy: Fit
    nominal: list[np.ndarray]
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
        self.measured = [run.stacked for run in predictor.runs]
        self.effects = list(dict.fromkeys(c.effect for c in self.coordinates if c.effect))

    # -- one supposition ------------------------------------------------------------------------

    def residuals(self, predicted: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Measured minus predicted of every run."""
        return [y - p for y, p in zip(self.measured, predicted)]

    def cost(self, noise: Noise, predicted: Sequence[np.ndarray] | None, point: np.ndarray,
             spread: np.ndarray) -> float:
        """Minus the log posterior density, up to a constant."""
        if predicted is None:
            return np.inf
        fit = sum(float(np.sum(noise.whiten(r, e) ** 2)) for r, e in enumerate(self.residuals(predicted)))
        used = spread > 0.0
        return 0.5 * fit / noise.temperature + 0.5 * float(np.sum((point[used] / spread[used]) ** 2))

    def assess(self, fit: Fit, noise: Noise) -> Fit:
        """Evidence of a fitted supposition under a noise."""
        white = [noise.whiten(r, e) for r, e in enumerate(self.residuals(fit.predicted))]
        slopes = [noise.whiten(r, j) for r, j in enumerate(fit.jacobians)]
        fit.linear = Linear(self.coordinates, fit.point, white, slopes, noise.temperature)
        fit.posterior = fit.linear.posterior(prior(self.coordinates, fit.effects))
        fit.score = fit.posterior.log_evidence + PRIOR_EFFECT * len(fit.effects)
        return fit

    def refine(self, fit: Fit, noise: Noise, iterations: int = 8, renewals: int = 0) -> Fit:
        """Most probable coordinates, by Gauss-Newton with Levenberg's damping.

        Derivatives by the parameters of the supposed effects are computed at the start; then every step
        taken corrects all of them along its direction (Broyden). Where that leads no further all are
        computed anew, at most ``renewals`` times.
        """
        spread = prior(self.coordinates, fit.effects)
        used = np.flatnonzero(spread > 0.0)
        own = [i for i in used if self.coordinates[i].effect in fit.effects]
        low = np.array([c.low for c in self.coordinates])
        high = np.array([c.high for c in self.coordinates])
        now = self.cost(noise, fit.predicted, fit.point, spread)
        jacobians = [j.copy() for j in fit.jacobians]
        if own and not renewals:
            for whole, part in zip(jacobians, self.predictor.jacobian(fit.point, fit.predicted, own)):
                whole[:, own] = part
        damping, fresh = 0.0, False
        for _ in range(iterations):
            square, slope = self._normal(noise, fit, jacobians, spread, used)
            gained = 0.0
            for _ in range(4):
                move = np.linalg.solve(square + damping * np.eye(used.size), slope)
                point = fit.point.copy()
                point[used] = np.clip(point[used] + spread[used] * move, low[used], high[used])
                predicted = self.predictor.all_runs(point)
                gained = now - self.cost(noise, predicted, point, spread)
                if gained > 0.0:
                    break
                damping = max(10.0 * damping, 1e-3 * float(np.trace(square)) / used.size)
            if gained > 0.0:
                self._learn(jacobians, point - fit.point, predicted, fit.predicted, spread)
                now, fit = now - gained, Fit(fit.effects, point, predicted, jacobians)
                damping, fresh = 0.1 * damping if damping > 1.0 else 0.0, False
            if gained < 1.0:
                if fresh or not renewals:
                    break
                renewals, fresh, damping = renewals - 1, True, 0.0
                jacobians = self.relinearise(fit).jacobians
        return Fit(fit.effects, fit.point, fit.predicted, jacobians)

    def _normal(self, noise: Noise, fit: Fit, jacobians: Sequence[np.ndarray], spread: np.ndarray,
                used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix and gradient of the log posterior in units of the prior."""
        square, slope = np.eye(used.size), -fit.point[used] / spread[used]
        for r, error in enumerate(self.residuals(fit.predicted)):
            columns = noise.whiten(r, jacobians[r][:, used] * spread[used])
            square = square + columns.T @ columns / noise.temperature
            slope = slope + columns.T @ noise.whiten(r, error) / noise.temperature
        return square, slope

    def _learn(self, jacobians: list[np.ndarray], moved: np.ndarray, after: Sequence[np.ndarray],
               before: Sequence[np.ndarray], spread: np.ndarray) -> None:
        """Make the derivatives agree with a step that was made (Broyden's update in units of the prior)."""
        for r, slopes in enumerate(jacobians):
            there = np.array([c.run in (None, r) and not _stays(c) for c in self.coordinates])
            direction = np.where(there, spread**2 * moved, 0.0)
            weight = float(direction @ moved)
            if weight > 0.0:
                slopes += np.outer(after[r] - before[r] - slopes @ moved, direction / weight)

    def relinearise(self, fit: Fit) -> Fit:
        """Renew all derivatives."""
        columns = [i for i, c in enumerate(self.coordinates) if not fit.jacobians or not _stays(c)]
        fresh = self.predictor.jacobian(fit.point, fit.predicted, columns)
        jacobians = [j.copy() for j in fit.jacobians or fresh]
        for whole, part in zip(jacobians, fresh):
            whole[:, columns] = part
        fit.jacobians = jacobians
        return fit

    # -- screening ------------------------------------------------------------------------------

    def candidates(self, fit: Fit, noise: Noise) -> list[tuple[float, tuple[str, ...]]]:
        """Every effect added to those of ``fit`` or put in place of one, by linear evidence, best first."""
        linear = Linear(self.coordinates, fit.point,
                        [noise.whiten(r, e) for r, e in enumerate(self.residuals(fit.predicted))],
                        [noise.whiten(r, j) for r, j in enumerate(fit.jacobians)], noise.temperature)
        sets: set[tuple[str, ...]] = set()
        for effect in self.effects:
            if effect in fit.effects:
                continue
            sets.add((*fit.effects, effect))
            for gone in fit.effects:
                sets.add((*(e for e in fit.effects if e != gone), effect))
        for gone in fit.effects:
            sets.add(tuple(e for e in fit.effects if e != gone))
        sets.discard(())
        scored = [(linear.posterior(prior(self.coordinates, s)).log_evidence + PRIOR_EFFECT * len(s), s)
                  for s in sets]
        return sorted(scored, reverse=True)

    def probes(self, fit: Fit) -> list[Fit]:
        """Starts for effects that do nothing while they are small."""
        starts = []
        for effect in self.effects:
            if effect in fit.effects:
                continue
            for i in self.predictor.index(effect):
                for size in self.coordinates[i].parameter.probes:
                    point = fit.point.copy()
                    for j in self.predictor.index(effect):
                        sizes = self.coordinates[j].parameter.probes
                        if sizes:
                            point[j] = self.coordinates[j].parameter.coordinate(sizes[0])
                    point[i] = self.coordinates[i].parameter.coordinate(size)
                    starts.append(Fit((*fit.effects, effect), point, [], fit.jacobians))
        return starts

    # -- the search -----------------------------------------------------------------------------

    def run(self) -> Identification:
        """Forward, backward and swap until no supposition is better."""
        zero = np.zeros(len(self.coordinates))
        predicted = self.predictor.all_runs(zero)
        if predicted is None:
            raise ArithmeticError("the plant of the vehicle file cannot be simulated with these inputs")
        self.say(f"sensitivities to {len(self.coordinates)} parameters over {len(self.measured)} runs")
        self.quiet = Noise(self.predictor.runs, self.predictor.ensembles(zero, predicted, _ENSEMBLE))
        start = self.relinearise(Fit((), zero, predicted, []))
        nominal = self._settled(start, self.noise(start))
        best = self.settle(start, rounds=3)
        noise = self.noise(best)
        best = self.assess(best, noise)
        tried: dict[tuple[str, ...], Fit] = {(): best}
        for _ in range(MOST_EFFECTS + 3):
            found = self._improve(best, noise, tried)
            if found is None:
                break
            best, noise = found
            self.say(f"taken in: {', '.join(best.effects)}")
        fits = self._alternatives(best, noise, tried)
        return Identification(fits[0], fits, next(f for f in fits if not f.effects), nominal, noise)

    def noise(self, fit: Fit) -> Noise:
        """The noise that a fitted supposition leaves."""
        return self.quiet.fitted(self.residuals(fit.predicted))

    def settle(self, fit: Fit, rounds: int = 2, renewals: int = 1) -> Fit:
        """Fitted, the scales of the noise following what is left to explain."""
        for _ in range(rounds):
            noise = self.noise(fit)
            fit = self.refine(fit, noise, renewals=renewals)
            if noise.size - self.noise(fit).size < _SETTLED:
                break
        return fit

    def _settled(self, start: Fit, noise: Noise) -> list[np.ndarray]:
        """The vehicle file as it is, only the start speed of each run fitted."""
        spread = np.array([c.spread if c.name == "start_speed" else 0.0 for c in self.coordinates])
        linear = Linear(self.coordinates, start.point,
                        [noise.whiten(r, e) for r, e in enumerate(self.residuals(start.predicted))],
                        [noise.whiten(r, j) for r, j in enumerate(start.jacobians)])
        return self.predictor.all_runs(linear.posterior(spread).mean) or start.predicted

    def _improve(self, best: Fit, noise: Noise, tried: dict) -> tuple[Fit, Noise] | None:
        """The best supposition one change away from ``best``, with its noise; None if there is no better.

        The noise that ``best`` leaves holds whatever it cannot explain, so under it nothing counts for much.
        So all are fitted under it, but compared under the noise that the one which explains most leaves.
        """
        listed = [(score, s) for score, s in self.candidates(best, noise)
                  if _key(s) not in tried and len(s) <= MOST_EFFECTS]
        starts = []
        for effects in [s for score, s in listed[:_SHORTLIST] if score > best.score - 10.0]:
            spread = prior(self.coordinates, effects)
            starts.append(Fit(effects, np.where(spread > 0.0, best.point, 0.0), best.predicted, best.jacobians))
        starts += self._probed(best, noise, tried)
        fits = [self.settle(start, 1, renewals=0) for start in starts]
        if not fits:
            return None
        sharp = min((self.noise(fit) for fit in [best, *fits]), key=lambda noise: noise.size)
        fits = sorted((self.assess(fit, sharp) for fit in fits), key=lambda fit: -fit.score)
        fits = [self.settle(fit) for fit in fits[:2]] + fits[2:]
        sharp = min((self.noise(fit) for fit in [best, *fits]), key=lambda noise: noise.size)
        best = self.assess(best, sharp)
        fits = [self.assess(fit, sharp) for fit in fits]
        for fit in fits:
            tried[_key(fit.effects)] = fit
        leader = max(fits, key=lambda fit: fit.score)
        self.say("  " + "; ".join(f"{'+'.join(f.effects)} {f.score - best.score:+.0f}" for f in
                                  sorted(fits, key=lambda fit: -fit.score)))
        if leader.score < best.score + _ACCEPT:
            return None
        leader = self.relinearise(self.settle(leader))
        noise = self.noise(leader)
        leader = self.assess(leader, noise)
        tried[_key(leader.effects)] = leader
        return leader, noise

    def _probed(self, best: Fit, noise: Noise, tried: dict) -> list[Fit]:
        """The promising ones among the probes: better than ``best`` once all else has adapted, linearly."""
        found: dict[tuple[str, ...], tuple[float, Fit]] = {}
        for start in self.probes(best):
            if _key(start.effects) in tried:
                continue
            start.predicted = self.predictor.all_runs(start.point)
            if start.predicted is None:
                continue
            own = [i for i, c in enumerate(self.coordinates) if c.effect == start.effects[-1]]
            start.jacobians = [j.copy() for j in best.jacobians]
            for whole, part in zip(start.jacobians,
                                   self.predictor.jacobian(start.point, start.predicted, own)):
                whole[:, own] = part
            score = self.assess(start, noise).score
            if score > best.score - 5.0 and score > found.get(start.effects, (-np.inf,))[0]:
                found[start.effects] = (score, start)
        return [start for _, start in found.values()]

    def _alternatives(self, best: Fit, noise: Noise, tried: dict) -> list[Fit]:
        """Everything that competes with the best: fitted, under the same noise, best first."""
        for score, effects in self.candidates(best, noise)[:6]:
            if score > best.score - 12.0 and _key(effects) != _key(best.effects) and effects:
                known = tried.get(_key(effects))
                spread = prior(self.coordinates, effects)
                start = known or Fit(effects, np.where(spread > 0.0, best.point, 0.0), best.predicted,
                                     best.jacobians)
                start = Fit(effects, start.point, start.predicted, best.jacobians)
                tried[_key(effects)] = self.settle(start, renewals=0)
        fits = [self.assess(fit, noise) for fit in tried.values()]
        return sorted(fits, key=lambda fit: -fit.score)


def _stays(coordinate: Coordinate) -> bool:
    """Whether a number of the file that no effect moves: it stays near 0, so its first derivative will do."""
    return not coordinate.effect and coordinate.run is None


def _key(effects: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted(effects))


# -- what the fits say ------------------------------------------------------------------------------


def probabilities(found: Identification, else_score: float = -np.inf) -> dict[str, float]:
    """Probability that each effect is there: the suppositions' shares of all evidence."""
    scores = np.array([fit.score for fit in found.alternatives] + [else_score])
    weights = np.exp(scores - scores.max())
    weights /= weights.sum()
    shares: dict[str, float] = {}
    for fit, weight in zip(found.alternatives, weights):
        for effect in fit.effects:
            shares[effect] = shares.get(effect, 0.0) + float(weight)
    return shares


def inseparable(found: Identification, threshold: float = 3.0) -> list[tuple[Fit, float]]:
    """Other suppositions the data cannot tell from the best one, with their separation in sigma."""
    close = []
    for fit in found.alternatives:
        if fit is found.best or not fit.effects or set(fit.effects) > set(found.best.effects):
            continue
        distance = np.sqrt(2.0 * max(found.best.score - fit.score, 0.0))
        if distance < threshold:
            close.append((fit, float(distance)))
    return close


def separations(search: Search, fit: Fit, linear: Linear) -> dict[tuple[str, str], float]:
    """How far two effects at their detection limits are apart, before anything is fitted [sigma]."""
    result = {}
    for a, b in itertools.combinations(search.effects, 2):
        found = []
        for one, other in ((a, b), (b, a)):
            change = np.zeros(len(search.coordinates))
            for i in search.predictor.index(one):
                change[i] = CATALOGUE[one].parameters[0].detection if i == search.predictor.index(one)[0] else 0.0
            found.append(linear.separation(change, prior(search.coordinates, [*fit.effects, other])))
        result[(a, b)] = min(found)
    return result
