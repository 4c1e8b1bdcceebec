"""Bayesian bookkeeping on linearised runs: what each says of the coordinates, and the evidence of a supposition.

Near a point of its own, a run's whitened residuals are linear in the coordinates, z = J v + e with white e. The
run's own nuisances are projected out. What is left, v, is not quite the u that all runs share: a plant of
another structure is not described by one stiffness in all manoeuvres, however exactly each run may fix it. So
v = u + d with d ~ N(0, D), and no run says more of u than D allows. Runs of the same manoeuvre have the same d.
What k of them say together they say with a d each as well, of k D, exactly if each shows the same. The
coordinates have Gaussian priors: narrow (their tolerance in a healthy car), wide for those of the effects that
are supposed to be the cause. With these every supposition has its evidence in closed form.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky
from scipy.optimize import lsq_linear

from cosim.diagnosis.fit.noise import WANDER, WANDER_TIME
from cosim.diagnosis.fit.predict import WANDERS, Coordinate
from cosim.diagnosis.plants.hats import correlation

# By how much what one manoeuvre says of a parameter may differ from what the next says, in detection limits.
HETEROGENEITY = 0.2


def prior(coordinates: Sequence[Coordinate], causes: Iterable[str]) -> np.ndarray:
    """Standard deviation of every coordinate where ``causes`` are supposed."""
    causes = set(causes)
    return np.array([c.spread if c.cause in causes else c.tolerance for c in coordinates])


def heterogeneity(coordinates: Sequence[Coordinate], repeats: int = 1) -> np.ndarray:
    """Standard deviation of d for every coordinate of a run, as if it had a d of its own; none for those of one run.

    Args:
        coordinates: Of the run.
        repeats: How many runs are of its manoeuvre, and have the same d.
    """
    alone = [0.0 if c.run is not None else HETEROGENEITY * c.parameter.detection if c.effect
             else 0.5 * c.tolerance for c in coordinates]
    return np.sqrt(repeats) * np.array(alone)


def within(factor: np.ndarray, best: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The most probable point of a Gaussian within bounds.

    Not the nearest: where one of two that make up for each other ends at its bound, the other stays back as well.

    Args:
        factor: Lower Cholesky factor of its precision.
        best: Its mean.
        low, high: Bounds.
    """
    if np.all((best >= low) & (best <= high)):
        return best
    return lsq_linear(factor.T, factor.T @ best, (low, high), method="bvls").x


@dataclass(frozen=True)
class Posterior:
    """Belief about the shared coordinates: a Gaussian, of which bounds may cut off the middle.

    Attributes:
        best: Where it is highest within the bounds.
        log_evidence: Of the data, up to what all suppositions share.
        least: Minus twice the log posterior density where it is highest, by the linearised runs; what
            ``Fitter.cost`` is by simulation.
        spread, factor: Prior standard deviations, and the lower Cholesky factor of all information in units of these.
    """

    best: np.ndarray
    log_evidence: float
    least: float
    spread: np.ndarray
    factor: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """What it would be without bounds."""
        return self.spread[:, None] * cho_solve((self.factor, True), np.eye(self.spread.size)) * self.spread


class Layout:
    """Which coordinates are shared and which each run's own, and the priors of the latter.

    Args:
        coordinates: All of them.
        repeats: Of each run, how many are of its manoeuvre, itself among them.

    Attributes:
        shared, own: Places of the shared coordinates and of each run's own.
        columns: Those a run depends on.
        low, high: Plausible range of all coordinates.
        deviations: By how much a run's may differ from the shared ones, one sigma, of each run.
        precision: Inverse prior covariance of each run's own.
    """

    def __init__(self, coordinates: Sequence[Coordinate], repeats: Sequence[int]) -> None:
        self.coordinates = list(coordinates)
        self.shared = np.array([i for i, c in enumerate(coordinates) if not c.nuisance])
        self.own = [np.array([i for i, c in enumerate(coordinates) if c.nuisance and c.run == r])
                    for r in range(len(repeats))]
        self.columns = [np.concatenate([self.shared, own]) for own in self.own]
        self.low, self.high = (np.array([getattr(c, end) for c in coordinates]) for end in ("low", "high"))
        self.deviations = [heterogeneity([coordinates[i] for i in self.shared], count) for count in repeats]
        self.precision = [self._precision(own) for own in self.own]

    def _precision(self, own: np.ndarray) -> np.ndarray:
        """Inverse prior covariance of a run's own coordinates: independent, but for the torque's wander."""
        covariance = np.diag([self.coordinates[i].tolerance**2 for i in own])
        row = np.flatnonzero([self.coordinates[i].name == WANDERS for i in own])
        covariance[np.ix_(row, row)] = WANDER**2 * correlation(row.size, WANDER_TIME)
        return np.linalg.inv(covariance)


