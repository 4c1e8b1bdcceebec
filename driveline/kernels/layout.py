"""Where everything of a network lies in its flat arrays, and the numbers that stand for laws and outputs.

`plan` (integers) is the structure: a header with counts and with where each table starts, then the
tables. `constants` are the numbers, `state` is all that changes in a run (complete to the bit),
`work` scratch in which the active numbers and the state of the moment lie during a call.
"""

from __future__ import annotations

from .backend import kernel

# Laws of a branch, and what its parameters are (after ratio_a and ratio_b).
SHAFT = 0      # stiffness, damping
LASH = 1       # stiffness, damping, half_gap, how fast a signal turns one side against the other
FRICTION = 2   # capacity (times a signal and a lag state), static_ratio, drag, base capacity (times cos grade),
               # drag moving backward beyond that moving forward
CONVERTER = 3  # tables
CONTACT = 4    # slip stiffness / relaxation length, relaxation length, deflection limit, radius
LOSS = 5       # constant, viscous, fraction, excess of the fraction on coast; reference branch
AERO = 6       # half density times drag area
ENGINE = 7     # gain, offset, noise, friction 0, 1, accessories, maximum, idle speed, gain, lag
SOURCE = 8     # gain; torque = gain * signal
REACTION = 9   # gain; torque = gain * torque of the reference branch, which does not feel it
TWO_STAGE = 10 # stiffness, damping, ratio of the first stage, its twist
RIPPLE = 11    # amplitude, order, phase; reference: place of the angle
SLIPPING = 12  # as FRICTION, then torque, target and reset time of the control that holds its slip
LEADING = 13   # gain; torque = gain * (rate - signal), as far as the signal of its reference says
CURVE = 14     # gain; torque = gain * a curve, which begins at the signal, over the twist at the place of its reference
RUBBING = 15   # as CONTACT, of what does not roll: friction that builds up over a twist; its radius is 0
DRY = (FRICTION, SLIPPING)  # what may stick
PATCHES = (CONTACT, RUBBING)  # what forgets its deflection as it slides
DRIVING = (ENGINE, SOURCE, LEADING, RIPPLE)  # what hears signals only as a torque on its node, or on the way to one
STRAIGHT = (SHAFT, LASH, TWO_STAGE)  # what has states that move as fast as speeds differ

# Columns of a branch in `plan`.
LAW, NODE_A, NODE_B, TWIST, PARAMETER, SIGNAL, REFERENCE, MODE = range(8)
BRANCH_COLUMNS = 8

# Header of `plan`: counts, then where each table starts in `plan`, `constants`, `state` or `work`.
(NODES, BRANCHES, CONTINUOUS, LAGS, INTEGRALS, TERMS, OUTPUTS, GEAR_ROWS, INPUTS, CHANNELS,
 SECTIONS, ACTIVE_SIZE, GEARS,
 BRANCH_TABLE, LAG_TABLE, INTEGRAL_TABLE, TERM_TABLE, GEAR_TABLE, CHANNEL_TABLE,
 INERTIA, GEAR_VALUES, CHANNEL_VALUES, SECTION_VALUES,
 STATE_MODES, STATE_CLOCK, STATE_QUEUE, STATE_SECTIONS, STATE_CHANNELS,
 GEAR_INPUT, DELAYED_INPUT, GRADE_INPUT, FILTERED_OUTPUT, SHIFT_LAG, GEARSET_NODE, GEARSET_BRANCH,
 FILTER_TARGET, SEED, SWITCHES, SWITCH_TABLE,
 BENT, BENT_TABLE, DRIVERS, DRIVER_TABLE, HEARD, HEARD_TABLE, CONTACTS, CONTACT_TABLE,
 ) = range(47)
HEADER = 47

# Columns of a CAN channel in `plan`: the output it samples, the output it shows, its place in
# `state`, its parameters and its jitter table in `constants`.
CHANNEL_COLUMNS = 5

# Single constants, at the start of `constants` (and of the active copy).
DELAY, SUBSTEP, NOISE_PERIOD, TICK, METER_GAIN, METER_OFFSET, METER_ON, PROPAGATED = range(8)
CONSTANTS_HEAD = 8

# Signals known in every plant; the inputs follow.
ONE, COS_GRADE, SIN_GRADE, DELAYED, NOISE, IN_GEAR, RUNS = range(7)
SIGNALS_HEAD = 7

# Clock part of the state.
GEAR, QUEUE_FIRST, QUEUE_COUNT, METER_HELD, EVENTS = range(5)
CLOCK_SIZE = 5
QUEUE_SIZE = 1024

# What a term of an output reads.
(SPEED, TORQUE, LASH_ANGLE, CONTACT_MODE, ACCELERATION, LEVEL, STORED) = range(7)

# Branches that may stick at the same time.
MOST_STUCK = 8
NONE_STUCK = -1.0  # in place of a branch's number

# What is kept of derivatives (``propagation``): how many were taken, which are used, steps since modes changed, how
# often they failed, whether the last step was whole; then the modes of the last step, the signals it heard, r of it,
# and a slot for each of the last sets of modes.
KEPT, USED, CALM, FAILED, WHOLE = range(5)
PROPAGATION_HEAD = 5
REFUSED, SWINGING = range(2)  # head of a slot: steps refused in a row; which driver swings, or -1
SLOT_HEAD = 2
SWINGS = 5  # instants in a step at which a torque that swings is looked at
MOST_KEPT = 4
NOT_A_MODE = 99.0

OK, NOT_FINITE, TOO_MANY_EVENTS, QUEUE_FULL, SLIDES_TOO_FAST = range(5)

NONE_DRAWN = 1 << 62  # in place of a noise value's number
TIME_TOLERANCE = 1e-9  # [s]; clock instants closer than this are the same


@kernel
def work_places(plan):
    """Where each part of `work` starts: signals, the state and its rates, both again for a step that is tried, a
    stage of it, torques of all branches at either end, modes, outputs, the equations of what sticks, derivatives.

    The active copy of `constants` comes first.
    """
    n = plan[CONTINUOUS]
    branches = plan[BRANCHES]
    signal = plan[ACTIVE_SIZE]
    y = signal + SIGNALS_HEAD + plan[INPUTS]
    torque = y + 5 * n
    modes = torque + 2 * branches
    observed = modes + branches
    matrix = observed + plan[OUTPUTS]
    return (signal, y, y + n, y + 2 * n, y + 3 * n, y + 4 * n, torque, torque + branches, modes, observed,
            matrix, matrix + MOST_STUCK * (MOST_STUCK + 3))


@kernel
def moving(plan):
    """How many states move each other: speeds and what branches hold. Lags, integrals and the ledger only follow."""
    return plan[CONTINUOUS] - plan[LAGS] - plan[INTEGRALS] - 2


@kernel
def kept_places(plan, kept):
    """Where what is kept of the last step lies: its modes, the signals it heard, r of it; then where slots begin."""
    modes = kept + PROPAGATION_HEAD
    heard = modes + plan[BRANCHES]
    r = heard + plan[HEARD]
    return modes, heard, r, r + plan[BENT]


@kernel
def slot_size(plan):
    """Length of what is kept for one set of modes."""
    m = moving(plan)
    bent = plan[BENT]
    return SLOT_HEAD + plan[BRANCHES] + (SWINGS + plan[DRIVERS]) * m + m * m + bent * (2 + 3 * m)


def work_size(plan):
    """Length of `work`."""
    *_, kept = work_places(plan)
    *_, slots = kept_places(plan, kept)
    return slots + MOST_KEPT * slot_size(plan) + 4 * moving(plan) ** 2
