"""Diagnosis of a bench by its inverse dynamics: which effect makes the measured motion need the measured torques.

Every effect of the catalogue that the plant can show becomes a direction in which the needed torques change.
Sets of effects are compared by their evidence, all of them up to three at once: the model is linear where it
matters, so that costs nothing. An effect is a cause only if time it was not fitted to is predicted better with
it than without, block by block, after correction for the number of effects tried. What is no effect but never
exact, that the samples of two channels are some milliseconds apart, is estimated beside every one of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from cosim.diagnosis.catalogue import shown_by
from cosim.diagnosis.effect import EffectParameter
from cosim.diagnosis.plants.rigid import RigidPlant
from cosim.diagnosis.plants.run import STEP, Run
from cosim.diagnosis.regression import Band, dependence, paired

BAND, TRIM = Band(), 0.25
BLOCK = 2.0  # s
SIGNIFICANT = 0.01  # after correction for the number of effects
SKEW = 2e-3  # s: by how much the samples of a channel are late, one sigma
TOLERANCE = 0.25  # what the catalogue can name is right on a healthy bench but for this share of what shows
SLIGHT = 0.02  # an effect that moves every channel by less than this share of it is within tolerance
RARE = 0.05  # share of benches on which an effect is there, before any is looked at
MOST = 4  # effects at once
APART = 3.0  # sigma: causes that are closer cannot be told apart
LISTED = 0.02  # less probable causes are not listed


@dataclass(frozen=True)
class Direction:
    """One number that may differ from the vehicle file; 0 is as the file says.

    Attributes:
        name: Of the effect's parameter; of the channel for the skew of its samples.
        effect: The effect it belongs to; empty for a skew.
        parameter: What it does; None for a skew. The torques are linear in its size, so the direction is the
            size beyond the neutral one, not its logarithm.
        step: For finite differences.
        tolerance: Standard deviation on a healthy bench.
        spread: Standard deviation where it is the cause.
    """

    name: str
    effect: str
    parameter: EffectParameter | None
    step: float
    tolerance: float
    spread: float

    def size(self, x: float) -> float:
        """The size of the effect's parameter, kept plausible."""
        return float(np.clip(self.parameter.neutral + x, *self.parameter.limits))

    def plausible(self, x: float) -> bool:
        """Whether the size is one that can be."""
        return self.parameter.limits[0] <= self.parameter.neutral + x <= self.parameter.limits[1]


@dataclass
class Rows:
    """One run, linearised: whitened residuals and derivatives, and the block each row is in."""

    residual: np.ndarray
    slopes: np.ndarray
    block: np.ndarray
    channel: np.ndarray


@dataclass(frozen=True)
class Supposition:
    """A set of effects, fitted.

    Attributes:
        effects: Their names.
        point: Of all directions, at the maximum.
        covariance: Of these.
        log_evidence: With the prior of the set in it.
        misfit: Squared whitened error.
    """

    effects: tuple[str, ...]
    point: np.ndarray
    covariance: np.ndarray
    log_evidence: float
    misfit: float


@dataclass
class InverseDiagnosis:
    """What was found.

    Attributes:
        finding: As the contract has it, without extension.
        values: The plant's and the sensors' with the causes in them.
        traces: ``{(run, channel): (clock, measured, before, after)}``, filtered as they were compared.
        probabilities: Of every effect that the plant can show.
        notices: What limits the diagnosis, in words.
    """

    finding: dict[str, Any]
    values: dict[str, float]
    traces: dict[tuple[str, str], tuple[np.ndarray, ...]]
    probabilities: dict[str, float]
    notices: list[str] = field(default_factory=list)


