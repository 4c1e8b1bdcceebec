"""A measurement: a folder with ``measurement.toml`` and data files, or one data file.

Every channel keeps its own clock: rows in which it is absent are left out, nothing is resampled.
``README.md`` beside this file describes the format for those who write one.
"""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from cosim import units
from cosim.measured.canonical import CANONICAL
from cosim.measured.columns import Column, DataTable
from cosim.measured.samples import in_order, unwound
from cosim.measured.tables import read_table
from cosim.messages import did_you_mean
from cosim.signals import Table
from driveline.quantities import InputError
from driveline.toml import read_toml

log = logging.getLogger("cosim")

KINDS = ("tip_in", "tip_out", "ramp", "step", "pulse_train", "coast_down", "cruise", "sweep", "drive",
         "bench")
_KEYS = {
    "measurement": ("vehicle", "variant", "manoeuvre", "channels", "note"),
    "manoeuvre": ("file", "kind", "gear", "back", "name", "channels", "note", "start", "stop"),
    "channel": ("column", "group", "unit", "time", "factor", "delay"),
    "clock": ("column", "unit", "factor"),
}
# What a unit means on an instrument of that kind, by the unit of the signal and as written: tachometers count
# revolutions, accelerometers weights. A speed of rotation in 1/s may be either, and is refused.
_MEANT = {("rad/s", "1/min"): "rpm", ("m/s2", "g"): "g_0"}
_SAME_INSTANT = 1e-6  # s: by how much instants of one clock differ that was written twice


@dataclass(frozen=True)
class Channel:
    """One measured signal on its own clock.

    Attributes:
        name: Canonical name.
        unit: SI unit.
        time: Instants [s], increasing, irregular.
        values: In ``unit``, finite, same shape.
        source: Column and unit it came from, for messages and provenance.
    """

    name: str
    unit: str
    time: np.ndarray
    values: np.ndarray
    source: str

    def gaps(self, factor: float = 5.0) -> list[tuple[float, float]]:
        """Spans [s] without a sample, longer than ``factor`` times the median distance."""
        distance = np.diff(self.time)
        if not distance.size:
            return []
        wide = np.flatnonzero(distance > factor * np.median(distance))
        return [(float(self.time[i]), float(self.time[i + 1])) for i in wide]

    def at(self, time: np.ndarray | float) -> np.ndarray:
        """Values at other instants [s]: linear between samples, the last one held if it is discrete."""
        return self.as_signal().values(np.asarray(time, dtype=np.float64))

    def as_signal(self, interpolation: str | None = None) -> Table:
        """To drive an input with; ``linear`` or ``hold``, by default what suits the signal."""
        suitable = "hold" if CANONICAL[self.name].discrete else "linear"
        return Table(times=self.time, data=self.values, unit=self.unit,
                     interpolation=interpolation or suitable)


@dataclass(frozen=True)
class Manoeuvre:
    """One recording.

    Attributes:
        name: Its own name, or that of the file.
        kind: One of ``KINDS``; empty where it is not said.
        gear: The gear throughout, or None.
        channels: By canonical name.
        back: Whether the road was driven the other way than in the other recordings.
        provenance: File and its SHA-256.
        notices: What the reader had to repair or leave out.
        begun: First instant of its file [s], before it was cut; None: as its channels.
    """

    name: str
    kind: str
    gear: int | None
    channels: Mapping[str, Channel]
    back: bool = False
    provenance: Mapping[str, Any] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    begun: float | None = None

    def __getitem__(self, name: str) -> Channel:
        if name not in self.channels:
            raise InputError(f"manoeuvre '{self.name}' has no channel '{name}'"
                             f"{did_you_mean(name, self.channels, 20)}")
        return self.channels[name]

    def __contains__(self, name: str) -> bool:
        return name in self.channels

    def without(self, names: Sequence[str]) -> Manoeuvre:
        """The same, without some of its channels."""
        return replace(self, channels={name: of for name, of in self.channels.items() if name not in names})

    @property
    def zero(self) -> float:
        """The whole second [s] in which its file begins, or just before which: 0, or the time of day."""
        begun = _span(self.channels)[0] if self.begun is None else self.begun
        return float(np.floor(begun + 0.1))

    def from_zero(self) -> Manoeuvre:
        """The same, with clocks that count from ``zero``."""
        channels = {name: replace(channel, time=channel.time - self.zero) for name, channel in self.channels.items()}
        return replace(self, channels=channels, begun=0.0) if self.zero else self

    @property
    def start(self) -> float:
        """First instant [s] from which on all channels have values."""
        return max(float(channel.time[0]) for channel in self.channels.values())

    @property
    def stop(self) -> float:
        """Last instant [s] until which all channels have values."""
        return min(float(channel.time[-1]) for channel in self.channels.values())


