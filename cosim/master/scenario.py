"""A scenario file: who takes part, what is connected to what, and what the driver does.

``cosim/scenarios/README.md`` describes the format; the files beside it show it.
"""

from __future__ import annotations

import hashlib
import logging
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cosim import units
from cosim.master.clock import PER_SECOND, step_length
from cosim.master.connections import number
from cosim.master.master import Master
from cosim.master.parameters import find_fmu
from cosim.measured import CANONICAL, Comparison, Manoeuvre, compare
from cosim.measured import load as load_measurement
from cosim.measured.tables import read_table
from cosim.messages import did_you_mean
from cosim.result import Result
from cosim.signals import KINDS, Constant, Signal, Table, from_table
from cosim.toml import TomlFile
from driveline.quantities import InputError

log = logging.getLogger("cosim")

SHIPPED = Path(__file__).parents[1] / "scenarios"

_KEYS = {
    "scenario": {"title": str, "step": None, "start": None, "stop": None, "order": str, "vehicle": str,
                 "variant": str, "gear": int, "fmu": dict, "signals": dict, "connections": dict,
                 "record": list, "record_step": None, "measurement": dict, "compare": dict},
    "measurement": {"path": str, "name": str, "note": str, "vehicle": str, "variant": str, "manoeuvre": list,
                    "channels": dict},
    "fmu": {"file": str, "twin": str, "step": None, "vehicle": str, "variant": str, "gear": int,
            "parameters": dict},
    "measured signal": {"kind": str, "channel": str, "interpolation": str, "above": None, "missing": None},
    "csv signal": {"kind": str, "file": str, "column": str, "time": str, "unit": str, "interpolation": str},
}
_TYPES = {str: "text", int: "a whole number", dict: "a table", list: "a list"}


