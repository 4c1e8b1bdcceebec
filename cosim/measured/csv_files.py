"""Text files with a column a signal: CSV, plain or gzip."""

from __future__ import annotations

import codecs
import contextlib
import csv
import gzip
import io
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cosim.measured.columns import Column, DataTable
from driveline.quantities import InputError

_HEADER = re.compile(r"\s*(.*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*$", re.DOTALL)
_SEPARATOR = re.compile(r'"?sep=(.)"?\s*$', re.IGNORECASE | re.DOTALL)  # a tab is one too
_WITH = r"^[-+]?\d*[{}]\d+([eE][-+]?\d+)?$"  # a number with a decimal mark
_BLANK = ("", "na", "null", "none", "-")  # in small letters


def read_csv(path: Path) -> DataTable:
    import polars

    try:
        contents, separator, skipped = _from_header(_decoded(_unpacked(path)))
        header = next(csv.reader(io.StringIO(contents, newline=""), delimiter=separator), [])
        # as text first: whether a column holds numbers matters only for those that are asked for;
        # from memory: in the name of a file polars takes brackets and stars for a pattern of several
        frame = polars.read_csv(contents.encode(), separator=separator, infer_schema=False)
    except polars.exceptions.NoDataError as error:
        raise InputError(f"{path} is empty: a header and rows of numbers are needed") from error
    except (UnicodeDecodeError, csv.Error, polars.exceptions.PolarsError) as error:
        if isinstance(error, polars.exceptions.PolarsError) and (ragged := _wider(contents, separator, header)):
            line, fields = ragged
            raise InputError(f"{path}, line {line + skipped}: {fields} fields, but line {1 + skipped}, which has to "
                             f"name the columns, has {len(header)}") from error
        raise InputError(f"{path} is not a readable CSV file: {str(error).splitlines()[0]}") from error
    named = _units_row(frame.row(0)) if frame.height else None
    if named is not None:
        frame = frame[1:]
    if frame.height == 0:
        raise InputError(f"{path} has a header but no rows")
    above = skipped + (1 if named is None else 2)  # lines
    places: dict[str, list[int]] = {}  # by name; logs often hold a column twice that nobody needs
    units = {}
    for place, title in enumerate(header):
        name, unit = _HEADER.match(title).groups()
        units[place] = unit or named and named[place]
        places.setdefault(name, []).append(place)

    written: dict[str, str] = {}  # decimal mark to a column that was asked for and has it

    def read(name: str, _: int | None) -> Column:
        if len(places[name]) > 1:
            raise InputError(f"{path}: {len(places[name])} columns are called '{name}' ("
                             f"{', '.join(header[place].strip() for place in places[name])}): "
                             "leave one of them, or give each its own name")
        place, = places[name]
        text = frame.to_series(place).str.strip_chars()
        if separator == ";":
            written.update({mark: name for mark in ",." if text.str.contains(_WITH.format(mark)).any()})
            if len(written) > 1:
                raise InputError(f"{path}: column '{written[',']}' has decimal commas and column '{written['.']}' "
                                 "decimal points, and either may part thousands: one and the same is needed")
            text = text.str.replace(",", ".", literal=True)
        text = text.set(text.str.to_lowercase().is_in(list(_BLANK)), None)
        numbers = text.cast(polars.Float64, strict=False)
        wrong = (numbers.is_null() & text.is_not_null()).arg_true()
        if wrong.len():
            raise InputError(
                f"{path}, line {wrong[0] + 1 + above}, column '{name}': {text[wrong[0]]!r} is not a number")
        return Column(numbers.fill_null(np.nan).to_numpy().astype(np.float64), units[place])

    return DataTable(path, list(places), read)


def _from_header(text: str) -> tuple[str, str, int]:
    """A CSV file from the line on that names the columns, its separator, and how many lines were before that.

    Before it may be blank lines, and the line with which spreadsheets are told the separator.
    """
    separator, skipped, begin, first = None, 0, 0, ""
    for line in io.StringIO(text, newline=""):
        told = _SEPARATOR.match(line) if separator is None else None
        if told is None and line.strip():
            first = line
            break
        separator = told[1] if told else separator
        skipped, begin = skipped + 1, begin + len(line)
    if separator is None:
        separator = ";" if first.count(";") > first.count(",") else "\t" if "\t" in first else ","
    return text[begin:], separator, skipped


def _wider(text: str, separator: str, header: Sequence[str]) -> tuple[int, int] | None:
    """Line and number of fields of the first row that has more of them than the header, if that is what is wrong."""
    rows = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    with contextlib.suppress(csv.Error):  # of a quote that nothing closes, which makes one field of all that follows
        return next(((rows.line_num, len(row)) for row in rows if len(row) > len(header)), None)
    return None


def _units_row(cells: Sequence[str | None]) -> list[str | None] | None:
    """The units in a row below the header, in brackets or not; None where there is a number in it, or nothing.

    A 1 is a number, but also the unit of what has none.

    Args:
        cells: Of the first row.
    """
    texts = ["" if (text := (cell or "").strip()).lower() in _BLANK else text for cell in cells]
    named = [text for text in texts if text not in ("", "1")]
    if not named or any(map(_is_number, named)):
        return None
    return [text.strip("[]() ") or None for text in texts]


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _decoded(contents: bytes) -> str:
    """Text as UTF-8, as UTF-16 that says so, or as programs on Windows have written it, where that is possible.

    Raises:
        UnicodeDecodeError: It is neither, so no text.
    """
    if contents[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):  # spreadsheets: "Unicode text"
        return contents.decode("utf-16")
    try:
        return contents.decode("utf-8-sig")
    except UnicodeDecodeError:
        if b"\0" in contents:
            raise
        return contents.decode("cp1252")


def _unpacked(path: Path) -> bytes:
    """What stands in a text file, plain or gzip."""
    try:
        with (gzip.open if path.suffix.lower() == ".gz" else open)(path, "rb") as file:
            return file.read()
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path} is not a readable CSV file: {error}") from error
