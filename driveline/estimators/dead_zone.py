"""A bank of Kalman filters over the dead zone in the plane of twist and torque, as kernels.

Each hypothesis is a normal distribution over the eight states below; all share the twist that was integrated
from both speeds. A hypothesis expects of an interval the mean torque that its dead zone gives along the
twist's path, averaged over where the flanks may be: for a normal distribution that mean is known in closed
form, and so are its derivatives (statistical linearisation), so a flank that is nearly touched already
teaches. Constants, state and work arrays are laid out here; driveline/estimators/lash_observer.py uses them.
"""

from __future__ import annotations

import math

from ..kernels.backend import kernel
from .samples import SAMPLES

BANK = 16  # hypotheses
N = 8  # of each: what follows
(FLANK, SIZE, OFFSET, STIFFNESS, INERTIA, WHEEL_LATE, ENGINE_LATE, LAST_ERROR) = range(N)
# FLANK: twist at which the coast flank lets go [rad]; SIZE: the whole lash [rad]; OFFSET: of the engine's torque
# [N.m]; STIFFNESS, INERTIA: natural logarithm and relative error of the model's; WHEEL_LATE: delay of the wheel's
# speed less that of the engine's, ENGINE_LATE: of the engine's speed against the torque [s], both beyond what is
# known; LAST_ERROR: error of the engine speed last taken in [rad/s].

# Constants.
(J_1, J_OUT, J_WHEEL, K_S, C_S, I_TR, I_FDR, LOSS_0, LOSS_1, LOSS_SHARE, DRAG, NOMINAL, SHARE,
 U_SIZE, U_WEAR, U_OFFSET, U_STIFFNESS, U_INERTIA, U_WHEEL, U_ENGINE, U_TIME,
 DELAY_ENGINE, DELAY_WHEEL, N_TORQUE, N_FRACTION, N_CHANGE, N_SPEED, N_TWIST, N_MODEL,
 N_INSTANT, N_DURATION, PERIOD, SUBSTEPS) = range(33)
CONSTANTS = 33

MOST_SUBSTEPS = 10
RING = 640  # sub-steps of twist kept to find instants in

# State: the first entry of the state array counts frames.
(RUNNING, TIME, TWIST, ENGINE, WHEEL, TORQUE, SIDE, LAST_TORQUE, ACCELERATION, SURPRISE, MISSING, TIME_UP, TIME_DOWN,
 TRAVERSALS, START, END, START_SPREAD, END_SPREAD, DIRECTION, REVISING, ENGINE_COUNT, WHEEL_COUNT, TORQUE_COUNT,
 RING_COUNT, LEFT, ASSUMED, SEEN) = range(1, 28)
ENGINE_RING = 28  # times, then values
WHEEL_RING = ENGINE_RING + 2 * SAMPLES
TORQUE_RING = WHEEL_RING + 2 * SAMPLES
RING_TIME = TORQUE_RING + 2 * SAMPLES
RING_TWIST = RING_TIME + RING
RING_RATE = RING_TWIST + RING
RING_DRAG = RING_RATE + RING
MEANS = RING_DRAG + RING
COVARIANCES = MEANS + BANK * N
WEIGHTS = COVARIANCES + BANK * N * N
STATE = WEIGHTS + BANK

# Work.
H = 0  # per hypothesis: row of derivatives, then P H', prediction, variance
PH = H + BANK * N
PREDICTED = PH + BANK * N
VARIANCE = PREDICTED + BANK
OPEN = VARIANCE + BANK
PATH = OPEN + BANK
RATES = PATH + MOST_SUBSTEPS + 1
EXTRA = RATES + MOST_SUBSTEPS + 1
ROOM = EXTRA + MOST_SUBSTEPS + 1
WORK = ROOM + 2 * N

TEMPER = 0.5  # power of the likelihood: model errors of successive frames are not independent
FORGOTTEN = 1e-9  # weight of a hypothesis below which it is set up anew


@kernel
def bell(z):
    """Density of the standard normal distribution."""
    if abs(z) > 8.0:
        return 0.0
    return 0.3989422804014327 * math.exp(-0.5 * z * z)


