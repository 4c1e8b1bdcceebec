"""TKBSE: the triggered Kalman backlash size estimator of thesis section 4.1.

The driveline is taken to be in contact all the time. Its sixth state, the offset in the shaft's
twist, then stays where it is while that is true, and moves by the size of the lash while the lash is
crossed. So a stationary Kalman filter for the contact model, started at zero offset when the torque
turns positive and rises, settles at the lash size. Each tip-in triggers it anew; between triggers
everything is held. "With constraint" (section 4.1.4) the size changes only when a trigger ends.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..kernels.backend import F8, entry_point
from ..plants.reduced import ThreeMassDriveline
from ..quantities import quantity
from .estimator import Estimator, Noise, Sampling, check_lash, estimate
from .kalman import discretise, stationary_gain
from .lumped import (
    C_S,
    DRIVELINE,
    I_FDR,
    I_TR,
    J_1,
    K_S,
    K_W,
    PLAUSIBLE_SPEED,
    PLAUSIBLE_TORQUE,
    driveline_constants,
    net_torque,
    plausible,
    road_load,
)
from .state_space import CONTACT, Lumped, twists

N, M = 6, 2
TWIST, ENGINE, WHEEL_TWIST, FINAL_DRIVE, WHEEL, SIZE = range(N)

GAIN = DRIVELINE
A = GAIN + 2 * N
B = A + N * N
LEVEL = B + N * M
SLOPE = LEVEL + 1
PERIOD = SLOPE + 1
SPREAD = PERIOD + 1
CONSTANTS = SPREAD + 2
ROOM = CONSTANTS
WORK = ROOM + N

# State: x, then these. The first entry of the state array counts frames.
KEPT = 1 + N
(TRIGGERED, TORQUE, SEEN, CONSTRAINED, TRIGGERS, SURPRISE, MISSED, ENGINE_BEFORE) = range(KEPT, KEPT + 8)
STATE = KEPT + 7

MEMORY = 20.0
SURPRISE_BOUND = 9.0
MISSED_BOUND = 5.0
INPUT_TORQUE, INPUT_ENGINE, INPUT_WHEEL = range(3)


@dataclass(frozen=True)
class Trigger:
    """When a tip-in is worth listening to (section 4.1.2)."""

    torque: float = quantity("N.m", "the crankshaft torque must be above this", start=0.0)
    slope: float = quantity("N.m/s", "and rise faster than this", start=6.0, minimum=0.0)


@dataclass(frozen=True)
class TkbseParameters(ThreeMassDriveline):
    """The driveline it believes in, and its tuning.

    The thesis calibrates Q for the size estimator anew and does not print it; the defaults of
    q_1 to q_6 are tuned to table 4.1.
    """

    noise: Noise = field(default_factory=lambda: TUNED)
    trigger: Trigger = field(default_factory=Trigger)
    sampling: Sampling = field(default_factory=Sampling)


TUNED = Noise(q_1=1e-8, q_2=1e-3, q_3=1e-8, q_4=1e-3, q_5=1e-4, q_6=1e-3)


@entry_point
def tkbse_step(state: F8, constants: F8, work: F8, inputs: F8, outputs: F8, time: float) -> int:
    """One frame at ``time`` [s]."""
    for i in range(CONSTANTS):
        work[i] = constants[i]
    torque_good = plausible(inputs[INPUT_TORQUE], PLAUSIBLE_TORQUE)
    engine_good = plausible(inputs[INPUT_ENGINE], PLAUSIBLE_SPEED)
    wheel_good = plausible(inputs[INPUT_WHEEL], PLAUSIBLE_SPEED)
    torque = state[TORQUE]
    slope = 0.0
    if torque_good:
        torque = inputs[INPUT_TORQUE]
        if state[SEEN] > 0.0:
            slope = (torque - state[TORQUE]) / work[PERIOD]
    wanted = torque > work[LEVEL] and slope > work[SLOPE]
    if torque_good and not wanted and state[TRIGGERED] > 0.0:
        state[TRIGGERED] = 0.0
        state[CONSTRAINED] = state[1 + SIZE]
    if wanted and state[TRIGGERED] == 0.0 and engine_good and wheel_good:
        # Speeds as the frame says. The offset begins at zero, the twist at what the torque balance
        # of the engine between the last two frames leaves for the shaft.
        for i in range(N):
            state[1 + i] = 0.0
        if state[ENGINE_BEFORE] > 0.0:
            acceleration = (inputs[INPUT_ENGINE] - state[ENGINE_BEFORE]) / work[PERIOD]
            drive = net_torque(work, 0, 0.5 * (torque + state[TORQUE]), inputs[INPUT_ENGINE], 0.0)
            shaft = work[I_TR] * (drive - work[J_1] * acceleration)
            rate = inputs[INPUT_ENGINE] / work[I_TR] - work[I_FDR] * inputs[INPUT_WHEEL]
            state[1 + TWIST] = (shaft - work[C_S] * rate) / work[K_S]
            state[1 + WHEEL_TWIST] = work[I_FDR] * shaft / work[K_W]
        state[1 + ENGINE] = inputs[INPUT_ENGINE]
        state[1 + FINAL_DRIVE] = inputs[INPUT_WHEEL]
        state[1 + WHEEL] = inputs[INPUT_WHEEL]
        state[TRIGGERED] = 1.0
        state[TRIGGERS] += 1.0
    elif state[TRIGGERED] > 0.0:
        shaft = (work[K_S] * (state[1 + TWIST] - state[1 + SIZE])
                 + work[C_S] * (state[1 + ENGINE] / work[I_TR] - work[I_FDR] * state[1 + FINAL_DRIVE]))
        drive = net_torque(work, 0, 0.5 * (state[TORQUE] + torque), state[1 + ENGINE], shaft)
        load = road_load(work, 0, state[1 + WHEEL])
        for i in range(N):
            total = work[B + M * i] * drive + work[B + M * i + 1] * load
            for j in range(N):
                total += work[A + N * i + j] * state[1 + j]
            work[ROOM + i] = total
        engine = 0.0
        wheel = 0.0
        if engine_good:
            engine = inputs[INPUT_ENGINE] - work[ROOM + ENGINE]
        if wheel_good:
            wheel = inputs[INPUT_WHEEL] - work[ROOM + WHEEL]
        for i in range(N):
            state[1 + i] = work[ROOM + i] + work[GAIN + 2 * i] * engine + work[GAIN + 2 * i + 1] * wheel
        surprise = 0.5 * (engine * engine / work[SPREAD] + wheel * wheel / work[SPREAD + 1])
        state[SURPRISE] += (surprise - state[SURPRISE]) / MEMORY
    if engine_good and wheel_good and torque_good:
        state[MISSED] = 0.0
    else:
        state[MISSED] += 1.0
    if torque_good:
        state[TORQUE] = torque
        state[SEEN] = 1.0
    state[ENGINE_BEFORE] = 0.0
    if engine_good:
        state[ENGINE_BEFORE] = inputs[INPUT_ENGINE]
    for i in range(N):
        outputs[i] = state[1 + i]
    outputs[6] = state[CONSTRAINED]
    outputs[7] = state[TRIGGERED]
    outputs[8] = state[TRIGGERS]
    outputs[9] = state[SURPRISE]
    outputs[10] = 1.0
    if state[SURPRISE] > SURPRISE_BOUND or state[MISSED] >= MISSED_BOUND:
        outputs[10] = 0.0
    return 0


class Tkbse(Estimator):
    """The triggered Kalman estimator of the backlash size."""

    name = "tkbse"
    description = "Triggered Kalman backlash size estimator (TKBSE)"
    Parameters = TkbseParameters
    entry_point = "tkbse_step"
    state_size = STATE
    work_size = WORK
    output_variables = (
        estimate("shaft_twist", "rad", "twist of the lumped propeller shaft with its lash", 0.1),
        estimate("engine_speed_estimate", "rad/s", "engine speed", 100.0),
        estimate("wheel_shaft_twist", "rad", "twist of the lumped wheel shaft", 0.01),
        estimate("final_drive_speed", "rad/s", "final drive speed, at the wheels", 30.0),
        estimate("wheel_speed_estimate", "rad/s", "wheel speed", 30.0),
        estimate("lash_size_unconstrained", "rad", "total lash (2 alpha) as it settles", 0.1),
        estimate("lash_size", "rad", "total lash (2 alpha) at the end of the last trigger", 0.1),
        estimate("triggered", "1", "1 while a tip-in is listened to"),
        estimate("triggers", "1", "tip-ins listened to so far"),
        estimate("surprise", "1", "normalised innovation, averaged; about 1 if the covariances are right"),
        estimate("trusted", "1", "1 while innovations and frames are as they should be, else 0"),
    )

    def constants(self, parameters: TkbseParameters) -> np.ndarray:
        """Driveline, stationary gain, discretised contact model and trigger, for ``tkbse_step``."""
        check_lash(parameters.shaft.half_gap)
        model = twists(Lumped.of(parameters), CONTACT)
        a, b = discretise(model.A, model.B, parameters.sampling.period)
        noise = np.diag(parameters.noise.measurement)
        gain, spread = stationary_gain(a, model.C, np.diag(parameters.noise.process), noise)
        return np.concatenate([
            driveline_constants(parameters), gain.ravel(), a.ravel(), b.ravel(),
            [parameters.trigger.torque, parameters.trigger.slope, parameters.sampling.period], np.diag(spread)])
