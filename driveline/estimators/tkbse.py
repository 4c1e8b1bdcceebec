"""TKBSE: the triggered Kalman backlash size estimator of thesis section 4.1.

The driveline is taken to be in contact all the time. Its sixth state, the offset in the shaft's
twist, then stays where it is while that is true, and moves by the size of the lash while the lash is
crossed. So a stationary Kalman filter for the contact model, started at zero offset when the torque
turns positive and rises, settles at the lash size. Each tip-in triggers it anew; between triggers
everything is held. "With constraint" (section 4.1.4) the size takes, when a trigger ends, the value at
which the estimate had settled after the crossing; where it never settled, it stays as it was.

Three things go beyond the thesis, and all can be turned off: the wheel speed's delay is found and taken out
(``alignment``; off where delay.wheel_speed_deviation is 0), the twist is the integral of the measured speeds
(off where trigger.measured_twist is 0), and the size is the mean of the last tip-ins (trigger.tip_ins; off
where it is 1).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import Any

import numpy as np

from ..kernels.backend import F8, entry_point, kernel
from ..plants.reduced import ThreeMassDriveline, three_mass_at_hub
from ..quantities import InputError, quantity
from .alignment import (
    ABSENT,
    BLOCK,
    FOUND,
    KNOWLEDGE,
    KNOWN_WHEEL,
    USED,
    VARIANCE,
    SoughtDelays,
    align,
    at_the_end,
    interrupt,
    learn,
)
from .estimator import AVERAGED, Estimator, Noise, Sampling, Trust, check_forward, check_shaft, estimate, retuned
from .kalman import discretise, evenly, stationary_gain
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
 WEIGHT, SURPRISE_BOUND, TORQUE_BOUND, MISSED_BOUND, DELAY_BOUND, SHUFFLE, TIP_INS, K_COAST,
 MEASURED_TWIST) = range(B + N * M, B + N * M + 18)
KNOWS = MEASURED_TWIST + 1
CONSTANTS = KNOWS + KNOWLEDGE
X = CONSTANTS
ROOM = X + N
FRAME = ROOM + N
WORK = FRAME + 3

# State: frames so far, x, then these.
KEPT = 1 + N
(TRIGGERED, ARMED, TORQUE, SINCE, COMPLETE, ENGINE_BEFORE, RATE_BEFORE, BALANCED, SHAFT, CALM, CANDIDATE,
 CONSTRAINED, TRIGGERS, SURPRISE, UNEXPLAINED, MISSED, SETTLED, COUNTED, CALM_SIZE, REFERENCE,
 RISE, SPEEDS, MEASURED) = range(KEPT, KEPT + 23)
ALIGNMENT = KEPT + 23
STATE = ALIGNMENT + BLOCK - 1  # without the count of frames

# Time [s] over which the torque's slope is taken, and a frame at least: the thesis's sampling time. Shorter frames
# would find steps of a torque that is told in bits, or more rarely than they come, and nothing between them.
RISING = 0.01
# Time [s] over which the engine's torque balance sets the shaft's torque right before a trigger.
SMOOTHING = 0.05
# Time [s] between two complete frames of a tip-in, and 1.5 frames at least, beyond which it says nothing of the lash:
# at 10 ms two lost ones are bridged, as one that is lost makes two of a speed read between frames.
BRIDGED = 0.035
LARGER = 1.5  # a size so many times another is not the same lash, or not all of it

FRAME_TORQUE, FRAME_ENGINE, FRAME_WHEEL = FRAME, FRAME + 1, FRAME + 2


@dataclass(frozen=True)
class Trigger:
    """When a tip-in is listened to (section 4.1.2), and when the size has settled (section 4.1.4)."""

    torque: float = quantity("N.m", "the crankshaft torque must be above this", start=0.0)
    slope: float = quantity("N.m/s", "and rise faster than this", start=6.0, minimum=0.0)
    settled_rate: float = quantity(
        "rad/s", "the size has settled when it changes less than this on average", start=0.6, minimum=0.0)
    settled_torque: float = quantity(
        "N.m", "while the shaft carries more than this", start=15.0, minimum=0.0)
    settled_time: float = quantity("s", "for this long, and a frame at least", start=0.03, minimum=0.0)
    tip_ins: int = quantity("1", "how many tip-ins the size is the mean of; 1 for the last alone, as in the thesis",
                            start=10, minimum=1, maximum=1000, kind="integer")
    measured_twist: int = quantity(
        "1", "1: the twist is the integral of the measured speeds; 0: what the filter predicts, as in the thesis",
        start=1, minimum=0, maximum=1, kind="integer")


@dataclass(frozen=True)
class SizeNoise(Noise):
    """Covariances, see docs/estimators/tkbse.md.

    The lash is what changes (q_6), what the road does is not known (q_5), and the engine speed may depart from
    what the torque says (q_2), ever so little.
    """

    q_1: float = retuned(Noise, "q_1", 1e-9)
    q_2: float = retuned(Noise, "q_2", 1e-2)
    q_3: float = retuned(Noise, "q_3", 1e-9)
    q_4: float = retuned(Noise, "q_4", 1e-8)
    q_5: float = retuned(Noise, "q_5", 1e2)
    q_6: float = retuned(Noise, "q_6", 1e-4)


@dataclass(frozen=True)
class SizeTrust(Trust):
    """Also of the delay."""

    delay: float = quantity("s", "standard deviation of the wheel speed's delay that is put up with",
                            start=5e-3, minimum=0.0)


@dataclass(frozen=True)
class TkbseParameters(ThreeMassDriveline):
    """The driveline it believes in, and its tuning."""

    coast_stiffness_factor: float = quantity(
        "1", "stiffness of the shaft while coasting over that while driving: of the torque before the final drive "
        "the axle shafts carry more, or less, by its loss", start=1.0, minimum=0.1, maximum=10.0)
    noise: SizeNoise = field(default_factory=SizeNoise)
    trigger: Trigger = field(default_factory=Trigger)
    delay: SoughtDelays = field(default_factory=SoughtDelays)
    sampling: Sampling = field(default_factory=Sampling)
    trust: SizeTrust = field(default_factory=SizeTrust)


@kernel
def stiffness(work, torque):
    """Of the shaft [N.m/rad] on the flank that a torque lies on."""
    if torque < 0.0:
        return work[K_COAST]
    return work[K_S]


@kernel
def balance(state, work, torque, engine_speed, rate):
    """Follow the shaft's torque: it changes with the twist ``rate`` [rad/s] that both speeds show.

    The engine's torque balance, which only differences of its speed give, and only for the middle of
    the last period, sets it right over the time ``SMOOTHING``.
    """
    acceleration = (engine_speed - state[ENGINE_BEFORE]) / work[PERIOD]
    net = net_torque(work, 0, 0.5 * (torque + state[TORQUE]), engine_speed, state[SHAFT])
    found = work[I_TR] * (net - work[J_1] * acceleration)
    change = stiffness(work, state[SHAFT]) * 0.5 * (rate + state[RATE_BEFORE]) * work[PERIOD]
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
        work[X + TWIST] = (shaft - work[C_S] * state[RATE_BEFORE]) / work[K_COAST]
        work[X + WHEEL_TWIST] = work[I_FDR] * shaft / work[K_W]
    work[X + ENGINE] = engine_speed
    work[X + FINAL_DRIVE] = wheel_speed
    work[X + WHEEL] = wheel_speed
    state[MEASURED] = work[X + TWIST]
    state[TRIGGERED] = 1.0
    state[ARMED] = 0.0
    state[CALM] = 0.0
    state[CANDIDATE] = 0.0
    state[SETTLED] = 0.0
    state[TRIGGERS] += 1.0
    state[SURPRISE] = 0.0
    state[UNEXPLAINED] = 0.0


@kernel
def advance(state, work, torque, engine_good, wheel_good, grown):
    """One period of the stationary filter (eq. 4.2); note the size where it has settled.

    By both speeds the twist has grown by ``grown`` [rad] since both were last there, ABSENT where one is missing. Only
    the difference of twist and offset acts on anything, so both can be moved until the twist has grown by so much.
    """
    work[ROOM + 0] = net_torque(work, 0, torque, work[X + ENGINE], shaft_torque(work, 0, X))
    work[ROOM + 1] = road_load(work, 0, work[X + WHEEL])
    drive, load = work[ROOM], work[ROOM + 1]
    for i in range(N):
        total = work[B + M * i] * drive + work[B + M * i + 1] * load
        for j in range(N):
            total += work[A + N * i + j] * work[X + j]
        work[ROOM + i] = total
    engine, wheel = 0.0, 0.0
    if engine_good:
        engine = work[FRAME_ENGINE] - work[ROOM + ENGINE]
    if wheel_good:
        wheel = work[FRAME_WHEEL] - work[ROOM + FINAL_DRIVE]
    for i in range(N):
        work[X + i] = work[ROOM + i] + work[GAIN + M * i] * engine + work[GAIN + M * i + 1] * wheel
    if grown > ABSENT and work[MEASURED_TWIST] > 0.0:
        astray = work[X + TWIST] - state[MEASURED] - grown
        work[X + TWIST] -= astray
        work[X + SIZE] -= astray
    if engine_good and wheel_good:
        state[MEASURED] = work[X + TWIST]
        settle(state, work)
    surprise = 0.5 * (engine * engine / work[SPREAD_ENGINE] + wheel * wheel / work[SPREAD_WHEEL])
    state[SURPRISE] += work[WEIGHT] * (surprise - state[SURPRISE])
    state[UNEXPLAINED] += work[WEIGHT] * (
        unexplained_torque(work, 0, engine, wheel, work[PERIOD]) - state[UNEXPLAINED])


@kernel
def settle(state, work):
    """One more frame with both speeds: note the size where it has settled."""
    if state[CALM] == 0.0:
        state[CALM_SIZE] = work[X + SIZE]
    if (shaft_torque(work, 0, X) > work[CALM_TORQUE]
            and abs(work[X + SIZE] - state[CALM_SIZE]) < work[CALM_RATE] * work[CALM_TIME]):
        state[CALM] += work[PERIOD]
        # Its mean over the first period of shuffle, which moves it where stiffness and inertias are not quite
        # right; no longer, for a speed that is late makes it drift.
        if state[CALM] >= work[CALM_TIME] and state[SETTLED] * work[PERIOD] < work[SHUFFLE]:
            # half of a lash that lies in two places can settle too, so one much larger replaces it
            if work[X + SIZE] > LARGER * state[CANDIDATE]:
                state[CANDIDATE] = 0.0
                state[SETTLED] = 0.0
            state[SETTLED] += 1.0
            state[CANDIDATE] += (work[X + SIZE] - state[CANDIDATE]) / state[SETTLED]
    else:
        state[CALM] = 0.0


@kernel
def conclude(state, work):
    """A trigger ends: its size joins the mean, or starts a new one where the lash is another."""
    state[TRIGGERED] = 0.0
    size = state[CANDIDATE]
    if size > 0.0:
        if size > LARGER * state[CONSTRAINED] or state[CONSTRAINED] > LARGER * size:
            state[COUNTED] = 0.0
        state[COUNTED] = min(state[COUNTED] + 1.0, work[TIP_INS])
        if state[COUNTED] == 1.0:
            state[CONSTRAINED] = size
        state[CONSTRAINED] += (size - state[CONSTRAINED]) / state[COUNTED]


@entry_point
def tkbse_step(state: F8, constants: F8, work: F8, inputs: F8, outputs: F8, time: float) -> int:
    """One frame: align it, watch the torque, start or advance the filter or hold it; ``time`` does not matter."""
    for i in range(CONSTANTS):
        work[i] = constants[i]
    for i in range(N):
        work[X + i] = state[1 + i]
    age = align(state, work, ALIGNMENT, KNOWS, inputs, FRAME)
    torque_good = plausible(work[FRAME_TORQUE], PLAUSIBLE_TORQUE)
    engine_good = plausible(work[FRAME_ENGINE], PLAUSIBLE_SPEED)
    wheel_good = plausible(work[FRAME_WHEEL], PLAUSIBLE_SPEED)
    torque, wanted = state[TORQUE], state[TRIGGERED] > 0.0
    if torque_good:
        torque = work[FRAME_TORQUE]
        rise = 0.0
        if state[SINCE] == 0.0:
            state[REFERENCE] = torque
        elif work[PERIOD] * (state[SINCE] + 1e-3) > RISING:
            state[RISE] = (torque - state[REFERENCE]) / (work[PERIOD] * state[SINCE])
            state[REFERENCE] = torque
            state[SINCE] = 0.0
        else:  # enough already, whatever the rest of this time brings
            rise = (torque - state[REFERENCE]) / RISING
        wanted = torque > work[LEVEL] and max(state[RISE], rise) > work[SLOPE]
        if torque <= work[LEVEL]:
            state[ARMED] = 1.0
    rate, grown = 0.0, ABSENT
    if engine_good and wheel_good:
        rate = work[FRAME_ENGINE] / work[I_TR] - work[I_FDR] * work[FRAME_WHEEL]
        if state[SPEEDS] > 0.0:
            grown = 0.5 * (state[RATE_BEFORE] + rate) * work[PERIOD] * state[SPEEDS]
    if torque_good and engine_good and wheel_good and state[COMPLETE] > 0.0:
        balance(state, work, torque, work[FRAME_ENGINE], rate)
    else:
        state[BALANCED] = 0.0
    if state[BALANCED] > 0.0 and abs(state[SHAFT]) > work[CALM_TORQUE]:
        carried = state[SHAFT] / stiffness(work, state[SHAFT])
        learn(state, work, ALIGNMENT, KNOWS, grown, carried, work[I_FDR] * work[FRAME_WHEEL])
    else:
        interrupt(state, ALIGNMENT)
    if state[SPEEDS] > 0.0:
        state[SPEEDS] += 1.0
    if engine_good and wheel_good:
        state[RATE_BEFORE] = rate
        state[SPEEDS] = 1.0
    if state[MISSED] + work[PERIOD] > max(BRIDGED, 1.5 * work[PERIOD]) + 1e-5:
        # nobody knows what the lash did meanwhile: a tip-in says what it had said, if that was all, or nothing
        if state[TRIGGERED] > 0.0 and state[SETTLED] * work[PERIOD] < work[SHUFFLE]:
            state[TRIGGERED] = 0.0
        if torque > work[LEVEL]:  # nor when it began
            state[ARMED] = 0.0
    if state[TRIGGERED] > 0.0 and not wanted:
        conclude(state, work)
    if state[TRIGGERED] > 0.0:
        advance(state, work, 0.5 * (state[TORQUE] + torque), engine_good, wheel_good, grown)
        for i in range(N):
            if not plausible(work[X + i], 10.0 * PLAUSIBLE_SPEED):
                state[TRIGGERED] = 0.0
        if state[TRIGGERED] == 0.0:
            for i in range(N):
                work[X + i] = 0.0
    elif wanted and state[ARMED] > 0.0 and engine_good and wheel_good:
        start(state, work, work[FRAME_ENGINE], work[FRAME_WHEEL])
    if state[TRIGGERED] == 0.0:  # one delay for a whole trigger
        state[ALIGNMENT + USED] = state[ALIGNMENT + FOUND]
    state[MISSED] += work[PERIOD]
    state[COMPLETE] = 0.0
    if torque_good and engine_good and wheel_good:
        state[MISSED] = 0.0
        state[COMPLETE] = 1.0
        state[ENGINE_BEFORE] = work[FRAME_ENGINE]
    if torque_good:
        state[TORQUE] = torque
    if torque_good or state[SINCE] > 0.0:
        state[SINCE] += 1.0
    for i in range(N):
        state[1 + i] = work[X + i]
        outputs[i] = work[X + i]
    outputs[6] = state[CONSTRAINED]
    outputs[7] = state[TRIGGERED]
    outputs[8] = state[TRIGGERS]
    outputs[9] = state[SURPRISE]
    outputs[10] = sqrt(max(state[UNEXPLAINED], 0.0))
    outputs[11] = age
    outputs[12] = work[KNOWS + KNOWN_WHEEL] + state[ALIGNMENT + FOUND]
    outputs[13] = sqrt(max(state[ALIGNMENT + VARIANCE], 0.0))
    outputs[14] = 1.0
    if (state[CONSTRAINED] == 0.0 or not state[SURPRISE] <= work[SURPRISE_BOUND]
            or not outputs[10] <= work[TORQUE_BOUND] or state[MISSED] > work[MISSED_BOUND]
            or outputs[13] > work[DELAY_BOUND] or at_the_end(state, work, ALIGNMENT, KNOWS) > 0.0):
        outputs[14] = 0.0
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
        estimate("latency", "s", "age of the frame that all this refers to", 0.01),
        estimate("wheel_speed_delay", "s", "delay of the wheel speed, known and found", 0.01),
        estimate("wheel_speed_delay_deviation", "s", "its standard deviation", 0.01),
        estimate("trusted", "1", "1 when a size was found with innovations and frames as they should be"),
    )

    @classmethod
    def defaults_from(cls, vehicle: Any, gear: int = 5) -> dict[str, float]:
        """The driveline lumped from a vehicle file, for one gear; both flanks."""
        from ..plants.full_order import FullOrderParameters

        values = super().defaults_from(vehicle, gear)
        coasting = three_mass_at_hub(vehicle.parameters(FullOrderParameters), gear, flank=-cls.flank)
        return values | {"coast_stiffness_factor": coasting.shaft.stiffness / values["shaft.stiffness"]}

    def constants(self, parameters: TkbseParameters) -> np.ndarray:
        """Driveline, stationary gain, discretised contact model, trigger and bounds, for ``tkbse_step``."""
        check_shaft(parameters.shaft)
        check_forward(parameters.gear.transmission_ratio)
        model = twists(Lumped.of(parameters), CONTACT)
        period, trigger, trust = parameters.sampling.period, parameters.trigger, parameters.trust
        a, b = discretise(model.A, model.B, period)
        # the lash moves evenly from frame to frame, not by a jump at the first
        way, noise = evenly(model.A, SIZE, period), parameters.noise
        process = np.diag(noise.process) * (np.arange(N) != SIZE) + noise.q_6 * np.outer(way, way)
        gain, spread = stationary_gain(a, measurement_matrix(), process, np.diag(noise.measurement))
        shuffle = shuffle_period(model.A)
        return np.concatenate([
            driveline_constants(parameters), gain.ravel(), a.ravel(), b.ravel(),
            [trigger.torque, trigger.slope, trigger.settled_rate, trigger.settled_torque,
             max(trigger.settled_time, period) - 0.5 * period, period], np.diag(spread),
            [1.0 - np.exp(-period / SMOOTHING), min(1.0, period / AVERAGED),
             trust.surprise, trust.torque, trust.missing, trust.delay, shuffle, trigger.tip_ins,
             parameters.coast_stiffness_factor * parameters.shaft.stiffness, trigger.measured_twist],
            parameters.delay.constants(period, shuffle)])


def shuffle_period(a: np.ndarray) -> float:
    """Period [s] of the slowest vibration of x' = A x.

    Raises:
        InputError: Nothing vibrates.
    """
    frequencies = np.abs(np.linalg.eigvals(a).imag)
    if not (frequencies > 1e-3).any():
        raise InputError("shaft.damping and wheel_shaft.damping are so large that nothing vibrates: the size is the "
                         "mean over a period of shuffle")
    return float(2.0 * np.pi / frequencies[frequencies > 1e-3].min())
