"""The manoeuvre that would tell causes apart, found by driving candidates in simulation."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import norm

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import SLOPE
from cosim.diagnosis.fit.evidence import Evidence, Layout, Slopes, prior
from cosim.diagnosis.fit.fitting import Fit, Fitter, as_found
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.fit.predict import Coordinate, Predictor, coordinates
from cosim.diagnosis.plants import SETTLE, STEP, FullOrderCar, Run
from cosim.diagnosis.plants.led import led_by
from cosim.diagnosis.search.identification import APART, LACKING, Identification, signed, trusted
from cosim.diagnosis.search.reach import around, instead_of, twins
from driveline.elements.engine_torque import engine_friction
from driveline.elements.road_load import GRAVITY
from driveline.quantities import InputError

DURATION = 7.0
TOP = 0  # for the highest gear there is
# kind: gears, highest torque [N.m] if the engine gives as much, and corners of the torque as (time [s], share of it;
# negative: overrun).
# In the lowest shafts are twisted most, in third and fifth they ring differently, in the highest the air resists.
_PROFILES = {
    "tip_in": ((2, 3, 5), 220.0, ((1.0, -0.1), (1.1, 1.0))),
    "tip_out": ((3,), 220.0, ((0.0, 0.8), (1.5, 0.8), (1.6, -0.1))),
    "ramp": ((2, 3, 5), 220.0, ((1.0, -0.1), (4.5, 1.0))),
    "pulse_train": ((2, 3, 5), 220.0, (
        (1.0, -0.1), (1.05, 0.8), (2.0, 0.8), (2.05, -0.1), (3.0, -0.1), (3.05, 1.0), (4.0, 1.0), (4.05, -0.1),
        (5.0, -0.1), (5.05, 0.6))),
    "coast_down": ((TOP,), 120.0, ((0.0, -0.1), (7.0, -0.1))),
}
_ENGINE_SPEED = 150.0  # rad/s at the start
# Of what the driven tyres can carry, at most. Nearer to that tyres differ by more than what is looked for: with a half
# a healthy plant of another structure left three times as much as it should, with 0.36 and 0.32 what it should.
_GRIP = 0.4
_UNSURE = 2.0  # sigma by which what was promised of a dozen blind cases and what came of it differed
_EACH = 0.05  # by how much every further time that a manoeuvre is driven has to raise the chance (a judgement)


@dataclass(frozen=True)
class Proposal:
    """A manoeuvre and how far apart it puts suppositions.

    Attributes:
        kind, gear, torque, speed: What to drive; its highest torque [N.m], below zero on the overrun; speed at the
            start [m/s].
        back: Whether on the same road the other way, where its slope has the other sign.
        times: How often.
        fitted: How many of these recordings are fitted; what is kept back measures the gain.
        apart: If the likeliest is true, how far every other is from it then [sigma], judged as the recordings are, with
            those there are; the nearest first.
        chance: That whichever is true stands alone then.
    """

    kind: str
    gear: int
    torque: float
    speed: float
    back: bool
    times: int
    fitted: int
    apart: tuple[tuple[float, Fit], ...]
    chance: float

    @property
    def separation_sigma(self) -> float:
        """How far the nearest is from the likeliest then, if that is true."""
        return max(self.apart[0][0], 0.0)

    @property
    def worth(self) -> float:
        """The chance, less what driving takes."""
        return self.chance - _EACH * (self.times - 1)


def propose(fitter: Fitter, found: Identification, rivals: Sequence[Fit],
            drives: Mapping[int, int]) -> Proposal | None:
    """The candidate after which whichever is true most probably stands alone; several times where that is worth it.

    Each is simulated as the likeliest says, with derivatives by all that may differ, and judged as a recording is that
    shows what one or the other would do: what healthy cars differ by, and other sizes of the others' causes, imitate
    what they can.

    Args:
        fitter: Of the recordings; their first has the channels that can be recorded.
        found: What is likeliest by them.
        rivals: What cannot be told from it.
        drives: How often it may be driven, and how many of these recordings would be fitted.

    Returns:
        None where no candidate can be driven.
    """
    one, noise = found.best, found.noise
    predictor = fitter.predictor
    evidence = fitter.judged(one, noise)
    shared = fitter.layout.shared
    fits = (one, *rivals)
    ways, wide = _ways(predictor, fits, shared), _wide(fitter, found, fits)
    behind = np.array([found.lead(fit) for fit in fits])
    now, likely = -behind - _log_evidence(evidence, fits), np.array([found.odds(fit) for fit in fits])
    best: Proposal | None = None
    given = _given(predictor.car, _ENGINE_SPEED)
    driven = [run.manoeuvre for run in predictor.runs]
    before = partial(_repeated, fitter, found)
    for kind, (gears, wanted, corners) in _PROFILES.items():
        torque = min(wanted, given)
        for gear in _drivable(predictor.car, gears, torque):
            speed = _ENGINE_SPEED * predictor.car.gearing.rolling(gear)["engine_speed"]
            run = _candidate(predictor.car, predictor.runs[0], kind, corners, gear, torque, speed)
            there = {back: driven.count((kind, gear, back)) for back in ways}
            counts = {count + fitted for count in there.values() for fitted in drives.values()}
            try:
                squares = information(predictor, noise, run, one, counts)
                unseen = _unseen(predictor, noise, run, one, wide)
            except (ArithmeticError, InputError):
                continue
            for (back, signs), (times, fitted) in itertools.product(ways.items(), drives.items()):
                square = squares[there[back] + fitted][np.ix_(shared, shared)]
                told = fitted * signs[:, None] * square * signs
                known = before((kind, gear, back), fitted) if there[back] else evidence
                apart = _apart(known, told, shared, fits, now, found.temper)
                apart[0] = np.minimum(apart[0], unseen)
                others = sorted(zip(apart[0, 1:].tolist(), rivals), key=lambda pair: pair[0])
                highest = torque * max(share for _, share in corners)
                candidate = Proposal(kind, gear, highest, speed, back, times, fitted, tuple(others),
                                    _chance(apart, fits, likely))
                if best is None or candidate.worth > best.worth:
                    best = candidate
    return best


def _repeated(fitter: Fitter, found: Identification, manoeuvre: tuple[str, int, bool], fitted: int) -> Evidence:
    """What the runs there are will say where some more of a manoeuvre are fitted: those of it less each.

    What a plant of another structure errs by is the same in all of them.
    """
    predictor = fitter.predictor
    more = [count + fitted * (run.manoeuvre == manoeuvre) for run, count in zip(predictor.runs, predictor.repeats)]
    again = copy(fitter)
    again.layout = Layout(fitter.coordinates, more)
    return again.judged(found.best, found.noise)


def _chance(apart: np.ndarray, fits: Sequence[Fit], likely: np.ndarray) -> float:
    """That whichever is true stands alone: what is promised is not sure, and a hopeless rival is the same for all.

    A cause that is not there goes away, but never stands out as wrong: what has it beside the true ones only has to be
    behind, as has none. And if none is true nothing is left to tell.
    """
    caused = np.array([bool(fit.causes) for fit in fits])
    told = norm.cdf((apart - np.array([[_needed(true, other) for other in fits] for true in fits])) / _UNSURE)
    np.fill_diagonal(told, 1.0)
    return float(np.average(np.prod(told, axis=1)[caused], weights=likely[caused]))


def _needed(true: Fit, other: Fit) -> float:
    """How far behind what is true another supposition has to be to be told from it [sigma]."""
    if not other.causes or set(true.causes) < set(other.causes):
        return 0.0
    return LACKING if set(other.causes) < set(true.causes) else APART


def _wide(fitter: Fitter, found: Identification, fits: Sequence[Fit]) -> list[list[tuple[float, Fit]]]:
    """Of each supposition, if it is the same as the first as far as recordings reach, what is wider and wider, and how
    far behind [sigma]; the nearest first."""
    found_wide: list[list[tuple[float, Fit]]] = [[] for _ in fits]
    for gone, place in twins(fitter.coordinates, fits[0]):
        causes = instead_of(fitter.coordinates, fits[0], gone, place)
        for wide, fit in zip(found_wide, fits):
            if fit.causes == causes:
                wider = around(fitter, found.noise, fits[0], gone, place)
                wide += sorted(((float(signed(fits[0].score - other.score, found.temper)), other) for other in wider),
                               key=lambda pair: pair[0])
    return found_wide


def _unseen(predictor: Predictor, noise: Noise, run: Run, one: Fit,
            wide: Sequence[Sequence[tuple[float, Fit]]]) -> np.ndarray:
    """How far behind the nearest of those is that a run does not tell from the first either [sigma]; infinite without.

    Derivatives know nothing of that: where the second of two stages is reached a wider first one is not.
    """
    def shown(fit: Fit) -> np.ndarray:
        return predictor.car.predict(predictor.values(as_found(predictor, fit, fit.shared), 0)[0], run)

    nearest, floor = np.full(len(wide), np.inf), run.stack(noise.floors)
    mine = shown(one) if any(wide) else np.empty(0)
    for i, fits in enumerate(wide):
        for sigma, fit in fits:
            if np.all(np.abs(shown(fit) - mine) < floor):
                nearest[i] = sigma
                break
    return nearest


def _apart(evidence: Evidence, square: np.ndarray, shared: np.ndarray, fits: Sequence[Fit],
           now: np.ndarray, temper: float) -> np.ndarray:
    """How far suppositions are behind one that is true after a further recording [sigma]: true one x other.

    Args:
        evidence: What the recordings say.
        square: What the further one would say.
        shared: Places of the shared coordinates.
        fits: The suppositions.
        now: Their scores, up to a constant, without their log evidence in ``evidence``.
        temper: Of differences in evidence.
    """
    then = [now + _log_evidence(evidence.expecting(square, true.shared[shared]), fits) for true in fits]
    return np.array([[signed(trusted(scores[k] - score, true, other), temper) for score, other in zip(scores, fits)]
                     for k, (scores, true) in enumerate(zip(then, fits))])


def _ways(predictor: Predictor, fits: Sequence[Fit], shared: np.ndarray) -> dict[bool, np.ndarray]:
    """Whether to drive the other way, and the signs that shared coordinates have then: a slope has the other one.

    Only where a slope is among what is compared, and is not an offset of its sensor.
    """
    ways = {False: np.ones(shared.size)}
    slopes = {i: c.cause for i, c in enumerate(predictor.coordinates) if c.parameter and SLOPE in c.parameter.targets}
    graded = any(run.graded for run in predictor.runs)
    if not graded and any(cause in fit.causes for cause in slopes.values() for fit in fits):
        ways[True] = np.where(np.isin(shared, list(slopes)), -1.0, 1.0)
    return ways


def _log_evidence(evidence: Evidence, fits: Sequence[Fit]) -> np.ndarray:
    """Of each supposition."""
    return np.array([evidence.posterior(prior(evidence.layout.coordinates, fit.causes)).log_evidence for fit in fits])


def _given(car: FullOrderCar, speed: float) -> float:
    """The highest torque that can be asked of the engine at a speed [rad/s] of it [N.m].

    Its friction is asked of the air path beside it; what accessories take comes off any torque that is asked for.
    """
    v = car.values
    return v["engine.maximum_torque"] - engine_friction(
        speed, v["engine.friction_constant"], v["engine.friction_viscous"])


def _drivable(car: FullOrderCar, gears: Iterable[int], torque: float) -> list[int]:
    """Those of some gears that the vehicle has, and in which its tyres carry a torque of the engine easily."""
    v = car.values
    carried = _GRIP * v["tyre.friction_coefficient"] * v["vehicle.driven_load_fraction"] * v["vehicle.mass"] * GRAVITY
    highest = carried * v["tyre.radius"] / (torque * v["final_drive.ratio"])
    ratios = car.gearing.ratios
    return [gear for gear in (wanted or max(ratios) for wanted in gears) if ratios.get(gear, np.inf) <= highest]


def _candidate(car: FullOrderCar, example: Run, kind: str, corners: Sequence[tuple[float, float]], gear: int,
               torque: float, speed: float) -> Run:
    time = STEP * np.arange(round(DURATION / STEP))
    inputs = np.tile(car.idle_inputs, (time.size, 1))
    inputs[:, car.columns["engine_torque"]] = torque * np.interp(time, *np.array(corners).T)
    inputs[:, car.columns["gear"]] = gear
    clocks = {name: np.arange(SETTLE, DURATION - 2 * STEP, float(np.median(np.diff(clock))))
              for name, clock in example.clocks.items()}
    return Run(kind, kind, gear, 0.0, inputs, speed, clocks, {})


def information(predictor: Predictor, noise: Noise, run: Run, one: Fit,
                counts: Iterable[int]) -> dict[int, np.ndarray]:
    """What a run that is not driven yet would say of the shared coordinates, near a supposition.

    Its own nuisances are projected out; what swings in it alone says nothing. The more runs there are of its manoeuvre
    the less each says: what a plant of another structure errs by is the same in all of them.

    Args:
        predictor: Of the runs there are.
        noise: Of these.
        run: What would be driven.
        one: The supposition.
        counts: How many runs of its manoeuvre there would be.

    Returns:
        For each of these.

    Raises:
        ArithmeticError, InputError: It cannot be simulated.
    """
    car, supposed = predictor.car, as_found(predictor, one, one.shared)
    values, _ = predictor.values(supposed, 0)
    raw = car.raw(values, run)
    # what would be measured leads all simulations, as it will when the recording is diagnosed
    run = led_by(run, raw)
    shown, random = car.instruments(raw, values, run), np.random.default_rng(1)
    run = replace(run, measured={name: shown[place] + noise.floors[name] * random.standard_normal(clock.size)
                                 for (name, place), clock in zip(run.slices.items(), run.clocks.values())})
    declared = coordinates(car, [run])
    places = {_identity(c): i for i, c in enumerate(predictor.coordinates)}
    with Predictor(car, [run], declared, predictor.workers) as alone:
        fitter = Fitter(alone)
        fit = fitter.at(np.array([supposed[places[_identity(c)]] if c.run is None else 0.0 for c in declared]))
        whitened = fitter.noise(fit).whiten(0, fit.tangents[0].jacobian)
    common = [k for k, i in enumerate(fitter.layout.shared) if declared[i].run is None]
    there = [places[_identity(declared[fitter.layout.shared[k]])] for k in common]
    told = {}
    for count in counts:
        capped = Slopes(Layout(declared, [count]), 0, whitened).capped
        told[count] = np.zeros((len(predictor.coordinates), len(predictor.coordinates)))
        told[count][np.ix_(there, there)] = capped[np.ix_(common, common)]
    return told


def _identity(coordinate: Coordinate) -> tuple[str, str, int | None]:
    return coordinate.effect, coordinate.name, coordinate.run


def words(proposal: Proposal, one: Fit) -> str:
    """How to drive it beyond kind and gear, and why it would tell suppositions apart."""
    def name(effects: Sequence[str]) -> str:
        return " with ".join(CATALOGUE[e].name.replace("_", " ") for e in effects) or "nothing wrong"

    way = ", on the same road the other way (back = true)" * proposal.back
    way += ", one of them to measure the gain on" * (proposal.fitted < proposal.times)
    others = ", ".join(f"{max(sigma, 0.0):.1f} sigma from {name(fit.effects)}" for sigma, fit in proposal.apart)
    to = "to" if proposal.torque > 0.0 else "at"
    found = (f"{to} {proposal.torque:.0f} N.m from {3.6 * proposal.speed:.0f} km/h{way}: {name(one.effects)}, if it is "
             f"that, is then {others}; chance to tell which it is {100.0 * proposal.chance:.0f} %")
    return found if proposal.chance > 0.5 else found + ", and nothing that was tried does more"
