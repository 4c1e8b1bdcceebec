"""What drives the inputs when no FMU does: constants, profiles and measured channels.

A signal is a pure function of time, evaluated for whole blocks of communication points at once.
Between two communication points the receiver holds it, as it holds everything.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cosim import units
from cosim.messages import did_you_mean
from driveline.quantities import InputError

INTERPOLATIONS = ("linear", "hold")
_TEXTS = ("unit", "interpolation")
_TIMES = ("time", "duration", "time_constant", "period", "width", "times")
_LISTS = ("times", "data")
# [s]: half the clock's nanosecond. "350 ms" is another double than the clock's 0.35, and so is what a logger's clock
# gives: without it whatever jumps there would jump a whole step later.
_SAME = 0.5e-9


@dataclass(frozen=True, kw_only=True)
class Signal:
    """A source of values over time.

    Attributes:
        unit: Unit of the values; empty means the unit of whatever input it is connected to.
    """

    kind: ClassVar[str] = ""
    unit: str = ""

    def __post_init__(self) -> None:
        for name in _TIMES:
            value = getattr(self, name, 0.0)
            if np.ndim(value) == 0 and not np.isfinite(value):
                raise InputError(f"{name} is {value:g}: a finite number is needed")

    def values(self, time: np.ndarray) -> np.ndarray:
        """The values at the instants ``time`` [s], same shape."""
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """For the provenance of a result: kind and attributes, of long tables only how long they are."""
        entries = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        for name, value in entries.items():
            if isinstance(value, np.ndarray):
                entries[name] = value.tolist() if value.size <= 20 else f"{value.size} values"
        return {"kind": self.kind, **entries}


@dataclass(frozen=True, kw_only=True)
class Constant(Signal):
    """The same value for ever."""

    kind: ClassVar[str] = "constant"
    value: float

    def values(self, time: np.ndarray) -> np.ndarray:
        return np.full(np.shape(time), float(self.value))


@dataclass(frozen=True, kw_only=True)
class Step(Signal):
    """``before``, and from ``time`` [s], to the nearest nanosecond, on ``after``."""

    kind: ClassVar[str] = "step"
    before: float
    after: float
    time: float

    def values(self, time: np.ndarray) -> np.ndarray:
        return np.where(time < self.time - _SAME, float(self.before), float(self.after))


@dataclass(frozen=True, kw_only=True)
class Ramp(Signal):
    """``before``, then from ``time`` [s] on straight to ``after``, reached ``duration`` [s] later."""

    kind: ClassVar[str] = "ramp"
    before: float
    after: float
    time: float
    duration: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, "duration")

    def values(self, time: np.ndarray) -> np.ndarray:
        return np.interp(time, [self.time, self.time + self.duration], [self.before, self.after])


@dataclass(frozen=True, kw_only=True)
class FirstOrder(Signal):
    """``before``, then from ``time`` [s] on towards ``after`` with ``time_constant`` [s]."""

    kind: ClassVar[str] = "first_order"
    before: float
    after: float
    time: float
    time_constant: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, "time_constant")

    def values(self, time: np.ndarray) -> np.ndarray:
        elapsed = np.maximum(time - self.time, 0.0)
        return self.after + (self.before - self.after) * np.exp(-elapsed / self.time_constant)


@dataclass(frozen=True, kw_only=True)
class PulseTrain(Signal):
    """``low``, with pulses of ``high`` that begin at ``time`` [s] and every ``period`` [s] after.

    Attributes:
        width: Length of a pulse [s], shorter than the period.
        count: Number of pulses; 0 for pulses to the end of the run.
    """

    kind: ClassVar[str] = "pulse_train"
    low: float
    high: float
    time: float
    period: float
    width: float
    count: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive(self, "period")
        _positive(self, "width")
        if self.count < 0 or not float(self.count).is_integer():
            raise InputError(f"count is {self.count:g}: a whole number is needed, 0 for pulses to the end")
        if self.width >= self.period:
            raise InputError(f"width is {self.width:g} s: less than the period, {self.period:g} s, is needed")

    def values(self, time: np.ndarray) -> np.ndarray:
        # a nanosecond of tolerance, the resolution of the clock: k * period is not exact in floats
        number = np.floor((time - self.time + 1e-9) / self.period)
        within = time - self.time - number * self.period < self.width - 1e-9
        on = (number >= 0) & within & ((number < self.count) if self.count else True)
        return np.where(on, float(self.high), float(self.low))


@dataclass(frozen=True, kw_only=True)
class Table(Signal):
    """Values at given times; before the first and after the last they are held.

    Attributes:
        times: Instants [s], increasing.
        data: One value for each instant.
        interpolation: ``linear`` between the instants, or ``hold`` the last one, to the nearest nanosecond.
    """

    kind: ClassVar[str] = "table"
    times: Any
    data: Any
    interpolation: str = "linear"

    def __post_init__(self) -> None:
        times = np.asarray(self.times, dtype=np.float64)
        data = np.asarray(self.data, dtype=np.float64)
        if times.ndim != 1 or times.shape != data.shape or times.size == 0:
            raise InputError(f"times has {times.size} entries and data {data.size}: equally many are needed, "
                             "and at least one")
        if not (np.isfinite(times).all() and np.isfinite(data).all()):
            raise InputError("times or data contain a number that is not finite")
        if np.any(np.diff(times) <= 0.0):
            position = int(np.argmax(np.diff(times) <= 0.0))
            raise InputError(
                f"times do not increase from entry {position + 1} ({times[position]:g} s) to the next")
        if self.interpolation not in INTERPOLATIONS:
            raise InputError(f"interpolation is '{self.interpolation}'"
                             f"{did_you_mean(self.interpolation, INTERPOLATIONS)}")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "data", data)

    def values(self, time: np.ndarray) -> np.ndarray:
        if self.interpolation == "linear":
            return np.interp(time, self.times, self.data)
        return self.data[np.maximum(np.searchsorted(self.times, time + _SAME, side="right") - 1, 0)]


KINDS: dict[str, type[Signal]] = {
    signal.kind: signal for signal in (Constant, Step, Ramp, FirstOrder, PulseTrain, Table)
}


def from_table(entries: dict[str, Any]) -> Signal:
    """A signal from its TOML table: ``kind`` and the attributes of that kind.

    Times are in s and values in the unit of the signal; text carries a unit of its own.

    Raises:
        InputError: An unknown kind or key, a missing key, or a value of the wrong type.
    """
    entries = dict(entries)
    kind = entries.pop("kind", None)
    if kind not in KINDS:
        raise InputError(f"kind is {kind!r}{did_you_mean(str(kind), [*KINDS, 'measured'])}")
    fields = {field.name: field for field in dataclasses.fields(KINDS[kind])}
    for key, value in entries.items():
        if key not in fields:
            raise InputError(f"a signal of kind '{kind}' has no '{key}'{did_you_mean(key, fields)}")
        if key in _TEXTS and not isinstance(value, str):
            raise InputError(f"{key} is {value!r}: text is needed")
        if key in _LISTS and not isinstance(value, list):
            raise InputError(f"{key} is {value!r}: a list of numbers is needed")
    missing = [name for name, field in fields.items()
               if field.default is dataclasses.MISSING and name not in entries]
    if missing:
        raise InputError(f"a signal of kind '{kind}' also needs {', '.join(missing)}")
    own = {**dict.fromkeys(_TIMES, "s"), "count": ""}  # units that are not the signal's
    for key in (key for key in fields if key in entries and key not in _TEXTS):
        unit, value = own.get(key, entries.get("unit", "")), entries[key]
        entries[key] = _number(value, unit, key) if key not in _LISTS else [
            _number(entry, unit, f"entry {i} of {key}") for i, entry in enumerate(value, start=1)]
    return KINDS[kind](**entries)


def _number(value: Any, unit: str, what: str) -> float:
    """A number in ``unit``, or text with a unit of its own."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(f"{what} is {value!r}: a number is needed")
    return units.in_unit(value, unit, what) if isinstance(value, str) else value


def _positive(signal: Signal, name: str) -> None:
    if not getattr(signal, name) > 0.0:
        raise InputError(f"{name} is {getattr(signal, name):g}: a positive number is needed")
