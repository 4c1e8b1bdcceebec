"""Whether recordings can be of this vehicle at all: a wrong unit, sign or gear would be explained at length otherwise.

Speeds must fit each other through gear, final drive and tyre, torques what the engine can do, and what is slow in any
channel must have the direction that the vehicle file gives it, when it gives it; over all recordings and in each
manoeuvre, as a channel may be another one in one file of several; stretches of a drive are of one file. The limits are
far beyond what the catalogue can name.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from cosim import units
from cosim.diagnosis.plants import FullOrderCar, Run, clocks
from cosim.measured import CANONICAL, Measurement
from driveline.quantities import InputError

_OFF = 1.4  # times the others, either way: no tyre is as much larger, no shaft turns so much faster
_SLIPPING = 2.2  # the same of an engine that may turn faster than its turbine
_ALIKE = 1.1  # speeds on one side of the gears
_TORQUE = 3.0  # times what the engine can give
_CARRIED = 6.0  # times what the gears make of the engine's torque, either way
_LIVELY = 0.1  # share of the engine's torque by which it has to change, for that to be asked
_ROLLING = 1.0  # m/s
# What is slower than shuffle is about what the vehicle file makes it. With every effect of the catalogue at its limits,
# in a tip-in, a coast-down and a pulse train, torque and seat's acceleration correlate with what it makes them by 0.95
# and more (the torque by 0.78 behind a meter's slowest filter, both by 0.54 where the engine's torque is 0.3 s late),
# and the seat's is 0.57 to 1.5 times as large. Led along the speeds the engine's torque turned round leaves 7 times as
# much and more in 54 blind cases, at those limits 0.6 times and more, in the drive on the road 4 times; led by nothing,
# 0.2 times on a slope of a tenth. Recordings one by one, 63 measurements of three with one effect each at its limit: no
# correlation is below 0.2 (a torque 0.3 s late in a sweep), the seat's is 0.49 times as large and more, the engine's
# torque turned round leaves 0.3 times as much and more (a clutch that holds a hundredth), and the propeller shaft
# carries 0.3 times what the gears make of it and more.
_SLOW = 0.5  # s, over which means are taken
_WITH = 0.5  # correlation from which on one goes with the other; below minus that against it, as its sign is wrong
_BETTER, _BETTER_ALONE = 4.0, 8.0  # times less is unlike it where the engine's torque is turned round; in one recording
_SHAKEN = 2.5  # times the seat's acceleration, either way
_UNIT = 1.5  # times, within which what it is off by is that of two units
_BEFORE_GEARS = ("engine_speed", "turbine_speed")
_BEHIND = ("transmission_output_speed", "wheel_speed", "vehicle_speed")
# What is taken for the unit that a channel has here, or for one another.
_MISTAKEN = {"rad/s": ("rpm", "deg/s"), "m/s": ("km/h", "mph"), "N.m": ("kN.m", "N.cm"), "N": ("kN",),
             "m": ("cm", "mm"), "rad": ("deg", "rev"), "m/s2": ("g_0", "ft/s2")}
_WRITTEN = {"g_0": "g"}  # a unit as people write it

_DIRECTED = ("propeller_shaft_torque", "seat_acceleration")  # beside speeds, which a slope may turn round

_Both = Mapping[str, tuple[np.ndarray, np.ndarray]]  # of channels: simulated and measured


def check(car: FullOrderCar, measurement: Measurement, runs: Sequence[Run]) -> None:
    """Refuse recordings that cannot be of a vehicle.

    Args:
        car: With the vehicle file as it is.
        measurement: What was measured.
        runs: All that were made of it.

    Raises:
        InputError: A gear, or the unit, clock or sign of a channel, is not right.
    """
    rolling = [(run, speeds) for run in runs if (speeds := _as_of_the_vehicle(car, run))]
    for run, speeds in rolling:
        if run.kind != "drive":
            _check_gear(car, run, speeds)
    _check_speeds(car, rolling)
    lively = [run for run in runs if run.swing > _LIVELY * car.values["engine.maximum_torque"]]
    _check_torques(car, runs, lively)
    clocks.check(car, measurement)
    _check_signs(car, [run for run in lively if run.clocks])


def _as_of_the_vehicle(car: FullOrderCar, run: Run) -> dict[str, float]:
    """What every speed makes the vehicle's, without slip, median over time [m/s]; none where it stands."""
    speeds = {name: factor * float(np.median(np.abs(run.measured[name])))
              for name, factor in car.gearing.rolling(run.gear).items() if name in run.measured}
    return speeds if len(speeds) > 1 and min(speeds.values()) > 0.0 and max(speeds.values()) > _ROLLING else {}


