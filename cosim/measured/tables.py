"""Data files as named columns: CSV (plain or gzip), MDF4, MAT v5 and v7.3.

A reader knows nothing of drivelines; ``measurement.py`` says what a column means.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import gzip
import io
import logging
import re
import weakref
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cosim.messages import did_you_mean
from driveline.quantities import InputError

_HEADER = re.compile(r"\s*(.*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*$", re.DOTALL)
_SEPARATOR = re.compile(r'"?sep=(.)"?\s*$', re.IGNORECASE | re.DOTALL)  # a tab is one too
_Contents = np.ndarray | Mapping[str, Any]  # of a variable of a workspace: numbers, or the fields of a struct
_WITH = r"^[-+]?\d*[{}]\d+([eE][-+]?\d+)?$"  # a number with a decimal mark
_CLOCKS = (1, 2)  # the types of channel that are one: 1 in MDF 3, 2 in MDF 4, where 1 has its samples elsewhere
_BLANK = ("", "na", "null", "none", "-")  # in small letters


@dataclass(frozen=True)
class Column:
    """Numbers as they stand in the file; NaN where there is none.

    Attributes:
        values: float64, shape (rows,).
        unit: Unit if the file says one, else None.
        times: The column's own clock [s] if the file has one for it, else None.
    """

    values: np.ndarray
    unit: str | None = None
    times: np.ndarray | None = None


@dataclass(frozen=True)
class DataTable:
    """The columns of one file, read when they are asked for.

    Attributes:
        path: The file.
        names: Names of the columns.
        groups: Of an MDF file: the numbers of the channel groups each name is in.
    """

    path: Path
    names: list[str]
    _read: Callable[[str, int | None], Column] = field(repr=False)
    groups: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def column(self, name: str, group: int | None = None) -> Column:
        """One column; of an MDF file from one of its channel groups, where the name is in several.

        Raises:
            InputError: No such column (those there are get named), several of that name, or it does not hold
                numbers.
        """
        if name not in self.names:
            raise InputError(f"{self.path}: there is no column '{name}'{did_you_mean(name, self.names, 20)}")
        if group is not None and group not in (there := self.groups.get(name, ())):
            raise InputError(f"{self.path}: column '{name}' is not in channel group {group}; " + (
                f"it is in {_listed(there)}" if there else "a file of this kind has no groups: leave group out"))
        return self._read(name, group)


def read_table(path: Path) -> DataTable:
    """Open a data file; the ending says of which kind it is.

    Raises:
        InputError: No such file, an unknown kind, an empty or a damaged file.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"there is no data file {path}")
    name = path.name.lower()
    reader = next((reader for ending, reader in READERS.items() if name.endswith(ending)), None)
    if reader is None:
        raise InputError(f"{path}: unknown kind of data file; known endings: {', '.join(READERS)}")
    return reader(path)


def _read_csv(path: Path) -> DataTable:
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


