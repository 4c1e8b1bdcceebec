"""Vehicle files: every number of the full-order plant with its unit and its source, as TOML.

``docs/vehicles.md`` describes the format. Numbers become SI here, once; the rest of the package
sees plain floats by structured name.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from ..elements.driveline_parts import GEARS
from ..elements.planetary import NEUTRAL, Gearbox, PlanetarySet, ShiftElement
from ..quantities import InputError, Variable, declared, from_values, parameter_variables, spelled_for_pint
from ..toml import read_toml

BASELINE = "baseline"
_FOLDER = Path(__file__).parent
_NUMBERED = re.compile(r"^(.*)\[(\d+)\]$")


@dataclass(frozen=True)
class Vehicle:
    """The parameters of one vehicle in one variant.

    Attributes:
        name: Name of the vehicle file without its ending.
        variant: ``baseline`` (the file as written) or the name of the variant applied to it.
        values: Structured name (``axle_shaft.stiffness``, ``transmission.ratio[7]``) to value in SI.
        sources, units, places: Of what stands in the file, the same names to where the number comes from, to the unit
            the file used, and to "file, line N", for messages.
        gearbox: The planetary gearbox the ratios came from; None for a plain ratio table.
        file: Path of the vehicle file, for messages.
    """

    name: str
    variant: str
    values: dict[str, float]
    sources: dict[str, str]
    units: dict[str, str] = field(repr=False)
    places: dict[str, str] = field(repr=False)
    gearbox: Gearbox | None = field(default=None, repr=False)
    file: str = field(default="", repr=False)

    def parameters(self, kind: type) -> Any:
        """The parameters of a plant, as an instance of its dataclass of quantities.

        Raises:
            InputError: A name is not known, a number is missing, or ``check`` finds something.
        """
        known = declared(kind)
        for name in self.values:  # first: of a name with a slip the right one is missing too
            bare = _NUMBERED.sub(r"\1", name)
            if bare not in known:
                raise InputError(f"{self._place(name)}: {_unknown(name, known)}")
            if known[bare][1] != (bare != name):
                raise InputError(f"{self._place(name)}: {bare} is " + (
                    "a table: write values = [...]" if bare == name else "one number: write value = ..."))
        try:
            parameters = from_values(kind, self.values)
        except InputError as error:
            raise InputError(f"{self.file or self.name}: {error}") from None
        self.check(parameter_variables(parameters))
        return parameters

    def _place(self, name: str) -> str:
        """File and line of a number, as far as they are known."""
        return self.places.get(name, self.file or self.name)

    def check(self, variables: Iterable[Variable]) -> None:
        """Compare with the declared parameters of a plant.

        Args:
            variables: Declared variables; those that are not parameters are ignored.

        Raises:
            InputError: A name is not declared, a unit has another dimension than the declared one,
                or a value is out of range; the message names file, line and what would be right.
        """
        known = {v.name: v for v in variables if v.causality == "parameter"}
        for name, value in self.values.items():
            place = self._place(name)
            if name not in known:
                raise InputError(f"{place}: {_unknown(name, known)}")
            variable = known[name]
            unit = self.units.get(name, variable.unit)
            if not _same_dimension(unit, variable.unit):
                raise InputError(f"{place}: {name} is given in {unit!r}: "
                                 f"{variable.unit!r} or a unit of its dimension is needed")
            try:
                variable.check(value)
            except InputError as error:
                raise InputError(f"{place}: {error}") from None


def names() -> list[str]:
    """The vehicles that ship with the package."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def variants(name_or_path: str | Path) -> list[str]:
    """``baseline`` and the variants a vehicle file declares."""
    return [BASELINE, *_File(name_or_path).variants]


def load(name_or_path: str | Path, variant: str | None = None) -> Vehicle:
    """Read a vehicle file, apply a variant and convert everything to SI.

    Args:
        name_or_path: One of ``names()``, or the path of a TOML file.
        variant: One of ``variants(...)``; None means ``baseline``, the file as written.

    Raises:
        InputError: The file is missing or says something that has no meaning; the message names
            file, line, table and entry, and what would be right.
    """
    file = _File(name_or_path)
    entries, gearbox = file.entries()
    variant = BASELINE if variant is None else variant
    if variant != BASELINE:
        if variant not in file.variants:
            known = ", ".join([BASELINE, *file.variants])
            raise InputError(f"{file.path}: no variant {variant!r}; there are {known}")
        file.change(entries, variant)
    return Vehicle(
        file.path.stem, variant,
        values={name: e.value for name, e in entries.items()},
        sources={name: e.source for name, e in entries.items()},
        units={name: e.unit for name, e in entries.items()},
        places={name: e.place for name, e in entries.items()},
        gearbox=gearbox, file=str(file.path))