@dataclass(frozen=True)
class Measurement:
    """Manoeuvres of one vehicle.

    Attributes:
        name: Name of the folder or file.
        vehicle: Name or path of the vehicle file; None where it is not said.
        variant: Variant of the vehicle, or None.
        manoeuvres: At least one.
    """

    name: str
    vehicle: str | None
    variant: str | None
    manoeuvres: tuple[Manoeuvre, ...]

    def __getitem__(self, name: str) -> Manoeuvre:
        found = {manoeuvre.name: manoeuvre for manoeuvre in self.manoeuvres}
        if name not in found:
            raise InputError(f"measurement '{self.name}' has no manoeuvre '{name}'"
                             f"{did_you_mean(name, found)}")
        return found[name]


def load(path: str | Path, description: Mapping[str, Any] | None = None) -> Measurement:
    """Read a measurement.

    Args:
        path: A folder with ``measurement.toml``, that file, or one data file.
        description: For a data file: what its ``measurement.toml`` would say, if the columns do not
            bear canonical names; its (only) manoeuvre then needs no ``file``.

    Raises:
        InputError: Anything in it cannot be understood; the message names file, line, table or column.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "measurement.toml"
        if not path.is_file():
            raise InputError(f"{path.parent} has no measurement.toml")
    if not path.is_file():
        raise InputError(f"there is no measurement {path}")
    if path.suffix == ".toml":
        return _described(read_toml(path)[1], str(path), path.parent, path.parent.name)
    described = dict(description or {})
    manoeuvres = _manoeuvres(described, str(path)) if described.get("manoeuvre") else [{}]
    if len(manoeuvres) != 1:
        raise InputError(f"{path} is one data file, but {len(manoeuvres)} manoeuvres are described: "
                         "give the folder that holds all files")
    described["manoeuvre"] = [{**manoeuvres[0], "file": path.name}]
    return _described(described, str(path), path.parent, _stem(path))


def _described(described: Mapping[str, Any], where: str, folder: Path, name: str) -> Measurement:
    """A measurement from the contents of its ``measurement.toml``."""
    _check_keys(described, "measurement", where)
    vehicle, variant = (_text(described, key, where) for key in ("vehicle", "variant"))
    common = _table(described.get("channels", {}), f"{where}: channels")
    read = tuple(_manoeuvre(manoeuvre, common, where, folder) for manoeuvre in _manoeuvres(described, where))
    _refuse_twice(read, where)
    read = _with_names_of_their_own(read, ["name" in manoeuvre for manoeuvre in _manoeuvres(described, where)], where)
    for manoeuvre in read:
        for notice in manoeuvre.notices:
            log.warning("%s", notice)
    if vehicle and vehicle.endswith(".toml") and (folder / vehicle).is_file():
        vehicle = str(folder / vehicle)
    return Measurement(name, vehicle, variant, read)


def _with_names_of_their_own(read: tuple[Manoeuvre, ...], named: Sequence[bool], where: str) -> tuple[Manoeuvre, ...]:
    """Where a name is there twice those who got it from their file get their place behind it; said aloud.

    Args:
        named: Of each: whether the name was given to it.
    """
    given = [manoeuvre.name for manoeuvre, own in zip(read, named) if own]
    all_names = [manoeuvre.name for manoeuvre in read]
    taken, found = set(all_names), []
    for place, (manoeuvre, own) in enumerate(zip(read, named), start=1):
        old = manoeuvre.name
        if all_names.count(old) > 1 and (not own or given.count(old) > 1):
            name = f"{old}_{place}"
            while name in taken:
                name += "_"
            taken.add(name)
            manoeuvre = replace(manoeuvre, name=name)
            log.info("%s: there is more than one manoeuvre '%s': that of %s, number %d, is called '%s'", where, old,
                     manoeuvre.provenance["file"], place, name)
        found.append(manoeuvre)
    return tuple(found)


def _refuse_twice(read: Sequence[Manoeuvre], where: str) -> None:
    """The same seconds of the same data are no second recording: what was fitted would be judged by itself."""
    for both in combinations(read, 2):
        begins, ends = zip(*(_span(manoeuvre.channels) for manoeuvre in both))
        shared = min(ends) - max(begins)
        if len({manoeuvre.provenance["sha256"] for manoeuvre in both}) == 1 and shared > 0.0:
            files = " and ".join(dict.fromkeys(f"'{manoeuvre.provenance['file']}'" for manoeuvre in both))
            raise InputError(f"{where}: {shared:.3g} s of {files} are in two manoeuvres, and would count as two "
                             "recordings: leave one out, or part them by start and stop")


def _manoeuvres(described: Mapping[str, Any], where: str) -> list[Mapping[str, Any]]:
    """What is said of each recording."""
    manoeuvres = described.get("manoeuvre")
    if not isinstance(manoeuvres, list) or not manoeuvres:
        raise InputError(f"{where}: at least one [[manoeuvre]] is needed, in two brackets, as there may be several")
    return [_table(manoeuvre, f"{where}: manoeuvre") for manoeuvre in manoeuvres]


def _manoeuvre(described: Mapping[str, Any], common: Mapping[str, Any], where: str,
               folder: Path) -> Manoeuvre:
    _check_keys(described, "manoeuvre", where)
    file = described.get("file")
    if not isinstance(file, str):
        raise InputError(f"{where}: every [[manoeuvre]] needs file = \"...\"")
    where = f"{where}, {file}"
    kind, gear, back = _text(described, "kind", where) or "", described.get("gear"), described.get("back", False)
    if kind and kind not in KINDS:
        raise InputError(f"{where}: kind is {kind!r}{did_you_mean(kind, KINDS, 20)}")
    if gear is not None and (isinstance(gear, bool) or not isinstance(gear, int)):
        raise InputError(f"{where}: gear is {gear!r}: a whole number is needed")
    if not isinstance(back, bool):
        raise InputError(f"{where}: back is {back!r}: true is needed where the road was driven the other way")
    table = read_table(folder / file)  # an absolute path stays as it is
    mapping = {**common, **_table(described.get("channels", {}), f"{where}: channels")}
    clock = _table(mapping.pop("time", {}), f"{where}: channels.time")
    _check_keys(clock, "clock", f"{where}: channels.time")
    if not mapping:
        mapping = {name: {} for name in CANONICAL if name != "time" and name in table.names}
        if not mapping:
            raise InputError(f"{table.path}: no column bears a canonical name (engine_speed, vehicle_speed "
                             "...), so measurement.toml has to say what is what; there are "
                             f"{', '.join(table.names)}")
    notices: list[str] = []
    channels = {}
    for name, entry in mapping.items():
        if name not in CANONICAL:
            raise InputError(f"{where}: channels.{name} is no canonical signal"
                             f"{did_you_mean(name, CANONICAL)}")
        channels[name] = _channel(name, _table(entry, f"{where}: channels.{name}"), clock, table, where, notices)
    begun, _ = _span(channels)
    span = {key: _seconds(described[key], f"{where}: {key}") for key in ("start", "stop") if key in described}
    if span:
        channels = {name: _within(channel, where, **span) for name, channel in channels.items()}
    digest = hashlib.sha256(table.path.read_bytes()).hexdigest()
    return Manoeuvre(
        str(described.get("name", _stem(Path(file)))), kind, gear, channels, back,
        {"file": table.path.name, "sha256": digest,
         "channels": {name: channel.source for name, channel in channels.items()}},
        tuple(f"{table.path.name}: {notice}" for notice in dict.fromkeys(notices)), begun)


def _span(channels: Mapping[str, Channel]) -> tuple[float, float]:
    """First and last instant [s] of any channel."""
    times = [channel.time for channel in channels.values()]
    return min(float(time[0]) for time in times), max(float(time[-1]) for time in times)


def _channel(name: str, entry: Mapping[str, Any], clock: Mapping[str, Any], table: DataTable,
             where: str, notices: list[str]) -> Channel:
    """One channel in SI on its own clock; what was repaired or not used is appended to ``notices``."""
    where = f"{where}: channels.{name}"
    _check_keys(entry, "channel", where)
    columns = entry.get("column", name)
    columns = [columns] if isinstance(columns, str) else columns
    if not isinstance(columns, list) or not columns or not all(isinstance(c, str) for c in columns):
        raise InputError(f"{where}: column is {entry.get('column')!r}: a name, or several to take the mean "
                         "of, is needed")
    group = entry.get("group")
    if group is not None and (isinstance(group, bool) or not isinstance(group, int)):
        raise InputError(f"{where}.group is {group!r}: the number of a channel group is needed, the first is 0")
    delay = _seconds(entry.get("delay", 0.0), f"{where}.delay")
    clocks, parts, sources = [], [], []
    for label in columns:
        column = table.column(label, group)
        unit = entry.get("unit", column.unit)
        if unit is None:
            if label != name and CANONICAL[name].unit != "1":  # a canonical name stands for its unit too
                raise InputError(f"{where}: column '{label}' has no unit: write unit = \"...\" "
                                 f"(the canonical one is {CANONICAL[name].unit})")
            unit = CANONICAL[name].unit
        clocks.append(_times(entry, clock, column, table, where, notices) - delay)
        parts.append(_in_si(column.values, name, str(unit), entry, where))
        sources.append(f"{label} [{unit}]" + ("" if group is None else f", group {group}")
                       + (f", {delay:g} s late" if delay else ""))
        if clocks[0].size != clocks[-1].size or not np.allclose(
                clocks[0], clocks[-1], rtol=0.0, atol=_SAME_INSTANT, equal_nan=True):
            raise InputError(f"{where}: columns '{columns[0]}' and '{label}' of {table.path.name} are sampled at "
                             "instants of their own, and nothing is resampled to take a mean: name one of them")
    label = " and ".join(columns)
    mean = np.mean(parts, axis=0)
    if all(np.isfinite(part).any() for part in parts) and not np.isfinite(mean).any():
        named = "' and '".join(columns)
        raise InputError(f"{where}: columns '{named}' of {table.path.name} are never sampled together, and nothing is "
                         "resampled to take a mean: name one of them")
    times, values = in_order(clocks[0], mean, table.path, label, notices)
    if CANONICAL[name].unit == "rad":
        values = unwound(values, label, notices)
    return Channel(name, CANONICAL[name].unit, times, values, " and ".join(sources))


def _in_si(values: np.ndarray, name: str, unit: str, entry: Mapping[str, Any], where: str) -> np.ndarray:
    """The numbers of a column in the unit of a canonical signal; ``factor`` of ``entry`` comes before ``unit``."""
    wanted = CANONICAL[name].unit
    try:
        if name == "road_grade" and units.parse(unit) == units.parse("%"):  # what it rises over what it runs
            return np.arctan(0.01 * _factor(entry, where) * values)
        meant = next((meant for (of, written), meant in _MEANT.items()
                      if of == wanted and units.parse(written) == units.parse(unit)), unit)
        factor, offset = units.conversion(meant, wanted)
    except InputError as error:
        raise InputError(f"{where}: {name} is measured in {wanted}: {error}{_other_quantity(name, unit)}") from error
    with np.errstate(over="ignore"):  # what has no number left in SI is infinite, and left out
        return factor * (_factor(entry, where) * values) + offset


def _other_quantity(name: str, unit: str) -> str:
    """How to make a signal of what control units tell in its place, in words; nothing where they tell nothing else."""
    try:
        if name == "wheel_speed":
            over = 1.0 / units.conversion(unit, "m/s")[0]
            return ('; of its circumference: write unit = "rad/s" and a factor of 1 over '
                    f"{over:.6g} times the rolling radius in m")
        if CANONICAL[name].unit == "N.m":
            share = units.conversion(unit, "1")[0]
            return (f'; as a share of a reference torque: write unit = "N.m" and a factor of {share:.6g} times that in '
                    "N.m")
    except InputError:
        pass
    return ""


def _factor(entry: Mapping[str, Any], where: str) -> float:
    """What a column is multiplied by before its unit."""
    factor = units.in_unit(entry.get("factor", 1.0), "", f"{where}.factor")
    if factor == 0.0 or not np.isfinite(factor):
        raise InputError(f"{where}.factor is {factor:g}: a finite number other than 0 is needed")
    return factor


def _seconds(value: Any, what: str) -> float:
    """A time [s]; text may have another unit of time."""
    seconds = units.in_unit(value, "s", what)
    if not np.isfinite(seconds):
        raise InputError(f"{what} is {seconds:g}: a finite time is needed")
    return seconds


def _times(entry: Mapping[str, Any], clock: Mapping[str, Any], column: Column, table: DataTable,
           where: str, notices: list[str]) -> np.ndarray:
    """The clock of a column [s]: the one named for it, the file's own for it, or the common one (``clock``)."""
    if "time" not in entry and column.times is not None:
        if clock:
            notices.append("every channel has its own clock in this file, so [channels.time] is not used; "
                           "time = \"...\" under a channel names another one for it")
        return column.times
    common = clock.get("column", "time")
    named = entry.get("time", common)
    if not isinstance(named, str):
        raise InputError(f"{where}: time is {named!r}: the name of a column is needed")
    if named not in table.names and "time" not in entry and "column" not in clock:
        raise InputError(f"{where}: no clock: add [channels.time] with column = \"...\" and unit = \"s\""
                         f"; {table.path.name} has {', '.join(table.names)}")
    group = entry.get("group")  # of a channel of an MDF file: its clock, too, if that is in that group
    read = table.column(named, group if group in table.groups.get(named, ()) else None)
    if read.values.size != column.values.size:
        raise InputError(f"{where}: {column.values.size} values, but its clock '{named}' has "
                         f"{read.values.size}: name its own clock with time = \"...\"")
    # what is said of the common clock holds for another one only as far as that does not say its unit itself
    said = {} if named != common and read.unit else clock
    return _in_si(read.values, "time", str(said.get("unit") or read.unit or "s"), said, f"{where}: clock '{named}'")


