"""One supposition fitted to all runs: Gauss-Newton on simulations, with derivatives that follow the steps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cosim.diagnosis.fit.evidence import Evidence, Layout, Posterior, Slopes, prior
from cosim.diagnosis.fit.noise import Noise, floors
from cosim.diagnosis.fit.predict import Predictor, effect_of

# Log odds that a given effect is there: of thirty, one in two that a car has any, as who asks has a reason to. What is
# not there gains up to 1, and is then smaller than what counts (``pool.SMALLEST``).
EFFECT = -3.4
SECOND_PARAMETER = -3.0  # and that a second parameter of it is off as well
# What the fit of one cause misses may look like another. So that one, beside others, has to be _CLEAR, or more than one
# recording shows it where there are ENOUGH: all but the one that shows it best say so much of it (log evidence).
ENOUGH, _CLEAR, _ALSO = 3, 4.0, 3.0
_ENSEMBLE = 8  # simulations with a wandering torque
SETTLED = 1.0  # log evidence that a fit with new derivatives may still gain
_PROMISED = 5.0  # log evidence; more that derivatives promise and a fit does not reach is worth a further set of them
_BENT = 2.0  # squared distance [sigma] between a run and its tangent at which derivatives are renewed
_JUDGED = 2.0  # power of the heavy tail where suppositions are compared
_ROUNDS = 6  # of new derivatives for a fit
_COOLING = (1000.0, 100.0, 10.0)  # temperatures of a fit that begins at the vehicle file, before that of the noise


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
        hope: Log evidence and log prior under it, where the derivatives say that it is highest.
        score: The same where the fit is.
        foretold: Log evidence of each run, given all others; None where runs are too few.
        near: Whether new derivatives by its causes and the runs' own gained nothing more.
        settled: Whether new ones by everything did not.
        stuck: Whether new ones by everything gained nothing, though they promised it.
    """

    causes: tuple[str, ...]
    shared: np.ndarray
    points: list[np.ndarray]
    predicted: list[np.ndarray] = field(repr=False)
    tangents: list[Tangent] = field(repr=False)
    posterior: Posterior | None = field(default=None, repr=False)
    hope: float = -np.inf
    score: float = -np.inf
    foretold: np.ndarray | None = field(default=None, repr=False)
    near: bool = False
    settled: bool = False
    stuck: bool = False

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects of the catalogue that its causes belong to."""
        return tuple(dict.fromkeys(effect_of(cause) for cause in self.causes))

    def without(self, gone: str) -> tuple[str, ...]:
        """Its causes but for one."""
        return tuple(cause for cause in self.causes if cause != gone)


class Fitter:
    """Fits suppositions to the runs of a predictor, and says how evident they are.

    Args:
        predictor: Over all runs.
    """

    def __init__(self, predictor: Predictor) -> None:
        self.predictor, self.coordinates = predictor, predictor.coordinates
        self.layout = Layout(self.coordinates, predictor.repeats)
        self.measured = [run.stacked for run in predictor.runs]
        self.scale = np.array([c.tolerance for c in self.coordinates])

    def nominal(self) -> Fit:
        """The vehicle file as it is, with derivatives by everything.

        Raises:
            ArithmeticError: It cannot be simulated.
        """
        return self.at(np.zeros(len(self.coordinates)))

    def at(self, shared: np.ndarray) -> Fit:
        """No cause, all runs at some coordinates, with derivatives by everything.

        Raises:
            ArithmeticError: They cannot be simulated.
        """
        points = [shared.copy() for _ in self.measured]
        predicted = self.predictor.all_runs(points)
        if predicted is None:
            raise ArithmeticError("the plant cannot be simulated with these values and inputs")
        tangents = self.predictor.jacobian(points, predicted, dict(enumerate(self.layout.columns)))
        return Fit((), shared, points, predicted, [Tangent(jacobian) for jacobian in tangents])

    def residuals(self, predicted: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Measured minus predicted of every run."""
        return [y - p for y, p in zip(self.measured, predicted)]

    def noise(self, fit: Fit) -> Noise:
        """What is left of the residuals where a fitted supposition is right."""
        strays = self.predictor.strays(fit.points, fit.predicted, _ENSEMBLE)
        of = floors(self.predictor.runs)
        left = [self._not_estimated(r, tangent, strays[r], run.stack(of))
                for r, (run, tangent) in enumerate(zip(self.predictor.runs, fit.tangents))]
        return Noise(self.predictor.runs, left, self.predictor.bent(fit.points))

    def _not_estimated(self, run: int, tangent: Tangent, strays: np.ndarray, floor: np.ndarray) -> np.ndarray:
        """What is left of random deviations (draws x samples) where the run's own coordinates follow them.

        A slow drift of all speeds is taken up by the torque that is estimated; counted as noise, it would be the
        largest part of it.
        """
        slopes = tangent.jacobian[:, self.layout.shared.size:].astype(float) / floor[:, None]
        heights = np.linalg.solve(slopes.T @ slopes + self.layout.precision[run], slopes.T @ (strays / floor).T)
        return strays - floor * (slopes @ heights).T

    @property
    def enough(self) -> bool:
        """Whether there are recordings enough to ask each what the others foretell."""
        return len(self.measured) >= ENOUGH

    def log_prior(self, causes: Iterable[str]) -> float:
        """Log odds of a set of causes before anything was measured."""
        causes = list(causes)
        count = len({effect_of(cause) for cause in causes})
        return EFFECT * count + SECOND_PARAMETER * (len(causes) - count)

    def judged(self, fit: Fit, noise: Noise) -> Evidence:
        """What the runs say where a supposition is compared with others."""
        return self.seen(fit, self._judging(fit, noise)[0])

    def _judging(self, fit: Fit, noise: Noise) -> tuple[Noise, np.ndarray]:
        """The noise as it is for a supposition that is compared with others, and what its errors cost each run."""
        return noise.heavy(self.residuals(fit.predicted), _JUDGED)

    def assess(self, fit: Fit, noise: Noise) -> Fit:
        """Evidence of a fitted supposition under a noise."""
        heavy, costs = self._judging(fit, noise)
        evidence = self.seen(fit, heavy)
        spread = prior(self.coordinates, fit.causes)
        fit.posterior = evidence.posterior(spread)
        fit.hope = fit.posterior.log_evidence - float(np.sum(costs)) + self.log_prior(fit.causes)
        fit.score = fit.hope - 0.5 * (self.cost(heavy, fit) - fit.posterior.least)
        fit.foretold = evidence.foretold(spread) - costs if self.enough else None
        return fit

    def shows(self, fit: Fit, without: Fit) -> bool:
        """Whether a cause beside others is clear, or more than one recording shows it.

        Each is asked how well the others foretell it with that cause and without; the one that favours it most does not
        count. What a fit misses in one recording can look like a cause there, and then foretells the others worse.

        Args:
            fit: With the cause.
            without: The same without it.
        """
        if not self.enough or fit.score - without.score > _CLEAR:
            return True
        gains = fit.foretold - without.foretold
        return float(np.sum(gains) - np.max(gains)) > _ALSO

    def seen(self, fit: Fit, noise: Noise) -> Evidence:
        """What the runs say at the points of a fit."""
        seen = []
        for r, (tangent, point) in enumerate(zip(fit.tangents, fit.points)):
            slopes = Slopes(self.layout, r, noise.whiten(r, tangent.jacobian))
            seen.append(slopes.seen(noise.whiten(r, self.measured[r] - fit.predicted[r]), point))
        return Evidence(seen)

    def changed(self, fit: Fit, noise: Noise, changes: Sequence[np.ndarray]) -> list[list[np.ndarray] | None]:
        """What changes of the coordinates change in every run, whitened; None where that cannot be simulated."""
        runs = range(len(fit.points))
        shown = self.predictor.many([(fit.points[r] + change, r) for change in changes for r in runs])
        found = [shown[k * len(runs):(k + 1) * len(runs)] for k in range(len(changes))]
        return [None if any(y is None for y in all_runs) else
                [noise.whiten(r, y - fit.predicted[r]) for r, y in enumerate(all_runs)] for all_runs in found]

    def run_cost(self, noise: Noise, run: int, predicted: np.ndarray | None, shared: np.ndarray,
                 point: np.ndarray) -> float:
        """A run's part of minus twice the log posterior density."""
        if predicted is None:
            return np.inf
        layout, deviation = self.layout, self.layout.deviations[run]
        own = point[layout.own[run]]
        loose = deviation > 0.0
        apart = (point - shared)[layout.shared][loose] / deviation[loose]
        return (float(np.sum(noise.whiten(run, self.measured[run] - predicted) ** 2))
                + float(own @ layout.precision[run] @ own) + float(apart @ apart))

    def run_costs(self, noise: Noise, fit: Fit) -> list[float]:
        """Each run's part of minus twice the log posterior density of a fit's coordinates."""
        return [self.run_cost(noise, r, predicted, fit.shared, point)
                for r, (predicted, point) in enumerate(zip(fit.predicted, fit.points))]

    def cost(self, noise: Noise, fit: Fit) -> float:
        """Minus twice the log posterior density of a fit's coordinates, up to a constant."""
        shared = self.layout.shared
        spread = prior(self.coordinates, fit.causes)[shared]
        return float(np.sum((fit.shared[shared] / spread) ** 2)) + sum(self.run_costs(noise, fit))

    def most_probable(self, evidence: Evidence, causes: tuple[str, ...]) -> tuple[np.ndarray, list[np.ndarray]]:
        """What is shared, and the coordinates of each run, by what linearised runs say; within what is plausible."""
        shared = np.zeros(len(self.coordinates))
        shared[self.layout.shared] = evidence.posterior(prior(self.coordinates, causes)).best
        return shared, [seen.point(shared[self.layout.shared]) for seen in evidence.seen]

    def refine(self, fit: Fit, noise: Noise, iterations: int = 12) -> Fit:
        """Most probable coordinates, by Gauss-Newton with derivatives that follow the steps."""
        for _ in range(iterations):
            heavy, _ = noise.heavy(self.residuals(fit.predicted))
            evidence = self.seen(fit, heavy)
            best, goals = self.most_probable(evidence, fit.causes)
            now, gained = self.cost(heavy, fit), 0.0
            for share in (1.0, 0.3, 0.1):
                moved = self._moved(fit, heavy, fit.shared + share * (best - fit.shared), goals, share)
                gained = now - self.cost(heavy, moved)
                if gained > 0.0:
                    break
            if gained <= 0.0:
                break
            fit = moved
            if gained < SETTLED:
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
            everything: Or only by its causes and the runs' own.
        """
        needed = {int(i) for own in self.layout.own for i in own}
        needed.update(i for cause in fit.causes for i in self.predictor.index(cause))
        tangents = list(fit.tangents)
        wanted = {r: [int(i) for i in self.layout.columns[r] if everything or i in needed]
                  for r, tangent in enumerate(tangents) if tangent.bent > _BENT}
        for (r, renewed), part in zip(wanted.items(), self.predictor.jacobian(fit.points, fit.predicted, wanted)):
            jacobian = tangents[r].jacobian.copy()
            jacobian[:, np.isin(self.layout.columns[r], renewed)] = part
            tangents[r] = Tangent(jacobian, 0.0 if everything else tangents[r].bent)
        return Fit(fit.causes, fit.shared, fit.points, fit.predicted, tangents)

    def renewed(self, fit: Fit, noise: Noise, everything: bool = True) -> Fit:
        """Refined with derivatives of its own, by everything or only by its causes and the runs' own.

        Where nothing more is gained it keeps these: what a last small step showed beyond them is impacts, by chance,
        and corrections by that let evidence seem 1.5 higher. In a long valley derivatives by everything may promise
        much and gain nothing: then others are tried once.
        """
        stuck = fit.stuck
        fresh = self.assess(self.relinearise(fit, everything), noise)
        fit = self.assess(self.refine(fresh, noise), noise)
        if fit.score - fresh.score < SETTLED:
            misled = everything and not stuck and fresh.hope - fresh.score > _PROMISED
            own = [Tangent(here.jacobian, moved.bent) for here, moved in zip(fresh.tangents, fit.tangents)]
            fit = self.assess(replace(fit, tangents=own, near=not misled, stuck=misled), noise)
        fit.settled = fit.near and everything
        return fit

    def cooled(self, fit: Fit, noise: Noise) -> Fit:
        """On its way from the vehicle file, as noise that is larger at first becomes nearly what it is.

        By derivatives of where nothing fits yet a step does too much of everything that runs are sensitive to, and
        a fit that begins with such a step is stuck where the crossings of lashes are others.
        """
        for temperature in _COOLING:
            warm = noise.tempered(np.full(len(self.measured), temperature))
            fit = self.relinearise(self.refine(fit, warm, 3), everything=False)
        return fit

    def settle(self, fit: Fit, noise: Noise, everything: bool = True) -> Fit:
        """Refined with derivatives of its own until they gain no more, at most ``_ROUNDS`` times."""
        for _ in range(_ROUNDS):
            if fit.settled or (fit.near and not everything):
                break
            fit = self.renewed(fit, noise, everything)
        fit.near, fit.settled = True, fit.settled or everything
        return fit

    def placed(self, fit: Fit, causes: tuple[str, ...], shared: np.ndarray, points: list[np.ndarray]) -> Fit | None:
        """A supposition elsewhere, with the derivatives of ``fit``; None where that cannot be simulated."""
        predicted = self.predictor.all_runs(points)
        if predicted is None:
            return None
        return Fit(causes, shared, points, predicted, [Tangent(t.jacobian, np.inf) for t in fit.tangents])


def as_found(predictor: Predictor, fit: Fit, point: np.ndarray) -> np.ndarray:
    """The coordinates of a run with the causes in them and its start speed, everything else as in the file."""
    kept = {i for cause in fit.causes for i in predictor.index(cause)}
    return np.array([x if i in kept or c.name == "start_speed" else 0.0
                     for i, (c, x) in enumerate(zip(predictor.coordinates, point))])
