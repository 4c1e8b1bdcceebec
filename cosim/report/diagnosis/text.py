"""Names, units and numbers as the page prints them."""

from __future__ import annotations

import math
import re

from markupsafe import Markup

from cosim.report import svg

_SQUARE = re.compile(r"\b(N|m|s|rad)2\b")
_MOMENT = re.compile(r"\b(N2?)\.m")  # in a sentence, where a dot may as well end it
_DOT = "\N{MIDDLE DOT}"


def words(name: str) -> str:
    """An identifier as it is read."""
    return name.replace("_", " ")


def shown_unit(unit: str) -> str:
    """A unit as it is printed, ``N·m/rad``; nothing for plain numbers."""
    return "" if unit == "1" else _squared(unit.replace(".", _DOT))


def with_unit(value: float, unit: str) -> str:
    """A number and its unit."""
    return f"{svg.number(value)} {shown_unit(unit)}".strip()


def rounded(value: float | None, factor: float, digits: int, size: float) -> str:
    """A number times a factor; nothing for None, and 0 where it is a thousandth of ``size``."""
    if value is None:
        return ""
    return "0" if abs(value) < 1e-3 * size else svg.number(factor * value, digits)


def dotted(sentence: str) -> str:
    """Units within a sentence as they are printed."""
    return _squared(_MOMENT.sub(rf"\1{_DOT}m", sentence))


def _squared(said: str) -> str:
    return _SQUARE.sub("\\1\N{SUPERSCRIPT TWO}", said)


def chance(p: float) -> str | Markup:
    """How often tolerance and noise alone would show it."""
    if p > 1e-4:
        return f"1 in {float(f'{1.0 / p:.1e}'):,.0f}"
    exponent = math.floor(-math.log10(max(p, 1e-99)))
    return Markup(f"1 in 10<sup>{exponent}</sup>") if p > 1e-99 else "never"