@kernel
def share_below(z):
    """Distribution function of the standard normal distribution, to 7.5e-8.

    Abramowitz and Stegun 26.2.17; from ``exp`` alone, so that compiled code gives the same bits.
    """
    if z > 8.0:
        return 1.0
    if z < -8.0:
        return 0.0
    t = 1.0 / (1.0 + 0.2316419 * abs(z))
    tail = bell(z) * t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    if z > 0.0:
        return 1.0 - tail
    return tail


@kernel
def flank_torque(constants, stiffness, begin, size, twist, rate):
    """Torque [N.m] of the dead zone with damped flanks that push but do not pull, as the engine feels it.

    Losses over the torque make the flank stiffer that drives, and softer that coasts.
    """
    if twist < begin:
        return min((1.0 - constants[LOSS_SHARE]) * (stiffness * (twist - begin) + constants[C_S] * rate), 0.0)
    if twist > begin + size:
        return max((1.0 + constants[LOSS_SHARE]) * (stiffness * (twist - begin - size) + constants[C_S] * rate), 0.0)
    return 0.0


@kernel
def stiffness_of(constants, logarithm):
    """Stiffness [N.m/rad] for the state of that name."""
    return constants[K_S] * math.exp(min(max(logarithm, -2.0), 2.0))


@kernel
def mean(state, index):
    """Mean of one state over the bank."""
    total = 0.0
    for m in range(BANK):
        total += state[WEIGHTS + m] * state[MEANS + N * m + index]
    return total


@kernel
def covariance(state, i, j):
    """Covariance of two states over the bank."""
    a = mean(state, i)
    b = mean(state, j)
    total = 0.0
    for m in range(BANK):
        x = MEANS + N * m
        within = state[COVARIANCES + N * N * m + N * i + j]
        total += state[WEIGHTS + m] * (within + (state[x + i] - a) * (state[x + j] - b))
    return total


@kernel
def likeliest(state):
    """The hypothesis with the largest weight."""
    best = 0
    for m in range(BANK):
        if state[WEIGHTS + m] > state[WEIGHTS + best]:
            best = m
    return best


@kernel
def prior_size(constants, m):
    """Mean and standard deviation of the lash [rad] in a hypothesis, and its weight."""
    nominal = constants[NOMINAL]
    if m == 0:
        return nominal, nominal * constants[U_SIZE], 0.5
    spacing = 5.0 / (BANK - 2.0)
    z = -2.5 + spacing * (m - 1.0)
    size = nominal * math.exp(constants[U_WEAR] * z)
    return size, 0.7 * spacing * constants[U_WEAR] * size, 0.5 * spacing * bell(z)


@kernel
def set_up(state, constants):
    """The bank before anything has been seen."""
    total = 0.0
    for m in range(BANK):
        x = MEANS + N * m
        p = COVARIANCES + N * N * m
        for i in range(N):
            state[x + i] = 0.0
        for i in range(N * N):
            state[p + i] = 0.0
        size, deviation, weight = prior_size(constants, m)
        state[x + SIZE] = size
        state[p + (N + 1) * SIZE] = deviation * deviation
        state[p + (N + 1) * OFFSET] = constants[U_OFFSET] * constants[U_OFFSET]
        state[p + (N + 1) * STIFFNESS] = constants[U_STIFFNESS] * constants[U_STIFFNESS]
        state[p + (N + 1) * INERTIA] = constants[U_INERTIA] * constants[U_INERTIA]
        state[p + (N + 1) * WHEEL_LATE] = constants[U_WHEEL] * constants[U_WHEEL]
        state[p + (N + 1) * ENGINE_LATE] = constants[U_ENGINE] * constants[U_ENGINE]
        state[p + (N + 1) * LAST_ERROR] = constants[N_SPEED] * constants[N_SPEED]
        state[WEIGHTS + m] = weight
        total += weight
    for m in range(BANK):
        state[WEIGHTS + m] /= total
    # the variance of the frames' instants is a ratio of sums; so it begins at what the parameter says
    state[TIME_DOWN] = 100.0
    state[TIME_UP] = state[TIME_DOWN] * constants[U_TIME] * constants[U_TIME]


