"""A bench by its inverse dynamics: which effects make the measured motion need the measured torques.

Every effect of the catalogue that the plant can show becomes a direction in which the needed torques change.
Sets of effects are compared by their evidence, all of up to two and larger ones grown from the best: the model is
linear where it matters, so that costs nothing. An effect is a cause only if time it was not fitted to is predicted
better with it than without, block by block, after correction for the number of effects tried (``significance``).
What is no effect but never exact, that the samples of two channels are some milliseconds or part of a frame apart, is
estimated beside every one of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg import cho_factor, cho_solve

from cosim.diagnosis.catalogue import shown_by
from cosim.diagnosis.effect import EffectParameter
from cosim.diagnosis.fit.regression import dependence, paired
from cosim.diagnosis.judge.finding import STILL
from cosim.diagnosis.plants.band import Band
from cosim.diagnosis.plants.rigid import RigidPlant, interval_of
from cosim.diagnosis.plants.run import STEP, Run
from driveline.quantities import InputError

BLOCK = 2.0  # s
SKEW, FRAMES = 2e-3, 0.5  # by how much the samples of a channel are late, one sigma: s, and sampling intervals
TOLERANCE = 0.25  # what the catalogue can name is right on a healthy bench but for this share of what shows
SLIGHT = 0.02  # an effect that moves every channel by less than this share of it is within tolerance
RARE = 0.05  # share of benches on which an effect is there, before any is looked at
MOST = 4  # effects at once
_FRAMES = " frames"


@dataclass(frozen=True)
class Direction:
    """One number that may differ from the vehicle file; 0 is as the file says.

    Attributes:
        name: Of the effect's parameter; of the channel for the skew of its samples, in seconds or in frames.
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


@dataclass(frozen=True)
class Block:
    """The rows of one block of time, whitened: what is missing, how it falls with each direction, whose it is."""

    missing: np.ndarray
    slopes: np.ndarray
    channel: np.ndarray

    @cached_property
    def square(self) -> np.ndarray:
        """Normal matrix."""
        return self.slopes.T @ self.slopes

    @cached_property
    def product(self) -> np.ndarray:
        """Right side of the normal equations."""
        return self.slopes.T @ self.missing


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