def _check_gear(car: FullOrderCar, run: Run, speeds: Mapping[str, float]) -> None:
    """Whether what turns before the gears and what turns behind them agree among themselves, but in another gear."""
    sides = [[speeds[name] for name in side if name in speeds] for side in (_BEFORE_GEARS, _BEHIND)]
    if min(map(len, sides)) == 0 or max(map(len, sides)) < 2 or any(max(side) > _ALIKE * min(side) for side in sides):
        return
    gearing, behind = car.gearing, float(np.median(sides[1]))
    off = speeds["turbine_speed"] / behind if "turbine_speed" in speeds else _off_by_engine(car, run, speeds, behind)
    ratios, ratio = gearing.ratios, gearing.ratios[run.gear] * off
    nearest = gearing.nearest(ratio * gearing.final_drive)
    if nearest != run.gear and apart(ratio / ratios[run.gear]) > _ALIKE > apart(ratio / ratios[nearest]):
        raise InputError(f"{run.name}: the speeds before and behind the gears have a ratio of {ratio:.3g}, as in gear "
                         f"{nearest}; gear {run.gear}, as the measurement says, has {ratios[run.gear]:.3g}")


def _off_by_engine(car: FullOrderCar, run: Run, speeds: Mapping[str, float], behind: float) -> float:
    """How many times as fast as in its gear the turbine turns over what is behind the gears, by the engine's speed; 1
    where that may be slip.

    An engine that drives turns no slower than the turbine, and one that is driven no faster.
    """
    name = next(name for name in _BEHIND if name in speeds)
    rolling, clock = car.gearing.rolling(run.gear), run.clocks["engine_speed"]
    torque = run.inputs[:, car.columns[car.driver]]
    engine = rolling["engine_speed"] * run.measured["engine_speed"]
    off = engine / np.maximum(np.interp(clock, run.clocks[name], rolling[name] * run.measured[name]), 0.1 * behind)
    given = np.interp(clock, run.time, torque)
    driving, driven = given > _LIVELY * car.values["engine.maximum_torque"], given < 0.0
    if driving.any() and (least := float(np.median(off[driving]))) < 1.0:
        return least
    if driven.any() and (most := float(np.median(off[driven]))) > 1.0:
        return most
    return 1.0


def _check_speeds(car: FullOrderCar, rolling: Sequence[tuple[Run, Mapping[str, float]]]) -> None:
    """Whether a speed is much more or less than the others make it, over all recordings, or in some of them."""
    # alone the engine's may be what a clutch that is open makes it
    some = [(run, speeds) for run, speeds in rolling
            if run.kind != "drive" and any(name != "engine_speed" for name in _odd_speeds([(run, speeds)]))]
    looked = rolling if not some or len(some) == len(rolling) else some[:1]
    for name, share in _odd_speeds(looked).items():
        others = ", ".join(other.replace("_", " ") for _, speeds in looked[:1] for other in speeds if other != name)
        raise InputError(f"{_in(looked, rolling)}{name} is {share:.3g} times what {others} make it, through gear, "
                         "final drive and tyre of the vehicle file: " + (
                             f"are its column and that of {other} exchanged?"
                             if (other := _exchanged_with(car, looked, name)) else
                             f"is its unit right?{as_if(name, share)}"))


def _odd_speeds(rolling: Sequence[tuple[Run, Mapping[str, float]]]) -> dict[str, float]:
    """Every speed that is much more or less than the others make it, and how many times; the oddest first."""
    off: dict[str, list[float]] = {}
    for _, speeds in rolling:
        middle = float(np.median(list(speeds.values())))
        for name, speed in speeds.items():
            off.setdefault(name, []).append(speed / middle)
    shares = {name: float(np.median(found)) for name, found in off.items()}
    return {name: shares[name] for name in sorted(shares, key=lambda name: -apart(shares[name]))
            if apart(shares[name]) > (_SLIPPING if name == "engine_speed" and shares[name] > 1.0 else _OFF)}


def _in(looked: Sequence[tuple[Run, object]], of: Sequence[tuple[Run, object]]) -> str:
    """Which recording it is in, in words; nothing where it is in all."""
    return f"{looked[0][0].name}: " if len(looked) < len(of) else ""


def _exchanged_with(car: FullOrderCar, rolling: Sequence[tuple[Run, Mapping[str, float]]], name: str) -> str | None:
    """The speed that would have to be called by this name, and the other way round, for all to agree; or None."""
    for other in {other: None for _, speeds in rolling for other in speeds if name in speeds and other != name}:
        left = []
        for run, speeds in rolling:
            if {name, other} <= set(speeds):
                over = car.gearing.rolling(run.gear)
                share = over[name] / over[other]
                turned = {**speeds, name: share * speeds[other], other: speeds[name] / share}.values()
                left.append(max(turned) / min(turned))
        if float(np.median(left)) < _ALIKE:
            return other
    return None


def _check_torques(car: FullOrderCar, runs: Sequence[Run], lively: Sequence[Run]) -> None:
    """Whether the engine can give the torque, and the propeller shaft carries about what the gears make of it."""
    most = car.values["engine.maximum_torque"]
    highest = max(float(np.abs(run.inputs[:, car.columns["engine_torque"]]).max()) for run in runs)
    if highest > _TORQUE * most:
        raise InputError(f"engine_torque is up to {highest:.3g} N.m, and the engine of the vehicle file gives at most "
                         f"{most:.3g}: is its unit right?")
    ratios = car.gearing.ratios
    carried = [(run, float(np.ptp(run.measured["propeller_shaft_torque"])) / (ratios[run.gear] * run.swing))
               for run in lively if "propeller_shaft_torque" in run.measured and run.gear in ratios]
    odd = [(run, share) for run, share in carried if apart(share) > _CARRIED and run.kind != "drive"] or carried
    if odd and apart(share := float(np.median([share for _, share in odd]))) > _CARRIED:
        raise InputError(f"{_in(odd, carried)}propeller_shaft_torque changes by {share:.3g} times what the gears make "
                         f"of the engine's torque: is its unit right?{as_if('propeller_shaft_torque', share)}")


