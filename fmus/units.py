"""What a unit such as ``N.m.s/rad`` is in SI base units, for the FMU's unit definitions."""

from __future__ import annotations

import math
import re

from driveline.quantities import InputError

# symbol: (factor to SI, offset, exponents of the base units FMI 2.0 knows)
_SYMBOLS: dict[str, tuple[float, float, dict[str, int]]] = {
    "1": (1.0, 0.0, {}),
    "%": (0.01, 0.0, {}),
    "kg": (1.0, 0.0, {"kg": 1}),
    "g": (1e-3, 0.0, {"kg": 1}),
    "t": (1e3, 0.0, {"kg": 1}),
    "m": (1.0, 0.0, {"m": 1}),
    "mm": (1e-3, 0.0, {"m": 1}),
    "km": (1e3, 0.0, {"m": 1}),
    "s": (1.0, 0.0, {"s": 1}),
    "ms": (1e-3, 0.0, {"s": 1}),
    "min": (60.0, 0.0, {"s": 1}),
    "h": (3600.0, 0.0, {"s": 1}),
    "A": (1.0, 0.0, {"A": 1}),
    "K": (1.0, 0.0, {"K": 1}),
    "degC": (1.0, 273.15, {"K": 1}),
    "rad": (1.0, 0.0, {"rad": 1}),
    "deg": (math.pi / 180.0, 0.0, {"rad": 1}),
    "rev": (2.0 * math.pi, 0.0, {"rad": 1}),
    "rpm": (math.pi / 30.0, 0.0, {"rad": 1, "s": -1}),
    "Hz": (1.0, 0.0, {"s": -1}),
    "N": (1.0, 0.0, {"kg": 1, "m": 1, "s": -2}),
    "kN": (1e3, 0.0, {"kg": 1, "m": 1, "s": -2}),
    "Pa": (1.0, 0.0, {"kg": 1, "m": -1, "s": -2}),
    "kPa": (1e3, 0.0, {"kg": 1, "m": -1, "s": -2}),
    "bar": (1e5, 0.0, {"kg": 1, "m": -1, "s": -2}),
    "J": (1.0, 0.0, {"kg": 1, "m": 2, "s": -2}),
    "W": (1.0, 0.0, {"kg": 1, "m": 2, "s": -3}),
    "kW": (1e3, 0.0, {"kg": 1, "m": 2, "s": -3}),
    "V": (1.0, 0.0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
}
_LOGARITHMIC = ("dB",)
_TERM = re.compile(r"([A-Za-z%]+|1)(-?\d+)?")


def base_unit(unit: str) -> dict[str, float | int] | None:
    """Attributes of FMI's ``BaseUnit``: non-zero exponents, and factor and offset where not 1 and 0.

    None for a logarithmic unit, which is no multiple of base units.

    Spelling as in Modelica: factors joined by dots, whole exponents directly behind the symbol, and
    all factors after the slash divide (``N.m.s/rad``, ``kg.m2``, ``m/s2``, ``N.m.s2/rad2``,
    ``N/(m/s)2`` is spelt ``N.s2/m2``).

    Raises:
        InputError: The unit is not spelt this way, or a symbol is not known.
    """
    if unit in _LOGARITHMIC:
        return None
    above, *below = unit.split("/")
    if len(below) > 1:
        raise InputError(f"unit {unit}: one slash is possible, the factors after it are joined by dots")
    factor, offset, exponents = 1.0, 0.0, {}
    for sign, factors in ((1, above), (-1, below[0] if below else "1")):
        for term in factors.removeprefix("(").removesuffix(")").split("."):
            found = _TERM.fullmatch(term)
            if found is None or found[1] not in _SYMBOLS:
                raise InputError(f"unit {unit}: '{term}' is not a known unit symbol")
            power = sign * int(found[2] or 1)
            symbol_factor, offset_here, symbol_exponents = _SYMBOLS[found[1]]
            factor *= symbol_factor**power
            if unit == term:  # an offset only means something where the symbol stands alone
                offset = offset_here
            for name, exponent in symbol_exponents.items():
                exponents[name] = exponents.get(name, 0) + power * exponent
    attributes: dict[str, float | int] = {name: n for name, n in exponents.items() if n}
    if factor != 1.0:
        attributes["factor"] = factor
    if offset != 0.0:
        attributes["offset"] = offset
    return attributes