class Torques:
    """Measured torques of some runs and what their motion needs, filtered alike.

    Args:
        plant: The bench as its vehicle file has it.
        runs: What is compared.
        band: In which; by default that in which their motion is known.
        channels: Of torque or force; by default those recorded that do not always read the same. No gain and all of it
            offset would explain such a one without error, whatever moves.

    Raises:
        InputError: There is none of these.

    Attributes:
        channels: Of torque or force, each recorded in one run or more.
        still: Others that were recorded.
        scale: Root mean square of each channel.
        trim: Left out at either end of every run [s].
    """

    def __init__(self, plant: RigidPlant, runs: Sequence[Run], band: Band | None = None,
                 channels: Sequence[str] | None = None) -> None:
        self.plant, self.runs = plant, list(runs)
        self.motions = [plant.motion(run, plant.values) for run in runs]
        recorded = [plant.shown(run) for run in runs]
        self.channels = _changing(plant, recorded) if channels is None else [
            c for c in channels if any(c in shown for shown in recorded)]
        self.still = [c for c in plant.sections if c not in self.channels and any(c in shown for shown in recorded)]
        self.shown = [{c: shown[c] for c in shown if c in self.channels} for shown in recorded]
        clocks = [clock for shown in recorded for clock, _ in shown.values()]
        self.interval = float(np.mean(np.concatenate([np.diff(clock) for clock in clocks])))
        self.band = band or Band.sampled(interval_of(clocks))
        self.trim = self.band.spoiled
        nominal = self.measured({})
        self.scale = {c: _root_mean_square(nominal, c) for c in self.channels}

    def thinned(self, signal: np.ndarray) -> np.ndarray:
        """What of a run's signal is compared, unfiltered."""
        return self.band.thinned(signal, STEP, self.trim)

    def clock(self, run: int) -> np.ndarray:
        """Instants [s] of what is compared."""
        return self.thinned(self.motions[run].time)

    def measured(self, skew: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        """Every run's measured torques, filtered, if their samples were late.

        Args:
            skew: By how much: ``CHANNEL`` in s, ``CHANNEL frames`` in sampling intervals. A bus that reads one
                value after another gives each a lateness of its own, and more of it where it is slow.
        """
        found = []
        for motion, shown in zip(self.motions, self.shown):
            signals = {}
            for name, (clock, values) in shown.items():
                interval = np.diff(clock, prepend=2.0 * clock[0] - clock[1])
                true = clock - skew.get(name, 0.0) - skew.get(name + _FRAMES, 0.0) * interval
                later = np.concatenate([[True], np.diff(np.maximum.accumulate(true)) > 0.0])
                within = np.clip(motion.time, true[0], true[later][-1])
                signals[name] = PchipInterpolator(true[later], values[later])(within)
            found.append(self._filtered(signals))
        return found

    def lateness(self, skew: Mapping[str, float], channel: str) -> float:
        """By how much [s] the samples of a channel are late on average; ``skew`` as for ``measured``."""
        return skew.get(channel, 0.0) + skew.get(channel + _FRAMES, 0.0) * self.interval

    def needed(self, values: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        """What every run's motion needs with these values of plant and sensors, filtered."""
        return [self._filtered(self.plant.torques(values, run, motion))
                for run, motion in zip(self.runs, self.motions)]

    def resisted(self, values: Mapping[str, float], share: float = 1.0) -> list[dict[str, np.ndarray]]:
        """What would be needed without acceleration, at a share of the speed, filtered."""
        return [self._filtered(self.plant.torques(values, run, replace(motion, speed=share * motion.speed,
                                                                       acceleration=0.0 * motion.acceleration)))
                for run, motion in zip(self.runs, self.motions)]

    def missing(self, values: Mapping[str, float], skew: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        """Measured minus needed."""
        return [{c: m[c] - n[c] for c in m} for m, n in zip(self.measured(skew), self.needed(values))]

    def _filtered(self, signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: self.band.of(signal, STEP, self.trim) for name, signal in signals.items()}


class Inverse(Torques):
    """How each effect moves the needed torques, and which sets of effects make them the measured ones.

    Args:
        plant: The bench as its vehicle file has it.
        runs: What is compared.
    """

    def __init__(self, plant: RigidPlant, runs: Sequence[Run]) -> None:
        super().__init__(plant, runs)
        self.effects, self.ranges = shown_by(plant.knows), plant.ranges
        self.nominal = self.missing(plant.values, {})
        self.directions: list[Direction] = []
        slopes = []
        for direction in self._possible():
            found = self._slope(direction, np.zeros(0), self.nominal)
            reach = max(_root_mean_square(found, c) / self.scale[c] for c in self.channels)
            if reach > 1e-9:  # no cause moves more than there is, no tolerance moves what one would notice
                self.directions.append(replace(direction, spread=min(direction.spread, 1.0 / reach),
                                               tolerance=min(direction.tolerance, SLIGHT / reach))
                                       if direction.effect else direction)
                slopes.append(found)
        self.sigma = dict(self.scale)
        self._settle(np.zeros(len(self.directions)), self.nominal, slopes)

    def _possible(self) -> Iterator[Direction]:
        for effect in self.effects.values():
            for p in effect.parameters:
                spread = (p.limits[1] - p.limits[0]) / 4.0 if p.scale == "log" else p.spread
                step = 0.25 * p.detection
                if not p.limits[0] <= p.neutral + step <= p.limits[1]:
                    step = -step
                # what the file has none of, and cannot be less than none, a healthy bench has none of
                absent = p.one_sided and not any(self.plant.values.get(t, 0.0) for t in p.targets)
                tolerance = 0.0 if absent else TOLERANCE * p.detection
                yield Direction(p.name, effect.name, p, step, tolerance, spread)
        for c in self.channels:
            yield Direction(c, "", None, STEP, SKEW, SKEW)
            yield Direction(c + _FRAMES, "", None, 0.2, FRAMES, FRAMES)

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
        for name, (low, high) in self.ranges.items():
            values[name] = min(max(values[name], low), high)
        return values, {d.name: float(x) for d, x in zip(self.directions, point) if not d.effect}

    def _slope(self, direction: Direction, point: np.ndarray,
               missing: Sequence[Mapping[str, np.ndarray]]) -> list[dict[str, np.ndarray]]:
        """How every run's missing torques fall in a direction at a point, by one-sided differences."""
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
        return [{c: (n[c] - m[c]) / direction.step for c in m}
                for m, n in zip(self.missing(values, skew), missing)]

    def relinearise(self, supposition: Supposition) -> None:
        """Take the derivatives, and the noise's scale, at another point: with some effects in, the rest as built."""
        point = np.array([x if not d.effect else d.size(x) - d.parameter.neutral if d.effect in supposition.effects
                          else 0.0 for d, x in zip(self.directions, supposition.point.tolist())])
        missing = self.missing(*self.at(point))
        self._settle(point, missing, [self._slope(d, point, missing) for d in self.directions])

    def _settle(self, point: np.ndarray, missing: Sequence[Mapping[str, np.ndarray]],
                slopes: Sequence[Sequence[Mapping[str, np.ndarray]]]) -> None:
        """Rows, whitened by what is left when everything may be wrong."""
        everything = np.array([d.spread for d in self.directions])
        for _ in range(3):
            self.blocks: list[list[Block]] = []  # of every run
            for r, left in enumerate(missing):
                j = [np.column_stack([s[r][c] for s in slopes]) / self.sigma[c] for c in left]
                y = [left[c] / self.sigma[c] + own @ point for c, own in zip(left, j)]
                count = max(1, round(y[0].size / (BLOCK * self.band.rate)))
                channel = np.array([self.channels.index(c) for c in left])
                self.blocks.append([
                    Block(np.concatenate(ys), np.vstack(js), np.repeat(channel, [y.size for y in ys]))
                    for ys, js in zip(zip(*(np.array_split(own, count) for own in y)),
                                      zip(*(np.array_split(own, count) for own in j)))])
            every = [b for run in self.blocks for b in run]
            self._square = np.sum([b.square for b in every], axis=0)
            self._product = np.sum([b.product for b in every], axis=0)
            self._length = float(sum(b.missing @ b.missing for b in every))
            best = self._solved(everything)[0]
            for i, c in enumerate(self.channels):
                own = np.concatenate([(b.missing - b.slopes @ best)[b.channel == i] for b in every])
                self.sigma[c] *= float(np.sqrt(np.mean(own**2) * dependence(own)))

    def _solved(self, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Maximum, covariance, log evidence (up to what all share) and squared error there."""
        factor = cho_factor(np.eye(spread.size) + spread[:, None] * self._square * spread, lower=True)
        covariance = spread[:, None] * cho_solve(factor, np.eye(spread.size)) * spread
        point = covariance @ self._product
        explained = float(self._product @ point)
        log_evidence = -0.5 * (self._length - explained) - float(np.sum(np.log(np.diag(factor[0]))))
        return point, covariance, log_evidence, self._length - 2.0 * explained + float(point @ self._square @ point)

    def spread(self, effects: Iterable[str]) -> np.ndarray:
        """Standard deviation of every direction where ``effects`` are the causes."""
        chosen = set(effects)
        return np.array([d.spread if d.effect in chosen else d.tolerance for d in self.directions])

    def supposed(self, effects: Iterable[str]) -> Supposition:
        """A set of effects fitted; its evidence is nothing where a value would have to be absurd."""
        effects = tuple(sorted(effects))
        point, covariance, log_evidence, misfit = self._solved(self.spread(effects))
        for d, x in zip(self.directions, point):
            if d.effect in effects and not self._possible_at(d, float(x)):
                log_evidence = -np.inf
        prior = len(effects) * np.log(RARE / (1.0 - RARE))
        return Supposition(effects, point, covariance, log_evidence + prior, misfit)

    def _possible_at(self, direction: Direction, x: float) -> bool:
        """Whether a size is plausible, and makes values that the plant can have."""
        p, size = direction.parameter, direction.parameter.neutral + x
        values = {t: p.applied(size, self.plant.values.get(t, p.neutral)) for t in p.targets}
        return p.limits[0] <= size <= p.limits[1] and all(
            low <= values[t] <= high for t, (low, high) in self.ranges.items() if t in values)

    def search(self) -> list[Supposition]:
        """All sets of up to two effects, and larger ones that grow from the best, most evident first."""
        names = self.names
        tried = {s: self.supposed(s) for n in range(3) for s in combinations(names, n)}
        for size in range(3, MOST + 1):
            roots = sorted((s for s in tried if len(s) == size - 1), key=lambda s: -tried[s].log_evidence)[:5]
            for s in {tuple(sorted((*root, name))) for root in roots for name in names if name not in root}:
                tried[s] = self.supposed(s)
        return sorted(tried.values(), key=lambda s: -s.log_evidence)

    def predicted_errors(self, effects: Iterable[str], exact: Iterable[str] = ()) -> np.ndarray:
        """Mean squared whitened error of every block and channel (blocks x channels), predicted from all others.

        NaN where the block's run has no such channel.

        Args:
            effects: The causes; the rest is within tolerance.
            exact: Effects that are exactly as the file says.
        """
        exact = set(exact)
        spread = self.spread(effects) * np.array([d.effect not in exact for d in self.directions])
        blocks = [b for run in self.blocks for b in run]
        found = np.full((len(blocks), len(self.channels)), np.nan)
        for i, b in enumerate(blocks):
            matrix = np.eye(spread.size) + spread[:, None] * (self._square - b.square) * spread
            point = spread * np.linalg.solve(matrix, spread * (self._product - b.product))
            error = (b.missing - b.slopes @ point) ** 2
            for c in np.unique(b.channel):
                found[i, c] = error[b.channel == c].mean()
        return found

    def significance(self, best: Sequence[str]) -> dict[str, float]:
        """For every effect of a set: p-value that blocks it moves are predicted no better with it than without.

        Without it, what else is within tolerance may take its place; so it is also tried with all that exactly as
        the file says, and what shows it more clearly counts.
        """
        tried = 2 * len(self.names)
        others = [e for e in self.names if e not in best]
        found = {}
        for e in best:
            own = np.array([d.effect == e for d in self.directions])
            moved = [bool(b.slopes[:, own].any()) for run in self.blocks for b in run]  # none that lack its channel
            doubts = [paired(np.nansum(self.predicted_errors(best, [*rest, e])[moved], axis=1),
                             np.nansum(self.predicted_errors(best, rest)[moved], axis=1)) for rest in ([], others)]
            found[e] = min(1.0, tried * min(doubts))
        return found

    @property
    def names(self) -> list[str]:
        """The effects that move anything here."""
        return sorted({d.effect for d in self.directions if d.effect})

    def missing_within(self, effects: Iterable[str] | None) -> list[dict[str, np.ndarray]]:
        """What every run misses of the torques; only the lateness of samples and these effects are fitted.

        With None, everything is.
        """
        chosen = set(self.names if effects is None else effects) | {""}
        point = self._solved(self.spread(chosen) * np.array([d.effect in chosen for d in self.directions]))[0]
        return [{c: np.concatenate([(b.missing - b.slopes @ point)[b.channel == i] for b in run]) * self.sigma[c]
                 for i, c in enumerate(self.channels) if c in shown} for run, shown in zip(self.blocks, self.shown)]

    def deviations(self, supposition: Supposition) -> np.ndarray:
        """Standard deviation of every direction: by the noise's scale, or what blocks disagree by if that is more."""
        scores = np.array([b.product - b.square @ supposition.point for run in self.blocks for b in run])
        robust = supposition.covariance @ (scores.T @ scores) @ supposition.covariance
        robust *= len(scores) / max(len(scores) - 1, 1)
        return np.sqrt(np.maximum(np.diag(robust), np.diag(supposition.covariance)))


def _changing(plant: RigidPlant, recorded: Sequence[Mapping[str, tuple[np.ndarray, np.ndarray]]]) -> list[str]:
    """The channels of torque or force that do not always read the same, in runs of clocks and values."""
    present = {c: np.concatenate([shown[c][1] for shown in recorded if c in shown]) for c in plant.sections
               if any(c in shown for shown in recorded)}
    found = [c for c, values in present.items() if np.ptp(values) > STILL * np.abs(values).max()]
    if not found:
        always = ", ".join(f"{c} always reads {values[0]:g}" for c, values in present.items())
        raise InputError(f"{always}: what the motion needs can be held against no torque that changes; record one that "
                         "does beside this")
    return found


def _root_mean_square(signals: Iterable[Mapping[str, np.ndarray]], channel: str) -> float:
    """Of a channel over all runs that have it."""
    return float(np.sqrt(np.mean(np.concatenate([signal[channel] for signal in signals if channel in signal]) ** 2)))
