"""The manoeuvre that would tell causes apart, found by driving candidates in simulation."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.evidence import HETEROGENEITY
from cosim.diagnosis.fitting import Fit, as_found
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.plants import SETTLE, STEP, FullOrderCar, Nuisance, Run
from cosim.diagnosis.plants.car import ANCHORS
from cosim.diagnosis.predict import RUN_NUISANCES, Coordinate, Predictor
from driveline.quantities import InputError

DURATION = 7.0
# kind: corners of the torque as (time [s], share of the highest torque; negative: overrun)
_PROFILES = {
    "tip_in": ((1.0, -0.1), (1.1, 1.0)),
    "tip_out": ((0.0, 0.8), (1.5, 0.8), (1.6, -0.1)),
    "ramp": ((1.0, -0.1), (4.5, 1.0)),
    "pulse_train": ((1.0, -0.1), (1.05, 0.8), (2.0, 0.8), (2.05, -0.1), (3.0, -0.1), (3.05, 1.0), (4.0, 1.0),
                    (4.05, -0.1), (5.0, -0.1), (5.05, 0.6)),
    "coast_down": ((0.0, -0.1), (7.0, -0.1)),
    "cruise": ((0.0, 0.2), (7.0, 0.2)),
}
_GEARS = (3, 5, 7)
_TORQUES = (120.0, 220.0)
_ENGINE_SPEED = 150.0  # rad/s at the start
_VAGUE = 3.0  # on the floor of every channel: that residuals are alike from sample to sample


@dataclass(frozen=True)
class Proposal:
    """A manoeuvre and how far apart it puts a supposition and its rivals.

    Attributes:
        kind, gear, torque, speed: What to drive; the highest torque [N.m], speed at the start [m/s].
        separation_sigma: From the rival that is nearest then, with the recordings there are; nuisances projected out.
        nearest: That rival.
    """

    kind: str
    gear: int
    torque: float
    speed: float
    separation_sigma: float
    nearest: Fit


def propose(predictor: Predictor, noise: Noise, one: Fit, rivals: Sequence[tuple[Fit, float]]) -> Proposal | None:
    """The candidate after which a supposition stands out best from all of its rivals; None where none can be driven.

    Args:
        predictor: Of the recordings; its first run has the channels that can be recorded.
        noise: Its floors.
        one: What is likeliest by the recordings.
        rivals: What cannot be told from it by them, and how far apart they are [sigma].
    """
    car = predictor.car
    best = None
    for (kind, corners), gear, torque in itertools.product(_PROFILES.items(), _GEARS, _TORQUES):
        if kind in ("coast_down", "cruise") and torque != _TORQUES[0]:
            continue
        ratio = car.values.get(f"transmission.ratio[{gear + 2}]", 0.0) * car.values["final_drive.ratio"]
        if not ratio > 0.0:
            continue
        speed = _ENGINE_SPEED / ratio * car.values["tyre.radius"]
        run = _candidate(car, predictor.runs[0], kind, corners, gear, torque, speed)
        try:
            separations = _separations(predictor, noise.floors, run, one, [other for other, _ in rivals])
        except (ArithmeticError, InputError):
            continue
        then = np.hypot(separations, [apart for _, apart in rivals])
        nearest = int(np.argmin(then))
        if best is None or then[nearest] > best.separation_sigma:
            best = Proposal(kind, gear, torque, speed, float(then[nearest]), rivals[nearest][0])
    return best


def _candidate(car: FullOrderCar, example: Run, kind: str, corners: Sequence[tuple[float, float]], gear: int,
               torque: float, speed: float) -> Run:
    time = STEP * np.arange(round(DURATION / STEP))
    inputs = np.tile(car.idle_inputs, (time.size, 1))
    inputs[:, car.columns["engine_torque"]] = torque * np.interp(time, *np.array(corners).T)
    inputs[:, car.columns["gear"]] = gear
    clocks = {name: np.arange(SETTLE, DURATION - 2 * STEP, float(np.median(np.diff(clock))))
              for name, clock in example.clocks.items()}
    return Run(kind, kind, gear, 0.0, inputs, speed, clocks, {})


def _separations(predictor: Predictor, floors: Mapping[str, float], run: Run, one: Fit,
                 others: Sequence[Fit]) -> list[float]:
    """Distance of each other's prediction from the one's in sigma.

    What the run's nuisances, the heterogeneity of the one's parameters, and any other size of the other's can imitate
    does not count.
    """
    car = predictor.car
    mine = _values(predictor, one)
    raw = car.raw(mine, run)
    # what would be measured leads all simulations, as it will when the recording is diagnosed
    run = replace(run, anchors={name: (run.time, raw[name]) for name in ANCHORS if name in run.clocks})
    base = car.predict(mine, run)
    scale = np.concatenate([np.full(clock.size, _VAGUE * floors[name]) for name, clock in run.clocks.items()])

    def moved(fit: Fit, there: np.ndarray, width: Callable[[Coordinate], float]) -> list[np.ndarray]:
        """What a fit's causes do as they move by their widths, in units of the noise."""
        own = [(i, predictor.coordinates[i]) for cause in fit.causes for i in predictor.index(cause)]
        return [(car.predict(_values(predictor, fit, i, c.step), run) - there) / scale * (width(c) / c.step)
                for i, c in own if c.run is None]

    imitating = [(car.predict(mine, run, Nuisance(**{name: step})) - base) / scale * (spread / step)
                 for name, (spread, step) in RUN_NUISANCES.items()]
    imitating += moved(one, base, lambda c: HETEROGENEITY * c.parameter.detection)
    found = []
    for other in others:
        there = car.predict(_values(predictor, other), run)
        design = np.column_stack(imitating + moved(other, there, lambda c: c.spread))
        white = (there - base) / scale
        inner = design.T @ white
        imitated = inner @ np.linalg.solve(design.T @ design + np.eye(inner.size), inner)
        found.append(float(np.sqrt(max(white @ white - imitated, 0.0))))
    return found


def _values(predictor: Predictor, fit: Fit, moved: int | None = None, step: float = 0.0) -> dict[str, float]:
    """Values with the supposed causes in them and nothing else changed, one coordinate moved."""
    point = as_found(predictor, fit, fit.shared)
    if moved is not None:
        point[moved] += step
    return predictor.values(point, 0)[0]


def words(proposal: Proposal, one: Fit) -> str:
    """How to drive it beyond kind and gear, and why it would tell a supposition from its rivals."""
    def name(effects: Sequence[str]) -> str:
        return " with ".join(CATALOGUE[e].name.replace("_", " ") for e in effects) or "nothing wrong"

    return (f"to {proposal.torque:.0f} N.m from {3.6 * proposal.speed:.0f} km/h: {name(one.effects)} and "
            f"{name(proposal.nearest.effects)} then differ by {proposal.separation_sigma:.1f} sigma")
