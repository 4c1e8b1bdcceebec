"""TKBSE: the triggered Kalman backlash size estimator of thesis section 4.1.

The driveline is taken to be in contact all the time. Its sixth state, the offset in the shaft's
twist, then stays where it is while that is true, and moves by the size of the lash while the lash is
crossed. So a stationary Kalman filter for the contact model, started at zero offset when the torque
turns positive and rises, settles at the lash size. Each tip-in triggers it anew; between triggers
everything is held. "With constraint" (section 4.1.4) the size takes, when a trigger ends, the value at
which the estimate had settled after the crossing; where it never settled, it stays as it was.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from ..kernels.backend import F8, entry_point, kernel
from ..plants.reduced import ThreeMassDriveline
from ..quantities import quantity
from .estimator import AVERAGED, Estimator, Noise, Sampling, Trust, check_shaft, estimate, retuned
from .kalman import discretise, stationary_gain
from .lumped import (
    C_S,
    DRIVELINE,
    ENGINE,
    FINAL_DRIVE,
    I_FDR,
    I_TR,
    J_1,
    K_S,
    K_W,
    LASH,
    PLAUSIBLE_SPEED,
    PLAUSIBLE_TORQUE,
    TWIST,
    WHEEL,
    WHEEL_TWIST,
    M,
    N,
    driveline_constants,
    measurement_matrix,
    net_torque,
    plausible,
    road_load,
    shaft_torque,
    unexplained_torque,
)
from .state_space import CONTACT, Lumped, twists

SIZE = LASH

# Constants behind the driveline's numbers; the work array begins with all of them.
GAIN = DRIVELINE
A = GAIN + M * N
B = A + N * N
(LEVEL, SLOPE, CALM_RATE, CALM_TORQUE, CALM_TIME, PERIOD, SPREAD_ENGINE, SPREAD_WHEEL, BALANCE_GAIN,
 WEIGHT, SURPRISE_BOUND, TORQUE_BOUND, MISSED_BOUND) = range(B + N * M, B + N * M + 13)
CONSTANTS = MISSED_BOUND + 1
X = CONSTANTS
ROOM = X + N
WORK = ROOM + N

# State: frames so far, x, then these.
KEPT = 1 + N
(TRIGGERED, ARMED, TORQUE, SINCE, COMPLETE, ENGINE_BEFORE, RATE_BEFORE, BALANCED, SHAFT, CALM, CANDIDATE,
 CONSTRAINED, TRIGGERS, SURPRISE, UNEXPLAINED, MISSED) = range(KEPT, KEPT + 16)
STATE = KEPT + 15  # without the count of frames

# Time [s] over which the engine's torque balance sets the shaft's torque right before a trigger.
SMOOTHING = 5e-3
LARGER = 1.5

INPUT_TORQUE, INPUT_ENGINE, INPUT_WHEEL = range(3)


@dataclass(frozen=True)
class Trigger:
    """When a tip-in is listened to (section 4.1.2), and when the size has settled (section 4.1.4)."""

    torque: float = quantity("N.m", "the crankshaft torque must be above this", start=0.0)
    slope: float = quantity("N.m/s", "and rise faster than this", start=6.0, minimum=0.0)
    settled_rate: float = quantity(
        "rad/s", "the size has settled when it changes less than this", start=0.6, minimum=0.0)
    settled_torque: float = quantity(
        "N.m", "while the shaft carries more than this", start=15.0, minimum=0.0)
    settled_time: float = quantity("s", "for this long", start=0.03, minimum=0.0)


@dataclass(frozen=True)
class SizeNoise(Noise):
    """Covariances tuned for 10 ms to the thesis's "Step 1" and a ramp, see docs/estimators/tkbse.md.

    The lash is what changes (q_6), what the road does is not known (q_5); q_4 shares out where in a frame
    the torque changed.
    """

    q_1: float = retuned(Noise, "q_1", 1e-9)
    q_2: float = retuned(Noise, "q_2", 1e-2)
    q_3: float = retuned(Noise, "q_3", 1e-9)
    q_4: float = retuned(Noise, "q_4", 6.4e-3)
    q_5: float = retuned(Noise, "q_5", 1e2)
    q_6: float = retuned(Noise, "q_6", 1e-4)


@dataclass(frozen=True)
class TkbseParameters(ThreeMassDriveline):
    """The driveline it believes in, and its tuning."""

    noise: SizeNoise = field(default_factory=SizeNoise)
    trigger: Trigger = field(default_factory=Trigger)
    sampling: Sampling = field(default_factory=Sampling)
    trust: Trust = field(default_factory=Trust)


@kernel
def balance(state, work, torque, engine_speed, rate):
    """Follow the shaft's torque: it changes with the twist ``rate`` [rad/s] that both speeds show.

    The engine's torque balance, which only differences of its speed give, and only for the middle of
    the last period, sets it right over the time ``SMOOTHING``.
    """
    acceleration = (engine_speed - state[ENGINE_BEFORE]) / work[PERIOD]
    net = net_torque(work, 0, 0.5 * (torque + state[TORQUE]), engine_speed, state[SHAFT])
    found = work[I_TR] * (net - work[J_1] * acceleration)
    change = work[K_S] * 0.5 * (rate + state[RATE_BEFORE]) * work[PERIOD]
    if state[BALANCED] == 0.0:
        state[SHAFT] = found - 0.5 * change
    state[SHAFT] += change + work[BALANCE_GAIN] * (found - state[SHAFT] - 0.5 * change)
    state[BALANCED] = 1.0


@kernel
def start(state, work, engine_speed, wheel_speed):
    """Speeds as measured, no offset, and the twist of the torque that still lies on the coast flank."""
    for i in range(N):
        work[X + i] = 0.0
    if state[BALANCED] > 0.0:
        shaft = min(state[SHAFT], 0.0)
        work[X + TWIST] = (shaft - work[C_S] * state[RATE_BEFORE]) / work[K_S]
        work[X + WHEEL_TWIST] = work[I_FDR] * shaft / work[K_W]
    work[X + ENGINE] = engine_speed
    work[X + FINAL_DRIVE] = wheel_speed
    work[X + WHEEL] = wheel_speed
    state[TRIGGERED] = 1.0
    state[ARMED] = 0.0
    state[CALM] = 0.0
    state[CANDIDATE] = 0.0
    state[TRIGGERS] += 1.0
    state[SURPRISE] = 0.0
    state[UNEXPLAINED] = 0.0


@kernel
def advance(state, work, torque, inputs, engine_good, wheel_good):
    """One period of the stationary filter (eq. 4.2); note the size while it has settled."""
    work[ROOM + 0] = net_torque(work, 0, torque, work[X + ENGINE], shaft_torque(work, 0, X))
    work[ROOM + 1] = road_load(work, 0, work[X + WHEEL])
    drive, load, before = work[ROOM], work[ROOM + 1], work[X + SIZE]
    for i in range(N):
        total = work[B + M * i] * drive + work[B + M * i + 1] * load
        for j in range(N):
            total += work[A + N * i + j] * work[X + j]
        work[ROOM + i] = total
    engine, wheel = 0.0, 0.0
    if engine_good:
        engine = inputs[INPUT_ENGINE] - work[ROOM + ENGINE]
    if wheel_good:
        wheel = inputs[INPUT_WHEEL] - work[ROOM + FINAL_DRIVE]
    for i in range(N):
        work[X + i] = work[ROOM + i] + work[GAIN + M * i] * engine + work[GAIN + M * i + 1] * wheel
    if (shaft_torque(work, 0, X) > work[CALM_TORQUE]
            and abs(work[X + SIZE] - before) < work[CALM_RATE] * work[PERIOD]):
        state[CALM] += work[PERIOD]
        # The first that settles: what comes later drifts where a speed is late. Half of a lash that
        # lies in two places can settle too, so one much larger replaces it.
        if state[CALM] >= work[CALM_TIME] and work[X + SIZE] > LARGER * state[CANDIDATE]:
            state[CANDIDATE] = work[X + SIZE]
    else:
        state[CALM] = 0.0
    surprise = 0.5 * (engine * engine / work[SPREAD_ENGINE] + wheel * wheel / work[SPREAD_WHEEL])
    state[SURPRISE] += work[WEIGHT] * (surprise - state[SURPRISE])
    state[UNEXPLAINED] += work[WEIGHT] * (
        unexplained_torque(work, 0, engine, wheel, work[PERIOD]) - state[UNEXPLAINED])


@entry_point
def tkbse_step(state: F8, constants: F8, work: F8, inputs: F8, outputs: F8, time: float) -> int:
    """One frame: watch the torque, start or advance the filter or hold it; ``time`` does not matter."""
    for i in range(CONSTANTS):
        work[i] = constants[i]
    for i in range(N):
        work[X + i] = state[1 + i]
    torque_good = plausible(inputs[INPUT_TORQUE], PLAUSIBLE_TORQUE)
    engine_good = plausible(inputs[INPUT_ENGINE], PLAUSIBLE_SPEED)
    wheel_good = plausible(inputs[INPUT_WHEEL], PLAUSIBLE_SPEED)
    torque, wanted = state[TORQUE], state[TRIGGERED] > 0.0
    if torque_good:
        torque = inputs[INPUT_TORQUE]
        slope = 0.0
        if state[SINCE] > 0.0:
            slope = (torque - state[TORQUE]) / (work[PERIOD] * state[SINCE])
        wanted = torque > work[LEVEL] and slope > work[SLOPE]
        if torque <= work[LEVEL]:
            state[ARMED] = 1.0
    rate = 0.0
    if engine_good and wheel_good:
        rate = inputs[INPUT_ENGINE] / work[I_TR] - work[I_FDR] * inputs[INPUT_WHEEL]
    if torque_good and engine_good and wheel_good and state[COMPLETE] > 0.0:
        balance(state, work, torque, inputs[INPUT_ENGINE], rate)
    else:
        state[BALANCED] = 0.0
    state[RATE_BEFORE] = rate
    if state[TRIGGERED] > 0.0 and not wanted:
        state[TRIGGERED] = 0.0
        if state[CANDIDATE] > 0.0:
            state[CONSTRAINED] = state[CANDIDATE]
    if state[TRIGGERED] > 0.0:
        advance(state, work, 0.5 * (state[TORQUE] + torque), inputs, engine_good, wheel_good)
        for i in range(N):
            if not plausible(work[X + i], 10.0 * PLAUSIBLE_SPEED):
                state[TRIGGERED] = 0.0
        if state[TRIGGERED] == 0.0:
            for i in range(N):
                work[X + i] = 0.0
    elif wanted and state[ARMED] > 0.0 and engine_good and wheel_good:
        start(state, work, inputs[INPUT_ENGINE], inputs[INPUT_WHEEL])
    state[MISSED] += work[PERIOD]
    state[COMPLETE] = 0.0
    if torque_good and engine_good and wheel_good:
        state[MISSED] = 0.0
        state[COMPLETE] = 1.0
        state[ENGINE_BEFORE] = inputs[INPUT_ENGINE]
    if torque_good:
        state[TORQUE] = torque
        state[SINCE] = 1.0
    elif state[SINCE] > 0.0:
        state[SINCE] += 1.0
    for i in range(N):
        state[1 + i] = work[X + i]
        outputs[i] = work[X + i]
    outputs[6] = state[CONSTRAINED]
    outputs[7] = state[TRIGGERED]
    outputs[8] = state[TRIGGERS]
    outputs[9] = state[SURPRISE]
    outputs[10] = sqrt(max(state[UNEXPLAINED], 0.0))
    outputs[11] = 1.0
    if (state[CONSTRAINED] == 0.0 or not state[SURPRISE] <= work[SURPRISE_BOUND]
            or not outputs[10] <= work[TORQUE_BOUND] or state[MISSED] > work[MISSED_BOUND]):
        outputs[11] = 0.0
    return 0


class Tkbse(Estimator):
    """The triggered Kalman estimator of the backlash size."""

    name = "tkbse"
    description = "Triggered Kalman backlash size estimator (TKBSE)"
    Parameters = TkbseParameters
    entry_point = "tkbse_step"
    state_size = STATE
    work_size = WORK
    flank = 1.0  # it listens while the engine drives
    output_variables = (
        estimate("shaft_twist", "rad", "twist of the lumped shaft with its lash, since the trigger", 0.1),
        estimate("engine_speed_estimate", "rad/s", "engine speed", 100.0),
        estimate("wheel_shaft_twist", "rad", "twist of the tyres", 0.01),
        estimate("wheel_speed_estimate", "rad/s", "speed of final drive and rims, which is measured", 30.0),
        estimate("tyre_speed", "rad/s", "speed of tyres and vehicle, behind the tyre's twist", 30.0),
        estimate("lash_size_unconstrained", "rad", "total lash (2 alpha) at the propeller shaft, settling", 0.1),
        estimate("lash_size", "rad", "total lash (2 alpha) at the propeller shaft, as last settled", 0.1),
        estimate("triggered", "1", "1 while a tip-in is listened to"),
        estimate("triggers", "1", "tip-ins listened to so far"),
        estimate("surprise", "1", "mean normalised innovation; about 1 if the covariances are right"),
        estimate("unexplained_torque", "N.m", "torque the innovations stand for, at the crankshaft", 10.0),
        estimate("trusted", "1", "1 when a size was found with innovations and frames as they should be"),
    )

    def constants(self, parameters: TkbseParameters) -> np.ndarray:
        """Driveline, stationary gain, discretised contact model, trigger and bounds, for ``tkbse_step``."""
        check_shaft(parameters.shaft)
        model = twists(Lumped.of(parameters), CONTACT)
        period, trigger, trust = parameters.sampling.period, parameters.trigger, parameters.trust
        a, b = discretise(model.A, model.B, period)
        noise = np.diag(parameters.noise.measurement)
        gain, spread = stationary_gain(a, measurement_matrix(), np.diag(parameters.noise.process), noise)
        return np.concatenate([
            driveline_constants(parameters), gain.ravel(), a.ravel(), b.ravel(),
            [trigger.torque, trigger.slope, trigger.settled_rate, trigger.settled_torque,
             trigger.settled_time - 0.5 * period, period], np.diag(spread),
            [1.0 - np.exp(-period / SMOOTHING), min(1.0, period / AVERAGED),
             trust.surprise, trust.torque, trust.missing]])