def _within(channel: Channel, where: str, start: float = -np.inf, stop: float = np.inf) -> Channel:
    inside = (channel.time >= start) & (channel.time <= stop)
    if not inside.any():
        raise InputError(f"{where}: {channel.name} has no values between start and stop; it runs from "
                         f"{channel.time[0]:g} to {channel.time[-1]:g} s")
    return Channel(channel.name, channel.unit, channel.time[inside], channel.values[inside], channel.source)


def _check_keys(table: Mapping[str, Any], kind: str, where: str) -> None:
    """Say so where a key has no meaning; others may keep their notes in the file, so it is no error."""
    for key in table:
        if key not in _KEYS[kind]:
            log.warning("%s: '%s' has no meaning in a %s and is ignored%s", where, key, kind,
                        did_you_mean(key, _KEYS[kind]))


def _text(table: Mapping[str, Any], key: str, where: str) -> str | None:
    """What a key says; None where it is missing."""
    value = table.get(key)
    if value is not None and not isinstance(value, str):
        raise InputError(f"{where}: {key} is {value!r}: text is needed")
    return value


def _table(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {value!r}: a table is needed")
    return value


def _stem(path: Path) -> str:
    packed = path.suffix.lower() in (".csv", ".gz")
    return re.sub(r"(\.csv)?(\.gz)?$", "", path.name, flags=re.IGNORECASE) if packed else path.stem
