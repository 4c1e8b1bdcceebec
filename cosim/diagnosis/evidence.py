"""Bayesian bookkeeping on linearised runs: evidence, held-out scores, what two causes have in common.

Near a point the whitened residuals z are linear in the coordinates, z = J u + e with white e. Every
coordinate has a Gaussian prior: narrow (its tolerance in a healthy car), wide for those of the effects
that are supposed to be the cause. So each supposition has an evidence in closed form, nuisances are
projected out exactly, and a whole run can be left out by taking its share of J'J away.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from cosim.diagnosis.predict import Coordinate


def prior(coordinates: Sequence[Coordinate], effects: Iterable[str]) -> np.ndarray:
    """Standard deviation of every coordinate where ``effects`` are the cause."""
    effects = set(effects)
    return np.array([c.spread if c.effect in effects else c.tolerance for c in coordinates])


@dataclass(frozen=True)
class Posterior:
    """Gaussian belief about the coordinates.

    Attributes:
        mean, covariance: Of the coordinates.
        log_evidence: Of the data, up to what all suppositions share.
    """

    mean: np.ndarray
    covariance: np.ndarray
    log_evidence: float


class Linear:
    """Runs linearised at a point.

    Args:
        coordinates: Of the columns.
        point: Where they were linearised.
        residuals: Whitened residuals of every run there.
        jacobians: Whitened derivatives of the predictions.
        temperature: Factor on the noise's variance; above 1 for errors that no colour describes.
    """

    def __init__(self, coordinates: Sequence[Coordinate], point: np.ndarray, residuals: Sequence[np.ndarray],
                 jacobians: Sequence[np.ndarray], temperature: float = 1.0) -> None:
        self.coordinates, self.point, self.temperature = list(coordinates), point, temperature
        targets = [r + j @ point for r, j in zip(residuals, jacobians)]
        self.targets, self.jacobians = targets, list(jacobians)
        self.squares = [j.T @ j / temperature for j in jacobians]
        self.products = [j.T @ z / temperature for j, z in zip(jacobians, targets)]
        self.lengths = [float(z @ z) / temperature for z in targets]

    def posterior(self, spread: np.ndarray, runs: Iterable[int] | None = None) -> Posterior:
        """Belief and evidence from some runs (default: all), with prior standard deviations ``spread``."""
        runs = range(len(self.squares)) if runs is None else list(runs)
        square = sum((self.squares[r] for r in runs), np.zeros((spread.size, spread.size)))
        product = sum((self.products[r] for r in runs), np.zeros(spread.size))
        length = sum(self.lengths[r] for r in runs)
        matrix = np.eye(spread.size) + spread[:, None] * square * spread
        factor = cho_factor(matrix, lower=True)
        scaled = cho_solve(factor, spread * product)
        log_evidence = -0.5 * (length - float((spread * product) @ scaled)) - float(
            np.sum(np.log(np.diag(factor[0]))))
        covariance = spread[:, None] * cho_solve(factor, np.eye(spread.size)) * spread
        return Posterior(spread * scaled, covariance, log_evidence)

    def held_out(self, spread: np.ndarray) -> np.ndarray:
        """Log density of every run, predicted from the others."""
        everything = self.posterior(spread).log_evidence
        runs = set(range(len(self.squares)))
        return np.array([everything - self.posterior(spread, runs - {r}).log_evidence for r in sorted(runs)])

    def blocks(self, spread: np.ndarray, run: int, length: int) -> np.ndarray:
        """Squared whitened error of a run predicted from the others, summed over blocks of samples."""
        others = set(range(len(self.squares))) - {run}
        error = self.targets[run] - self.jacobians[run] @ self.posterior(spread, others).mean
        whole = error.size // length * length
        return np.sum(error[:whole].reshape(-1, length) ** 2, axis=1)

    def separation(self, change: np.ndarray, spread: np.ndarray) -> float:
        """How far data changed by ``change`` of the coordinates are from what ``spread`` allows [sigma].

        The change itself included: coordinates that are wide in ``spread`` imitate it as well as they can.
        """
        square = sum(self.squares)
        shifted = square @ change
        matrix = np.eye(spread.size) + spread[:, None] * square * spread
        inner = spread * shifted
        distance = float(change @ shifted - inner @ np.linalg.solve(matrix, inner))
        return float(np.sqrt(max(distance, 0.0)))