@kernel
def anchor(state, constants, work, torque):
    """The flank's place from one torque [N.m] in contact; the twist counts from here on.

    torque = k (twist - flank [- size]) + i offset, so the flank's error follows those of the others.
    """
    side = 1.0
    if torque < 0.0:
        side = -1.0
    for m in range(BANK):
        x = MEANS + N * m
        p = COVARIANCES + N * N * m
        k = stiffness_of(constants, state[x + STIFFNESS]) * (1.0 + side * constants[LOSS_SHARE])
        spring = torque - constants[I_TR] * state[x + OFFSET]
        state[x + FLANK] = -spring / k
        for i in range(N):
            work[ROOM + i] = 0.0
        work[ROOM + OFFSET] = constants[I_TR] / k
        work[ROOM + STIFFNESS] = spring / k
        if torque > 0.0:
            state[x + FLANK] -= state[x + SIZE]
            work[ROOM + SIZE] = -1.0
        for j in range(N):
            total = 0.0
            for i in range(N):
                if i != FLANK:
                    total += work[ROOM + i] * state[p + N * i + j]
            work[ROOM + N + j] = total
        own = constants[N_TORQUE] / k
        variance = own * own + 1e-8
        for i in range(N):
            if i != FLANK:
                variance += work[ROOM + i] * work[ROOM + N + i]
                state[p + N * FLANK + i] = work[ROOM + N + i]
                state[p + N * i + FLANK] = work[ROOM + N + i]
        state[p + (N + 1) * FLANK] = variance
    state[SIDE] = side
    state[TWIST] = 0.0
    state[RING_COUNT] = 0.0
    state[REVISING] = -1.0
    state[LAST_TORQUE] = torque
    state[ACCELERATION] = 0.0
    state[RUNNING] = 1.0


@kernel
def revive(state, constants, m, best):
    """Set up a forgotten hypothesis: what the likeliest has learnt, with its own size of the lash.

    The flank that is or was last touched stays where it is.
    """
    x = MEANS + N * m
    p = COVARIANCES + N * N * m
    for i in range(N):
        state[x + i] = state[MEANS + N * best + i]
    for i in range(N * N):
        state[p + i] = state[COVARIANCES + N * N * best + i]
    size, deviation, _weight = prior_size(constants, m)
    variance = deviation * deviation
    if state[SIDE] > 0.0:  # the drive flank is where it is: flank + size known
        upper = state[p + (N + 1) * FLANK] + 2.0 * state[p + N * FLANK + SIZE] + state[p + (N + 1) * SIZE]
        state[x + FLANK] += state[x + SIZE] - size
        for j in range(N):
            if j != FLANK and j != SIZE:
                value = state[p + N * FLANK + j] + state[p + N * SIZE + j]
                state[p + N * FLANK + j] = value
                state[p + N * j + FLANK] = value
        state[p + (N + 1) * FLANK] = max(upper, 0.0) + variance
    state[x + SIZE] = size
    for j in range(N):
        state[p + N * SIZE + j] = 0.0
        state[p + N * j + SIZE] = 0.0
    state[p + (N + 1) * SIZE] = variance
    if state[SIDE] > 0.0:
        state[p + N * FLANK + SIZE] = -variance
        state[p + N * SIZE + FLANK] = -variance
    state[WEIGHTS + m] = FORGOTTEN