def _check_signs(car: FullOrderCar, lively: Sequence[Run]) -> None:
    """Whether what is slow has the direction that the vehicle file gives it, and the seat feels about as much."""
    try:
        as_is, turned = ([_slow(car, run, gain) for run in lively] for gain in (1.0, -1.0))
        # led along a channel that is wrong it would do what that says; but only led it stands a slope, which turns
        # speeds as a torque does and nothing here
        alone = [_slow(car, run if run.unknown_road else run.free, 1.0) for run in lively]
    except ArithmeticError:  # what cannot be simulated as it is is refused where it is fitted
        return
    each = [[r] for r, run in enumerate(lively) if run.kind != "drive"]
    for some in (range(len(lively)), *each) if lively else ():
        single = len(some) < len(lively)
        _check_directions(f"{lively[some[0]].name}: " if single else "", _BETTER_ALONE if single else _BETTER,
                          *([found[r] for r in some] for found in (as_is, turned, alone)))


def _check_directions(where: str, better: float, as_is: Sequence[_Both], turned: Sequence[_Both],
                      alone: Sequence[_Both]) -> None:
    """Raise InputError where what is slow goes the other way, or the seat feels much more or less.

    Args:
        where: What the message begins with.
        better: How many times less has to be unlike them where the engine's torque is turned round.
        as_is, turned, alone: Of every recording what is slow: with the engine's torque as it is, turned round, and led
            by nothing.
    """
    slow = {name: tuple(np.concatenate(parts) for parts in zip(*both)) for name in _DIRECTED
            if (both := [found[name] for found in alone if name in found])}
    with_it = {name: _correlation(*both) for name, both in slow.items()}
    against = [name for name, correlation in with_it.items() if correlation < -_WITH]
    if _unlike(turned) < _unlike(as_is) / better or len(against) == len(_DIRECTED):
        raise InputError(f"{where}all else goes up where engine_torque goes down: is its sign right?")
    for name in against:
        raise InputError(f"{where}{name} goes down where by the vehicle file it goes up: is its sign right?")
    if with_it.get("seat_acceleration", 0.0) > _WITH:
        simulated, measured = slow["seat_acceleration"]
        share = float(simulated @ measured) / float(simulated @ simulated)
        if apart(share) > _SHAKEN:
            raise InputError(f"{where}seat_acceleration is {share:.3g} times what the vehicle file makes it: is its "
                             f"unit right?{as_if('seat_acceleration', share, _UNIT)}")


def _slow(car: FullOrderCar, run: Run, gain: float) -> _Both:
    """What is slower than shuffle, about its mean: simulated, and measured.

    In all channels but the differential's acceleration, which shows how it nods as lashes are crossed.

    Args:
        gain: Of the engine's torque.
    """
    predicted, found = car.predict(car.values | {"input.engine_torque.gain": gain}, run), {}
    for name, place in run.slices.items():
        clock, measured = run.clocks[name], run.measured[name]
        count = max(1, round(_SLOW / float(np.median(np.diff(clock)))))
        if name != "differential_acceleration" and count < clock.size and np.ptp(measured) > 0.0:
            means = [np.convolve(signal, np.full(count, 1.0 / count), "valid")
                     for signal in (predicted[place], measured)]
            found[name] = means[0] - np.mean(means[0]), means[1] - np.mean(means[1])
    return found


def _unlike(found: Sequence[_Both]) -> float:
    """What of the channels is not in proportion to what is simulated, as a share, summed over them; of all but speeds
    either way round."""
    with_it = [(name, _correlation(*both)) for channels in found for name, both in channels.items()]
    return sum(1.0 - (max(r, 0.0) if name.endswith("speed") else r) ** 2 for name, r in with_it)


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Of two signals about their means, both of which change."""
    return float(one @ other) / float(np.sqrt((one @ one) * (other @ other)))


def apart(share: float) -> float:
    """How many times one is the other, either way; they have one sign."""
    return max(share, 1.0 / max(share, 1e-9))


def as_if(channel: str, share: float, within: float = _ALIKE) -> str:
    """The units that may have been mistaken for one another, in words; nothing where none differ by so much.

    Args:
        channel: What is off.
        share: How many times it is what it should be.
        within: Times that may be more or less.
    """
    unit = CANONICAL[channel].unit
    for is_, said in itertools.permutations((unit, *_MISTAKEN.get(unit, ())), 2):
        if apart(share * units.conversion(is_, said)[0]) < within:
            is_, said = (_WRITTEN.get(name, name) for name in (is_, said))
            return f" It is as if {is_} were taken for {said}"
    return ""
