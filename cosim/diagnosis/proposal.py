"""The manoeuvre that would tell two causes apart, found by driving candidates in simulation."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.plants import SETTLE, STEP, FullOrderCar, Nuisance, Run
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
_TORQUES = (120.0, 250.0)


@dataclass(frozen=True)
class Proposal:
    """A manoeuvre and how far apart it puts two causes.

    Attributes:
        kind, gear, torque, speed: What to drive; the highest torque [N.m], speed at the start [m/s].
        separation_sigma: Between the causes, nuisances projected out.
    """

    kind: str
    gear: int
    torque: float
    speed: float
    separation_sigma: float


def propose(car: FullOrderCar, noise: Noise, one: Mapping[str, float], other: Mapping[str, float],
            example: Run, engine_speed: float = 150.0) -> Proposal | None:
    """The candidate that separates two sets of values best.

    Args:
        car: The plant.
        noise: Of the channels, as far as the recordings showed it.
        one, other: Complete values under the two causes.
        example: A run with the channels that can be recorded.
    """
    best = None
    for (kind, corners), gear, torque in itertools.product(_PROFILES.items(), _GEARS, _TORQUES):
        if kind in ("coast_down", "cruise") and torque != _TORQUES[0]:
            continue
        if not car.values.get(f"transmission.ratio[{gear + 2}]", 0.0) > 0.0:
            continue
        speed = engine_speed / (car.values["final_drive.ratio"] * car.values[f"transmission.ratio[{gear + 2}]"]
                                ) * car.values["tyre.radius"]
        run = _candidate(car, example, kind, corners, gear, torque, speed)
        try:
            separation = _separation(car, noise, run, one, other)
        except (ArithmeticError, InputError):
            continue
        if best is None or separation > best.separation_sigma:
            best = Proposal(kind, gear, torque, speed, separation)
    return best


def _candidate(car: FullOrderCar, example: Run, kind: str, corners: Sequence[tuple[float, float]], gear: int,
               torque: float, speed: float) -> Run:
    time = STEP * np.arange(round(DURATION / STEP))
    inputs = np.tile(car.idle_inputs, (time.size, 1))
    inputs[:, 0] = torque * np.interp(time, *np.array(corners).T)
    inputs[:, 2] = gear
    clocks = {name: np.arange(SETTLE, DURATION - 2 * STEP, float(np.median(np.diff(clock))))
              for name, clock in example.clocks.items()}
    return Run(kind, kind, gear, 0.0, inputs, speed, clocks, {})


def _separation(car: FullOrderCar, noise: Noise, run: Run, one: Mapping[str, float],
                other: Mapping[str, float]) -> float:
    """Distance of the two predictions in sigma, start speed, grade and torque bias projected out."""
    base = car.predict(one, run)
    nuisances = [Nuisance(start_speed=0.1), Nuisance(grade=1e-3), Nuisance(torque=1.0)]
    columns = np.column_stack([car.predict(one, run, nuisance) - base for nuisance in nuisances])
    difference = car.predict(other, run) - base
    white, design = np.empty_like(difference), np.empty_like(columns)
    for name, place in run.slices.items():
        scale, colour = noise.floors()[name], noise.colours[name]
        white[place] = colour.white(difference[place] / scale)
        design[place] = colour.white(columns[place] / scale)
    coefficients = np.linalg.solve(design.T @ design + np.eye(3), design.T @ white)
    return float(np.sqrt(max(white @ white - (design.T @ white) @ coefficients, 0.0) / noise.temperature))


def words(proposal: Proposal, one: Sequence[str], other: Sequence[str]) -> str:
    """Why it would help, in a sentence."""
    def name(effects: Sequence[str]) -> str:
        return " with ".join(CATALOGUE[e].name.replace("_", " ") for e in effects)

    return (f"{proposal.kind.replace('_', ' ')} in gear {proposal.gear} to {proposal.torque:.0f} N.m from "
            f"{3.6 * proposal.speed:.0f} km/h: {name(one)} and {name(other)} then differ by "
            f"{proposal.separation_sigma:.1f} sigma")
