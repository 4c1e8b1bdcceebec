"""Whether recordings can be of this vehicle at all: a wrong unit or gear would be explained at length otherwise.

Speeds must fit each other through gear, final drive and tyre, torques what the engine can do. The limits are far beyond
what the catalogue can name.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from cosim import units
from cosim.diagnosis.plants import FullOrderCar, Run
from cosim.measured import CANONICAL
from driveline.quantities import InputError

_OFF = 1.4  # times the others, either way: no tyre is as much larger, no shaft turns so much faster
_SLIPPING = 2.2  # the same of an engine that may turn faster than its turbine
_ALIKE = 1.1  # speeds on one side of the gears
_TORQUE = 3.0  # times what the engine can give
_CARRIED = 6.0  # times what the gears make of the engine's torque, either way
_LIVELY = 0.1  # share of the engine's torque by which it has to change, for that to be asked
_ROLLING = 1.0  # m/s
_BEFORE_GEARS = ("engine_speed", "turbine_speed")
_BEHIND = ("transmission_output_speed", "wheel_speed", "vehicle_speed")
# What is taken for the unit that a channel has here, or for one another.
_MISTAKEN = {"rad/s": ("rpm", "deg/s"), "m/s": ("km/h", "mph"), "N.m": ("kN.m", "N.cm"), "N": ("kN",),
             "m": ("cm", "mm"), "rad": ("deg", "rev")}


def check(car: FullOrderCar, runs: Sequence[Run]) -> None:
    """Refuse recordings that cannot be of a vehicle.

    Args:
        car: With the vehicle file as it is.
        runs: All of them.

    Raises:
        InputError: A gear, or the unit of a speed or torque, is not right.
    """
    rolling = [(run, speeds) for run in runs if (speeds := _as_of_the_vehicle(car, run))]
    for run, speeds in rolling:
        if run.kind != "drive":
            _check_gear(car, run, speeds)
    _check_speeds([speeds for _, speeds in rolling])
    _check_torques(car, runs)


def _as_of_the_vehicle(car: FullOrderCar, run: Run) -> dict[str, float]:
    """What every speed makes the vehicle's, without slip, median over time [m/s]; none where it stands."""
    speeds = {name: factor * float(np.median(np.abs(run.measured[name])))
              for name, factor in car.rolling(run.gear).items() if name in run.measured}
    return speeds if len(speeds) > 1 and min(speeds.values()) > 0.0 and max(speeds.values()) > _ROLLING else {}


def _check_gear(car: FullOrderCar, run: Run, speeds: Mapping[str, float]) -> None:
    """Whether what turns before the gears and what turns behind them agree among themselves, but in another gear."""
    sides = [[speeds[name] for name in side if name in speeds] for side in (_BEFORE_GEARS, _BEHIND)]
    if "turbine_speed" not in speeds or min(map(len, sides)) == 0 or max(map(len, sides)) < 2:
        return
    if any(max(side) > _ALIKE * min(side) for side in sides):
        return
    gears = car.gears
    ratio = gears[run.gear] * speeds["turbine_speed"] / float(np.median(sides[1]))
    nearest = car.gear_of(ratio * car.values["final_drive.ratio"])
    if nearest != run.gear and apart(ratio / gears[run.gear]) > _ALIKE > apart(ratio / gears[nearest]):
        raise InputError(f"{run.name}: the speeds before and behind the gears have a ratio of {ratio:.3g}, as in gear "
                         f"{nearest}; gear {run.gear}, as the measurement says, has {gears[run.gear]:.3g}")


def _check_speeds(rows: Sequence[Mapping[str, float]]) -> None:
    """Whether a speed is much more or less than the others make it, over all recordings."""
    off: dict[str, list[float]] = {}
    for speeds in rows:
        middle = float(np.median(list(speeds.values())))
        for name, speed in speeds.items():
            off.setdefault(name, []).append(speed / middle)
    shares = {name: float(np.median(found)) for name, found in off.items()}
    for name in sorted(shares, key=lambda name: -apart(shares[name])):
        free = name == "engine_speed" and shares[name] > 1.0
        if apart(shares[name]) > (_SLIPPING if free else _OFF):
            others = ", ".join(other.replace("_", " ") for other in shares if other != name)
            raise InputError(f"{name} is {shares[name]:.3g} times what {others} make it, through gear, final drive "
                             f"and tyre of the vehicle file: is its unit right?{as_if(name, shares[name])}")


def _check_torques(car: FullOrderCar, runs: Sequence[Run]) -> None:
    """Whether the engine can give the torque, and the propeller shaft carries about what the gears make of it."""
    most = car.values["engine.maximum_torque"]
    torques = [run.inputs[:, car.columns["engine_torque"]] for run in runs]
    highest = max(float(np.abs(torque).max()) for torque in torques)
    if highest > _TORQUE * most:
        raise InputError(f"engine_torque is up to {highest:.3g} N.m, and the engine of the vehicle file gives at most "
                         f"{most:.3g}: is its unit right?")
    carried = []
    for run, torque in zip(runs, torques):
        made = car.gears.get(run.gear, 0.0) * float(np.ptp(torque))
        if "propeller_shaft_torque" in run.measured and np.ptp(torque) > _LIVELY * most and made > 0.0:
            carried.append(float(np.ptp(run.measured["propeller_shaft_torque"])) / made)
    if carried and apart(share := float(np.median(carried))) > _CARRIED:
        raise InputError(f"propeller_shaft_torque changes by {share:.3g} times what the gears make of the engine's "
                         f"torque: is its unit right?{as_if('propeller_shaft_torque', share)}")


def apart(share: float) -> float:
    """How many times one is the other, either way; they have one sign."""
    return max(share, 1.0 / max(share, 1e-9))


def as_if(channel: str, share: float) -> str:
    """The units that may have been mistaken for one another, in words; nothing where none differ by so much.

    Args:
        channel: What is off.
        share: How many times it is what it should be.
    """
    unit = CANONICAL[channel].unit
    for is_, said in itertools.permutations((unit, *_MISTAKEN.get(unit, ())), 2):
        if apart(share * units.conversion(is_, said)[0]) < _ALIKE:
            return f" It is as if {is_} were taken for {said}"
    return ""
