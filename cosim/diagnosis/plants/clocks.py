"""Whether all channels of a recording follow its torque in time, or some are of a logger that began earlier or later.

The catalogue's delays are those within one logger. What is later than these would be explained at length by something
else, as a torque that is missing. It shows in a free simulation of the vehicle file: what is slow in a channel begins
and ends with the torque, whatever else is wrong with the car.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.plants.observation import observe
from cosim.measured import Manoeuvre, Measurement
from driveline.quantities import InputError

_EVERY = 0.01  # s: how finely is looked
_OVER = 0.3  # s, over which means are taken, and speeds change: what is quicker is the car's own
_MOST = 10.0  # s, either way, as far as half a recording is left
_POSSIBLE, _LATE = 0.3, 0.4  # s: to which the catalogue's delays go, and from which on it is none of these
# A lag is clear beside others where so many times less of a channel is unlike the simulation, and no more than that
# share of it. With every effect of the catalogue at its limits what is within these has a lag that is possible; an
# engine whose converter clutch slips is late beyond them by 6.9 times, but 0.13 and more of it is like nothing then.
_CLEARER, _UNLIKE = 4.0, 0.1
_ALIKE = 0.15  # s, within which lags are one
_SAME = 1e-9  # share of a signal that is rounding


@dataclass(frozen=True)
class Lag:
    """By how much a channel is late.

    Attributes:
        seconds: By which it comes after what it should follow; negative: before that.
        unlike: Share of it that is not in proportion to that, shifted by so much.
        clearer: How many times as much of it is unlike that with a delay that is possible as with one that is not,
            each at its best.
    """

    seconds: float
    unlike: float
    clearer: float

    @property
    def late(self) -> bool:
        """Whether it is clear that this is none of the catalogue's delays."""
        return abs(self.seconds) >= _LATE and self.clearer > _CLEARER and self.unlike < _UNLIKE

    @property
    def on_time(self) -> bool:
        """Whether it is clear that it may be."""
        return self.clearer < 1.0 / _CLEARER


def check(car: FullOrderCar, measurement: Measurement) -> None:
    """Refuse recordings with channels of different clocks.

    Args:
        car: With the vehicle file as it is.
        measurement: Whose units are right.

    Raises:
        InputError: A channel is late or early by more than the catalogue's delays.
    """
    for manoeuvre in measurement.manoeuvres:
        refuse(f"manoeuvre '{manoeuvre.name}'", car.driver, lags(car, manoeuvre))


def refuse(where: str, reference: str, found: Mapping[str, Lag]) -> None:
    """Raise InputError where channels are of another clock than most.

    Args:
        where: In which recording, in words.
        reference: The channel that all others are late against; it is the one to be named where all that is late is so
            by the same, and nothing is on time.
        found: Every other's lag.
    """
    late = {name: lag.seconds for name, lag in found.items() if lag.late}
    if not late:
        return
    against = reference
    if not any(lag.on_time for lag in found.values()):
        common = float(np.median(list(late.values())))
        with_it = sum(abs(lag.seconds - common) < _ALIKE for lag in found.values())
        if with_it > max(1, sum(abs(lag.seconds) < _LATE for lag in found.values())):
            late, against = {reference: -common}, "all else"
    parts = ", ".join(f"{name} is about {abs(seconds):.2f} s {'late' if seconds > 0.0 else 'early'}"
                      for name, seconds in late.items())
    name, seconds = next(iter(late.items()))
    raise InputError(f"{where}: {parts} against {against}, as of a logger that was not started with the rest: write "
                     f"delay = {seconds:.2f} under [channels.{name}]")


def lags(car: FullOrderCar, manoeuvre: Manoeuvre) -> dict[str, Lag]:
    """By how much every channel is late against what the engine's torque makes of it.

    All but the differential's acceleration, which is quick. None of a drive, of a recording through several gears, or
    where the torque cannot be simulated.
    """
    run = car.whole(manoeuvre)
    if run is None:
        return {}
    try:
        raw = car.raw(car.values, run)
    except ArithmeticError:  # what cannot be simulated as it is is refused where it is fitted
        return {}
    measured, found = manoeuvre.from_zero(), {}
    for name in run.clocks:
        if name != "differential_acceleration":
            channel = measured[name]
            clocks = [np.arange(begin, end, _EVERY)
                      for begin, end in ((channel.time[0], channel.time[-1]), (run.time[0], run.time[-1]))]
            signals = channel.at(clocks[0]), observe(raw, run.time, car.values, name, clocks[1])
            parts = [_slow(signal, name.endswith("speed")) for signal in signals]
            found[name] = lag(*parts, _EVERY, clocks[0][0] - clocks[1][0])
    return found


def _slow(signal: np.ndarray, speed: bool) -> np.ndarray:
    """What is slower than shuffle; of a speed by how much it changes, as it goes on rising after a torque has risen."""
    count = round(_OVER / _EVERY)
    if speed:
        signal = signal[count:] - signal[:-count]
    return np.convolve(signal, np.full(count, 1.0 / count), "valid")


def lag(measured: np.ndarray, simulated: np.ndarray, every: float, ahead: float = 0.0) -> Lag:
    """By how much one signal is later than another.

    Args:
        measured, simulated: Of which what is too fast to be alike is gone; on even clocks.
        every: Of these [s].
        ahead: By how much the first clock begins later [s].
    """
    one, other = measured - np.mean(measured), simulated - np.mean(simulated)
    shifts = np.arange(1 - other.size, one.size)  # by which other[i] lies on one[i + shift]
    begin, end = np.maximum(shifts, 0), np.minimum(other.size + shifts, one.size)
    count = end - begin
    of_one, of_other = (begin, end), (begin - shifts, end - shifts)
    sums, sums_other = _within(one, *of_one), _within(other, *of_other)
    product = correlate(one, other) - sums * sums_other / count
    squares = ((_within(one**2, *of_one) - sums**2 / count) * (_within(other**2, *of_other) - sums_other**2 / count))
    seconds = every * shifts + ahead
    known = (count >= min(one.size, other.size) // 2) & (np.abs(seconds) <= _MOST)
    known &= squares > _SAME * (one @ one) * (other @ other)
    unlike = np.maximum(1.0 - product[known] ** 2 / squares[known], _SAME)
    seconds = seconds[known]
    possible, beyond = (unlike[mask] for mask in (np.abs(seconds) < _POSSIBLE + 0.5 * every, np.abs(seconds) > _LATE))
    if not possible.size or not beyond.size:
        return Lag(0.0, 1.0, 1.0)
    best = int(np.argmin(unlike))
    return Lag(float(seconds[best]), float(unlike[best]), float(possible.min() / beyond.min()))


def _within(signal: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Sums of a signal from one index to before another."""
    sums = np.concatenate([[0.0], np.cumsum(signal)])
    return sums[end] - sums[begin]
