"""A data file as named columns, whatever kind of file it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cosim.messages import did_you_mean
from driveline.quantities import InputError


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
                f"it is in {listed(there)}" if there else "a file of this kind has no groups: leave group out"))
        return self._read(name, group)


def listed(names: Sequence[object], most: int = 8) -> str:
    """"a, b and c", the first of them where there are many."""
    words = [str(name) for name in names]
    if len(words) > most:
        return ", ".join(words[:most]) + ", ..."
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))
