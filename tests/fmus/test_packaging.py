"""What is in an FMU, that it is the same every time, and that FMUs do not meet in one process."""

import hashlib
import json
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import pytest
import pythonfmu
from fmpy.validation import validate_fmu
from lxml import etree

from driveline.quantities import InputError
from fmus.loader import BEHIND
from fmus.packaging import FMUS, HERE, build, released_once, write_fmu


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_same_source_same_bytes(toy, tmp_path):
    again = write_fmu(tmp_path / "toy.fmu", toy.model({}), toy.slave, payload=toy.payload)
    assert digest(again) == digest(toy.fmu)


def test_a_given_date_is_the_only_difference(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    dated = write_fmu(tmp_path / "toy.fmu", toy.model({}), toy.slave, payload=toy.payload)
    assert fmpy.read_model_description(str(dated)).generationDateAndTime == "2023-11-14T22:13:20Z"
    assert fmpy.read_model_description(str(dated)).guid == fmpy.read_model_description(str(toy.fmu)).guid
    with zipfile.ZipFile(dated) as one, zipfile.ZipFile(toy.fmu) as other:
        assert one.namelist() == other.namelist()
        differing = [name for name in one.namelist() if one.read(name) != other.read(name)]
        assert one.infolist()[0].date_time == (2023, 11, 14, 22, 13, 20)
    assert differing == ["modelDescription.xml"]


def test_another_start_value_or_source_is_another_guid(toy, other_toy, tmp_path):
    model = toy.model({"mass.inertia": 2.0000000000000004})
    tuned = write_fmu(tmp_path / "toy.fmu", model, toy.slave, payload=toy.payload)
    guids = {fmpy.read_model_description(str(path)).guid for path in (tuned, toy.fmu, other_toy.fmu)}
    assert len(guids) == 3


def test_start_values_are_exact(toy, tmp_path, load):
    values = {"mass.inertia": 0.1 + 0.2, "spring.stiffness": 1e23, "gear.gain[1]": 5e-324}
    fmu = write_fmu(tmp_path / "toy.fmu", toy.model(values), toy.slave, payload=toy.payload)
    host = load(fmu)
    starts = {v.name: float(v.start) for v in fmpy.read_model_description(str(fmu)).modelVariables if v.start
              and v.type == "Real"}
    for name, value in values.items():
        assert host[name] == value
        assert starts[name] == value


def test_nothing_to_complain_about(toy):
    assert validate_fmu(str(toy.fmu)) == []
    schema = Path(fmpy.__file__).parent / "schema" / "fmi2" / "fmi2ModelDescription.xsd"
    with zipfile.ZipFile(toy.fmu) as archive:
        etree.XMLSchema(file=str(schema)).assertValid(etree.fromstring(archive.read("modelDescription.xml")))


def test_the_description_tells_what_the_model_declares(toy):
    described = fmpy.read_model_description(str(toy.fmu))
    force, position, gear = (
        next(v for v in described.modelVariables if v.name == name)
        for name in ("force", "mass.position", "gear"))
    assert (force.unit, force.nominal, force.causality, force.initial) == ("N", "10.0", "input", "exact")
    assert (position.start, position.initial) == (None, "calculated")
    assert (gear.min, gear.max, gear.type, gear.variability) == ("1", "2", "Integer", "discrete")
    dependencies = {u.variable.name: [d.name for d in u.dependencies] for u in described.outputs}
    assert dependencies == {"mass.position": [], "mass.velocity": [], "engaged_gear": ["gear"], "moving": []}
    initial = {u.variable.name: len(u.dependencies) for u in described.initialUnknowns}
    assert initial == {name: 7 for name in dependencies}
    newton = next(unit for unit in described.unitDefinitions if unit.name == "N").baseUnit
    assert (newton.kg, newton.m, newton.s, newton.rad, newton.factor) == (1, 1, -2, 0, 1.0)


def test_a_variable_that_fmi_cannot_declare_is_named(toy, tmp_path, monkeypatch):
    model = toy.model({})
    wrong = tuple(replace(v, variability="fixed") if v.name == "force" else v for v in model.variables)
    monkeypatch.setattr(type(model), "variables", wrong)
    with pytest.raises(InputError, match="force is declared input and fixed: discrete or continuous"):
        write_fmu(tmp_path / "toy.fmu", model, toy.slave, payload=toy.payload)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_build_leaves_what_was_there(toy, tmp_path, monkeypatch):
    path = write_fmu(tmp_path / "toy.fmu", toy.model({}), toy.slave, payload=toy.payload)

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(zipfile.ZipFile, "writestr", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_fmu(path, toy.model({"mass.inertia": 3.0}), toy.slave, payload=toy.payload)
    assert digest(path) == digest(toy.fmu)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["toy car.fmu", "1toy.fmu", "toy.zip", "täy.fmu"])
def test_a_name_that_cannot_be_an_identifier_is_refused(toy, tmp_path, name):
    with pytest.raises(InputError, match="letters, digits and _"):
        write_fmu(tmp_path / name, toy.model({}), toy.slave, payload=toy.payload)


def test_an_unknown_fmu_is_named(tmp_path):
    with pytest.raises(InputError, match="there is no FMU plant_fun: possible are plant_fom"):
        list(build(tmp_path, ["plant_fun"]))


def test_every_fmu_has_its_script_and_readme():
    for folder in FMUS.values():
        assert (HERE / folder / f"{Path(folder).name}_slave.py").is_file()
        assert (HERE / folder / "README.md").is_file()


def test_same_names_from_different_sources_do_not_meet(toy, other_toy, load):
    """A gain of 1 or 2 that is written in the payload's source, under the same module names."""
    ways = {toy: 1.0, other_toy: 2.0}
    for order in ((toy, other_toy, toy), (other_toy, toy, other_toy)):
        hosts = [load(each.fmu) for each in order]
        for host in hosts:
            host.initialize(force=1.0)
        for host, each in zip(hosts, order, strict=True):
            host.doStep(0.0, 0.01)
            assert host["mass.velocity"] == pytest.approx(0.01 * ways[each] / 2.0, rel=1e-15)


def test_it_survives_its_extraction_folder(toy, load, tmp_path):
    """simulate_fmu deletes the folder; what comes later must not need the modules' files again."""
    first = load(toy.fmu, tmp_path / "first")
    first.initialize(force=2.0)
    expected = first.run(0, 5)
    first.freeInstance()
    shutil.rmtree(tmp_path / "first")
    second = load(toy.fmu, tmp_path / "second")
    second.initialize(force=2.0)
    assert second.run(0, 5) == expected


@pytest.mark.parametrize("folder", ["plain", "with blanks in it", "100% +ä (1)"])
def test_it_needs_numpy_alone_and_lies_anywhere(toy, other_toy, tmp_path, folder, simulate_with_numpy_alone):
    """The characters matter where an FMU is extracted, not where the file lies."""
    place = tmp_path / folder
    place.mkdir()
    paths = [shutil.copy(each.fmu, place / f"{i}.fmu") for i, each in enumerate((toy, other_toy, toy))]
    assert simulate_with_numpy_alone(*paths).count("6 points") == 3


def test_the_state_of_the_linux_library_is_released_once(toy):
    """One instruction differs from PythonFMU's: the function that releases it again returns at once."""
    theirs = (Path(pythonfmu.__file__).parent / "resources/binaries/linux64/libpythonfmu-export.so").read_bytes()
    with zipfile.ZipFile(toy.fmu) as archive:
        ours = archive.read(f"binaries/linux64/{BEHIND}")
    assert len(ours) == len(theirs)
    (changed,) = [at for at, pair in enumerate(zip(theirs, ours)) if pair[0] != pair[1]]
    assert ours[changed] == 0xC3  # ret
    assert released_once(theirs) == ours == released_once(ours)


def test_another_linux_library_is_refused(toy):
    with zipfile.ZipFile(toy.fmu) as archive:
        library = archive.read(f"binaries/linux64/{BEHIND}")
    with pytest.raises(InputError, match="not the one of 0.7"):
        released_once(library.replace(b"finalizePythonInterpreter", b"finalizeAnotherThing_____"))


def test_only_what_is_needed_is_inside(toy):
    with zipfile.ZipFile(toy.fmu) as archive:
        names = archive.namelist()
        described = json.loads(archive.read("resources/model.json"))
    assert len(names) == len(set(names))
    assert not [name for name in names if "__pycache__" in name or name.endswith(("builder.py", ".toml"))]
    assert described["model"] == "toy"
    assert set(described["start_values"]) == {
        v.name for v in toy.model.variables if v.causality != "output"}
