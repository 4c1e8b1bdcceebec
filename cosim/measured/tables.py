"""Data files as named columns: CSV (plain or gzip), MDF4, MAT v5 and v7.3.

A reader knows nothing of drivelines; ``measurement.py`` says what a column means.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cosim.measured.columns import DataTable
from cosim.measured.csv_files import read_csv
from cosim.measured.mat_files import read_mat
from cosim.measured.mdf_files import read_mdf
from driveline.quantities import InputError

READERS: dict[str, Callable[[Path], DataTable]] = {
    ".csv": read_csv, ".csv.gz": read_csv, ".mf4": read_mdf, ".mdf": read_mdf, ".mat": read_mat,
}


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