class Inverse:
    """Needed and measured torques of some runs, and how each effect moves them.

    Args:
        plant: The bench as its vehicle file has it.
        runs: What is compared.
    """

    def __init__(self, plant: RigidPlant, runs: Sequence[Run]) -> None:
        self.plant, self.runs = plant, list(runs)
        self.effects = shown_by(plant.knows)
        self.measured = [self._filtered(plant.shown(run)) for run in runs]
        self.channels = list(self.measured[0])
        self.scale = {c: float(np.sqrt(np.mean(np.concatenate([m[c] for m in self.measured]) ** 2)))
                      for c in self.channels}
        self.nominal = self.predict(plant.values, {})
        self.directions: list[Direction] = []
        slopes = []
        for direction in self._possible():
            found = self._slope(direction, np.zeros(0), self.nominal)
            reach = max(float(np.sqrt(np.mean(np.concatenate([s[c] for s in found]) ** 2))) / self.scale[c]
                        for c in self.channels)
            if reach > 1e-9:  # no cause moves more than there is, no tolerance moves what one would notice
                self.directions.append(replace(direction, spread=min(direction.spread, 1.0 / reach),
                                               tolerance=min(direction.tolerance, SLIGHT / reach)))
                slopes.append(found)
        self.rows: list[Rows] = []
        self.sigma = dict(self.scale)
        self._settle(np.zeros(len(self.directions)), self.nominal, slopes)

    def _possible(self) -> Iterator[Direction]:
        for effect in self.effects.values():
            for p in effect.parameters:
                spread = (p.limits[1] - p.limits[0]) / 4.0 if p.scale == "log" else p.spread
                step = 0.25 * p.detection
                if not p.limits[0] <= p.neutral + step <= p.limits[1]:
                    step = -step
                # what cannot be less than none is none on a healthy bench
                tolerance = 0.0 if p.neutral in p.limits else TOLERANCE * p.detection
                yield Direction(p.name, effect.name, p, step, tolerance, spread)
        for c in self.channels:
            yield Direction(c, "", None, STEP, SKEW, SKEW)

    def _filtered(self, signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: BAND.of(signal, STEP, TRIM) for name, signal in signals.items()}

    def at(self, point: np.ndarray, effects: Iterable[str] | None = None) -> tuple[dict[str, float], dict[str, float]]:
        """The values that a point stands for, of all effects or of some, and the skew of every channel [s]."""
        sizes: dict[str, dict[str, float]] = {}
        chosen = set(self.effects if effects is None else effects)
        for d, x in zip(self.directions, point):
            if d.effect in chosen and x != 0.0:
                sizes.setdefault(d.effect, {})[d.name] = d.size(float(x))
        values = dict(self.plant.values)
        for name, given in sizes.items():
            values |= self.effects[name].changes(given, values)
        for name, (low, high) in self.plant.ranges.items():
            values[name] = min(max(values[name], low), high)
        return values, {d.name: float(x) for d, x in zip(self.directions, point) if not d.effect}

    def predict(self, values: Mapping[str, float], skew: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        """Every run's needed torques, filtered as they are compared; channels late by ``skew`` [s]."""
        found = []
        for run in self.runs:
            needed = self.plant.torques(values, run)
            time = STEP * np.arange(len(run.inputs))
            late = {name: np.interp(time - skew[name], time, signal) if skew.get(name) else signal
                    for name, signal in needed.items()}
            found.append(self._filtered(late))
        return found

    def _slope(self, direction: Direction, point: np.ndarray,
               predicted: Sequence[Mapping[str, np.ndarray]]) -> list[dict[str, np.ndarray]]:
        """Derivative of every run's torques in a direction at a point, by one-sided differences."""
        if direction.effect and direction not in self.directions:  # not yet known to move anything
            p = direction.parameter
            values = dict(self.plant.values)
            values |= self.effects[direction.effect].changes({p.name: p.neutral + direction.step}, values)
            skew = {}
        elif direction in self.directions:
            moved = point.copy()
            moved[self.directions.index(direction)] += direction.step
            values, skew = self.at(moved)
        else:
            values, skew = self.plant.values, {direction.name: direction.step}
        return [{c: (m[c] - n[c]) / direction.step for c in self.channels}
                for m, n in zip(self.predict(values, skew), predicted)]

    def relinearise(self, supposition: Supposition) -> None:
        """Take the derivatives, and the noise's scale, at another point: with some effects in, the rest as built."""
        point = np.array([x if not d.effect else d.size(x) - d.parameter.neutral if d.effect in supposition.effects
                          else 0.0 for d, x in zip(self.directions, supposition.point.tolist())])
        predicted = self.predict(*self.at(point))
        self._settle(point, predicted, [self._slope(d, point, predicted) for d in self.directions])

    def _settle(self, point: np.ndarray, predicted: Sequence[Mapping[str, np.ndarray]],
                slopes: Sequence[Sequence[Mapping[str, np.ndarray]]]) -> None:
        """Rows, whitened by what is left when everything may be wrong."""
        everything = np.array([d.spread for d in self.directions])
        for _ in range(3):
            self.rows, first = [], 0
            for r, measured in enumerate(self.measured):
                j = [np.column_stack([s[r][c] for s in slopes]) / self.sigma[c] for c in self.channels]
                y = [(measured[c] - predicted[r][c]) / self.sigma[c] + own @ point
                     for c, own in zip(self.channels, j)]
                length = y[0].size
                count = max(1, round(length / (BLOCK * BAND.rate)))
                block = first + np.minimum(np.arange(length) * count // length, count - 1)
                first += count
                self.rows.append(Rows(np.concatenate(y), np.vstack(j), np.tile(block, len(self.channels)),
                                      np.repeat(np.arange(len(self.channels)), length)))
            best = _solved(self.rows, everything)[0]
            left = np.concatenate([r.residual - r.slopes @ best for r in self.rows])
            channel = np.concatenate([r.channel for r in self.rows])
            for i, c in enumerate(self.channels):
                own = left[channel == i]
                self.sigma[c] *= float(np.sqrt(np.mean(own**2) * dependence(own)))

    def spread(self, effects: Iterable[str]) -> np.ndarray:
        """Standard deviation of every direction where ``effects`` are the causes."""
        chosen = set(effects)
        return np.array([d.spread if d.effect in chosen else d.tolerance for d in self.directions])

    def supposed(self, effects: Iterable[str]) -> Supposition:
        """A set of effects fitted; its evidence is nothing where a value would have to be absurd."""
        effects = tuple(sorted(effects))
        point, covariance, log_evidence, misfit = _solved(self.rows, self.spread(effects))
        for d, x in zip(self.directions, point):
            if d.effect in effects and not d.plausible(float(x)):
                log_evidence = -np.inf
        prior = len(effects) * np.log(RARE / (1.0 - RARE))
        return Supposition(effects, point, covariance, log_evidence + prior, misfit)

    def search(self) -> list[Supposition]:
        """All sets of up to two effects, and larger ones that grow from the best, most evident first."""
        names = sorted({d.effect for d in self.directions if d.effect})
        tried = {s: self.supposed(s) for n in range(3) for s in combinations(names, n)}
        for size in range(3, MOST + 1):
            roots = sorted((s for s in tried if len(s) == size - 1), key=lambda s: -tried[s].log_evidence)[:5]
            for s in {tuple(sorted((*root, name))) for root in roots for name in names if name not in root}:
                tried[s] = self.supposed(s)
        return sorted(tried.values(), key=lambda s: -s.log_evidence)

    def predicted_errors(self, effects: Iterable[str]) -> np.ndarray:
        """Squared whitened error of every block, predicted from all others."""
        spread = self.spread(effects)
        square, product, by_block = _sums(self.rows, spread.size)
        found = np.zeros(len(by_block))
        for b, (s, p, y, j) in enumerate(by_block):
            point = spread * np.linalg.solve(np.eye(spread.size) + spread[:, None] * (square - s) * spread,
                                             spread * (product - p))
            found[b] = float(np.sum((y - j @ point) ** 2))
        return found

    def significance(self, best: Sequence[str]) -> dict[str, float]:
        """For every effect of a set: p-value that blocks are predicted no better with it than without."""
        tried = len({d.effect for d in self.directions if d.effect})
        with_all = self.predicted_errors(best)
        return {e: min(1.0, tried * paired(self.predicted_errors([o for o in best if o != e]), with_all))
                for e in best}

    def deviations(self, supposition: Supposition) -> np.ndarray:
        """Standard deviation of every direction: by the noise's scale, or what blocks disagree by if that is more."""
        scores = []
        for _, _, y, j in _sums(self.rows, len(self.directions))[2]:
            scores.append(j.T @ (y - j @ supposition.point))
        scores = np.array(scores)
        robust = supposition.covariance @ (scores.T @ scores) @ supposition.covariance
        robust *= len(scores) / max(len(scores) - 1, 1)
        return np.sqrt(np.maximum(np.diag(robust), np.diag(supposition.covariance)))


def _sums(rows: Sequence[Rows], size: int) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, ...]]]:
    """Normal matrix and right side, altogether and with the rows of every block."""
    square, product, blocks = np.zeros((size, size)), np.zeros(size), []
    for r in rows:
        for b in np.unique(r.block):
            j, y = r.slopes[r.block == b], r.residual[r.block == b]
            blocks.append((j.T @ j, j.T @ y, y, j))
            square += blocks[-1][0]
            product += blocks[-1][1]
    return square, product, blocks


def _solved(rows: Sequence[Rows], spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Maximum, covariance, log evidence (up to what all share) and squared error there."""
    square, product, _ = _sums(rows, spread.size)
    factor = cho_factor(np.eye(spread.size) + spread[:, None] * square * spread, lower=True)
    covariance = spread[:, None] * cho_solve(factor, np.eye(spread.size)) * spread
    point = covariance @ product
    length = sum(float(r.residual @ r.residual) for r in rows)
    log_evidence = -0.5 * (length - float(product @ point)) - float(np.sum(np.log(np.diag(factor[0]))))
    misfit = length - 2.0 * float(product @ point) + float(point @ square @ point)
    return point, covariance, log_evidence, misfit
