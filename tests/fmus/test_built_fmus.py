"""Every FMU the package builds: nothing to complain about, and the same numbers wherever it runs."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from lxml import etree

from driveline.estimators import ESTIMATORS
from driveline.kernels import native
from driveline.models import MODELS, SHIPPED_VARIANT, SHIPPED_VEHICLE
from driveline.vehicles import load as load_vehicle
from fmus import packaging
from fmus.packaging import FMUS, HERE

STEP = 1e-3


def in_process(name, backend="auto"):
    return MODELS[name](MODELS[name].defaults_from(load_vehicle(SHIPPED_VEHICLE, SHIPPED_VARIANT)), backend=backend)


def torque_input(described):
    """The input that drives the plant: its first one in N.m."""
    return next(name for name, v in described.items() if v.causality == "input" and v.unit == "N.m")


def tip_in(host, count=60, first=0):
    """Outputs while the torque goes from drag to drive and back: the lash is crossed twice."""
    name, rows = torque_input(host.variables), []
    for step in range(first, first + count):
        host[name] = 150.0 if step % 40 < 20 else -50.0
        host.doStep(step * STEP, STEP)
        rows.append(host.outputs())
    return np.array(rows)


@pytest.fixture(params=FMUS)
def name(request):
    return request.param


def test_nothing_to_complain_about(fmus, name):
    assert validate_fmu(str(fmus[name])) == []
    schema = Path(fmpy.__file__).parent / "schema" / "fmi2" / "fmi2ModelDescription.xsd"
    with zipfile.ZipFile(fmus[name]) as archive:
        etree.XMLSchema(file=str(schema)).assertValid(etree.fromstring(archive.read("modelDescription.xml")))
    for variable in fmpy.read_model_description(str(fmus[name])).modelVariables:
        assert variable.description
        assert variable.type != "Real" or variable.unit


def test_trajectory_is_the_one_in_process_to_the_bit(fmus, name, load):
    host, model = load(fmus[name]), in_process(name)
    host.initialize()
    model.initialize()
    torque = torque_input(host.variables)
    expected = []
    for step in range(60):
        model[torque] = 150.0 if step % 40 < 20 else -50.0
        model.step(step * STEP, STEP)
        expected.append([v for v, d in zip(model.values, model.variables, strict=True)
                         if d.causality == "output"])
    got = tip_in(host)
    assert np.ptp(got, axis=0).any()
    np.testing.assert_array_equal(got, np.array(expected))


def test_restored_snapshot_goes_on_with_the_same_bits(fmus, name, load):
    host, other = load(fmus[name]), load(fmus[name])
    host.initialize()
    tip_in(host, 15)
    snapshot = host.getFMUState()
    saved = host.serializeFMUState(snapshot)
    ahead = tip_in(host, 40, 15)
    host.setFMUState(snapshot)
    np.testing.assert_array_equal(tip_in(host, 40, 15), ahead)
    other.setFMUState(other.deserializeFMUState(saved))
    np.testing.assert_array_equal(tip_in(other, 40, 15), ahead)


def test_all_at_once_in_any_order_as_each_alone(fmus, load):
    alone = {}
    for name in FMUS:
        host = load(fmus[name])
        host.initialize()
        alone[name] = tip_in(host, 25)
        host.freeInstance()
    for order in (list(FMUS), list(FMUS)[::-1]):
        hosts = {name: load(fmus[name]) for name in [*order, *order]}
        for host in hosts.values():
            host.initialize()
        for name, host in hosts.items():
            np.testing.assert_array_equal(tip_in(host, 25), alone[name])


def test_bad_values_are_named(fmus, name, load):
    host = load(fmus[name])
    torque = torque_input(host.variables)
    host.initialize()
    host[torque] = np.nan
    if name in ESTIMATORS:  # to them it is a missing frame
        host.doStep(0.0, 0.1)
        assert np.isfinite(host.outputs()).all()
    else:
        with pytest.raises(FMICallException):
            host.doStep(0.0, STEP)
        assert f"{torque} is nan" in host.messages[-1][1]
    host[torque] = 0.0
    with pytest.raises(FMICallException):
        host.doStep(0.0, 0.0)
    assert "communication step is 0 s" in host.messages[-1][1]


def test_a_gear_that_does_not_exist_is_named(fmus, load):
    host = load(fmus["plant_fom"])
    host.initialize()
    host["gear"] = 11
    with pytest.raises(FMICallException):
        host.doStep(0.0, STEP)
    assert "gear is 11" in host.messages[-1][1]


def test_wheels_spin_as_in_process_to_the_bit_and_the_log_says_what_the_tyres_carry(fmus, load):
    host, model = load(fmus["plant_fom"]), in_process("plant_fom")
    start = {"start.vehicle_speed": 5.0, "tyre.friction_coefficient": 0.1, "gear": 1, "engine_torque": 400.0}
    host.initialize(**start)
    for name, value in start.items():
        model[name] = value
    model.initialize()
    assert host.messages == [(1, message) for message in model.log]
    assert "starts rolling" in model.log[0]
    for step in range(400):
        host.doStep(step * STEP, STEP)
        model.step(step * STEP, STEP)
        assert host["wheel_speed"] == model["wheel_speed"]
    assert host["wheel_speed"] * model["tyre.radius"] > 2.0 * host["vehicle_speed"]


def test_a_negative_inertia_is_named(fmus, load):
    host = load(fmus["plant_fom"])
    host["engine.inertia"] = -0.1
    with pytest.raises(FMICallException):
        host.initialize()
    assert "engine.inertia is -0.1 kg.m2" in host.messages[-1][1]


def test_numpy_alone_is_enough(fmus, simulate_with_numpy_alone):
    said = simulate_with_numpy_alone(*fmus.values())
    assert said.count("6 points") == len(FMUS)
    assert "plain Python" not in said


def test_snapshot_goes_on_in_a_new_process(fmus, name, load, go_on_elsewhere):
    host = load(fmus[name])
    host.initialize()
    tip_in(host, 15)
    saved = host.serializeFMUState(host.getFMUState())
    outputs, _ = go_on_elsewhere(host.unzipDirectory, saved, 15, 20, STEP)
    assert outputs == host.run(15, 20, STEP)[-1]


@pytest.mark.parametrize("fit", ["missing", "damaged"])
def test_without_its_library_it_runs_in_plain_python_and_says_so(
        fmus, load, tmp_path, go_on_elsewhere, fit):
    """And with the same bits; in a process of its own, because a loaded module keeps its library."""
    host = load(fmus["plant_rom_2dof"])
    host.initialize()
    host[torque_input(host.variables)] = 150.0
    folder = tmp_path / "without"
    fmpy.extract(str(fmus["plant_rom_2dof"]), str(folder))
    libraries = [*folder.rglob("lib/kernels-*")]
    assert libraries
    for library in libraries:
        if fit == "missing":
            library.unlink()
        else:
            library.write_bytes(b"not a library")
    outputs, said = go_on_elsewhere(folder, host.serializeFMUState(host.getFMUState()), 0, 5, STEP)
    assert "plain Python" in said
    assert outputs == host.run(0, 5, STEP)[-1]


def test_the_script_builds_the_same_bytes_again(fmus, tmp_path):
    script = HERE.parent / "build_fmus.py"
    environment = {**os.environ, "PYTHONHASHSEED": "1"}
    done = subprocess.run([sys.executable, script, "--out", tmp_path / "again"], cwd=script.parent,
                          env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for line, (name, path) in zip(done.stdout.splitlines(), fmus.items(), strict=True):
        again = tmp_path / "again" / f"{name}.fmu"
        assert line.startswith(str(again))
        assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize("order", [sorted(FMUS), sorted(FMUS, reverse=True)], ids=["there", "back"])
def test_fmus_run_one_after_the_other_in_one_process_in_any_order(fmus, order):
    """They share their modules, and a host like FMPy deletes the folder of the first when it is done with it."""
    script = "import sys, fmpy\nfor path in sys.argv[1:]: fmpy.simulate_fmu(path, stop_time=0.01, step_size=1e-3)"
    done = subprocess.run([sys.executable, "-c", script, *(fmus[name] for name in order)],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_every_slave_knows_every_model(name):
    """So that what an FMU loads is all that the others of its build will ask for."""
    slave = HERE / FMUS[name] / f"{Path(FMUS[name]).name}_slave.py"
    assert "from driveline.models import MODELS\n" in slave.read_text() and "    models = MODELS\n" in slave.read_text()


def test_an_fmu_can_bear_another_name_and_gear(tmp_path, monkeypatch):
    monkeypatch.setattr(native, "libraries", dict)
    path, = packaging.build(tmp_path, ["plant_fom"], gear=3, suffix="_extended")
    described = fmpy.read_model_description(str(path))
    assert path.name == "plant_fom_extended.fmu"
    assert described.coSimulation.modelIdentifier == described.modelName == "plant_fom_extended"
    assert next(v.start for v in described.modelVariables if v.name == "gear") == "3"
    assert validate_fmu(str(path)) == []
