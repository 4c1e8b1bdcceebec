"""What a run gives: signals over time, with their units and where they come from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import polars

from cosim.files import replacing, write_text
from cosim.messages import did_you_mean
from driveline.quantities import InputError

_METADATA = "driveline-cosim"


def check_signal_name(name: str) -> None:
    """Refuse the name of a signal that a file of results could not tell from its time axis.

    Raises:
        InputError: The name is ``time``.
    """
    if name == "time":
        raise InputError("a signal cannot be called 'time', as the instants of a result are: give it another name")


@dataclass(frozen=True)
class Result:
    """Recorded signals, all at the same instants.

    Attributes:
        time: Instants [s].
        signals: Values by name, each of the shape of ``time``.
        units: Unit by name; ``""`` where the source declares none.
        provenance: What it takes to run this again: versions, FMUs with GUID and hash, parameters,
            scenario and its hash, and what the master had to say.
        complete: False where the run ended before its stop time.

    Raises:
        InputError: A signal is called ``time``, as is the column of the instants.
    """

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    complete: bool = True

    def __post_init__(self) -> None:
        for name in self.signals:
            check_signal_name(name)

    @property
    def names(self) -> list[str]:
        """The names of the signals, in the order they were asked for."""
        return list(self.signals)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.signals:
            raise InputError(f"the result has no signal '{name}'{did_you_mean(name, self.signals)}")
        return self.signals[name]

    def __contains__(self, name: str) -> bool:
        return name in self.signals

    def to_csv(self, path: str | Path) -> None:
        """Write a CSV file whose header reads ``name [unit]``, and the provenance as JSON beside it.

        The numbers have as many digits as it takes to get the same doubles back.

        Raises:
            InputError: The path ends in ``.json``, as that of the provenance does.
        """
        path, metadata = Path(path), self._metadata(indent=2)
        if path.suffix == ".json":
            raise InputError(f"{path}: units and provenance go into a file of that name, so the table needs another, "
                             "such as one that ends in .csv")
        with replacing(path) as temporary:
            self._frame(_headers(self._units())).write_csv(temporary)
        write_text(path.with_suffix(".json"), metadata + "\n")

    def to_parquet(self, path: str | Path) -> None:
        """Write one Parquet file with units and provenance in its metadata."""
        metadata = {_METADATA: self._metadata()}
        with replacing(Path(path)) as temporary:
            self._frame({}).write_parquet(temporary, metadata=metadata)

    @classmethod
    def read(cls, path: str | Path) -> Result:
        """Read what ``to_csv`` or ``to_parquet`` wrote.

        Raises:
            InputError: No such file, or not written by this class.
        """
        path = Path(path)
        if not path.is_file():
            raise InputError(f"there is no result {path}")
        try:
            if path.suffix == ".parquet":
                with path.open("rb") as file:  # a path may hold what means several files to polars: [ ] * ?
                    metadata = json.loads(polars.read_parquet_metadata(file)[_METADATA])
                frame = polars.read_parquet(path, glob=False)
            else:
                metadata = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
                frame = polars.read_csv(path, infer_schema=False, glob=False).cast(polars.Float64)
            units, provenance, complete = (metadata[key] for key in ("units", "provenance", "complete"))
        except (KeyError, TypeError, OSError, ValueError, polars.exceptions.PolarsError) as error:
            raise InputError(f"{path} is not a result of this package: {error}") from error
        headers = {name: name for name in ("time", *units)} if path.suffix == ".parquet" else _headers(units)
        if odd := set(headers.values()).symmetric_difference(frame.columns):
            raise InputError(f"{path} does not have the columns that its metadata name: {', '.join(sorted(odd))}")
        columns = {name: frame[header].to_numpy() for name, header in headers.items()}
        return cls(columns.pop("time"), columns, units, provenance, complete)

    def _units(self) -> dict[str, str]:
        """Of every signal."""
        return {name: self.units.get(name, "") for name in self.signals}

    def _metadata(self, indent: int | None = None) -> str:
        """Everything but the numbers, as JSON."""
        entries = {"complete": self.complete, "units": self._units(), "provenance": dict(self.provenance)}
        return json.dumps(entries, indent=indent, default=_plain)

    def _frame(self, headers: Mapping[str, str]) -> polars.DataFrame:
        columns = {"time": self.time, **self.signals}
        return polars.DataFrame({headers.get(name, name): values for name, values in columns.items()})


def _headers(units: Mapping[str, str]) -> dict[str, str]:
    """The columns' names in a CSV file."""
    return {name: f"{name} [{unit}]" for name, unit in {"time": "s", **units}.items()}


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy, which JSON does not know, as Python's own."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r} cannot be written as JSON")