@kernel
def path(state, constants, work, best, torque, engine, wheel, h):
    """Twist and its rate at the sub-steps of an interval of length ``h``, into ``work``.

    The speeds at both ends are measured; between them they bend as the flanks of the likeliest
    hypothesis make them. Two passes more settle what the path and the torque owe each other.
    """
    n = int(constants[SUBSTEPS])
    x = MEANS + N * best
    k = stiffness_of(constants, state[x + STIFFNESS])
    inertia = constants[J_1] * max(1.0 + state[x + INERTIA], 0.1)
    step = h / n
    for j in range(n + 1):
        work[EXTRA + j] = 0.0
    for sweep in range(4):
        place = state[TWIST]
        work[PATH] = place
        for j in range(n + 1):
            part = j / n
            rate = ((state[ENGINE] + (engine - state[ENGINE]) * part) / constants[I_TR]
                    - constants[I_FDR] * (state[WHEEL] + (wheel - state[WHEEL]) * part))
            rate += work[EXTRA + j] - part * work[EXTRA + n]
            if j > 0:
                place += 0.5 * step * (work[RATES + j - 1] + rate)
            work[PATH + j] = place
            work[RATES + j] = rate
        if sweep < 3:
            before = 0.0
            total = 0.0
            for j in range(n + 1):
                pushes = flank_torque(constants, k, state[x + FLANK], state[x + SIZE], work[PATH + j], work[RATES + j])
                pulls = state[TORQUE] + (torque - state[TORQUE]) * j / n
                relative = ((pulls - pushes / constants[I_TR]) / (inertia * constants[I_TR])
                            - constants[I_FDR] * constants[I_FDR] * pushes / constants[J_WHEEL])
                if j > 0:
                    total += 0.5 * step * (before + relative)
                work[EXTRA + j] = total
                before = relative


@kernel
def look(state, constants, work, m, drag, slope, driving):
    """Mean torque of the interval that a hypothesis expects, and its derivatives, into ``work``.

    ``drag`` [N.m]: what the transmission carries while its own lash is open less than afterwards;
    ``slope``: change of the engine's torque over the interval [N.m/s]; ``driving``: mean net torque at the engine.
    """
    n = int(constants[SUBSTEPS])
    x = MEANS + N * m
    p = COVARIANCES + N * N * m
    k = stiffness_of(constants, state[x + STIFFNESS])
    coasting = 1.0 - constants[LOSS_SHARE]
    drive = 1.0 + constants[LOSS_SHARE]
    ratio = constants[I_TR]
    lower = math.sqrt(max(state[p + (N + 1) * FLANK], 1e-10))
    upper = state[p + (N + 1) * FLANK] + 2.0 * state[p + N * FLANK + SIZE] + state[p + (N + 1) * SIZE]
    upper = math.sqrt(max(upper, 1e-10))
    coasts = 0.0
    drives = 0.0
    torque = 0.0
    open_part = 0.0
    for j in range(n + 1):
        part = 1.0 / n
        if j == 0 or j == n:
            part = 0.5 / n
        twist = work[PATH + j]
        damping = constants[C_S] * work[RATES + j]
        depth = state[x + FLANK] - drag / k - twist
        z = depth / lower
        touched = share_below(z)
        torque += part * coasting * (damping * touched - k * (depth * touched + lower * bell(z)))
        coasts += part * touched
        open_part += part * share_below((state[x + FLANK] + constants[SHARE] * state[x + SIZE] - twist) / lower)
        depth = twist - state[x + FLANK] - state[x + SIZE]
        z = depth / upper
        touched = share_below(z)
        torque += part * drive * (damping * touched + k * (depth * touched + upper * bell(z)))
        drives += part * touched
    torque -= drag * open_part
    inertia = constants[J_1] * max(1.0 + state[x + INERTIA], 0.1)
    acceleration = (driving - torque / ratio - state[x + OFFSET]) / inertia
    h = H + N * m
    work[h + FLANK] = -k * (coasting * coasts + drive * drives)
    work[h + SIZE] = -k * drive * drives
    work[h + OFFSET] = ratio
    work[h + STIFFNESS] = torque + drag * open_part
    work[h + INERTIA] = ratio * constants[J_1] * acceleration
    work[h + WHEEL_LATE] = 0.0
    work[h + ENGINE_LATE] = ratio * slope
    work[OPEN + m] = max(1.0 - coasts - drives, 0.0)
    expected = (torque + ratio * state[x + OFFSET] + work[h + INERTIA] * state[x + INERTIA])
    return expected


