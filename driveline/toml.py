"""Reading TOML: vehicle files, scenarios and measurements, all alike."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from .quantities import InputError


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Text and contents of a file, which may begin with a byte order mark, as from editors on Windows.

    Raises:
        InputError: It cannot be read, or is not TOML.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        return text, tomllib.loads(text)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: this is not TOML: {error}") from error
