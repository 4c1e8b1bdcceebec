"""Reading TOML so that messages can name the line."""

from __future__ import annotations

import contextlib
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from driveline.quantities import InputError

_KEY = re.compile(r'"([^"]*)"|\'([^\']*)\'|([A-Za-z0-9_-]+)')


@dataclass(frozen=True)
class TomlFile:
    """A parsed file that knows where its keys stand.

    Attributes:
        path: The file.
        text: Its contents.
        table: The parsed contents.
    """

    path: Path
    text: str = field(repr=False)
    table: dict[str, Any] = field(repr=False)

    @classmethod
    def read(cls, path: Path) -> TomlFile:
        """Read and parse.

        Raises:
            InputError: No such file, or not TOML.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
            return cls(Path(path), text, tomllib.loads(text))
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path} cannot be read: {error}") from error
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{path}: {error}") from error

    @contextlib.contextmanager
    def at(self, *keys: str) -> Iterator[None]:
        """Inside, the message of every InputError is prefixed with file, line and key."""
        try:
            yield
        except InputError as error:
            line = self.line(keys)
            where = f"{self.path}, line {line}" if line else str(self.path)
            raise InputError(f"{where}: {'.'.join(keys)}: {error}") from error

    def line(self, keys: tuple[str, ...]) -> int | None:
        """The line of a key, or of the innermost table around it that has one of its own."""
        best, best_length, header = None, 0, ()
        for number, line in enumerate(self.text.splitlines(), start=1):
            stripped = line.strip()
            if stripped.startswith("["):
                header = self._keys(stripped.strip("[]").split("]")[0])
                here = header
            elif "=" in stripped and not stripped.startswith("#"):
                here = header + self._keys(stripped.split("=")[0] if stripped[0] not in "\"'"
                                           else stripped[:stripped.index(stripped[0], 1) + 1])
            else:
                continue
            if here == keys[:len(here)] and len(here) > best_length:
                best, best_length = number, len(here)
        return best

    @staticmethod
    def _keys(text: str) -> tuple[str, ...]:
        return tuple(double or single or bare for double, single, bare in _KEY.findall(text))
