"""Diagnosis of a bench by its inverse dynamics: which effect makes the measured motion need the measured torques.

Every effect of the catalogue that the plant can show becomes a direction in which the needed torques change.
Sets of effects are compared by their evidence, all of them up to three at once: the model is linear where it
matters, so that costs nothing. An effect is a cause only if time it was not fitted to is predicted better with
it than without, block by block, after correction for the number of effects tried. What is no effect but never
exact, that the samples of two channels are some milliseconds or part of a frame apart, is estimated beside every
one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import ttest_1samp

from cosim.diagnosis.catalogue import shown_by
from cosim.diagnosis.effect import EffectParameter
from cosim.diagnosis.plants.rigid import RigidPlant
from cosim.diagnosis.plants.run import STEP, Run
from cosim.diagnosis.regression import Band, dependence, paired

TRIM = 6.0  # periods of the band's edge, at both ends of a run
BLOCK = 2.0  # s
SIGNIFICANT = 0.01  # after correction for the number of effects
SKEW, FRAMES = 2e-3, 0.5  # by how much the samples of a channel are late, one sigma: s, and sampling intervals
TOLERANCE = 0.25  # what the catalogue can name is right on a healthy bench but for this share of what shows
SLIGHT = 0.02  # an effect that moves every channel by less than this share of it is within tolerance
RARE = 0.05  # share of benches on which an effect is there, before any is looked at
MOST = 4  # effects at once
APART = 3.0  # sigma: causes that are closer cannot be told apart
LISTED = 0.02  # less probable causes are not listed
STRUCTURE = 0.2  # share of what is left that goes with one variable, from which on it is no noise
MOSTLY = 0.5  # from which share on no effect is a cause beside it
RIVALS = 4  # other explanations that are listed
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


class Torques:
    """Measured torques of some runs and what their motion needs, filtered alike.

    Args:
        plant: The bench as its vehicle file has it.
        runs: What is compared.
        band: In which; by default that in which their motion is known.
    """

    def __init__(self, plant: RigidPlant, runs: Sequence[Run], band: Band | None = None) -> None:
        self.plant, self.runs = plant, list(runs)
        self.motions = [plant.motion(run, plant.values) for run in runs]
        self.shown = [plant.shown(run) for run in runs]
        intervals = np.concatenate([np.diff(clock) for shown in self.shown for clock, _ in shown.values()])
        self.interval = float(np.mean(intervals))
        self.band = band or Band.sampled(float(np.quantile(intervals, 0.9)))
        self.trim = TRIM / self.band.edge
        self.channels = list(self.shown[0])
        nominal = self.measured({})
        self.scale = {c: float(np.sqrt(np.mean(np.concatenate([m[c] for m in nominal]) ** 2))) for c in self.channels}

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

    def needed(self, values: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        """What every run's motion needs with these values of plant and sensors, filtered."""
        return [self._filtered(self.plant.torques(values, run, motion))
                for run, motion in zip(self.runs, self.motions)]

    def missing(self, values: Mapping[str, float], skew: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
        """Measured minus needed."""
        return [{c: m[c] - n[c] for c in self.channels} for m, n in zip(self.measured(skew), self.needed(values))]

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
            reach = max(float(np.sqrt(np.mean(np.concatenate([s[c] for s in found]) ** 2))) / self.scale[c]
                        for c in self.channels)
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
                absent = p.neutral in p.limits and not any(self.plant.values.get(t, 0.0) for t in p.targets)
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
        return [{c: (n[c] - m[c]) / direction.step for c in self.channels}
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
                j = [np.column_stack([s[r][c] for s in slopes]) / self.sigma[c] for c in self.channels]
                y = [left[c] / self.sigma[c] + own @ point for c, own in zip(self.channels, j)]
                count = max(1, round(y[0].size / (BLOCK * self.band.rate)))
                channel = np.arange(len(self.channels))
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

        Args:
            effects: The causes; the rest is within tolerance.
            exact: Effects that are exactly as the file says.
        """
        exact = set(exact)
        spread = self.spread(effects) * np.array([d.effect not in exact for d in self.directions])
        blocks = [b for run in self.blocks for b in run]
        found = np.zeros((len(blocks), len(self.channels)))
        for i, b in enumerate(blocks):
            matrix = np.eye(spread.size) + spread[:, None] * (self._square - b.square) * spread
            point = spread * np.linalg.solve(matrix, spread * (self._product - b.product))
            error = (b.missing - b.slopes @ point) ** 2
            found[i] = [error[b.channel == c].mean() for c in range(len(self.channels))]
        return found

    def significance(self, best: Sequence[str]) -> dict[str, float]:
        """For every effect of a set: p-value that blocks are predicted no better with it than without.

        Without it, what else is within tolerance may take its place; so it is also tried with all that exactly as
        the file says, and what shows it more clearly counts.
        """
        tried = 2 * len(self.names)
        others = [e for e in self.names if e not in best]
        found = {}
        for e in best:
            doubts = [paired(self.predicted_errors(best, [*rest, e]).sum(axis=1),
                             self.predicted_errors(best, rest).sum(axis=1)) for rest in ([], others)]
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
                 for i, c in enumerate(self.channels)} for run in self.blocks]

    def deviations(self, supposition: Supposition) -> np.ndarray:
        """Standard deviation of every direction: by the noise's scale, or what blocks disagree by if that is more."""
        scores = np.array([b.product - b.square @ supposition.point for run in self.blocks for b in run])
        robust = supposition.covariance @ (scores.T @ scores) @ supposition.covariance
        robust *= len(scores) / max(len(scores) - 1, 1)
        return np.sqrt(np.maximum(np.diag(robust), np.diag(supposition.covariance)))


def diagnose_inverse(plant: RigidPlant, runs: Sequence[Run], reserved: Sequence[Run] = (),
                     say: Callable[[str], None] = lambda text: None) -> InverseDiagnosis:
    """Diagnose a bench.

    Args:
        plant: As its vehicle file has it.
        runs: What the diagnosis may use.
        reserved: What it may not; the gain is measured on these.
        say: Told what happens.
    """
    say("what the measured motion needs, and how every effect moves that")
    inverse = Inverse(plant, runs)
    listed = _wrong(inverse)
    say("comparing sets of effects")
    tried = inverse.search()
    if tried[0].effects:
        inverse.relinearise(tried[0])
        tried = inverse.search()
    best, tried = _proved(inverse, tried)
    shares = {name: 0.0 for name in inverse.effects} | _shares(tried)
    rivals = _rivals(tried, best)
    close = [rival for rival in rivals if rival["separation_sigma"] < APART]
    share, unknown = _unknown(inverse)
    strange = share > STRUCTURE
    if share > MOSTLY:  # causes that leave that are what is nearest, not what is
        best, tried = inverse.supposed(()), []
        shares = dict.fromkeys(shares, 0.0)
        rivals = close = []
    verdict = (("ambiguous" if close else "cause") if best.effects else "unknown" if listed or strange else "none")
    after, skew = inverse.at(best.point, best.effects)
    finding = {
        "verdict": verdict, "wrong": listed, "causes": _causes(inverse, tried, best, shares),
        "together": [*best.effects],
        "ambiguous_with": close, "ruled_out": [r for r in rivals if r["separation_sigma"] >= APART],
        "next_manoeuvre": _next(inverse, tried, best, close[0]["effects"]) if close else None,
        "unknown": unknown if verdict == "unknown" else None, "gain": None}
    notices = []
    if strange:
        notices.append(f"no effect explains {100.0 * share:.0f} % of what is left at the {unknown['balance']}: it goes "
                       f"with the {unknown['driving_variable']}, {unknown['size']:.3g} from end to end")
    for c in inverse.channels:
        late = skew[c] + skew[c + _FRAMES] * inverse.interval
        if abs(late) > SKEW:
            notices.append(f"{c}: samples {1e3 * abs(late):.1f} ms {'late' if late > 0.0 else 'early'} against the "
                           "motion, which is taken for the logger's")
    traces = _traces(inverse, after, skew)
    if reserved:
        say("measuring the gain on " + ", ".join(run.name for run in reserved))
        untouched = _traces(Torques(plant, reserved, inverse.band), after, skew)
        finding["gain"] = _gain(untouched, inverse)
        traces |= untouched
    else:
        notices.append("no recording is left over to measure the gain on")
    return InverseDiagnosis(finding, after, traces, shares, notices)


def _proved(inverse: Inverse, tried: Sequence[Supposition]) -> tuple[Supposition, list[Supposition]]:
    """The most evident set all of whose effects predict better time that was left out, and the sets still in question.

    An effect that does not is no cause in any set.
    """
    tried = list(tried)
    while tried[0].effects:
        doubts = inverse.significance(tried[0].effects)
        worst = max(doubts, key=doubts.__getitem__)
        if doubts[worst] < SIGNIFICANT:
            break
        tried = [s for s in tried if worst not in s.effects]
    return tried[0], tried


def _shares(tried: Sequence[Supposition]) -> dict[str, float]:
    """Probability of every effect: of all sets that hold it together."""
    weight = np.exp(np.array([s.log_evidence for s in tried]) - tried[0].log_evidence)
    weight /= weight.sum()
    names = {e for s in tried for e in s.effects}
    return {e: float(sum(w for s, w in zip(tried, weight) if e in s.effects)) for e in names}


def _causes(inverse: Inverse, tried: Sequence[Supposition], best: Supposition,
            shares: Mapping[str, float]) -> list[dict[str, Any]]:
    """Every effect of the best set, then less probable ones as they are in the most evident set with them."""
    found = []
    for name in sorted(shares, key=lambda e: (e not in best.effects, -shares[e])):
        if name not in best.effects and shares[name] < LISTED:
            continue
        fit = best if name in best.effects else next(s for s in tried if name in s.effects)
        parameters = {}
        for d, x, deviation in zip(inverse.directions, fit.point, inverse.deviations(fit)):
            if d.effect == name:
                low, value, high = (d.parameter.physical(d.size(x + side * 1.645 * deviation), inverse.plant.values)[1]
                                    for side in (-1.0, 0.0, 1.0))
                nominal, _, unit = d.parameter.physical(d.parameter.neutral, inverse.plant.values)
                parameters[d.name] = {"nominal": nominal, "value": value, "low90": low, "high90": high, "unit": unit}
        found.append({"effect": name, "probability": shares[name], "parameters": parameters})
    return found


def _rivals(tried: Sequence[Supposition], best: Supposition) -> list[dict[str, Any]]:
    """What else might stand where one or more of the best set's effects do, closest first."""
    found: dict[tuple[str, ...], float] = {}
    for other in tried:
        instead = tuple(e for e in other.effects if e not in best.effects)
        replaced = set(best.effects) - set(other.effects)
        if replaced and instead and np.isfinite(other.log_evidence) and not any(
                set(known) <= set(instead) for known in found):
            found[instead] = float(np.sqrt(2.0 * max(best.log_evidence - other.log_evidence, 0.0)))
    return [{"effects": list(instead), "separation_sigma": distance}
            for instead, distance in sorted(found.items(), key=lambda item: item[1])][:RIVALS]


def _wrong(inverse: Inverse) -> list[dict[str, Any]]:
    """What the vehicle file gets wrong of each channel: its zero, its size, its course."""
    units = {v.name: v.unit for v in (*inverse.plant.plant.inputs, *inverse.plant.plant.output_variables)}
    where = f"{', '.join(dict.fromkeys(run.name for run in inverse.runs))}"
    healthy, everything = inverse.predicted_errors(()), inverse.predicted_errors(inverse.effects)
    nominal, missing = inverse.needed(inverse.plant.values), inverse.missing_within(())
    found = []
    for c, channel in enumerate(inverse.channels):
        zeros, scales, scale, sigma = [], [], inverse.scale[channel], inverse.sigma[channel]
        for error, needed, blocks in zip(missing, nominal, inverse.blocks):
            for e, n in zip(np.array_split(error[channel], len(blocks)), np.array_split(needed[channel], len(blocks))):
                zeros.append(float(np.mean(e)))
                scales.append(float(np.polyfit(n, e, 1)[0]))
        excess = float(np.sqrt(np.mean(healthy[:, c])) - np.sqrt(np.mean(everything[:, c]))) * sigma
        rows = (
            (float(np.mean(zeros)), _mean_is_zero(zeros), units[channel], SLIGHT * scale, "zero is off by {0:.3g} {1}"),
            (float(np.mean(scales)), _mean_is_zero(scales), "1", SLIGHT,
             "reads {2:.3g} times what the measured motion needs"),
            (excess, paired(healthy[:, c], everything[:, c]), units[channel], SLIGHT * sigma,
             "error {0:.3g} {1} larger than it would have to be"))
        for size, p, unit, slight, words in rows:
            if 3 * len(inverse.channels) * p < SIGNIFICANT and abs(size) > slight:
                found.append({"signal": channel, "where": where, "what": words.format(size, unit, 1.0 + size),
                              "size": size, "unit": unit, "p_value": min(1.0, 3 * len(inverse.channels) * p)})
    return sorted(found, key=lambda row: row["p_value"])


def _mean_is_zero(values: Sequence[float]) -> float:
    """p-value that blocks scatter about zero (Student's t)."""
    return float(ttest_1samp(values, 0.0).pvalue) if len(values) > 2 and np.ptp(values) > 0.0 else 1.0


def _unknown(inverse: Inverse) -> tuple[float, dict[str, Any]]:
    """What no effect explains: share of the noise that it is, and over what it shows best, and how.

    Searched in what is left when every effect may be there as it likes.
    """
    missing, found = inverse.missing_within(None), []
    for channel, node in inverse.plant.sections.items():
        if channel in inverse.channels:
            error = np.concatenate([m[channel] for m in missing])
            for name in ("speed", "acceleration", "position", "time"):
                over = np.concatenate([inverse.thinned(getattr(motion, name))
                                       for motion in inverse.motions])
                share, shape, size = _shape(over, error)
                found.append((share, {"balance": node, "driving_variable": name, "shape": shape, "size": size}))
    return max(found, key=lambda pair: pair[0])


def _shape(over: np.ndarray, error: np.ndarray, bins: int = 12) -> tuple[float, str, float]:
    """Share of the error that its mean over a variable predicts of the other half, the shape, its size."""
    edges = np.quantile(over, np.linspace(0.0, 1.0, bins + 1))
    place = np.clip(np.searchsorted(edges, over, side="right") - 1, 0, bins - 1)
    half = np.arange(over.size) * 20 // over.size % 2 == 0

    def means(chosen: np.ndarray) -> np.ndarray:
        return np.array([error[chosen & (place == b)].mean() if (chosen & (place == b)).any() else 0.0
                         for b in range(bins)])

    share = 1.0 - float(np.mean((error - means(half)[place])[~half] ** 2) / np.mean(error[~half] ** 2))
    curve = means(np.full(over.size, True))
    centres = np.array([np.median(over[place == b]) if (place == b).any() else 0.0 for b in range(bins)])
    x = centres / max(np.abs(centres).max(), 1e-300)
    shapes = {"constant": np.ones(bins), "proportional": x, "changes sign with it": np.sign(x), "even": x * x,
              "cubic": x**3}
    left = {name: float(np.sum((curve - s * (s @ curve) / (s @ s)) ** 2)) for name, s in shapes.items() if s @ s > 0.0}
    return share, min(left, key=left.__getitem__), float(np.ptp(curve) if np.ptp(curve) > 0.0 else curve[0])


def _traces(torques: Torques, values: Mapping[str, float],
            skew: Mapping[str, float]) -> dict[tuple[str, str], tuple[np.ndarray, ...]]:
    """Run and channel to clock, measured as if its samples were not late, before and after."""
    measured, before, after = torques.measured(skew), torques.needed(torques.plant.values), torques.needed(values)
    return {(run.name, c): (torques.clock(r), measured[r][c], before[r][c], after[r][c])
            for r, run in enumerate(torques.runs) for c in torques.channels}


def _gain(traces: Mapping[tuple[str, str], tuple[np.ndarray, ...]], inverse: Inverse) -> dict[str, Any]:
    """Errors before and after over the range of the channel, on recordings that were not used."""
    rows = []
    for (run, channel), (_, measured, before, after) in traces.items():
        span = float(np.ptp(measured))
        rows.append({"manoeuvre": run, "signal": channel,
                     "nrmse_before": float(np.sqrt(np.mean((measured - before) ** 2))) / span,
                     "nrmse_after": float(np.sqrt(np.mean((measured - after) ** 2))) / span,
                     "noise_floor": inverse.sigma[channel] / span})
    return {"held_out": rows,
            "fraction_of_noise_floor": float(np.median([r["nrmse_after"] / r["noise_floor"] for r in rows]))}


def _next(inverse: Inverse, tried: Sequence[Supposition], best: Supposition,
          instead: Sequence[str]) -> dict[str, Any] | None:
    """What would tell the best set from the closest other: a torque not recorded yet, or another motion."""
    other = next(s for s in tried if tuple(e for e in s.effects if e not in best.effects) == tuple(instead))
    pair = [inverse.at(s.point, s.effects)[0] for s in (best, other)]
    plant, run, measured = inverse.plant, inverse.runs[0], inverse.motions[0]
    fastest = float(np.abs(measured.speed).max())
    time = measured.time - measured.time[0]
    angle = 2.0 * np.pi * (0.2 * time + 0.5 * (5.0 - 0.2) / time[-1] * time**2)
    speeds = {"bench": measured.speed, "sweep": fastest * np.sin(angle),
              "coast_down": fastest * (1.0 - 2.0 * time / time[-1])}
    found = []
    for kind, speed in speeds.items():
        motion = replace(measured, speed=speed, acceleration=np.gradient(speed, STEP))
        a, b = (plant.torques(values, run, motion, every=True) for values in pair)
        for channel in a:
            sigma = inverse.sigma.get(channel, SLIGHT * float(np.std(inverse.band.of(a[channel], STEP, inverse.trim))))
            apart = float(np.linalg.norm(inverse.band.of(a[channel] - b[channel], STEP, inverse.trim)))
            apart /= max(sigma, 1e-300)
            new = channel not in inverse.channels
            found.append({"kind": kind, "gear": 0, "separation_sigma": apart,
                          "why": (f"the two differ in {channel}" + (", which was not recorded" if new else "")
                                  + ("" if kind == "bench" else f"; {time[-1]:.0f} s up to the speed seen"))})
    chosen = max(found, key=lambda row: row["separation_sigma"])
    return chosen if chosen["separation_sigma"] > APART else None