def names() -> list[str]:
    """The scenarios that ship with the package."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


class Scenario:
    """A scenario, read and checked as far as that is possible without its FMUs.

    Args:
        file: The scenario file.
        overrides: ``participant.parameter`` (or input) to value; they win over the file.
        measurement: Path that replaces the measurement the file names.
        twins: Take every FMU's in-process twin.
    """

    def __init__(self, file: TomlFile, overrides: Mapping[str, float | str] | None = None,
                 measurement: str | Path | None = None, twins: bool = False) -> None:
        self._file, self._overrides, self._twins = file, dict(overrides or {}), twins
        self.name = file.path.stem
        table = self._table = file.table
        self._check(table, "scenario")
        if not table.get("fmu"):
            raise InputError(f"{file.path}: no FMU takes part: add [fmu.plant] with file = \"plant_fom\"")
        for name, entry in table["fmu"].items():
            self._check(entry, "fmu", "fmu", name)
            with file.at("fmu", name):
                if ("file" in entry) == ("twin" in entry):
                    raise InputError("either file (an FMU) or twin (a model in process) is needed")
        for signal, channel in table.get("compare", {}).items():
            with file.at("compare", signal):
                if not isinstance(channel, str):
                    raise InputError(f"it is {channel!r}: the name of a channel is needed")
        self.title = table.get("title", self.name)
        self.manoeuvre = self._load_manoeuvre(measurement)

    @classmethod
    def load(cls, path: str | Path, overrides: Mapping[str, float | str] | None = None,
             measurement: str | Path | None = None, twins: bool = False) -> Scenario:
        """Read a scenario file, or one of those that ship with the package by its name.

        Raises:
            InputError: The message names file, line and key, and what would be right.
        """
        path = Path(path)
        if not path.is_file() and path.suffix != ".toml" and len(path.parts) == 1:
            if path.name not in names():
                raise InputError(f"there is no scenario '{path}'{did_you_mean(path.name, names())}")
            path = SHIPPED / f"{path.name}.toml"
        return cls(TomlFile.read(path), overrides, measurement, twins)

    @property
    def start(self) -> float:
        """Where the run starts [s]: as said, or with the measurement, or at 0."""
        if "start" in self._table or self.manoeuvre is None:
            return self._seconds("start", 0.0)
        return math.ceil(self.manoeuvre.start / self._step - 1e-6) * self._step

    @property
    def stop(self) -> float:
        """Where it stops [s]: as said, or with the measurement."""
        if "stop" in self._table:
            return self._seconds("stop", 0.0)
        if self.manoeuvre is None:
            raise InputError(f"{self._file.path}: stop is missing: how long is the run, in s?")
        return math.floor(self.manoeuvre.stop / self._step + 1e-6) * self._step

    @property
    def _step(self) -> float:
        with self._file.at("step"):
            return step_length(self._table.get("step", 1e-3), "step") / PER_SECOND

    def master(self) -> Master:
        """Everything put together and checked, ready to run.

        Raises:
            InputError: The message names file, line and key, and what would be right.
        """
        table, at = self._table, self._file.at
        step = self._step
        with at("order"):
            master = Master(step, table.get("order", "jacobi"))
        for name, entry in table["fmu"].items():
            self._add(master, name, entry)
        for name, entry in table.get("signals", {}).items():
            with at("signals", name):
                master.signal(name, self._signal(name, entry))
        connections = dict(table.get("connections", {}))
        for name, value in self._overrides.items():
            try:
                self._override(master, connections, name, value)
            except InputError as error:
                raise InputError(f"--set {name}={value}: {error}") from error
        for target, source in connections.items():
            with at("connections", target):
                if isinstance(source, bool) or not isinstance(source, str | int | float):
                    raise InputError(f"the source is {source!r}: an output, a signal or a number is needed")
                master.connect(source, target)
        with at("record"):
            master.record(*table.get("record", []),
                          step=self._seconds("record_step", 0.0) if "record_step" in table else None)
        self._check_pairs(master)
        provenance: dict[str, Any] = {
            "scenario": self._file.path.name,
            "scenario_sha256": hashlib.sha256(self._file.text.encode()).hexdigest()}
        if self._overrides:
            provenance["set"] = dict(self._overrides)
        if self.manoeuvre is not None:
            provenance["measurement"] = {"manoeuvre": self.manoeuvre.name, **self.manoeuvre.provenance}
        return master.describe(**provenance)

    def run(self, progress: Callable[[float], None] | None = None) -> Result:
        """Put together and run; see ``Master.run``."""
        master, start, stop = self.master(), self.start, self.stop
        try:
            return master.run(stop, start, progress)
        except InputError as error:
            raise InputError(f"{self._file.path}: {error}") from error

    def compare(self, result: Result) -> list[Comparison]:
        """The pairs of the file's ``[compare]``; empty without it."""
        pairs = self._table.get("compare", {})
        if not pairs:
            return []
        with self._file.at("compare"):
            if self.manoeuvre is None:
                raise InputError("there is no measurement to compare with: add [measurement]")
            return compare(result, self.manoeuvre, pairs)

    def _check_pairs(self, master: Master) -> None:
        """What ``compare`` will not like is said before the run: a result without motion is compared."""
        if self._table.get("compare"):
            with self._file.at("record"):
                recorded = master.recorded()
            self.compare(Result(np.array([self.start, self.stop]), {name: np.zeros(2) for name in recorded}, recorded))

    def _add(self, master: Master, name: str, entry: dict[str, Any]) -> None:
        twin = entry.get("twin") or (Path(entry["file"]).stem if self._twins else None)
        common = {key: self._table[key] for key in ("vehicle", "variant", "gear") if key in self._table}
        if self.manoeuvre is not None and self.manoeuvre.gear is not None:
            common.setdefault("gear", self.manoeuvre.gear)
        options = {**common, **{key: entry[key] for key in ("vehicle", "variant", "gear") if key in entry}}
        if "vehicle" in options and (self._file.path.parent / options["vehicle"]).is_file():
            options["vehicle"] = str(self._file.path.parent / options["vehicle"])
        with self._file.at("fmu", name):
            what = twin or find_fmu(entry["file"], self._file.path.parent)
            master.add(name, what, step=entry.get("step"), twin=bool(twin), **options)
        for parameter, value in entry.get("parameters", {}).items():
            with self._file.at("fmu", name, "parameters", parameter):
                if isinstance(value, dict):
                    value = self._measured_value(value)
                master.set(f"{name}.{parameter}", value)

    def _measured_value(self, entry: dict[str, Any]) -> str:
        """``{ measured = "vehicle_speed" }``: what was measured where the run starts."""
        if set(entry) != {"measured"} or not isinstance(entry["measured"], str) or self.manoeuvre is None:
            raise InputError(f"the value is {entry!r}: a number, text with a unit, or with a [measurement] "
                             "also { measured = \"vehicle_speed\" } is needed")
        channel = self.manoeuvre[entry["measured"]]
        return f"{float(channel.at(self.start))!r} {channel.unit}"

    def _signal(self, name: str, entry: Any) -> Signal:
        kind = entry.get("kind") if isinstance(entry, dict) else None
        if kind is None or kind not in (*KINDS, "measured", "csv"):
            raise InputError(f"kind is {kind!r}{did_you_mean(str(kind), [*KINDS, 'measured', 'csv'], 20)}")
        if kind == "measured":
            self._check(entry, "measured signal", "signals", name)
            return self._measured_signal(entry.get("channel", name), entry)
        if kind == "csv":
            self._check(entry, "csv signal", "signals", name)
            if "file" not in entry or "column" not in entry:
                raise InputError("a signal of kind 'csv' needs file and column")
            return self._csv_signal(entry)
        signal = from_table(entry)
        units.parse(signal.unit)  # says so here, where the line is known, if nobody knows it
        return signal

    def _measured_signal(self, name: str, entry: dict[str, Any]) -> Signal:
        """A channel, or the value for one that is missing; with ``above`` a switch that is 1 while it is above that."""
        if self.manoeuvre is None:
            raise InputError("there is no measurement: add [measurement], or give one when running")
        signal: Constant | Table
        if name not in self.manoeuvre and "missing" in entry and name in CANONICAL:
            unit = CANONICAL[name].unit
            signal = Constant(value=units.in_unit(entry["missing"], unit, "missing"), unit=unit)
        else:
            signal = self.manoeuvre[name].as_signal(entry.get("interpolation"))
        if "above" not in entry:
            return signal
        above = units.in_unit(entry["above"], signal.unit, "above")
        if isinstance(signal, Constant):
            return Constant(value=float(signal.value > above), unit="1")
        return Table(times=signal.times, data=(signal.data > above).astype(np.float64), unit="1", interpolation="hold")

    def _csv_signal(self, entry: dict[str, Any]) -> Table:
        """A column over a time column, in s where its header says no unit; rows without either are left out."""
        table = read_table(self._file.path.parent / entry["file"])
        column, clock = table.column(entry["column"]), table.column(entry.get("time", "time"))
        factor, _ = units.conversion(clock.unit or "s", "s")
        times = factor * clock.values
        present = np.isfinite(times) & np.isfinite(column.values)
        return Table(times=times[present], data=column.values[present],
                     unit=entry.get("unit", column.unit or ""),
                     interpolation=entry.get("interpolation", "linear"))

    def _override(self, master: Master, connections: dict[str, Any], name: str, value: float | str) -> None:
        """A parameter is set; an input gets a constant in place of its source."""
        variable = master.variable(name)
        if variable.causality == "input" and variable.kind != "string":
            connections[name] = number(value, variable, name)
        else:
            master.set(name, value)

    def _load_manoeuvre(self, given: str | Path | None) -> Manoeuvre | None:
        entry = self._table.get("measurement")
        if entry is None and given is None:
            return None
        entry = entry or {}
        if given is None and "path" not in entry:
            raise InputError(f"{self._file.path} needs a measurement: give one with --measurement PATH "
                             "(a folder with measurement.toml, or a data file)")
        self._check(entry, "measurement", "measurement")
        path = Path(given) if given is not None else self._file.path.parent / entry["path"]
        description = {key: value for key, value in entry.items() if key not in ("path", "name", "note")}
        if path.is_file() and path.suffix != ".toml":
            if given is not None and "channels" in description:
                description["channels"] = _as_far_as_needed(description["channels"], path)
        elif given is None and path.exists() and description:
            with self._file.at("measurement", min(description)):
                raise InputError(f"what is in {path} is said by its measurement.toml: not here too")
        elif given is None and not path.exists():
            with self._file.at("measurement", "path"):
                raise InputError(f"there is no measurement {path}")
        measurement = load_measurement(path, description)
        if "name" in entry:
            with self._file.at("measurement", "name"):
                return measurement[entry["name"]]
        return measurement.manoeuvres[0]

    def _seconds(self, key: str, missing: float) -> float:
        with self._file.at(key):
            return units.in_unit(self._table.get(key, missing), "s", key)

    def _check(self, table: Any, kind: str, *keys: str) -> None:
        """Known keys of the right type, nothing else."""
        known = _KEYS[kind]
        with self._file.at(*keys) if keys else self._file.at(kind):
            if not isinstance(table, dict):
                raise InputError(f"it is {table!r}: a table is needed")
        for key, value in table.items():
            with self._file.at(*keys, key):
                if key not in known:
                    raise InputError(f"a {kind} has no such key{did_you_mean(key, known, 20)}")
                wanted = known[key]
                if wanted is not None and (not isinstance(value, wanted) or isinstance(value, bool)):
                    raise InputError(f"it is {value!r}: {_TYPES[wanted]} is needed")


def _as_far_as_needed(channels: dict[str, Any], path: Path) -> dict[str, Any]:
    """What of a description of columns holds for a data file that may say itself what they mean.

    A channel whose columns are not in the file is the column of its canonical name, or, where the file has others
    of those, absent. Where it has none, the description is all there is, and the reader says which column is missing.
    """
    columns = read_table(path).names

    def is_there(name: str, entry: Any) -> bool:
        column = entry.get("column", name) if isinstance(entry, dict) else None
        return all(c in columns for c in (column if isinstance(column, list) else [column]) if isinstance(c, str))

    described = {name: entry for name, entry in channels.items() if is_there(name, entry)}
    own = {name: {"column": name} for name in CANONICAL if name in columns and name not in described}
    if len(described) == len(channels) or not own.keys() - {"time"}:
        return channels
    for name in sorted(channels.keys() - described.keys() - own.keys()):
        log.info("%s has no column for %s", path.name, name)
    return {**own, **described}