def _read_mdf(path: Path) -> DataTable:
    try:
        import asammdf
    except ImportError as error:
        raise InputError(f"{path}: MDF files need the package asammdf, pip install "
                         "'driveline-cosim[measured]'") from error
    with _hushed():
        try:
            file = asammdf.MDF(path)
        except Exception as error:  # asammdf raises many kinds for a damaged file
            _give_up(error)
            raise InputError(f"{path} is not a readable MDF file: {error}") from error
    if not file.channels_db:
        file.close()
        raise InputError(f"{path} has no channels")
    samples = [group.channel_group.cycles_nr for group in file.groups]

    def read(name: str, group: int | None) -> Column:
        where = [place for place in file.channels_db[name] if group in (None, place[0])]
        # a logger may declare a channel in groups it never wrote; they leave no doubt
        where = [place for place in where if samples[place[0]]] or where[:1]
        if len(where) > 1:
            there = [f"{number} ({samples[number]} samples)" for number in dict.fromkeys(g for g, _ in where)]
            out = ("say which by group = N beside its column in measurement.toml" if len(there) > 1 else
                   "give each its own name")
            raise InputError(f"{path}: channel '{name}' is there {len(where)} times, in channel group "
                             f"{_listed(there)}: {out}")
        (group, place), = where
        conversion = file.groups[group].channels[place].conversion
        computed = bool(getattr(conversion, "formula", "")) or hasattr(conversion, "P1")
        if not _within_records(file.groups[group], place):
            raise InputError(f"{path}, channel '{name}' cannot be read: it, or its clock, lies beyond the end of its "
                             "records, so the file is damaged")
        try:
            with _hushed():
                signal = file.get(name, group, place, raw=computed)
                found = _computed(conversion, signal.samples) if computed else signal.samples
            if np.iscomplexobj(found):
                raise InputError("it holds complex numbers: real ones are needed")
            values = np.asarray(found, dtype=np.float64)
            if values.ndim > 1:
                raise InputError(f"it holds {values[0].size} numbers at every instant: one is needed")
        except InputError as error:
            raise InputError(f"{path}, channel '{name}': {error}") from error
        except (ValueError, TypeError) as error:
            raise InputError(f"{path}, channel '{name}': its values are not numbers") from error
        except Exception as error:  # of many kinds for a damaged file
            raise InputError(f"{path}, channel '{name}' cannot be read: {error}") from error
        return Column(values, signal.unit or None, np.asarray(signal.timestamps, dtype=np.float64))

    groups = {name: tuple(dict.fromkeys(group for group, _ in where)) for name, where in file.channels_db.items()}
    table = DataTable(path, sorted(file.channels_db), read, groups)
    weakref.finalize(table, file.close)  # left to itself asammdf does so at an end of its own, and not on every system
    return table


def _within_records(group: Any, place: int) -> bool:
    """Whether a channel of an MDF file and its clock lie within the records of their group.

    asammdf reads whatever memory there is beyond them, and may end the process by that.
    """
    length = 8 * group.channel_group.samples_byte_nr
    for number, channel in enumerate(group.channels):
        if number == place or channel.channel_type in _CLOCKS:
            begin = (channel.start_offset + 8 * channel.additional_byte_offset if hasattr(channel, "start_offset")
                     else 8 * channel.byte_offset + channel.bit_offset)  # MDF 3, MDF 4
            if begin + channel.bit_count > length:
                return False
    return True


def _computed(conversion: Any, samples: np.ndarray) -> np.ndarray:
    """What a formula or a rational function of an MDF file makes of samples as they were logged.

    Left to itself asammdf computes with integers in 32 bits, which overflow, and passes them on as they are where it
    cannot compute the formula.

    Raises:
        InputError: It cannot be computed.
    """
    # what picks bits from them needs them whole; but many write ^ for a power
    whole = np.issubdtype(samples.dtype, np.integer) and "^" not in conversion.formula
    for numbers in (samples.astype(np.float64), *([samples.astype(np.int64)] if whole else [])):
        values = conversion.convert(numbers)
        if not conversion.formula or values is not numbers:
            return np.broadcast_to(values, samples.shape)  # of a constant there is but one
    raise InputError(f"its formula '{conversion.formula}' cannot be computed: log or export it converted")


@contextlib.contextmanager
def _hushed() -> Iterator[None]:
    """Without asammdf's own log, which repeats in its words, and with a traceback, what is raised as well."""
    logger = logging.getLogger("asammdf")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _give_up(error: Exception) -> None:
    """Close what asammdf did not manage to open: left to itself it does so when it is deleted, and fails aloud."""
    trace = error.__traceback__
    while trace is not None:
        half = trace.tb_frame.f_locals.get("self")
        # what has slots in place of a __dict__ is a block of the file
        if type(half).__module__.startswith("asammdf.") and "_closed" in getattr(half, "__dict__", ()):
            half._closed = True
            for name in ("_tempfile", "_file", "_mapped_file"):
                if vars(half).get(name) is not None:
                    vars(half)[name].close()
            if vars(half).get("_delete_on_close"):  # its own copy of a file that was never finished
                Path(half.name).unlink(missing_ok=True)
        trace = trace.tb_next