@dataclass(frozen=True)
class _Entry:
    """One scalar in SI, the unit it was written in, its source and its place in the file."""

    value: float
    unit: str
    source: str
    place: str


class _File:
    """A parsed vehicle file that knows on which line everything stands."""

    def __init__(self, name_or_path: str | Path) -> None:
        self.path = Path(name_or_path)
        if str(name_or_path) in names():
            self.path = _FOLDER / f"{name_or_path}.toml"
        if not self.path.is_file():
            raise InputError(f"no vehicle {str(name_or_path)!r}: the path of a TOML file is needed, "
                             f"or one of {', '.join(names())}")
        text, self.data = read_toml(self.path)
        self.lines = dict(_lines(text))
        self.variants = self.data.pop("variant", {})
        if not isinstance(self.variants, dict) or set(map(type, self.variants.values())) - {dict}:
            raise InputError(f"{self.place('variant')}: variants are tables such as [variant.modified]")

    def place(self, *keys: str) -> str:
        """File and line of a table or entry, or of the innermost table around it that has a line."""
        for end in range(len(keys), 0, -1):
            if keys[:end] in self.lines:
                return f"{self.path}, line {self.lines[keys[:end]]}"
        return str(self.path)

    def fail(self, keys: tuple[str, ...], what: str) -> InputError:
        return InputError(f"{self.place(*keys)}: [{'.'.join(keys[:-1])}] {keys[-1]}: {what}")

    def entries(self) -> tuple[dict[str, _Entry], Gearbox | None]:
        """All scalars of the file by structured name, and the gearbox if there is one."""
        entries: dict[str, _Entry] = {}
        for section, table in self.data.items():
            if section == "gearbox":
                continue
            if not isinstance(table, dict):
                raise InputError(f"{self.place(section)}: {section} stands alone: tables such as "
                                 "[vehicle] with entries such as mass = { value, unit, source } are needed")
            for name, given in table.items():
                entries |= self.entry((section, name), given)
        gearbox = None
        if "gearbox" in self.data:
            gearbox = self.gearbox()
            for name in ("ratio", "inertia"):
                if f"transmission.{name}[1]" in entries:
                    raise self.fail(("transmission", name), "[gearbox] gives it already; leave one out")
            entries |= self.gear_tables(gearbox)
        return entries, gearbox

    def entry(self, keys: tuple[str, ...], given: Any) -> dict[str, _Entry]:
        """One entry of the file: a scalar, or a table as ``name[1]``, ``name[2]`` ..."""
        needed = 'write { value = ..., unit = "...", source = "..." }, or values = [...] for a table'
        if not isinstance(given, dict):
            raise self.fail(keys, needed)
        if unknown := sorted(set(given) - {"value", "values", "unit", "source"}):
            raise self.fail(keys, f"{unknown[0]!r} is not known here; {needed}")
        if ("value" in given) == ("values" in given):
            raise self.fail(keys, f"exactly one of value and values; {needed}")
        unit, source = self.unit(keys, given), self.source(keys, given)
        name, place = ".".join(keys), self.place(*keys)
        if "value" in given:
            return {name: _Entry(self.si(keys, given["value"], unit), unit, source, place)}
        if not isinstance(given["values"], list) or not given["values"]:
            raise self.fail(keys, "values needs a list of numbers")
        return {f"{name}[{i}]": _Entry(self.si(keys, number, unit), unit, source, place)
                for i, number in enumerate(given["values"], start=1)}

    def unit(self, keys: tuple[str, ...], given: dict[str, Any]) -> str:
        unit = given.get("unit")
        if not isinstance(unit, str):
            raise self.fail(keys, 'unit = "..." is missing ("1" for a pure number)')
        try:
            _factor(unit)
        except ValueError as error:
            raise self.fail(keys, str(error)) from None
        return unit

    def source(self, keys: tuple[str, ...], given: dict[str, Any]) -> str:
        source = given.get("source")
        if not isinstance(source, str) or not source.strip():
            raise self.fail(keys, 'source = "..." is missing: say where the number comes from')
        return source

    def si(self, keys: tuple[str, ...], number: Any, unit: str) -> float:
        """A number of the file in SI."""
        if not isinstance(number, (int, float)) or number - number != 0.0:
            raise self.fail(keys, f"{number!r} is not a finite number")
        if isinstance(number, bool) and unit != "1":
            raise self.fail(keys, f"{number!r} is a switch, which has unit \"1\", not {unit!r}")
        return float(number) * _factor(unit)

    def change(self, entries: dict[str, _Entry], variant: str) -> None:
        """Apply the changes of a variant; a name without index changes a whole table."""
        for name, given in self.variants[variant].items():
            keys = ("variant", variant, name)
            operations = {"add", "times", "set"} & set(given) if isinstance(given, dict) else set()
            known = operations | ({"source"} if operations == {"times"} else {"unit", "source"})
            if len(operations) != 1 or set(given) - known:
                raise self.fail(keys, "write one of add, times, set, then unit (not with times) and source, "
                                      'for example { add = 300, unit = "kg", source = "..." }')
            targets = [n for n in entries if n == name or _NUMBERED.sub(r"\1", n) == name]
            if not targets:
                raise self.fail(keys, _unknown(name, entries, "not in this file"))
            operation, source = operations.pop(), self.source(keys, given)
            unit = "1" if operation == "times" else self.unit(keys, given)
            number = self.si(keys, given[operation], unit)
            for target in targets:
                old = entries[target]
                if operation != "times" and not _same_dimension(unit, old.unit):
                    raise self.fail(keys, f"{unit!r} is not a unit of its dimension; "
                                          f"it was given in {old.unit!r}")
                value = {"add": old.value + number, "times": old.value * number, "set": number}[operation]
                entries[target] = _Entry(value, old.unit, f"{operation} {given[operation]}: {source}; "
                                                          f"before: {old.source}", self.place(*keys))

    def gearbox(self) -> Gearbox:
        """The planetary gearbox of the file."""
        table = self.data["gearbox"]
        needed = {"source": str, "input_shaft": str, "output_shaft": str, "sets": dict,
                  "shift_elements": dict, "clutch_table": dict, "inertia": dict}
        for name in sorted(set(needed) | set(table)):
            if name not in needed or not isinstance(table.get(name), needed[name]):
                problem = "is not known" if name not in needed else "is missing or of the wrong kind"
                raise self.fail(("gearbox", name), f"{problem}; [gearbox] has {', '.join(needed)}")
        self.source(("gearbox", "source"), table)

        def build(kind: type, group: str, name: str, given: Any) -> Any:
            wanted = {f.name: {"str": str, "int": int}[f.type] for f in dataclasses.fields(kind)}
            if not isinstance(given, dict) or {key: type(v) for key, v in given.items()} != wanted:
                described = ", ".join(f"{key} ({t.__name__})" for key, t in wanted.items())
                raise self.fail(("gearbox", group, name), f"needs exactly {described}")
            return kind(**given)

        parts = {group: {name: build(kind, group, name, given) for name, given in table[group].items()}
                 for group, kind in (("sets", PlanetarySet), ("shift_elements", ShiftElement))}

        inertias: dict[str, _Entry] = {}
        for shaft, given in table["inertia"].items():
            (inertias[shaft],) = self.entry(("gearbox", "inertia", shaft), given).values()
            if not _same_dimension(inertias[shaft].unit, "kg.m2"):
                raise self.fail(("gearbox", "inertia", shaft), "a moment of inertia such as kg.m2 is needed")
        clutch_table = {}
        for gear, engaged in table["clutch_table"].items():
            if gear not in {str(g) for g in GEARS}:
                raise self.fail(("gearbox", "clutch_table", gear), "gears are -1, 0 and 1 to 10")
            if not isinstance(engaged, list) or not all(isinstance(name, str) for name in engaged):
                raise self.fail(("gearbox", "clutch_table", gear), 'needs a list such as ["A", "B", "D"]')
            clutch_table[int(gear)] = tuple(engaged)
        if missing := [g for g in GEARS if g not in clutch_table]:
            raise self.fail(("gearbox", "clutch_table"), f"gear {missing[0]} is missing")
        try:
            return Gearbox(
                shafts=tuple(inertias), input_shaft=table["input_shaft"], output_shaft=table["output_shaft"],
                clutch_table=clutch_table, inertias=tuple(e.value for e in inertias.values()), **parts)
        except InputError as error:
            raise InputError(f"{self.place('gearbox')}: {error}") from None

    def gear_tables(self, gearbox: Gearbox) -> Iterator[tuple[str, _Entry]]:
        """``transmission.ratio`` and ``transmission.inertia`` of all gears, computed from the gearbox."""
        source = "computed from [gearbox]: " + self.data["gearbox"]["source"]
        for index, gear in enumerate(GEARS, start=1):
            place = self.place("gearbox", "clutch_table", str(gear))
            try:
                ratio = 1.0 if gear == NEUTRAL else gearbox.ratio(gear)
                inertia = gearbox.inertia_at_input(gear)
            except InputError as error:
                raise InputError(f"{place}: {error}") from None
            yield f"transmission.ratio[{index}]", _Entry(ratio, "1", source, place)
            yield f"transmission.inertia[{index}]", _Entry(inertia, "kg.m2", source, place)


