"""DSKSE: the discrete switched Kalman state estimator of thesis section 3.1.2.

In contact the full six-state model is predicted and corrected; in the lash the two states that
cannot be seen there, twist and lash angle, are only predicted (section 3.1.2.2, figure 3.2). Modes
change by eq. 3.32 and 3.33.

In contact only twist less lash angle acts on anything, so the two together cannot be seen either. There
the lash angle stands on its flank, and the twist moves with it: corrections go to the difference.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from ..kernels.backend import F8, entry_point, kernel
from ..plants.reduced import ThreeMassDriveline
from ..quantities import Variable
from .estimator import AVERAGED, FRAME_INPUTS, Estimator, Noise, Sampling, Trust, check_shaft, estimate
from .kalman import correct, discretise, predict
from .lumped import (
    DRIVELINE,
    ENGINE,
    FINAL_DRIVE,
    HALF_GAP,
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
    net_torque,
    plausible,
    road_load,
    shaft_torque,
    steady_torques,
    unexplained_torque,
)
from .state_space import BACKLASH, CONTACT, Lumped, twists

# Constants behind the driveline's numbers; the work array begins with all of them.
Q = DRIVELINE
R_1 = Q + N
R_2 = R_1 + 1
A_CONTACT = R_2 + 1
B_CONTACT = A_CONTACT + N * N
A_LASH = B_CONTACT + N * M
B_LASH = A_LASH + N * N
PERIOD = B_LASH + N * M
WEIGHT = PERIOD + 1
SURPRISE_BOUND, TORQUE_BOUND, MISSED_BOUND = range(WEIGHT + 1, WEIGHT + 4)
CONSTANTS = MISSED_BOUND + 1
X = CONSTANTS
P = X + N
U = P + N * N
ROOM = U + M
WORK = ROOM + 2 * N * N

# State: frames so far, x and P, then these.
KEPT = 1 + N + N * N
(RUNNING, MODE, TORQUE, LEFT_FLANK, LEFT_AT, START, END, DURATION, SURPRISE, UNEXPLAINED,
 MISSED, DOUBTED) = range(KEPT, KEPT + 12)
STATE = KEPT + 11  # without the count of frames

INPUT_TORQUE, INPUT_ENGINE, INPUT_WHEEL, INPUT_SIZE = range(4)


@dataclass(frozen=True)
class DskseParameters(ThreeMassDriveline):
    """The driveline it believes in, and its tuning."""

    noise: Noise = field(default_factory=Noise)
    sampling: Sampling = field(default_factory=Sampling)
    trust: Trust = field(default_factory=Trust)


@kernel
def start(state, work, torque, engine_speed, wheel_speed, half_gap):
    """Steady rolling on the flank that the torque lies on."""
    for i in range(N + N * N):
        work[X + i] = 0.0
    for i in range(N):
        work[P + N * i + i] = work[Q + i]
    shaft, wheel = steady_torques(
        work, 0, net_torque(work, 0, torque, engine_speed, 0.0), road_load(work, 0, wheel_speed))
    mode = 1.0
    if shaft < 0.0:
        mode = -1.0
    work[X + LASH] = mode * half_gap
    work[X + TWIST] = mode * half_gap + shaft / work[K_S]
    work[X + ENGINE] = engine_speed
    work[X + WHEEL_TWIST] = wheel / work[K_W]
    work[X + FINAL_DRIVE] = wheel_speed
    work[X + WHEEL] = wheel_speed
    state[MODE] = mode
    state[RUNNING] = 1.0
    state[SURPRISE] = 0.0
    state[UNEXPLAINED] = 0.0


@kernel
def stand_on_flank(work, flank):
    """Move lash angle and twist together until the lash stands on its flank; their difference stays."""
    shift = flank - work[X + LASH]
    work[X + LASH] = flank
    work[X + TWIST] += shift
    for i in range(N):
        work[P + N * TWIST + i] -= work[P + N * LASH + i]
        work[P + N * LASH + i] = 0.0
    for i in range(N):
        work[P + N * i + TWIST] -= work[P + N * i + LASH]
        work[P + N * i + LASH] = 0.0


@kernel
def switch(state, work, half_gap, time):
    """Change the mode by eq. 3.32 and 3.33, and note when a traversal starts and ends.

    The rate of the lash angle (eq. 2.15) is the shaft's torque over its damping, whatever the mode. A
    traversal goes from one flank to the other; leaving a flank and returning to it is none. Nor is one noted whose end
    was only predicted, for longer than without frames is put up with.
    """
    mode = state[MODE]
    if mode != 0.0:
        stand_on_flank(work, mode * half_gap)
        if mode * shaft_torque(work, 0, X) <= 0.0:
            state[MODE] = 0.0
            state[LEFT_FLANK] = mode
            state[LEFT_AT] = time
    elif abs(work[X + LASH]) >= half_gap:
        side = 1.0
        if work[X + LASH] < 0.0:
            side = -1.0
        work[X + LASH] = side * half_gap
        if side * shaft_torque(work, 0, X) > 0.0:
            state[MODE] = side
            stand_on_flank(work, side * half_gap)
            if side != state[LEFT_FLANK] and state[MISSED] <= work[MISSED_BOUND]:
                state[START] = state[LEFT_AT]
                state[END] = time
                state[DURATION] = time - state[LEFT_AT]


@kernel
def advance(state, work, torque, inputs, engine_good, wheel_good):
    """One period: predict with the torque that acted on average, then correct with what came in."""
    contact = state[MODE] != 0.0
    shaft = 0.0
    if contact:
        shaft = shaft_torque(work, 0, X)
    work[U] = net_torque(work, 0, torque, work[X + ENGINE], shaft)
    work[U + 1] = road_load(work, 0, work[X + WHEEL])
    first, last = 0, N
    if contact:
        predict(work, X, P, A_CONTACT, B_CONTACT, U, Q, ROOM, N, M)
    else:
        predict(work, X, P, A_LASH, B_LASH, U, Q, ROOM, N, M)
        first, last = ENGINE, LASH
    surprise, engine, wheel = 0.0, 0.0, 0.0
    if engine_good:
        engine = inputs[INPUT_ENGINE] - work[X + ENGINE]
        variance = correct(work, X, P, ENGINE, engine, work[R_1], first, last, ROOM, N)
        surprise += 0.5 * engine * engine / variance
    if wheel_good:
        wheel = inputs[INPUT_WHEEL] - work[X + FINAL_DRIVE]
        variance = correct(work, X, P, FINAL_DRIVE, wheel, work[R_2], first, last, ROOM, N)
        surprise += 0.5 * wheel * wheel / variance
    state[SURPRISE] += work[WEIGHT] * (surprise - state[SURPRISE])
    state[UNEXPLAINED] += work[WEIGHT] * (
        unexplained_torque(work, 0, engine, wheel, work[PERIOD]) - state[UNEXPLAINED])


@entry_point
def dskse_step(state: F8, constants: F8, work: F8, inputs: F8, outputs: F8, time: float) -> int:
    """One frame at ``time`` [s]: predict, correct, switch."""
    half_gap = constants[HALF_GAP]
    if inputs[INPUT_SIZE] > 0.0 and inputs[INPUT_SIZE] < 1.0:
        half_gap = 0.5 * inputs[INPUT_SIZE]
    torque_good = plausible(inputs[INPUT_TORQUE], PLAUSIBLE_TORQUE)
    engine_good = plausible(inputs[INPUT_ENGINE], PLAUSIBLE_SPEED)
    wheel_good = plausible(inputs[INPUT_WHEEL], PLAUSIBLE_SPEED)
    all_good = torque_good and engine_good and wheel_good
    for i in range(CONSTANTS):
        work[i] = constants[i]
    for i in range(N + N * N):
        work[X + i] = state[1 + i]
    if all_good and state[MISSED] > work[MISSED_BOUND]:
        # what was only predicted for so long may lie on the wrong flank: start anew, and see whether that was right
        state[RUNNING] = 0.0
        state[DOUBTED] = AVERAGED
    if state[RUNNING] > 0.0:
        torque = state[TORQUE]
        if torque_good:
            torque = 0.5 * (torque + inputs[INPUT_TORQUE])
        advance(state, work, torque, inputs, engine_good, wheel_good)
        switch(state, work, half_gap, time)
        for i in range(N):
            if not plausible(work[X + i], 10.0 * PLAUSIBLE_SPEED):
                state[RUNNING] = 0.0
    elif all_good:
        start(state, work, inputs[INPUT_TORQUE], inputs[INPUT_ENGINE], inputs[INPUT_WHEEL], half_gap)
    if state[RUNNING] == 0.0:
        for i in range(N + N * N):
            work[X + i] = 0.0
        state[MODE] = 0.0
    state[MISSED] += work[PERIOD]
    state[DOUBTED] = max(state[DOUBTED] - work[PERIOD], 0.0)
    if all_good:
        state[MISSED] = 0.0
    if torque_good:
        state[TORQUE] = inputs[INPUT_TORQUE]
    for i in range(N + N * N):
        state[1 + i] = work[X + i]
    for i in range(N):
        outputs[i] = work[X + i]
        outputs[N + i] = work[P + N * i + i]
    outputs[12] = state[MODE]
    outputs[13] = state[START]
    outputs[14] = state[END]
    outputs[15] = state[DURATION]
    outputs[16] = state[SURPRISE]
    outputs[17] = sqrt(max(state[UNEXPLAINED], 0.0))
    outputs[18] = 1.0
    if (state[RUNNING] == 0.0 or not state[SURPRISE] <= work[SURPRISE_BOUND]
            or not outputs[17] <= work[TORQUE_BOUND] or state[MISSED] > work[MISSED_BOUND] or state[DOUBTED] > 0.0):
        outputs[18] = 0.0
    return 0


class Dskse(Estimator):
    """The switched Kalman estimator of the backlash state."""

    name = "dskse"
    description = "Discrete switched Kalman state estimator of driveline backlash (DSKSE)"
    Parameters = DskseParameters
    entry_point = "dskse_step"
    state_size = STATE
    work_size = WORK
    inputs = (*FRAME_INPUTS, Variable(
        "lash_size", "rad", "total lash at the propeller shaft (2 alpha); 0 for that of the parameters",
        "input", "continuous", nominal=0.1))
    output_variables = (
        estimate("shaft_twist", "rad", "twist of the lumped shaft with its lash", 0.1),
        estimate("engine_speed_estimate", "rad/s", "engine speed", 100.0),
        estimate("wheel_shaft_twist", "rad", "twist of the tyres", 0.01),
        estimate("wheel_speed_estimate", "rad/s", "speed of final drive and rims, which is measured", 30.0),
        estimate("tyre_speed", "rad/s", "speed of tyres and vehicle, behind the tyre's twist", 30.0),
        estimate("lash_position", "rad", "position in the lash, at the propeller shaft", 0.1),
        *(estimate(f"variance[{i}]", unit, f"variance of state {i}") for i, unit in enumerate(
            ("rad2", "rad2/s2", "rad2", "rad2/s2", "rad2/s2", "rad2"), start=1)),
        estimate("contact", "1", "flank in contact: -1, 0 none, 1"),
        estimate("traversal_start", "s", "when the last complete traversal of the lash started"),
        estimate("traversal_end", "s", "when the last complete traversal of the lash ended"),
        estimate("traversal_time", "s", "how long the last complete traversal took", 0.1),
        estimate("surprise", "1", "mean normalised innovation; about 1 if the covariances are right"),
        estimate("unexplained_torque", "N.m", "torque the innovations stand for, at the crankshaft", 10.0),
        estimate("trusted", "1", "1 while innovations and frames are as they should be, else 0"),
    )

    def constants(self, parameters: DskseParameters) -> np.ndarray:
        """Driveline, covariances, both discretised modes and bounds, as ``dskse_step`` reads them."""
        check_shaft(parameters.shaft)
        lumped, period, trust = Lumped.of(parameters), parameters.sampling.period, parameters.trust
        matrices = []
        for mode in (CONTACT, BACKLASH):
            model = twists(lumped, mode)
            matrices += [m.ravel() for m in discretise(model.A, model.B, period)]
        return np.concatenate([
            driveline_constants(parameters), parameters.noise.process, parameters.noise.measurement,
            *matrices, [period, min(1.0, period / AVERAGED), trust.surprise, trust.torque, trust.missing]])
