"""The 3DOF driveline as the estimators see it: sensors, numbers in a row, loads, steady state, trust."""

from __future__ import annotations

import numpy as np

from ..elements.fade import fade
from ..kernels.backend import kernel
from ..plants.reduced import ThreeMassDriveline
from .state_space import Lumped

# States of model II (eq. 3.13), in order.
N = 6
TWIST, ENGINE, WHEEL_TWIST, FINAL_DRIVE, WHEEL, LASH = range(N)

# What the two sensors read. The wheel sensor is at the rim, which turns with J_2 (three_mass_at_hub);
# the printed C (eq. 3.17) reads theta_w, which lies behind the tyre.
MEASURED = (ENGINE, FINAL_DRIVE)
M = len(MEASURED)

# Places of the driveline's numbers in an estimator's constants.
(K_S, C_S, I_TR, I_FDR, RADIUS, AERO, ROLLING, LOSS_CONSTANT, LOSS_VISCOUS, LOSS_FRACTION, HALF_GAP,
 J_1, J_2, J_V, K_W) = range(15)
DRIVELINE = 15

# Speeds beyond this [rad/s] and torques beyond that [N.m] are not measurements.
PLAUSIBLE_SPEED = 2000.0
PLAUSIBLE_TORQUE = 1e4
ROLLS = 0.05  # m/s: the rolling resistance changes its sign over so much, as no sensor tells when a vehicle stands


def measurement_matrix() -> np.ndarray:
    """C, measurements x states: engine speed, and the speed of the final drive with the rims."""
    return np.eye(N)[list(MEASURED)]


def driveline_constants(driveline: ThreeMassDriveline) -> np.ndarray:
    """The driveline's numbers in the order of the constants above."""
    p, gear, vehicle = Lumped.of(driveline), driveline.gear, driveline.vehicle
    return np.array([
        p.k_s, p.c_s, p.i_tr, p.i_fdr, p.r_w, vehicle.aerodynamic_factor, vehicle.rolling_resistance_force,
        gear.loss_constant, gear.loss_viscous, gear.loss_fraction, driveline.shaft.half_gap,
        p.J_1, p.J_2, p.J_v, p.k_w])


@kernel
def plausible(value, limit):
    """Whether a number can be a measurement; NaN cannot."""
    return -limit < value < limit


@kernel
def net_torque(work, at, torque, engine_speed, shaft_torque):
    """Crankshaft torque less the gear-train losses [N.m]."""
    return (torque - work[at + LOSS_CONSTANT] - work[at + LOSS_VISCOUS] * engine_speed
            - work[at + LOSS_FRACTION] * abs(shaft_torque))


@kernel
def road_load(work, at, wheel_speed):
    """Aerodynamic drag and rolling resistance [N] at a wheel speed [rad/s]."""
    speed = work[at + RADIUS] * wheel_speed
    return work[at + AERO] * speed * abs(speed) + work[at + ROLLING] * fade(speed / ROLLS)


@kernel
def steady_torques(work, at, torque, load):
    """Torque in the shaft [N.m, at the propeller shaft] and in the wheel shaft while all accelerate alike."""
    ratio = work[at + I_TR] * work[at + I_FDR]
    inertia = work[at + J_1] * ratio * ratio + work[at + J_2] + work[at + J_V]
    acceleration = (torque * ratio - work[at + RADIUS] * load) / inertia
    shaft = (torque - work[at + J_1] * ratio * acceleration) * work[at + I_TR]
    return shaft, work[at + I_FDR] * shaft - work[at + J_2] * acceleration


@kernel
def shaft_torque(work, at, x):
    """Torque in the shaft in contact [N.m] (eq. 3.2) for the state at ``work[x]``."""
    rate = work[x + ENGINE] / work[at + I_TR] - work[at + I_FDR] * work[x + FINAL_DRIVE]
    return work[at + K_S] * (work[x + TWIST] - work[x + LASH]) + work[at + C_S] * rate


@kernel
def unexplained_torque(work, at, engine, wheel, period):
    """The torque [N.m, at the crankshaft] that innovations of both speeds stand for, squared."""
    at_engine = work[at + J_1] * engine / period
    at_wheel = work[at + J_2] * wheel / (period * work[at + I_TR] * work[at + I_FDR])
    return at_engine * at_engine + at_wheel * at_wheel