def _lines(text: str) -> Iterator[tuple[tuple[str, ...], int]]:
    """Where each table header and each entry of a TOML text starts."""
    table: tuple[str, ...] = ()
    key = r'(?:"([^"]*)"|([\w-]+))'
    for number, line in enumerate(text.splitlines(), start=1):
        if header := re.match(r"\s*\[\s*([^\[\]]+?)\s*\]", line):
            table = tuple(quoted or bare for quoted, bare in re.findall(key, header[1]))
            yield table, number
        elif entry := re.match(rf"\s*{key}\s*=", line):
            yield (*table, entry[1] or entry[2]), number


def _unknown(name: str, known: Iterable[str], what: str = "not known") -> str:
    """"x is not known; did you mean y?", or what there is in its section, or which sections."""
    plain = sorted({_NUMBERED.sub(r"\1", n) for n in known})
    bare = _NUMBERED.sub(r"\1", name)
    if bare in plain:
        count = sum(_NUMBERED.sub(r"\1", n) == bare for n in known)
        return f"{name} is {what}: {bare} has {count if count > 1 else 'one value, no'} entries"
    section, _, entry = bare.partition(".")
    sections = sorted({n.partition(".")[0] for n in plain})
    inside = [n for n in plain if n.partition(".")[0] == section]
    # a slip in an entry's name leaves the section right, one in the section the entry's name
    if inside:
        entries = [n.partition(".")[2] for n in inside]
        close = [f"{section}.{e}" for e in difflib.get_close_matches(entry, entries, n=3)]
    else:
        meant = [f"{s}.{entry}" for s in difflib.get_close_matches(section, sections, n=1)]
        close = [n for n in meant if n in plain] or difflib.get_close_matches(bare, plain, n=3)
    if close:
        return f"{name} is {what}; did you mean {' or '.join(close)}?"
    return f"{name} is {what}; there are {', '.join(inside or sections)}"


