"""A stand-in for the thesis's vehicle measurement, which is not published: generated, not measured.

It is the modified vehicle, made a little wrong on purpose in the ways a real one is:

- its shuffle is at the 5.84 Hz that were measured, by softer axle shafts (the factor is searched for);
- its crankshaft does not deliver what the control unit reports: gain, offset, noise, a short lag;
- its torque comes through the supplier's filter, its speeds sampled and quantised by CAN, its seat's
  acceleration with noise.

So errors against it say how a model fares against a vehicle that differs from it in this way. They are not
the errors of the thesis, whose vehicle differed in ways nobody outside knows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.optimize import brentq

from cosim.result import Result
from cosim.studies.manoeuvre import FULL_ORDER, TipIn, drive, parameters, shuffle_after
from driveline.vehicles import Vehicle

MEASURED_FREQUENCY = 5.84  # [Hz], thesis section 2.1.3.1
TORQUE_ERROR = {  # of what the control unit reports; sizes chosen here
    "engine.torque_gain": 1.02, "engine.torque_offset": -2.0, "engine.air_lag": 0.002,
}
TORQUE_NOISE = {"engine.torque_noise": 0.25, "engine.noise_seed": 7.0}
SEAT_NOISE = 0.05  # [m/s2], standard deviation of the accelerometer, chosen here
SEED = 11


@dataclass(frozen=True)
class StandIn:
    """What the stand-in vehicle's instruments give in the tip-in.

    Attributes:
        result: ``engine_speed``, ``wheel_speed``, ``vehicle_speed``, ``propeller_shaft_torque``,
            ``seat_acceleration`` as the instruments give them; ``crankshaft_torque`` as the control unit
            reports it.
        axle_factor: Factor on the stiffness of the axle shafts that puts shuffle at 5.84 Hz.
        frequency: Shuffle frequency fitted to its torque meter's signal, noise and all [Hz].
    """

    result: Result
    axle_factor: float
    frequency: float


def measure(vehicle: Vehicle, tip_in: TipIn, frequency: float = MEASURED_FREQUENCY) -> StandIn:
    """Drive the tip-in with the stand-in vehicle.

    Args:
        vehicle: The modified vehicle.
        frequency: Where its shuffle is without the torque noise [Hz].
    """
    meter = "propeller_shaft_torque_measured"

    def trip(factor: float, noise: Mapping[str, float] = MappingProxyType({})) -> Result:
        changes = {"axle_shaft.stiffness": factor * vehicle.values["axle_shaft.stiffness"]}
        changes |= TORQUE_ERROR | dict(noise)
        return drive(FULL_ORDER, parameters(FULL_ORDER, vehicle, tip_in.gear, changes), tip_in)

    def off(factor: float) -> float:
        return shuffle_after(trip(factor), tip_in, meter).frequency - frequency

    factor = brentq(off, 0.7, 1.3, xtol=1e-4)
    truth = trip(factor, TORQUE_NOISE)
    noise = SEAT_NOISE * np.random.default_rng(SEED).standard_normal(truth.time.size)
    signals = {
        "crankshaft_torque": truth["engine_torque"],
        "engine_speed": truth["engine_speed_measured"],
        "wheel_speed": truth["wheel_speed_measured"],
        "vehicle_speed": truth["vehicle_speed_measured"],
        "propeller_shaft_torque": truth[meter],
        "seat_acceleration": truth["seat_acceleration"] + noise,
    }
    return StandIn(Result(truth.time, signals, {name: truth.units[name] for name in signals}), factor,
                   shuffle_after(truth, tip_in, meter).frequency)
