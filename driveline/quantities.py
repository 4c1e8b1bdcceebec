"""What a parameter or signal is: its name, unit and meaning, declared once.

Everything that shows a quantity to somebody (the FMU's model description, the documentation
tables, the messages about bad input, the units of a result file) reads it from here.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

WHOLE = (-2**31, 2**31 - 1)  # what an integer of FMI 2.0, which has 32 bits, can be
_POSSIBLE = {"integer": WHOLE, "boolean": (0, 1)}
_ANY = (-math.inf, math.inf)


class InputError(ValueError):
    """The input is wrong; the message names the variable, file or line and what would be right."""


def spelled_for_pint(unit: str) -> str:
    """A unit in FMI spelling (``kg.m2``, ``s-1``, ``%``), or as it is written on paper, in pint's.

    A dot multiplies, a digit after a letter is a power, and a revolution is a turn.

    Raises:
        ValueError: A number is raised to a power, which pint would work out for ever for 9**9**9**9.
    """
    spelled = unit.strip().replace("%", "percent").replace("·", "*").replace("°C", "degC").replace("°", "deg")
    spelled = re.sub(r"(?<=[A-Za-z0-9)])\.(?=[A-Za-z(])", "*", spelled)
    spelled = re.sub(r"([A-Za-z])\^?(-?\d+)", r"\1**\2", spelled)
    spelled = re.sub(r"\b(rev\b|[rU](?=/(min|s)\b))", "turn", spelled)
    if re.search(r"\d\s*(\*\*|\^)", spelled):
        raise ValueError("a number is raised to a power")
    return spelled


def behind(unit: str) -> str:
    """A unit as it stands behind its number, with the blank between them; nothing for a pure number."""
    return "" if unit in ("", "1") else f" {unit}"


@dataclass(frozen=True)
class Variable:
    """One scalar that crosses a model's boundary.

    Attributes:
        name: Structured name, for example ``axle_shaft.stiffness``.
        unit: SI unit in FMI spelling (``N.m/rad``, ``rad/s``, ``1``).
        meaning: One line for whoever sees the variable in a foreign tool.
        causality: ``parameter``, ``input`` or ``output``.
        variability: ``fixed``, ``tunable``, ``discrete`` or ``continuous``.
        kind: ``real``, ``integer`` or ``boolean``; the model stores all three as a double.
        start: Start value, in ``unit``.
        minimum, maximum: The range that makes sense; outside it the model refuses.
        nominal: Typical magnitude, for solvers and plots; None where 1 will do.
        depends_on: For an output: the inputs it depends on *within* one communication step
            without a state between them (empty: none).
    """

    name: str
    unit: str
    meaning: str
    causality: str = "parameter"
    variability: str = "fixed"
    kind: str = "real"
    start: float = 0.0
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None
    depends_on: tuple[str, ...] = ()

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value that is possible: as declared, and what an integer's 32 bits hold, or 0 and 1."""
        low, high = _POSSIBLE.get(self.kind, _ANY)
        return (low if self.minimum is None or self.minimum < low else self.minimum,
                high if self.maximum is None or self.maximum > high else self.maximum)

    def check(self, value: float) -> None:
        """Raise InputError unless ``value`` is finite and inside the range of this variable."""
        unit = behind(self.unit)
        if not value - value == 0.0:  # true for NaN and both infinities
            raise InputError(f"{self.name} is {value}: a finite number{unit and f' in{unit}'} is needed")
        low, high = self.range
        digits = ".10g" if self.kind == "integer" else "g"  # all of those an integer can have
        if value < low:
            raise InputError(f"{self.name} is {value:{digits}}{unit}: at least {low:{digits}} is needed")
        if value > high:
            raise InputError(f"{self.name} is {value:{digits}}{unit}: at most {high:{digits}} is possible")
        if self.kind != "real" and value != int(value):
            raise InputError(f"{self.name} is {value:g}: a whole number is needed")


def quantity(
    unit: str,
    meaning: str,
    *,
    start: Any = dataclasses.MISSING,
    minimum: float | None = None,
    maximum: float | None = None,
    nominal: float | None = None,
    tunable: bool = False,
    kind: str = "real",
) -> Any:
    """A parameter, as the field of an element's dataclass: unit and meaning stand on the field.

    A tuple-valued field is a table; its entries become ``name[1]``, ``name[2]`` ...
    """
    metadata = {
        "unit": unit, "meaning": meaning, "minimum": minimum, "maximum": maximum,
        "nominal": nominal, "variability": "tunable" if tunable else "fixed", "kind": kind,
    }
    return dataclasses.field(default=start, metadata=metadata)


def parameter_variables(owner: Any, prefix: str = "") -> Iterator[Variable]:
    """The parameters of a dataclass instance, depth first, as scalar variables.

    Args:
        owner: A dataclass instance whose fields are quantities, tuples of numbers or dataclasses.
        prefix: Put before every name, ending with a dot where it is not empty.
    """
    for field in dataclasses.fields(owner):
        value = getattr(owner, field.name)
        name = prefix + field.name
        if dataclasses.is_dataclass(value):
            yield from parameter_variables(value, name + ".")
            continue
        entries = [(name, value)]
        if isinstance(value, tuple):
            entries = [(f"{name}[{i}]", entry) for i, entry in enumerate(value, start=1)]
        for entry_name, entry in entries:
            yield Variable(entry_name, start=float(entry), **field.metadata)


_CONVERT = {"real": float, "integer": int, "boolean": bool}


@functools.cache
def _layout(kind: type) -> tuple[tuple[dataclasses.Field, type | None, bool], ...]:
    """Every field of a dataclass of quantities, its class if it is another one, and whether it is a table.

    Slow, and the same for a class every time.
    """
    types = typing.get_type_hints(kind)
    return tuple((field, types[field.name] if dataclasses.is_dataclass(types[field.name]) else None,
                  typing.get_origin(types[field.name]) is tuple) for field in dataclasses.fields(kind))


@functools.cache
def declared(kind: type) -> Mapping[str, tuple[str, bool]]:
    """All that a dataclass of quantities declares: structured name to unit, and whether it is a table."""
    found: dict[str, tuple[str, bool]] = {}
    for field, nested, table in _layout(kind):
        if nested is None:
            found[field.name] = field.metadata["unit"], table
        else:
            found |= {f"{field.name}.{name}": of for name, of in declared(nested).items()}
    return found


def from_values(kind: type, values: Mapping[str, float], prefix: str = "") -> Any:
    """An instance of a dataclass of quantities, its scalars taken from ``values`` by structured name.

    Integers and booleans come back as such, tables as tuples. A field with a default may be missing.

    Raises:
        InputError: A value is missing; the message names it.
    """
    arguments: dict[str, Any] = {}
    for field, nested, table in _layout(kind):
        name = prefix + field.name
        if nested is not None:
            arguments[field.name] = from_values(nested, values, name + ".")
        elif table:
            entries = []
            while f"{name}[{len(entries) + 1}]" in values:
                entries.append(float(values[f"{name}[{len(entries) + 1}]"]))
            if not entries:
                raise InputError(f"{name}[1] is missing: a table of {field.metadata['meaning']}")
            arguments[field.name] = tuple(entries)
        elif name in values:
            arguments[field.name] = _CONVERT[field.metadata["kind"]](values[name])
        elif field.default is dataclasses.MISSING:
            raise InputError(f"{name} [{field.metadata['unit']}] is missing: {field.metadata['meaning']}")
    return kind(**arguments)