@cache
def _registry() -> Any:
    import pint  # only whoever reads a vehicle file needs it; an FMU does not

    return pint.UnitRegistry(cache_folder=None)


@cache
def _unit(text: str) -> Any:
    """One ``text`` as a pint quantity in SI base units; levels in dB stay numbers in dB."""
    quantity = _registry().Quantity
    if text == "dB":
        return quantity(1.0, "dimensionless")
    try:
        return quantity(1.0, spelled_for_pint(text)).to_base_units()
    except Exception as error:  # pint raises half a dozen unrelated types for a unit it cannot read
        why = f": {error}" if str(error) else ""
        raise ValueError(f"unit {text!r} is not understood{why}; "
                         "spelled right are N.m/rad, kg.m2, rpm, deg, mm, %, 1") from None


def _factor(unit: str) -> float:
    """SI units in one ``unit``."""
    return float(_unit(unit).magnitude)


def _same_dimension(unit: str, other: str) -> bool:
    """Whether one can stand for the other; angles are not numbers, turns not periods, and a level in dB is only that.

    Angles have no dimension, so 60 rpm would pass for 6.28 Hz, 650 1/min for 11 rad/s, and 5 N.m/deg for 286 N.m. Where
    nothing but the angle is left out, as in N.m for N.m/rad, radians are meant.
    """
    if "dB" in (unit, other):
        return unit == other
    dimension = _unit(unit).dimensionality
    return dimension == _unit(other).dimensionality and (
        _angles(unit) == _angles(other) or (_angles(unit) == 0 and dimension != {"[time]": -1}))


def _angles(unit: str) -> int:
    """To which power a unit holds the radian."""
    return dict(_unit(unit).unit_items()).get("radian", 0)
