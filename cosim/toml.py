"""Reading TOML so that messages can name the line."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from driveline.quantities import InputError
from driveline.toml import read_toml

_KEY = r'(?:"[^"]*"|\'[^\']*\'|[A-Za-z0-9_-]+)'
_DOTTED = rf"({_KEY}(?:\s*\.\s*{_KEY})*)"
_HEADER = re.compile(rf"\s*\[\[?\s*{_DOTTED}\s*\]")
_ENTRY = re.compile(rf"\s*{_DOTTED}\s*=")
# Texts of several lines; and before them what may hold their marks: comments and texts of one line.
_TEXTS = re.compile(
    r'#[^\n]*|(?P<lines>"""(?:\\.|[^\\])*?"""|\'{3}.*?\'{3})|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'', re.DOTALL)


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
        return cls(Path(path), *read_toml(Path(path)))

    @contextlib.contextmanager
    def at(self, *keys: str) -> Iterator[None]:
        """Inside, the message of every InputError is prefixed with file, line and key; the innermost counts."""
        try:
            yield
        except InputError as error:
            if str(error).startswith((f"{self.path}, line ", f"{self.path}: ")):
                raise
            line = self.line(keys)
            where = f"{self.path}, line {line}" if line else str(self.path)
            raise InputError(f"{where}: {'.'.join(keys)}: {error}") from error

    def line(self, keys: tuple[str, ...]) -> int | None:
        """The line of a key, or of the innermost table around it that has one of its own."""
        best, best_length, header = None, 0, ()
        # what stands in a text of several lines is no key, whatever it looks like
        without_texts = _TEXTS.sub(
            lambda found: "\n" * found[0].count("\n") if found["lines"] else found[0], self.text)
        for number, line in enumerate(without_texts.split("\n"), start=1):
            if found := _HEADER.match(line):
                here = header = self._keys(found[1])
            elif found := _ENTRY.match(line):
                here = header + self._keys(found[1])
            else:
                continue
            if here == keys[:len(here)] and len(here) > best_length:
                best, best_length = number, len(here)
        return best

    @staticmethod
    def _keys(text: str) -> tuple[str, ...]:
        return tuple(key.strip("\"'") for key in re.findall(_KEY, text))
