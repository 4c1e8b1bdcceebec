"""Pages that are written by hand name whatever they are a list of."""

import dataclasses
import re
from pathlib import Path

import pytest

from driveline.estimators import ESTIMATORS
from driveline.plants import full_order
from driveline.plants.full_order import FullOrderParameters
from fmus.packaging import FMUS

ROOT = Path(__file__).parents[2]
NO_LAWS = {"driveline_parts"}
OF_EVERY_MODEL = {"start", "solver"}  # no sections of a vehicle file


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_every_element_of_the_full_order_plant_is_on_its_page():
    used = set(re.findall(r"from \.\.elements\.(\w+) import", Path(full_order.__file__).read_text(encoding="utf-8")))
    page = text("docs/plants/plant_fom.md")
    assert len(used) > 10
    assert [name for name in sorted(used - NO_LAWS) if f"`{name}.py`" not in page] == []


def test_every_section_of_a_vehicle_file_is_described():
    page = text("docs/vehicles.md").replace("`*_speed_sensor`", " ".join(
        f"`{field.name}`" for field in dataclasses.fields(FullOrderParameters) if field.name.endswith("_speed_sensor")))
    sections = {field.name for field in dataclasses.fields(FullOrderParameters)} - OF_EVERY_MODEL
    assert [name for name in sorted(sections) if f"`{name}`" not in page] == []


@pytest.mark.parametrize("name", FMUS)
def test_every_fmu_is_in_the_readme(name):
    assert f"{name}.fmu`" in text("README.md")


@pytest.mark.parametrize("name", ESTIMATORS)
def test_every_estimator_has_a_page(name):
    assert f"`driveline/estimators/{name}.py`" in text(f"docs/estimators/{name}.md")
