"""MDF files, of version 3 and 4, by asammdf."""

from __future__ import annotations

import contextlib
import logging
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cosim.measured.columns import Column, DataTable, listed
from driveline.quantities import InputError

_CLOCKS = (1, 2)  # the types of channel that are one: 1 in MDF 3, 2 in MDF 4, where 1 has its samples elsewhere


def read_mdf(path: Path) -> DataTable:
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
                             f"{listed(there)}: {out}")
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
