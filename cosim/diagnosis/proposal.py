"""The manoeuvre that would tell causes apart, found by driving candidates in simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import SLOPE
from cosim.diagnosis.evidence import Evidence, Slopes, prior
from cosim.diagnosis.fitting import Fit, Fitter, as_found
from cosim.diagnosis.identify import APART, Identification, separation
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.plants import SETTLE, STEP, FullOrderCar, Run
from cosim.diagnosis.plants.car import led_by
from cosim.diagnosis.predict import Coordinate, Predictor, coordinates
from driveline.quantities import InputError

DURATION = 7.0
# kind: highest torque [N.m], and corners of the torque as (time [s], share of it; negative: overrun)
_PROFILES = {
    "tip_in": (220.0, ((1.0, -0.1), (1.1, 1.0))),
    "tip_out": (220.0, ((0.0, 0.8), (1.5, 0.8), (1.6, -0.1))),
    "ramp": (220.0, ((1.0, -0.1), (4.5, 1.0))),
    "pulse_train": (220.0, ((1.0, -0.1), (1.05, 0.8), (2.0, 0.8), (2.05, -0.1), (3.0, -0.1), (3.05, 1.0), (4.0, 1.0),
                            (4.05, -0.1), (5.0, -0.1), (5.05, 0.6))),
    "coast_down": (120.0, ((0.0, -0.1), (7.0, -0.1))),
    "cruise": (120.0, ((0.0, 0.2), (7.0, 0.2))),
}
_GEARS = (3, 5, 7)
_ENGINE_SPEED = 150.0  # rad/s at the start


@dataclass(frozen=True)
class Proposal:
    """A manoeuvre and how far apart it puts suppositions, whichever of them is true.

    Attributes:
        kind, gear, torque, speed: What to drive; the highest torque [N.m], speed at the start [m/s].
        back: Whether on the same road the other way, where its slope has the other sign.
        separation_sigma: Of the two that are nearest then, judged as the recordings are, with those there are.
        nearest: These: if the first is true, it is that far from the second.
        told: Of so many, one is told from another.
    """

    kind: str
    gear: int
    torque: float
    speed: float
    back: bool
    separation_sigma: float
    nearest: tuple[Fit, Fit]
    told: int


def propose(fitter: Fitter, found: Identification, rivals: Sequence[Fit]) -> Proposal | None:
    """The candidate after which whichever is true stands out from most others, and best from the nearest of them.

    Each is simulated as the likeliest says, with derivatives by all that may differ, and judged as a recording is that
    shows what one or the other would do: what healthy cars differ by, and other sizes of the others' causes, imitate
    what they can.

    Args:
        fitter: Of the recordings; their first has the channels that can be recorded.
        found: What is likeliest by them.
        rivals: What cannot be told from it.

    Returns:
        None where no candidate can be driven.
    """
    one, noise = found.best, found.noise
    predictor = fitter.predictor
    evidence = fitter.judged(one, noise)
    shared = fitter.layout.shared
    fits = (one, *rivals)
    ways = _ways(predictor, fits, shared)
    now = -np.array([found.lead(fit) for fit in fits]) - _log_evidence(evidence, fits)
    best: Proposal | None = None
    for kind, (torque, corners) in _PROFILES.items():
        for gear in _GEARS:
            speed = _start_speed(predictor.car, gear)
            if speed is None:
                continue
            run = _candidate(predictor.car, predictor.runs[0], kind, corners, gear, torque, speed)
            try:
                square = information(predictor, noise, run, one)[np.ix_(shared, shared)]
            except (ArithmeticError, InputError):
                continue
            for back, signs in ways.items():
                pairs = _apart(evidence, signs[:, None] * square * signs, shared, fits, now)
                sigma, *nearest = min(pairs, key=lambda pair: pair[0])
                told = sum(pair[0] > APART for pair in pairs)
                if best is None or (told, sigma) > (best.told, best.separation_sigma):
                    best = Proposal(kind, gear, torque, speed, back, sigma, tuple(nearest), told)
    return best


def _apart(evidence: Evidence, square: np.ndarray, shared: np.ndarray, fits: Sequence[Fit],
           now: np.ndarray) -> list[tuple[float, Fit, Fit]]:
    """How far suppositions are from one that is true after a further recording [sigma], that one, and the other.

    Args:
        evidence: What the recordings say.
        square: What the further one would say.
        shared: Places of the shared coordinates.
        fits: The suppositions.
        now: Their scores, up to a constant, without their log evidence in ``evidence``.
    """
    pairs = []
    for k, true in enumerate(fits):
        if true.causes:  # a cause that is not there goes away, but never stands out as wrong
            then = now + _log_evidence(evidence.expecting(square, true.shared[shared]), fits)
            pairs += [(separation(then[k] - then[i]), true, other) for i, other in enumerate(fits) if i != k]
    return pairs


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


def _start_speed(car: FullOrderCar, gear: int) -> float | None:
    """Of the vehicle [m/s]; None without such a gear."""
    factor = car.rolling(gear).get("engine_speed")
    return factor and _ENGINE_SPEED * factor


def _candidate(car: FullOrderCar, example: Run, kind: str, corners: Sequence[tuple[float, float]], gear: int,
               torque: float, speed: float) -> Run:
    time = STEP * np.arange(round(DURATION / STEP))
    inputs = np.tile(car.idle_inputs, (time.size, 1))
    inputs[:, car.columns["engine_torque"]] = torque * np.interp(time, *np.array(corners).T)
    inputs[:, car.columns["gear"]] = gear
    clocks = {name: np.arange(SETTLE, DURATION - 2 * STEP, float(np.median(np.diff(clock))))
              for name, clock in example.clocks.items()}
    return Run(kind, kind, gear, 0.0, inputs, speed, clocks, {})


def information(predictor: Predictor, noise: Noise, run: Run, one: Fit) -> np.ndarray:
    """What a run that is not driven yet would say of the shared coordinates, near a supposition.

    Its own nuisances are projected out; what swings in it alone says nothing.

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
        capped = Slopes(fitter.layout, 0, fitter.noise(fit).whiten(0, fit.tangents[0].jacobian)).capped
    common = [k for k, i in enumerate(fitter.layout.shared) if declared[i].run is None]
    there = [places[_identity(declared[fitter.layout.shared[k]])] for k in common]
    everything = np.zeros((len(predictor.coordinates), len(predictor.coordinates)))
    everything[np.ix_(there, there)] = capped[np.ix_(common, common)]
    return everything


def _identity(coordinate: Coordinate) -> tuple[str, str, int | None]:
    return coordinate.effect, coordinate.name, coordinate.run


def words(proposal: Proposal) -> str:
    """How to drive it beyond kind and gear, and why it would tell suppositions apart."""
    def name(effects: Sequence[str]) -> str:
        return " with ".join(CATALOGUE[e].name.replace("_", " ") for e in effects) or "nothing wrong"

    way = ", on the same road the other way (back = true)" * proposal.back
    one, other = (name(fit.effects) for fit in proposal.nearest)
    found = (f"to {proposal.torque:.0f} N.m from {3.6 * proposal.speed:.0f} km/h{way}: {one} and {other} then differ "
             f"by {proposal.separation_sigma:.1f} sigma")
    enough = proposal.separation_sigma > APART
    return found if enough else found + ", too little to tell them apart, and nothing that was tried does more"
