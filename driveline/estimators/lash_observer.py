"""Position and size of the lash together, with their uncertainties, from the plane of twist and torque.

Both speeds are measured, so two things are known frame by frame without any model of tyres, mass or road:
the twist of everything between crankshaft and hub, the integral of engine_speed / i_tr - i_fdr * wheel_speed,
up to a constant; and the mean torque in the driveline, what the engine's torque did not put into its own
inertia. Plotted against each other they lie on a dead zone: a line of slope k_s, the gap, a line of slope k_s.
The estimator learns this dead zone: where it begins (the coast flank), how wide it is (the lash), and the
nuisances that bend the picture: stiffness, engine inertia, torque offset, delays of both speeds.

- Every hypothesis of a bank is a Kalman filter over these, linearised statistically (the mean of a dead
  zone over a normal distribution is known in closed form), for lashes from a quarter to four times the
  nominal one. Its weight is its likelihood. One hypothesis is the nominal lash itself.
- Within a frame the twist is taken from the speeds at both ends and from what the dead zone does between
  them, so the instants of leaving and touching a flank fall between frames.
- Instants are read off the recorded twist, again for some frames after an impact, with what has been
  learnt by then; so the start, which is grazing and passes unnoticed, is found when it matters.
- Frames carry their time. Known delays and time stamps shift the signals against each other before
  anything is computed; unknown ones are states.

docs/estimators/lash_observer.md derives it and says what it cannot do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..elements.driveline_parts import FINAL_DRIVE_RATIO, GEAR_RATIO
from ..kernels.backend import F8, entry_point, kernel
from ..plants.reduced import LashShaft, reduce
from ..quantities import InputError, Variable, parameter_variables, quantity
from .dead_zone import (
    ASSUMED,
    BANK,
    C_S,
    COVARIANCES,
    DELAY_ENGINE,
    DELAY_WHEEL,
    DIRECTION,
    DRAG,
    END,
    END_SPREAD,
    ENGINE,
    ENGINE_COUNT,
    ENGINE_LATE,
    ENGINE_RING,
    FLANK,
    I_TR,
    INERTIA,
    J_1,
    LEFT,
    LOSS_0,
    LOSS_1,
    MEANS,
    MISSING,
    MOST_SUBSTEPS,
    N_DURATION,
    N_INSTANT,
    N_MODEL,
    N_TORQUE,
    OFFSET,
    PERIOD,
    REVISING,
    RING,
    RING_COUNT,
    RING_DRAG,
    RING_RATE,
    RING_TIME,
    RING_TWIST,
    RUNNING,
    SEEN,
    SIDE,
    SIZE,
    START,
    START_SPREAD,
    STATE,
    STIFFNESS,
    SURPRISE,
    TIME,
    TIME_DOWN,
    TIME_UP,
    TORQUE,
    TORQUE_COUNT,
    TORQUE_RING,
    TRAVERSALS,
    TWIST,
    WEIGHTS,
    WHEEL,
    WHEEL_COUNT,
    WHEEL_LATE,
    WHEEL_RING,
    WORK,
    N,
    anchor,
    covariance,
    interval,
    mean,
    set_up,
    share_below,
    stiffness_of,
)
from .estimator import FRAME_INPUTS, Delays, Estimator, Sampling, check_forward, estimate, retuned
from .lumped import PLAUSIBLE_SPEED, PLAUSIBLE_TORQUE, plausible
from .samples import SAMPLES, linear, push, smooth

REVISED = 0.08  # [s] after an impact during which its instants are revised
NORMAL_90 = 1.6448536269514722
LONGEST = 0.025  # [s] between two engine speeds, beyond which the twist is lost; 1.5 frames where that is more
GONE = 0.05  # [s] without a wheel speed, or a torque, beyond which the twist or the torque is lost; the same
PATIENCE = 0.06  # [s] for which an engine speed waits for wheel speed and torque
AHEAD = 0.03  # [s] by which it may then be ahead of them, where one is late that nobody told of
SHORTEST = 0.005  # [s] of an interval; of shorter frames several make one
SURPRISE_BOUND = 4.0
MISSING_BOUND = 0.05  # [s] without a complete frame
PERIOD_BOUND = 0.0201  # [s] between frames, beyond which sizes were wrong that it was sure of

INPUT_TORQUE, INPUT_ENGINE, INPUT_WHEEL, INPUT_ENGINE_AGE, INPUT_WHEEL_AGE = range(5)


@dataclass(frozen=True)
class Ratios:
    """Ratios of the fixed gear, and its losses apart from each other."""

    transmission_ratio: float = quantity("1", "transmission ratio (i_tr)", **GEAR_RATIO)
    final_drive_ratio: float = quantity("1", "final drive ratio (i_fdr)", **FINAL_DRIVE_RATIO)
    loss_constant: float = quantity("N.m", "transmission drag before its lash, at the engine", minimum=0.0)
    loss_viscous: float = quantity("N.m.s/rad", "transmission drag over engine speed", minimum=0.0)
    loss_fraction: float = quantity("1", "loss in both over the torque carried", minimum=0.0, maximum=0.5)
    final_drive_drag: float = quantity("N.m", "final drive drag between the lashes, at the propeller shaft",
        minimum=0.0)


@dataclass(frozen=True)
class Uncertainty:
    """What is not known beforehand, as standard deviations."""

    size: float = quantity("1", "nominal lash, relative, as long as it has not worn",
        start=0.03, minimum=1e-3)
    wear: float = quantity("1", "logarithm of the lash over the nominal one, if it has",
        start=0.6, minimum=0.05, maximum=1.0)
    torque: float = quantity("N.m", "offset of the engine's torque", start=2.0, minimum=1e-3)
    stiffness: float = quantity("1", "logarithm of the stiffness over the nominal one",
        start=0.25, minimum=0.0, maximum=1.0)
    inertia: float = quantity("1", "engine inertia, relative", start=0.15, minimum=0.0, maximum=1.0)
    wheel_delay: float = quantity("s", "wheel speed delay beyond the known one",
        start=0.01, minimum=0.0, maximum=0.1)
    engine_delay: float = quantity("s", "engine speed delay beyond the known one",
        start=0.004, minimum=0.0, maximum=0.1)
    time: float = quantity("s", "instants at which speeds are taken, from frame to frame; learnt from there",
                           start=2e-4, minimum=1e-6, maximum=0.02)


@dataclass(frozen=True)
class ObserverNoise:
    """What the picture of a dead zone leaves unexplained, frame by frame, as standard deviations."""

    torque: float = quantity("N.m", "mean torque of a frame, at the propeller shaft",
        start=2.0, minimum=1e-3)
    fraction: float = quantity("1", "the same over the torque", start=0.03, minimum=0.0)
    change: float = quantity("1", "the same over the torque's change since the last frame",
        start=0.05, minimum=0.0)
    speed: float = quantity("rad/s", "engine speed, noise and resolution", start=2e-3, minimum=1e-6)
    twist: float = quantity("rad", "growth of the twist's error, per square root of 10 ms",
        start=1e-4, minimum=0.0)
    model: float = quantity("1", "lash, relative: what no number of traversals tells, as the driveline has more "
                                 "than one lash", start=0.005, minimum=0.0)
    instant: float = quantity("s", "both instants of a traversal together: what the delay of the engine's speed and "
                                   "lags of the driveline leave open", start=2e-3, minimum=0.0)
    duration: float = quantity("1", "of a traversal, over what independent errors of both instants would give",
                               start=0.65, minimum=0.0, maximum=2.0)


@dataclass(frozen=True)
class LashSampling(Sampling):
    """Its noise is told by the frame, so there are not as many as anyone likes."""

    period: float = retuned(Sampling, "period", 0.01, minimum=5e-4)


@dataclass(frozen=True)
class LashObserverParameters:
    """The driveline between crankshaft and hub, and what is not known about it."""

    engine_inertia: float = quantity("kg.m2", "engine to pinion, at the engine (J_1)", minimum=1e-4)
    output_inertia: float = quantity("kg.m2", "of these, between both lashes, at the propeller shaft",
        minimum=0.0)
    wheel_inertia: float = quantity("kg.m2", "hubs and tyres; only shapes the hub speed within a frame",
        minimum=1e-4)
    shaft: LashShaft
    transmission_share: float = quantity("1", "share of the lash that lies in the transmission",
        minimum=0.0, maximum=1.0)
    gear: Ratios
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    delay: Delays = field(default_factory=Delays)
    noise: ObserverNoise = field(default_factory=ObserverNoise)
    sampling: LashSampling = field(default_factory=LashSampling)


@kernel
def find_instants(state, constants):
    """Read start and end of the traversal that led to the present flank off the recorded twist."""
    side = state[SIDE]
    count = int(state[RING_COUNT])
    kept = min(count, RING)
    k = stiffness_of(constants, mean(state, STIFFNESS))
    begin = mean(state, FLANK)
    size = mean(state, SIZE)
    left = begin
    met = begin + size
    if side < 0.0:
        left = begin + size
        met = begin
    lower = covariance(state, FLANK, FLANK)
    upper = lower + 2.0 * covariance(state, FLANK, SIZE) + covariance(state, SIZE, SIZE)
    found_end = 0
    found_start = 0
    instants = state[TIME_UP] / state[TIME_DOWN]
    for i in range(1, kept):
        if found_start == 0:
            now = (count - i) % RING
            before = (count - i - 1) % RING
            if found_end == 0:
                a = side * (state[RING_TWIST + before] - met)
                b = side * (state[RING_TWIST + now] - met)
                if a <= 0.0 < b:
                    found_end = 1
                    rate = max(abs(state[RING_RATE + now]), 0.05)
                    variance = upper
                    if side < 0.0:
                        variance = lower
                    length = state[RING_TIME + now] - state[RING_TIME + before]
                    end = state[RING_TIME + now] - length * b / (b - a)
                    state[END] = end - state[ASSUMED]
                    state[END_SPREAD] = math.sqrt(max(variance, 0.0) / (rate * rate) + 2.5e-7 + instants)
            else:
                a = side * (state[RING_TWIST + before] - left) + side * constants[C_S] * state[RING_RATE + before] / k
                b = side * (state[RING_TWIST + now] - left) + side * constants[C_S] * state[RING_RATE + now] / k
                if side > 0.0:
                    a += state[RING_DRAG + before] / k
                    b += state[RING_DRAG + now] / k
                if a <= 0.0 < b:
                    found_start = 1
                    length = state[RING_TIME + now] - state[RING_TIME + before]
                    rate = max((b - a) / length, 0.02)
                    variance = lower
                    if side < 0.0:
                        variance = upper
                    own = 0.35 * constants[N_TORQUE] / k
                    state[START] = state[RING_TIME + now] - length * b / (b - a) - state[ASSUMED]
                    variance = max(variance, 0.0) + own * own
                    state[START_SPREAD] = math.sqrt(variance / (rate * rate) + 2.5e-7 + instants)


@kernel
def follow(state, constants, h):
    """Notice a traversal, and revise its instants for a while."""
    lower = 0.0
    upper = 0.0
    for m in range(BANK):
        x = MEANS + N * m
        p = COVARIANCES + N * N * m
        depth = state[x + FLANK] - state[TWIST]
        lower += state[WEIGHTS + m] * share_below(depth / math.sqrt(max(state[p + (N + 1) * FLANK], 1e-10)))
        variance = state[p + (N + 1) * FLANK] + 2.0 * state[p + N * FLANK + SIZE] + state[p + (N + 1) * SIZE]
        depth = state[TWIST] - state[x + FLANK] - state[x + SIZE]
        upper += state[WEIGHTS + m] * share_below(depth / math.sqrt(max(variance, 1e-10)))
    now = 0.0
    if lower > 0.95:
        now = -1.0
    elif upper > 0.95:
        now = 1.0
    if now != 0.0 and now != state[SIDE]:
        state[SIDE] = now
        state[DIRECTION] = now
        state[TRAVERSALS] += 1.0
        state[REVISING] = REVISED
        state[START] = state[LEFT]
        state[END] = state[TIME] - state[ASSUMED]
        state[START_SPREAD] = h
        state[END_SPREAD] = h
    if now == 0.0:
        if state[DIRECTION] != 2.0:
            state[LEFT] = state[TIME] - h - state[ASSUMED]
        state[DIRECTION] = 2.0
    else:
        state[DIRECTION] = now
    if state[REVISING] >= 0.0:
        find_instants(state, constants)
        state[REVISING] -= h
    return now


@entry_point
def lash_observer_step(state: F8, constants: F8, work: F8, inputs: F8, outputs: F8, time: float) -> int:
    """One frame at ``time`` [s]: take in what has come, learn from every interval that is complete."""
    torque_good = plausible(inputs[INPUT_TORQUE], PLAUSIBLE_TORQUE)
    engine_good = plausible(inputs[INPUT_ENGINE], PLAUSIBLE_SPEED)
    wheel_good = plausible(inputs[INPUT_WHEEL], PLAUSIBLE_SPEED)
    engine_age = 0.0
    wheel_age = 0.0
    if 0.0 < inputs[INPUT_ENGINE_AGE] < 1.0:
        engine_age = inputs[INPUT_ENGINE_AGE]
    if 0.0 < inputs[INPUT_WHEEL_AGE] < 1.0:
        wheel_age = inputs[INPUT_WHEEL_AGE]
    if state[RUNNING] == 0.0 and state[ENGINE_COUNT] + state[WHEEL_COUNT] + state[TORQUE_COUNT] == 0.0:
        set_up(state, constants)
        state[REVISING] = -1.0
    if torque_good:
        push(state, TORQUE_RING, TORQUE_COUNT, time, inputs[INPUT_TORQUE])
    if engine_good:
        push(state, ENGINE_RING, ENGINE_COUNT, time - engine_age - constants[DELAY_ENGINE], inputs[INPUT_ENGINE])
    if wheel_good:
        push(state, WHEEL_RING, WHEEL_COUNT, time - wheel_age - constants[DELAY_WHEEL], inputs[INPUT_WHEEL])
    if torque_good and engine_good and wheel_good:
        state[MISSING] = 0.0
    else:
        state[MISSING] += constants[PERIOD]
    contact = outputs[3]
    longest = max(LONGEST, 1.5 * constants[PERIOD])
    apart = 1e-5
    if constants[PERIOD] < 0.99 * SHORTEST:
        apart = SHORTEST - 0.1 * constants[PERIOD]
    last_torque, last_wheel = -1e9, -1e9
    if state[TORQUE_COUNT] > 0.0:
        last_torque = state[TORQUE_RING + int(state[TORQUE_COUNT]) - 1]
    if state[WHEEL_COUNT] > 0.0:
        last_wheel = state[WHEEL_RING + int(state[WHEEL_COUNT]) - 1]
    if time - min(last_torque, last_wheel + constants[DELAY_WHEEL]) > max(GONE, 1.5 * constants[PERIOD]) + 1e-5:
        # nothing tells what twist or torque did: begin again when all have come back, and learn nothing till then
        state[RUNNING] = 0.0
        state[SEEN] = 0.0
    elif state[ENGINE_COUNT] > 0.0:
        for turn in range(2):  # two, to catch up when a signal had to be waited for
            found = -1
            for i in range(SAMPLES):
                if found < 0 and i < int(state[ENGINE_COUNT]) and state[ENGINE_RING + i] > state[TIME] + apart:
                    found = i
            if state[RUNNING] == 0.0 and turn == 0 and state[SEEN] == 0.0:
                found = int(state[ENGINE_COUNT]) - 1
            if found >= 0:
                late = mean(state, WHEEL_LATE)
                engine_late = mean(state, ENGINE_LATE)
                at = state[ENGINE_RING + found]
                patience = max(0.3 * constants[PERIOD], 1e-4)
                newest = min(last_wheel - late, last_torque)
                waited = state[ENGINE_RING + int(state[ENGINE_COUNT]) - 1] - at
                if newest + patience < at - AHEAD and waited > PATIENCE:
                    state[RUNNING] = 0.0
                    state[SEEN] = 0.0
                    state[TIME] = at
                elif newest + patience >= at or waited > PATIENCE:
                    engine = state[ENGINE_RING + SAMPLES + found]
                    wheel = smooth(state, WHEEL_RING, WHEEL_COUNT, at + late)
                    torque = linear(state, TORQUE_RING, TORQUE_COUNT, at - engine_late)
                    h = at - state[TIME]
                    if state[SEEN] == 0.0 or h > longest or state[RUNNING] == 0.0:
                        # begin, or begin again, at a torque that tells the flank
                        if 0.0 < h <= longest and state[SEEN] > 0.0:
                            shown = constants[I_TR] * (
                                0.5 * (torque + state[TORQUE]) - constants[LOSS_0]
                                - constants[LOSS_1] * 0.5 * (engine + state[ENGINE])
                                - constants[J_1] * (engine - state[ENGINE]) / h) - constants[DRAG]
                            if abs(shown) > 15.0:
                                anchor(state, constants, work, shown)
                        else:
                            state[RUNNING] = 0.0
                        state[TIME] = at
                        state[SEEN] = 1.0
                        state[ENGINE] = engine
                        state[WHEEL] = wheel
                        state[TORQUE] = torque
                    else:
                        state[ASSUMED] = engine_late
                        interval(state, constants, work, at, torque, engine, wheel, late)
                        contact = follow(state, constants, h)
    report(state, constants, outputs, time, contact)
    return 0


@kernel
def report(state, constants, outputs, time, contact):
    """The outputs, from the bank."""
    size = mean(state, SIZE)
    spread = constants[N_MODEL] * size
    size_variance = covariance(state, SIZE, SIZE)
    size_deviation = math.sqrt(max(size_variance, 0.0) + spread * spread)
    flank = mean(state, FLANK)
    flank_variance = covariance(state, FLANK, FLANK)
    across = covariance(state, FLANK, SIZE)
    position = state[TWIST] - flank - 0.5 * size
    deviation = math.sqrt(max(flank_variance + across + 0.25 * size_variance, 0.0) + 0.25 * spread * spread)
    if contact != 0.0 or abs(position) > 0.5 * size or state[RUNNING] == 0.0:
        side = 1.0
        if position < 0.0 or (state[RUNNING] == 0.0 and state[SIDE] < 0.0):
            side = -1.0
        if contact != 0.0:
            side = contact
        position = side * 0.5 * size
        deviation = 0.5 * size_deviation
    if state[RUNNING] == 0.0:
        deviation = size
    late = max(covariance(state, ENGINE_LATE, ENGINE_LATE), 0.0)
    late += constants[N_INSTANT] * constants[N_INSTANT]
    outputs[0] = position
    outputs[1] = deviation
    outputs[2] = min(max(0.5 + position / max(size, 1e-9), 0.0), 1.0)
    outputs[3] = contact
    outputs[4] = size
    outputs[5] = size_deviation
    outputs[6] = max(size - NORMAL_90 * size_deviation, 0.0)
    outputs[7] = size + NORMAL_90 * size_deviation
    outputs[8] = state[TRAVERSALS]
    outputs[9] = state[START]
    outputs[10] = math.sqrt(state[START_SPREAD] * state[START_SPREAD] + late)
    outputs[11] = state[END]
    outputs[12] = math.sqrt(state[END_SPREAD] * state[END_SPREAD] + late)
    duration = state[END] - state[START]
    jitter = state[TIME_UP] / max(state[TIME_DOWN], 1e-300)
    both = constants[N_DURATION] * math.sqrt(
        state[START_SPREAD] * state[START_SPREAD] + state[END_SPREAD] * state[END_SPREAD])
    both = math.sqrt(both * both + 4.0 * jitter)
    outputs[13] = duration
    outputs[14] = both
    outputs[15] = max(duration - NORMAL_90 * both, 0.0)
    outputs[16] = duration + NORMAL_90 * both
    outputs[17] = 1.0
    if state[REVISING] >= 0.0:
        outputs[17] = 0.0
    outputs[18] = mean(state, OFFSET)
    outputs[19] = math.exp(min(max(mean(state, STIFFNESS), -2.0), 2.0))
    outputs[20] = 1.0 + mean(state, INERTIA)
    outputs[21] = constants[DELAY_ENGINE] + mean(state, ENGINE_LATE)
    outputs[22] = constants[DELAY_WHEEL] + mean(state, ENGINE_LATE) + mean(state, WHEEL_LATE)
    outputs[23] = math.sqrt(jitter)
    outputs[24] = 0.0
    if state[SEEN] > 0.0:
        outputs[24] = time - state[TIME]
    outputs[25] = state[SURPRISE]
    outputs[26] = 0.0
    if (state[RUNNING] > 0.0 and state[SURPRISE] < SURPRISE_BOUND and state[MISSING] < MISSING_BOUND
            and constants[PERIOD] < PERIOD_BOUND):
        outputs[26] = 1.0


class LashObserver(Estimator):
    """Position and size of the lash with their uncertainties."""

    name = "lash_observer"
    description = "Observer of backlash position and size with uncertainties, from twist and torque"
    Parameters = LashObserverParameters
    entry_point = "lash_observer_step"
    state_size = STATE - 1
    work_size = WORK
    inputs = (*FRAME_INPUTS, Variable(
        "engine_speed_age", "s", "time since the engine speed was taken, beyond its known delay; 0 where unknown",
        "input", "continuous"), Variable(
        "wheel_speed_age", "s", "time since the wheel speed was taken, beyond its known delay; 0 where unknown",
        "input", "continuous"))
    output_variables = (
        estimate("lash_position", "rad", "position in the lash, at the propeller shaft", 0.1),
        estimate("lash_position_deviation", "rad", "its standard deviation", 0.01),
        estimate("lash_position_share", "1", "position as a share of the lash: 0 coast flank, 1 drive flank"),
        estimate("contact", "1", "flank in contact: -1, 0 none, 1"),
        estimate("lash_size", "rad", "total lash (2 alpha)", 0.1),
        estimate("lash_size_deviation", "rad", "its standard deviation", 0.01),
        estimate("lash_size_low90", "rad", "lower end of its 90 % interval", 0.1),
        estimate("lash_size_high90", "rad", "upper end of its 90 % interval", 0.1),
        estimate("traversals", "1", "traversals of the lash so far"),
        estimate("traversal_start", "s", "when the last traversal started"),
        estimate("traversal_start_deviation", "s", "its standard deviation", 0.01),
        estimate("traversal_end", "s", "when the last traversal ended"),
        estimate("traversal_end_deviation", "s", "its standard deviation", 0.01),
        estimate("traversal_time", "s", "how long the last traversal took", 0.1),
        estimate("traversal_time_deviation", "s", "its standard deviation", 0.01),
        estimate("traversal_time_low90", "s", "lower end of its 90 % interval", 0.1),
        estimate("traversal_time_high90", "s", "upper end of its 90 % interval", 0.1),
        estimate("traversal_settled", "1", "0 while the last traversal's instants are being revised, else 1"),
        estimate("torque_offset", "N.m", "offset of the engine's torque", 1.0),
        estimate("stiffness_factor", "1", "stiffness over the parameter's"),
        estimate("inertia_factor", "1", "engine inertia over the parameter's"),
        estimate("engine_speed_delay", "s", "delay of the engine speed against the torque", 0.01),
        estimate("wheel_speed_delay", "s", "delay of the wheel speed against the torque", 0.01),
        estimate("time_jitter", "s", "scatter of the instants at which speeds are taken", 1e-3),
        estimate("latency", "s", "age of the engine speed that position and contact refer to", 0.01),
        estimate("surprise", "1", "normalised innovation, averaged; at most about 1 if the covariances are right"),
        estimate("trusted", "1", "1 while innovations and frames are as they should be, at most 20 ms apart, else 0"),
    )

    @classmethod
    def defaults_from(cls, vehicle: Any, gear: int = 5) -> dict[str, float]:
        """The driveline up to the hub, from a vehicle file, for one gear."""
        from ..plants.full_order import FullOrderParameters

        full = vehicle.parameters(FullOrderParameters)
        split = reduce(full, gear).split_lash
        ratio, final = split.gear.transmission_ratio, split.gear.final_drive_ratio
        first, second = split.transmission_shaft, split.shaft
        lumped = 1.0 / (1.0 / first.stiffness + 1.0 / second.stiffness)
        damping = lumped**2 * (first.damping / first.stiffness**2 + second.damping / second.stiffness**2)
        half_gap = first.half_gap + second.half_gap
        parameters = LashObserverParameters(
            engine_inertia=split.engine_inertia + split.output_inertia / ratio**2,
            output_inertia=split.output_inertia,
            wheel_inertia=2.0 * (full.hub.inertia + full.tyre.belt_inertia) + full.axle_shaft.inertia,
            shaft=LashShaft(lumped, damping, half_gap),
            transmission_share=first.half_gap / half_gap if half_gap > 0.0 else 0.0,
            gear=Ratios(
                ratio, final, full.transmission.loss_constant[gear + 1], full.transmission.loss_viscous[gear + 1],
                full.transmission.loss_fraction[gear + 1] + full.final_drive.loss_fraction,
                full.final_drive.loss_constant))
        return {v.name: v.start for v in parameter_variables(parameters)}

    def constants(self, parameters: LashObserverParameters) -> np.ndarray:
        """The numbers of ``lash_observer_step``, in order."""
        p, gear, unknown, noise = parameters, parameters.gear, parameters.uncertainty, parameters.noise
        if not 0.0 < p.shaft.half_gap < 0.25:
            raise InputError(f"shaft.half_gap is {p.shaft.half_gap:g} rad: an estimator of lash needs one between 0 "
                             "and 0.25 rad")
        check_forward(gear.transmission_ratio)
        p.delay.longest(p.sampling.period, SAMPLES)
        frames = max(math.ceil(SHORTEST / p.sampling.period - 1e-6), 1)
        substeps = min(round(frames * p.sampling.period / 1e-3), MOST_SUBSTEPS)
        return np.array([
            p.engine_inertia, p.output_inertia, p.wheel_inertia, p.shaft.stiffness, p.shaft.damping,
            gear.transmission_ratio, gear.final_drive_ratio, gear.loss_constant, gear.loss_viscous, gear.loss_fraction,
            gear.final_drive_drag,
            2.0 * p.shaft.half_gap, p.transmission_share,
            unknown.size, unknown.wear, unknown.torque, unknown.stiffness, unknown.inertia, unknown.wheel_delay,
            unknown.engine_delay, unknown.time,
            p.delay.engine_speed, p.delay.wheel_speed,
            noise.torque, noise.fraction, noise.change, noise.speed, noise.twist, noise.model,
            noise.instant, noise.duration,
            p.sampling.period, substeps])
