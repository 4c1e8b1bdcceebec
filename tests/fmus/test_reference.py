"""The reference beside every slave is what its FMU gives."""

import csv
import zipfile

import numpy as np
import pytest

from fmus import reference
from fmus.packaging import FMUS, HERE
from fmus.reference import START_SPEED, STEP


@pytest.mark.parametrize("name", FMUS)
def test_the_fmu_gives_its_reference(fmus, name, load):
    path = HERE / FMUS[name] / f"{name}_reference.csv"
    assert path.exists(), f"python -m fmus.reference {name} writes it"
    text = path.read_text(encoding="utf-8")
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


def test_that_of_a_new_model_is_written_alone(tmp_path, monkeypatch):
    """Written anew, those of all the others differ in their last digits from one processor to the next."""
    monkeypatch.setattr(reference, "HERE", tmp_path)
    (tmp_path / FMUS["dskse"]).mkdir(parents=True)
    assert [*reference.write(["dskse"])] == [tmp_path / FMUS["dskse"] / "dskse_reference.csv"]
    assert [path.name for path in tmp_path.rglob("*.csv")] == ["dskse_reference.csv"]