def _read_mat(path: Path) -> DataTable:
    import scipy.io

    try:
        arrays = {name: values for name, values in scipy.io.loadmat(path).items() if not name.startswith("__")}
    except NotImplementedError:
        return _read_mat_hdf5(path)
    except Exception as error:  # scipy raises many kinds for a damaged file
        raise InputError(f"{path} is not a readable MAT file: {_in_short(error)}") from error
    return _from_arrays(path, {name: _opened(values) for name, values in arrays.items()})


def _opened(values: np.ndarray) -> _Contents:
    """A struct of MAT v5 as its fields, all else as it is."""
    if values.dtype.names and values.size == 1:
        return {name: values[name].flat[0] for name in values.dtype.names}
    return values


def _read_mat_hdf5(path: Path) -> DataTable:
    try:
        import h5py
    except ImportError as error:
        raise InputError(f"{path}: MAT files of version 7.3 need the package h5py, pip install "
                         "'driveline-cosim[measured]'") from error

    def holds_numbers(node: h5py.Dataset) -> bool:
        # a text is stored as the numbers of its letters, an object (datetime, string) as that of its place elsewhere
        return (node.attrs.get("MATLAB_class") not in (b"char", "char") and "MATLAB_object_decode" not in node.attrs
                and "MATLAB_empty" not in node.attrs)  # of an empty array its shape is stored

    def vectors(group: h5py.Group) -> dict[str, np.ndarray]:
        return {name: node[()] for name, node in group.items()
                if isinstance(node, h5py.Dataset) and holds_numbers(node)}

    try:
        with h5py.File(path) as file:
            arrays: dict[str, _Contents] = {
                name: vectors(node) for name, node in file.items()
                if isinstance(node, h5py.Group) and not name.startswith("#")}  # MATLAB's own store of cells
            arrays |= vectors(file)
    except Exception as error:  # of many kinds for a damaged file
        raise InputError(f"{path} is not a readable MAT file: {_in_short(error)}") from error
    return _from_arrays(path, arrays)


def _from_arrays(path: Path, contents: Mapping[str, _Contents]) -> DataTable:
    """The vectors among the variables of a workspace, or, where there is none but one struct, among its fields."""
    structs = {name: of for name, of in contents.items() if isinstance(of, Mapping)}
    vectors = _vectors(contents)
    if not vectors and len(structs) == 1:
        vectors = _vectors(*structs.values())
    if not vectors:
        there = _listed([f"a struct {name} with {_listed(list(of)) or 'nothing'}" if isinstance(of, Mapping) else
                         f"{name} ({'x'.join(map(str, of.shape))})" for name, of in contents.items()])
        raise InputError(f"{path} holds no vectors of numbers{there and f', but {there}'}: variables that are vectors "
                         "are needed, or one struct whose fields are")

    def read(name: str, _: int | None) -> Column:
        values = vectors[name]
        if _is_complex(values):
            raise InputError(f"{path}: column '{name}' holds complex numbers: real ones are needed")
        return Column(np.asarray(values, dtype=np.float64))

    return DataTable(path, list(vectors), read)


def _vectors(contents: Mapping[str, _Contents]) -> dict[str, np.ndarray]:
    return {name: np.ravel(values) for name, values in contents.items() if isinstance(values, np.ndarray)
            and values.size == max(values.shape, default=0) and values.size > 1
            and (np.issubdtype(values.dtype, np.number) or _is_complex(values))}


def _is_complex(values: np.ndarray) -> bool:
    """Also as MAT v7.3 writes complex numbers, in two fields."""
    return np.iscomplexobj(values) or values.dtype.names == ("real", "imag")


def _in_short(error: Exception) -> str:
    """What an error says, without the bytes of a damaged file that stand in it."""
    words = "".join(letter if letter.isprintable() else " " for letter in str(error))
    return words if len(words) <= 200 else f"{words[:200]}..."


def _listed(names: Sequence[object], most: int = 8) -> str:
    """"a, b and c", the first of them where there are many."""
    words = [str(name) for name in names]
    if len(words) > most:
        return ", ".join(words[:most]) + ", ..."
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


READERS: dict[str, Callable[[Path], DataTable]] = {
    ".csv": _read_csv, ".csv.gz": _read_csv, ".mf4": _read_mdf, ".mdf": _read_mdf, ".mat": _read_mat,
}