class Slopes:
    """The whitened derivatives of one run, prepared for residuals of any size.

    Args:
        layout: Of the coordinates.
        run: Which run.
        jacobian: Whitened; samples x ``layout.columns[run]``.
    """

    def __init__(self, layout: Layout, run: int, jacobian: np.ndarray) -> None:
        # derivatives come in single precision; their squares, rounded so as well, may say less than nothing of what
        # tells two nearly equal causes apart
        self.layout, self.run, self.jacobian = layout, run, jacobian.astype(float)
        own = layout.own[run]
        square = self.jacobian.T @ self.jacobian
        n = layout.shared.size
        self.square, self.n = square, n
        matrix = square[n:, n:] + layout.precision[run]
        factor = cho_factor(matrix)
        self.inverse = cho_solve(factor, np.eye(own.size))
        self.cross = square[n:, :n]
        self.information = square[:n, :n] - self.cross.T @ self.inverse @ self.cross
        self.log_determinant = 2.0 * float(np.sum(np.log(np.abs(np.diag(factor[0]))))) - float(
            np.linalg.slogdet(layout.precision[run])[1])
        d = layout.deviations[run]
        # of I + D^1/2 A D^1/2, and (D^-1 + A)^-1 in a form that allows for D = 0
        self.factor = cholesky(np.eye(n) + d[:, None] * self.information * d, lower=True)
        self.loose = d[:, None] * cho_solve((self.factor, True), np.diag(d))
        capped = self._about_shared(self.information)
        self.capped = 0.5 * (capped + capped.T)
        self.log_determinant += 2.0 * float(np.sum(np.log(np.diag(self.factor))))

    def _about_shared(self, told: np.ndarray) -> np.ndarray:
        """Information on v (a vector, or columns of a matrix) as one on u: (I + A D)^-1 told.

        As told - A (D^-1 + A)^-1 told it would be a small difference of large numbers where a run is sharp.
        """
        d = self.layout.deviations[self.run][:, None]
        columns = told.reshape(d.size, -1)
        part = cho_solve((self.factor, True), d * columns)
        return np.divide(part, d, out=columns - self.information @ (d * part), where=d > 0.0).reshape(told.shape)

    def seen(self, residual: np.ndarray, point: np.ndarray) -> Seen:
        """What the run says, given its whitened residual at a point of all coordinates."""
        there = point[self.layout.columns[self.run]]
        product = self.jacobian.T @ residual
        vector = product + self.square @ there
        length = float(residual @ residual) + 2.0 * float(product @ there) + float(there @ self.square @ there)
        own = vector[self.n:]
        b = vector[:self.n] - self.cross.T @ (self.inverse @ own)
        length -= float(own @ self.inverse @ own)
        return Seen(self, b, own, self._about_shared(b), length - float(b @ self.loose @ b))


@dataclass(frozen=True)
class Seen:
    """What one run says of the shared coordinates: exp(-(u' M u - 2 m' u + length)/2), M = ``slopes.capped``.

    Attributes:
        slopes: Of the run.
        exact, own: Information vectors of v and of the run's own coordinates.
        capped: m.
        length: See above.
    """

    slopes: Slopes
    exact: np.ndarray
    own: np.ndarray
    capped: np.ndarray
    length: float

    def point(self, shared: np.ndarray) -> np.ndarray:
        """The most probable plausible coordinates of the run, given the shared ones; all others 0."""
        s, layout = self.slopes, self.slopes.layout
        v = shared + s.loose @ (self.exact - s.information @ shared)
        deviation = layout.deviations[s.run]
        free = deviation > 0.0  # those that are not have no part in the factor of the others
        d, best, low, high = (x[free] for x in (deviation, v - shared, layout.low[layout.shared] - shared,
                                                layout.high[layout.shared] - shared))
        v[free] = shared[free] + d * within(s.factor[np.ix_(free, free)], best / d, low / d, high / d)
        result = np.zeros(len(layout.coordinates))
        result[layout.shared] = v
        result[layout.own[s.run]] = s.inverse @ (self.own - s.cross @ v)
        return result


