"""The reference beside every slave is what its FMU gives."""

import csv
import zipfile

import numpy as np
import pytest

from fmus.packaging import FMUS, HERE
from fmus.reference import START_SPEED, STEP


@pytest.mark.parametrize("name", FMUS)
def test_the_fmu_gives_its_reference(fmus, name, load):
    text = (HERE / FMUS[name] / f"{name}_reference.csv").read_text(encoding="utf-8")
    with zipfile.ZipFile(fmus[name]) as archive:
        assert archive.read(f"documentation/{name}_reference.csv").decode() == text
    columns, *rows = csv.reader(text.splitlines())
    rows = np.array(rows, dtype=float)
    host = load(fmus[name])
    inputs = [column for column in columns if host.variables.get(column) is not None
              and host.variables[column].causality == "input"]

    def value(column: str, row: np.ndarray) -> float:
        number = row[columns.index(column)]
        return int(number) if host.variables[column].type == "Integer" else float(number)

    if "start.vehicle_speed" in host.variables:
        host["start.vehicle_speed"] = START_SPEED
    for column in inputs:
        host[column] = value(column, rows[0])
    host.initialize()
    for step, row in enumerate(rows[1:]):
        for column in inputs:
            host[column] = value(column, row)
        host.doStep(step * STEP, STEP)
        for column in columns[1 + len(inputs):]:
            assert host[column] == pytest.approx(row[columns.index(column)], rel=1e-9, abs=1e-12), (column, step)
