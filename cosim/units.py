"""Units at the door: what FMUs, scenarios and measurements write, and how it converts.

The angle is a dimension of its own here. Otherwise 1 Hz would pass for 1 rad/s and N.m for N.m/rad,
the two mistakes that rotating machinery invites most.
"""

from __future__ import annotations

import functools
import math
import numbers
import re
from collections.abc import Mapping
from importlib import resources

import pint

from driveline.quantities import InputError, spelled_for_pint

_ANGLE_PREFIXES = ("", "milli", "micro", "ste")  # the steradian is a unit of its own
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$", re.DOTALL)
_defined: dict[str, str] = {}  # what FMUs say of units, by name
_ambiguous: set[str] = set()  # names that two FMUs define otherwise


@functools.cache
def registry() -> pint.UnitRegistry:
    """pint's units, with the angle as a dimension and ``Nm`` as everybody writes it."""
    folder, lines = resources.files("pint"), []
    for line in folder.joinpath("default_en.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("@import"):
            lines += folder.joinpath(line.split()[1]).read_text(encoding="utf-8").splitlines()
        else:
            lines.append("radian = [angle] = rad" if line.startswith("radian = []") else line)
    units = pint.UnitRegistry(None, autoconvert_offset_to_baseunit=True, on_redefinition="ignore")
    units.load_definitions(lines)  # defining the radian again later would leave what hangs on it as it was
    units.define("newton_metre = newton * meter = Nm")  # in pint a measure of yarn
    return units


def define(name: str, base: Mapping[str, int], factor: float = 1.0, offset: float = 0.0) -> None:
    """Note what an FMU says of a unit: it counts where nobody knows the name.

    Args:
        base: Exponents of kg, m, s, A, K, mol, cd and rad; ``value_in_base = factor * value + offset`` (FMI 2.0.4,
            section 2.2.2).
    """
    meaning = " * ".join([repr(factor), *(f"{unit} ** {power}" for unit, power in base.items())])
    meaning += f"; offset: {offset!r}" if offset else ""
    if _defined.setdefault(name, meaning) != meaning:  # one name, two units: whoever needs it is told
        _ambiguous.add(name)
        parse.cache_clear()
        conversion.cache_clear()


@functools.cache
def parse(text: str) -> pint.Unit:
    """The unit written as ``text``: FMI spelling (``kg.m2``, ``rad/s``, ``s-1``, ``1``) or pint's.

    Raises:
        InputError: Nobody knows this unit, two FMUs define it otherwise, or it is a multiple of the radian that
            nobody measures in.
    """
    try:
        return _known(text)
    except InputError:
        if text in _ambiguous:
            raise InputError(f"unit '{text}' is defined by two FMUs, and not alike") from None
        if text not in _defined:
            raise
    name = f"fmu_unit_{list(_defined).index(text)}"
    registry().define(f"{name} = {_defined[text]}")
    return registry().Unit(name)


def _known(text: str) -> pint.Unit:
    """As ``parse``, without what FMUs define."""
    if text.strip() in ("1", "", "-"):
        return registry().Unit("")
    try:
        unit = registry().parse_units(spelled_for_pint(text))
    except Exception as error:  # pint raises a dozen kinds, tokenizer errors among them
        raise InputError(
            f"unknown unit '{text}'; written like N.m, rad/s, rpm, km/h, m/s2, deg, %") from error
    for name, _ in registry().Quantity(1.0, unit).unit_items():
        if name.endswith("radian") and name.removesuffix("radian") not in _ANGLE_PREFIXES:
            raise InputError(f"unit '{text}' has a {name} in it; angles are written rad, mrad, deg or rev")
    return unit


@functools.cache
def conversion(source: str, target: str) -> tuple[float, float]:
    """Factor and offset with ``value_in_target = factor * value_in_source + offset``.

    Raises:
        InputError: A unit is unknown, the two do not measure the same thing, or one is a level as the dB, between
            which and a number there is no such line.
    """
    if source == target:
        if source in _ambiguous:
            parse(source)
        return 1.0, 0.0

    def converted(number: float) -> float:
        return float(registry().Quantity(number, parse(source)).to(parse(target)).magnitude)

    try:
        one, two, three = map(converted, (1.0, 2.0, 3.0))
        if not math.isclose(two - one, three - two, rel_tol=1e-6):
            raise InputError(f"'{source}' cannot be converted to '{target}': one is the logarithm of the other")
        zero = converted(0.0)
    except pint.DimensionalityError as error:
        raise InputError(f"'{source}' cannot be converted to '{target}'") from error
    return (one, 0.0) if zero == 0.0 else (one - zero, zero)


def in_unit(value: float | int | str, unit: str, what: str) -> float:
    """``value`` as a number in ``unit``: a plain number is in it already, text carries its own unit.

    Args:
        value: ``0.3``, ``"1.1 deg"`` or ``"1.1"``.
        unit: The unit wanted; empty where it is unknown, then text may carry none.
        what: Named in the message of the error.

    Raises:
        InputError: Neither a number nor a quantity of the right kind; a truth value is none, though Python counts
            with it.
    """
    if isinstance(value, numbers.Real) and not isinstance(value, bool):  # numpy's numbers too
        return float(value)
    match = _QUANTITY.match(value) if isinstance(value, str) else None
    if match is None:
        raise InputError(f"{what} is {value!r}: a number is needed" + (f", in {unit}" if unit else ""))
    number, written = float(match[1]), match[2]
    if not written:
        return number
    if not unit:
        raise InputError(f"{what} is {value!r}, but its unit is not declared: give a plain number")
    try:
        factor, offset = conversion(written, unit)
    except InputError as error:
        raise InputError(f"{what} is {value!r}: {error}") from error
    return factor * number + offset