class Evidence:
    """What all runs say together.

    Args:
        seen: By each run.
        expected: By runs that are not driven yet: what each would say of the shared coordinates, and where these are
            if it shows what is expected.
    """

    def __init__(self, seen: Sequence[Seen], expected: Sequence[tuple[np.ndarray, np.ndarray]] = ()) -> None:
        self.seen, self.expected = list(seen), list(expected)
        self.layout = seen[0].slopes.layout

    @cached_property
    def _sums(self) -> tuple[np.ndarray, np.ndarray, float, float]:
        told = [(s.slopes.capped, s.capped, s.length, s.slopes.log_determinant) for s in self.seen]
        told += [(square, square @ there, float(there @ square @ there), 0.0) for square, there in self.expected]
        return tuple(sum(parts) for parts in zip(*told))

    def expecting(self, square: np.ndarray, there: np.ndarray) -> Evidence:
        """With a run that is not driven yet: its information on the shared coordinates, and where they are.

        Its log evidence is up to what all suppositions share.
        """
        return Evidence(self.seen, [*self.expected, (square, there)])

    def _factor(self, spread: np.ndarray) -> np.ndarray:
        """Lower Cholesky factor of all information, the prior's too, in units of ``spread`` (shared coordinates)."""
        return cholesky(np.eye(spread.size) + spread[:, None] * self._sums[0] * spread, lower=True)

    def posterior(self, spread: np.ndarray) -> Posterior:
        """Belief and evidence with prior standard deviations ``spread`` (all coordinates)."""
        spread, low, high = (x[self.layout.shared] for x in (spread, self.layout.low, self.layout.high))
        _, product, length, log_determinant = self._sums
        factor = self._factor(spread)
        highest = cho_solve((factor, True), spread * product)
        best = within(factor, highest, low / spread, high / spread)
        least = length - float((spread * product) @ highest) + float(np.sum((factor.T @ (best - highest)) ** 2))
        log_evidence = -0.5 * (least + log_determinant) - float(np.sum(np.log(np.diag(factor))))
        return Posterior(spread * best, log_evidence, least, spread, factor)

    def foretold(self, spread: np.ndarray) -> np.ndarray:
        """Log evidence of each of several runs, given all others."""
        whole = self.posterior(spread).log_evidence
        rest = [Evidence([other for other in self.seen if other is not seen], self.expected) for seen in self.seen]
        return np.array([whole - e.posterior(spread).log_evidence for e in rest])

    def occam(self, spread: np.ndarray) -> float:
        """Log evidence that coordinates cost for being allowed to be anything within ``spread``."""
        return float(np.sum(np.log(np.diag(self._factor(spread[self.layout.shared])))))

    def imitated(self, change: np.ndarray, spread: np.ndarray) -> np.ndarray:
        """The coordinates, as far as ``spread`` allows, that change data most nearly as ``change`` does."""
        spread, shared = spread[self.layout.shared], self.layout.shared
        found = np.zeros(change.size)
        found[shared] = spread * cho_solve((self._factor(spread), True), spread * (self._sums[0] @ change[shared]))
        return found

    def separation(self, change: np.ndarray, spread: np.ndarray) -> float:
        """How far data changed by ``change`` of the coordinates are from what ``spread`` allows [sigma].

        Coordinates that are wide in ``spread`` imitate the change as well as they can.
        """
        left = (change - self.imitated(change, spread))[self.layout.shared]
        distance = float(change[self.layout.shared] @ self._sums[0] @ left)
        return float(np.sqrt(max(distance, 0.0)))
