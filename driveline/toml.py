"""Reading TOML: vehicle files, scenarios and measurements, all alike."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .quantities import InputError

_LARGEST = 2**63  # integers of TOML have 64 bits; Python reads longer ones, which no number of numpy can hold


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Text and contents of a file, which may begin with a byte order mark, as from editors on Windows.

    Raises:
        InputError: It cannot be read, or is not TOML.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        table = tomllib.loads(text)
        too_long = next((keys for keys, number in _integers(table) if not -_LARGEST <= number < _LARGEST), None)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error}") from error
    except ValueError as error:  # of decoding, of TOML, or of an integer of thousands of digits
        raise InputError(f"{path}: this is not TOML: {error}") from error
    except RecursionError as error:
        raise InputError(f"{path}: tables or lists are nested too deeply") from error
    if too_long:
        raise InputError(f"{path}: {'.'.join(too_long)} is an integer of more than 64 bits, which TOML does not have: "
                         "larger numbers are written like 1e20")
    return text, table


def _integers(value: Any, keys: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], int]]:
    """All integers in a table, with the keys that lead there."""
    if isinstance(value, dict):
        for key, inside in value.items():
            yield from _integers(inside, (*keys, key))
    elif isinstance(value, list):
        for inside in value:
            yield from _integers(inside, keys)
    elif isinstance(value, int):
        yield keys, value
