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
    """

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    complete: bool = True

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
        """
        path = Path(path)
        headers = {name: f"{name} [{unit}]" for name, unit in {"time": "s", **self.units}.items()}
        with replacing(path) as temporary:
            self._frame(headers).write_csv(temporary)
        write_text(path.with_suffix(".json"), json.dumps(self._metadata(), indent=2) + "\n")

    def to_parquet(self, path: str | Path) -> None:
        """Write one Parquet file with units and provenance in its metadata."""
        with replacing(Path(path)) as temporary:
            self._frame({}).write_parquet(temporary, metadata={_METADATA: json.dumps(self._metadata())})

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
                metadata = json.loads(polars.read_parquet_metadata(path)[_METADATA])
                frame = polars.read_parquet(path)
            else:
                metadata = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
                frame = polars.read_csv(path, infer_schema=False).cast(polars.Float64)
        except (KeyError, OSError, ValueError, polars.exceptions.PolarsError) as error:
            raise InputError(f"{path} is not a result of this package: {error}") from error
        units = metadata["units"]
        columns = dict(zip(["time", *units], frame.iter_columns()))
        return cls(columns.pop("time").to_numpy(), {name: c.to_numpy() for name, c in columns.items()},
                   units, metadata["provenance"], metadata["complete"])

    def _metadata(self) -> dict[str, Any]:
        return {"complete": self.complete, "units": dict(self.units), "provenance": dict(self.provenance)}

    def _frame(self, headers: Mapping[str, str]) -> polars.DataFrame:
        columns = {"time": self.time, **self.signals}
        return polars.DataFrame({headers.get(name, name): values for name, values in columns.items()})
