"""DSKSE: the discrete switched Kalman state estimator of thesis section 3.1.2.

In contact the full six-state model is predicted and corrected; in the lash the two states that
cannot be seen there, twist and lash angle, are only predicted (section 3.1.2.2, figure 3.2). Modes
change by eq. 3.32 and 3.33. In contact the lash angle stands on its flank.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..kernels.backend import F8, entry_point, kernel
from ..plants.reduced import ThreeMassDriveline
from ..quantities import Variable
from .estimator import FRAME_INPUTS, Estimator, Noise, Sampling, check_lash, estimate
from .kalman import correct, discretise, predict
from .lumped import (
    C_S,
    DRIVELINE,
    HALF_GAP,
    I_FDR,
    I_TR,
    K_S,
    K_W,
    PLAUSIBLE_SPEED,
    PLAUSIBLE_TORQUE,
    driveline_constants,
    net_torque,
    plausible,
    road_load,
    steady_torques,
)
from .state_space import BACKLASH, CONTACT, Lumped, twists

N, M = 6, 2
TWIST, ENGINE, WHEEL_TWIST, FINAL_DRIVE, WHEEL, LASH = range(N)

# Constants behind the driveline's numbers; the work array begins with all of them.
Q = DRIVELINE
R_1 = Q + N
R_2 = R_1 + 1
A_CONTACT = R_2 + 1
B_CONTACT = A_CONTACT + N * N
A_LASH = B_CONTACT + N * M
B_LASH = A_LASH + N * N
CONSTANTS = B_LASH + N * M
X = CONSTANTS
P = X + N
U = P + N * N
ROOM = U + M
WORK = ROOM + 2 * N * N

# State: x and P, then these. The first entry of the state array counts frames.
KEPT = 1 + N + N * N
(RUNNING, MODE, TORQUE, START, END, DURATION, SURPRISE, MISSED) = range(KEPT, KEPT + 8)
STATE = KEPT + 7

# Normalised innovations are averaged over about this many frames for the estimator's own verdict,
# and believed while the average stays below the bound: three times what its covariance promises.
MEMORY = 20.0
SURPRISE_BOUND = 3.0
MISSED_BOUND = 5.0

INPUT_TORQUE, INPUT_ENGINE, INPUT_WHEEL, INPUT_SIZE = range(4)


@dataclass(frozen=True)
class DskseParameters(ThreeMassDriveline):
    """The driveline it believes in, and its tuning."""

    noise: Noise = field(default_factory=Noise)
    sampling: Sampling = field(default_factory=Sampling)


@kernel
def lash_rate(work):
    """Rate of the lash angle [rad/s] by eq. 2.15, whatever the mode."""
    twist = work[X + TWIST] - work[X + LASH]
    return (work[X + ENGINE] / work[I_TR] - work[I_FDR] * work[X + FINAL_DRIVE]
            + work[K_S] / work[C_S] * twist)


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
    work[X + FINAL_DRIVE] = engine_speed / (work[I_TR] * work[I_FDR])
    work[X + WHEEL] = wheel_speed
    state[MODE] = mode
    state[RUNNING] = 1.0


@kernel
def switch(state, work, half_gap, time):
    """Change the mode by eq. 3.32 and 3.33, and note when a traversal starts and ends."""
    mode = state[MODE]
    if mode != 0.0:
        work[X + LASH] = mode * half_gap
        if mode * lash_rate(work) <= 0.0:
            state[MODE] = 0.0
            state[START] = time
    elif abs(work[X + LASH]) >= half_gap:
        side = 1.0
        if work[X + LASH] < 0.0:
            side = -1.0
        work[X + LASH] = side * half_gap
        if side * lash_rate(work) > 0.0:
            state[MODE] = side
            state[END] = time
            state[DURATION] = time - state[START]


@entry_point
def dskse_step(state: F8, constants: F8, work: F8, inputs: F8, outputs: F8, time: float) -> int:
    """One frame at ``time`` [s]: predict with the mean torque since the last one, correct, switch."""
    half_gap = constants[HALF_GAP]
    if inputs[INPUT_SIZE] > 0.0 and inputs[INPUT_SIZE] < 1.0:
        half_gap = 0.5 * inputs[INPUT_SIZE]
    torque_good = plausible(inputs[INPUT_TORQUE], PLAUSIBLE_TORQUE)
    engine_good = plausible(inputs[INPUT_ENGINE], PLAUSIBLE_SPEED)
    wheel_good = plausible(inputs[INPUT_WHEEL], PLAUSIBLE_SPEED)
    for i in range(CONSTANTS):
        work[i] = constants[i]
    for i in range(N + N * N):
        work[X + i] = state[1 + i]
    if state[RUNNING] == 0.0:
        if not (torque_good and engine_good and wheel_good):
            return 0
        start(state, work, inputs[INPUT_TORQUE], inputs[INPUT_ENGINE], inputs[INPUT_WHEEL], half_gap)
    else:
        contact = state[MODE] != 0.0
        shaft = 0.0
        if contact:
            shaft = (work[K_S] * (work[X + TWIST] - work[X + LASH])
                     + work[C_S] * (work[X + ENGINE] / work[I_TR] - work[I_FDR] * work[X + FINAL_DRIVE]))
        torque = state[TORQUE]
        if torque_good:
            torque = 0.5 * (torque + inputs[INPUT_TORQUE])
        work[U] = net_torque(work, 0, torque, work[X + ENGINE], shaft)
        work[U + 1] = road_load(work, 0, work[X + WHEEL])
        first, last = 0, N
        if contact:
            predict(work, X, P, A_CONTACT, B_CONTACT, U, Q, ROOM, N, M)
        else:
            predict(work, X, P, A_LASH, B_LASH, U, Q, ROOM, N, M)
            first, last = ENGINE, LASH
        surprise = 0.0
        if engine_good:
            innovation = inputs[INPUT_ENGINE] - work[X + ENGINE]
            s = correct(work, X, P, ENGINE, innovation, work[R_1], first, last, ROOM, N)
            surprise += 0.5 * innovation * innovation / s
        if wheel_good:
            innovation = inputs[INPUT_WHEEL] - work[X + WHEEL]
            s = correct(work, X, P, WHEEL, innovation, work[R_2], first, last, ROOM, N)
            surprise += 0.5 * innovation * innovation / s
        state[SURPRISE] += (surprise - state[SURPRISE]) / MEMORY
        if engine_good and wheel_good:
            state[MISSED] = 0.0
        else:
            state[MISSED] += 1.0
        switch(state, work, half_gap, time)
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
    outputs[17] = 1.0
    if state[SURPRISE] > SURPRISE_BOUND or state[MISSED] >= MISSED_BOUND:
        outputs[17] = 0.0
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
        estimate("shaft_twist", "rad", "twist of the lumped propeller shaft with its lash", 0.1),
        estimate("engine_speed_estimate", "rad/s", "engine speed", 100.0),
        estimate("wheel_shaft_twist", "rad", "twist of the lumped wheel shaft", 0.01),
        estimate("final_drive_speed", "rad/s", "final drive speed, at the wheels", 30.0),
        estimate("wheel_speed_estimate", "rad/s", "wheel speed", 30.0),
        estimate("lash_position", "rad", "position in the lash, at the propeller shaft", 0.1),
        *(estimate(f"variance[{i}]", unit, f"variance of state {i}") for i, unit in enumerate(
            ("rad2", "rad2/s2", "rad2", "rad2/s2", "rad2/s2", "rad2"), start=1)),
        estimate("contact", "1", "flank in contact: -1, 0 none, 1"),
        estimate("traversal_start", "s", "when the last traversal of the lash started"),
        estimate("traversal_end", "s", "when the last traversal of the lash ended"),
        estimate("traversal_time", "s", "how long the last traversal took", 0.1),
        estimate("surprise", "1", "normalised innovation, averaged; about 1 if the covariances are right"),
        estimate("trusted", "1", "1 while innovations and frames are as they should be, else 0"),
    )

    def constants(self, parameters: DskseParameters) -> np.ndarray:
        """Driveline, covariances, and both discretised modes, as ``dskse_step`` reads them."""
        check_lash(parameters.shaft.half_gap)
        lumped = Lumped.of(parameters)
        matrices = []
        for mode in (CONTACT, BACKLASH):
            model = twists(lumped, mode)
            matrices += [m.ravel() for m in discretise(model.A, model.B, parameters.sampling.period)]
        return np.concatenate([driveline_constants(parameters), parameters.noise.process,
                               parameters.noise.measurement, *matrices])