@kernel
def interval(state, constants, work, time, torque, engine, wheel, late):
    """Learn from one interval between two engine speeds; ``late``: mean delays used for the alignment."""
    ratio = constants[I_TR]
    h = time - state[TIME]
    best = likeliest(state)
    path(state, constants, work, best, torque, engine, wheel, h)
    n = int(constants[SUBSTEPS])
    mean_torque = 0.5 * (torque + state[TORQUE])
    loss = constants[LOSS_0] + constants[LOSS_1] * 0.5 * (engine + state[ENGINE])
    acceleration = (engine - state[ENGINE]) / h
    driving = mean_torque - loss - constants[DRAG] / ratio
    measured = ratio * (driving - constants[J_1] * acceleration)
    x = MEANS + N * best
    inertia = constants[J_1] * max(1.0 + state[x + INERTIA], 0.1)
    # while only the transmission's lash is open, the output shaft behind it is neither dragged nor accelerated
    free = (mean_torque - loss - state[x + OFFSET]) / inertia
    drag = max(constants[DRAG] + constants[J_OUT] * free / ratio, 0.0)
    for j in range(1, n + 1):
        at = int(state[RING_COUNT]) % RING
        state[RING_TIME + at] = state[TIME] + h * j / n
        state[RING_TWIST + at] = work[PATH + j]
        state[RING_RATE + at] = work[RATES + j]
        pulls = state[TORQUE] + (torque - state[TORQUE]) * j / n
        state[RING_DRAG + at] = max(
            constants[DRAG] + constants[J_OUT] * (pulls - loss - state[x + OFFSET]) / (inertia * ratio), 0.0)
        state[RING_COUNT] += 1.0

    slope = (torque - state[TORQUE]) / h
    turned = constants[I_FDR] * (wheel - state[WHEEL])
    steep = max(abs(acceleration), abs(state[ACCELERATION]))
    instants = state[TIME_UP] / state[TIME_DOWN]
    speed_variance = constants[N_SPEED] * constants[N_SPEED] + instants * steep * steep
    to_torque = ratio * constants[J_1] / h
    change = measured - state[LAST_TORQUE]
    fraction = constants[N_FRACTION] * measured
    changing = constants[N_CHANGE] * change
    # errors of the picture last about as long as 10 ms, so many short frames tell no more than one long
    short = max(0.01 / h, 1.0)
    noise = (constants[N_TORQUE] * constants[N_TORQUE] + fraction * fraction + changing * changing) * short
    bent = (work[RATES + n] - work[RATES]) / 0.3
    twist_noise = (constants[N_TWIST] * constants[N_TWIST] * (h / 0.01) * (1.0 + bent * bent)
                   + instants * turned * turned)
    half = 0.5 * h / ratio
    # the shaft between both lashes is picked up with a blow or several, somewhere in the gap
    blow = constants[J_OUT] * 0.5 * (abs(work[RATES]) + abs(work[RATES + n])) / max(h, 0.01)
    least = 1e300
    for m in range(BANK):
        x = MEANS + N * m
        p = COVARIANCES + N * N * m
        # what moves the picture: delays other than assumed, and errors of the speed at the beginning
        state[x + FLANK] += turned * (state[x + WHEEL_LATE] - late) + half * state[x + LAST_ERROR]
        for j in range(N):
            state[p + N * FLANK + j] += turned * state[p + N * WHEEL_LATE + j] + half * state[p + N * LAST_ERROR + j]
        for j in range(N):
            state[p + N * j + FLANK] += turned * state[p + N * j + WHEEL_LATE] + half * state[p + N * j + LAST_ERROR]
        state[p + (N + 1) * FLANK] += twist_noise
        state[p + (N + 1) * OFFSET] += 4e-4 * (h / 0.01)
        wear = 1e-5 * constants[NOMINAL]
        state[p + (N + 1) * SIZE] += wear * wear * (h / 0.01)
        expected = look(state, constants, work, m, drag, slope, driving)
        expected += to_torque * state[x + LAST_ERROR]
        work[H + N * m + LAST_ERROR] = to_torque
        bump = blow * work[OPEN + m]
        total = noise + bump * bump * short + to_torque * to_torque * speed_variance
        for i in range(N):
            value = 0.0
            for j in range(N):
                value += state[p + N * i + j] * work[H + N * m + j]
            work[PH + N * m + i] = value
        for i in range(N):
            total += work[H + N * m + i] * work[PH + N * m + i]
        # the delay of the engine's speed is counted from the one assumed in the alignment
        expected -= work[H + N * m + ENGINE_LATE] * state[ASSUMED]
        expected += work[H + N * m + ENGINE_LATE] * state[x + ENGINE_LATE]
        work[PREDICTED + m] = expected
        work[VARIANCE + m] = total
        least = min(least, (measured - expected) * (measured - expected) / total)

    best = likeliest(state)
    residual = measured - work[PREDICTED + best]
    by_time = to_torque * to_torque * steep * steep
    if by_time > 0.0:
        unexplained = residual * residual - work[VARIANCE + best] + by_time * instants
        state[TIME_UP] = 0.998 * state[TIME_UP] + 0.002 * 100.0 * constants[U_TIME] * constants[U_TIME]
        state[TIME_DOWN] = 0.998 * state[TIME_DOWN] + 0.002 * 100.0
        scale = min(by_time * max(instants, 1e-6) / work[VARIANCE + best], 1.0)
        scale *= scale
        unexplained = min(max(unexplained / by_time, -instants), 9.0 * instants + 1e-6)
        state[TIME_UP] = max(state[TIME_UP] + 100.0 * scale * unexplained, 0.0)
        state[TIME_DOWN] += 100.0 * scale
        state[TIME_UP] = min(max(state[TIME_UP], 1e-10 * state[TIME_DOWN]), 1e-4 * state[TIME_DOWN])

    widened = 1.0
    if least > 9.0:  # nobody expected it: then nobody shall learn more than three deviations from it
        widened = least / 9.0
    top = -1e300
    for m in range(BANK):
        x = MEANS + N * m
        p = COVARIANCES + N * N * m
        s = work[VARIANCE + m] * widened
        residual = measured - work[PREDICTED + m]
        own_gain = -to_torque * speed_variance / s
        for i in range(N):
            work[ROOM + i] = work[PH + N * m + i] / s
        for i in range(N):
            state[x + i] += work[ROOM + i] * residual
            for j in range(i + 1):
                value = state[p + N * i + j] - work[ROOM + i] * work[PH + N * m + j]
                state[p + N * i + j] = value
                state[p + N * j + i] = value
        # the error of the speed at the end takes the place of that at the beginning
        for i in range(N):
            value = -work[ROOM + i] * own_gain * s
            state[p + N * i + LAST_ERROR] = value
            state[p + N * LAST_ERROR + i] = value
        state[x + LAST_ERROR] = own_gain * residual
        state[p + (N + 1) * LAST_ERROR] = max(speed_variance - own_gain * own_gain * s, 0.0)
        state[x + FLANK] += half * state[x + LAST_ERROR]
        for j in range(N):
            state[p + N * FLANK + j] += half * state[p + N * LAST_ERROR + j]
        for j in range(N):
            state[p + N * j + FLANK] += half * state[p + N * j + LAST_ERROR]
        for i in range(N):
            state[p + (N + 1) * i] = max(state[p + (N + 1) * i], 0.0)
        state[x + STIFFNESS] = min(max(state[x + STIFFNESS], -2.0), 2.0)
        state[x + INERTIA] = min(max(state[x + INERTIA], -0.8), 4.0)
        state[x + SIZE] = min(max(state[x + SIZE], 0.02 * constants[NOMINAL]), 1.0)
        work[VARIANCE + m] = (-0.5 * TEMPER * (residual * residual / s + math.log(s))
                              + math.log(state[WEIGHTS + m] + 1e-300))
        top = max(top, work[VARIANCE + m])
    total = 0.0
    for m in range(BANK):
        state[WEIGHTS + m] = math.exp(max(work[VARIANCE + m] - top, -700.0))
        total += state[WEIGHTS + m]
    for m in range(BANK):
        state[WEIGHTS + m] /= total
    best = likeliest(state)
    for m in range(BANK):
        if state[WEIGHTS + m] < FORGOTTEN:
            revive(state, constants, m, best)
    state[SURPRISE] += (least - state[SURPRISE]) * min(h / 0.2, 1.0)
    state[LAST_TORQUE] = measured
    state[ACCELERATION] = acceleration
    state[TWIST] = work[PATH + n]
    state[TIME] = time
    state[ENGINE] = engine
    state[WHEEL] = wheel
    state[TORQUE] = torque
