"""The slave as a host sees it, on the toy FMU."""

import gc
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

FORCES = [3.0, -1.0 / 3.0, 0.1, 7.7]


def drive(fmu, model, steps=40, dt=0.01):
    """The same inputs into an FMU and a model in process; their outputs."""
    rows = [], []
    for step in range(steps):
        values = {"force": FORCES[step % 4], "gear": 1 + step // 20, "locked": step == 30}
        for name, value in values.items():
            fmu[name] = model[name] = value
        rows[0].extend(fmu.run(step, 1, dt))
        model.step(step * dt, dt)
        rows[1].append([model[name] for name in ("mass.position", "mass.velocity", "engaged_gear", "moving")])
    return rows


def failure(host, action, *arguments):
    """What the host's log says when an action fails."""
    host.messages.clear()
    with pytest.raises(FMICallException) as caught:
        action(*arguments)
    assert caught.value.status >= 3
    return host.messages[-1][1].splitlines()[-1]


def test_trajectory_is_the_one_in_process_to_the_bit(toy, load):
    host, model = load(toy.fmu), toy.model({"mass.inertia": 1.7})
    host.initialize(**{"mass.inertia": 1.7})
    model.initialize()
    in_fmu, in_process = drive(host, model)
    assert in_fmu == in_process
    assert len({tuple(row) for row in in_fmu}) > 30


def test_values_come_back_as_they_were_set(toy, load):
    host = load(toy.fmu)
    host["force"], host["gear"], host["locked"] = 0.1 + 0.2, 2, True
    assert [host["force"], host["gear"], host["locked"]] == [0.1 + 0.2, 2, True]
    assert host["gear.gain[2]"] == 1.0 / 3.0
    host.setReal([0, 4], [5.0, 6.0])
    assert host.getReal([4, 0, 3]) == [6.0, 5.0, 1.0 / 3.0]


def test_setting_a_tunable_parameter_in_a_run_acts(toy, load):
    host, model = load(toy.fmu), toy.model({})
    host.initialize()
    model.initialize()
    drive(host, model)
    host["spring.stiffness"] = model["spring.stiffness"] = 500.0
    model.retune()
    in_fmu, in_process = drive(host, model)
    assert in_fmu == in_process


@pytest.mark.parametrize(("name", "value", "said"), [
    ("force", np.nan, "force is nan"),
    ("gear", 3, "gear is 3"),
    ("gear", -2147483648, "gear is -2"),
    ("force", np.inf, "force is inf"),
])
def test_an_impossible_input_is_named(toy, load, name, value, said):
    host = load(toy.fmu)
    host.initialize()
    host[name] = value
    assert said in failure(host, host.doStep, 0.0, 0.01)


@pytest.mark.parametrize(("name", "value", "said"), [
    ("mass.inertia", -1.0, "mass.inertia is -1 kg"),
    ("spring.stiffness", np.nan, "spring.stiffness is nan"),
])
def test_an_impossible_parameter_is_named(toy, load, name, value, said):
    host = load(toy.fmu)
    host[name] = value
    assert said in failure(host, host.initialize)


@pytest.mark.parametrize("step", [0.0, -0.01, np.nan, np.inf])
def test_a_step_without_positive_length_is_refused(toy, load, step):
    host = load(toy.fmu)
    host.initialize()
    assert "communication step" in failure(host, host.doStep, 0.0, step)


def test_what_may_not_be_set_is_refused(toy, load):
    host = load(toy.fmu)
    assert "mass.position is an output" in failure(host, host.setReal, [7], [1.0])
    assert "gear is integer, not real" in failure(host, host.setReal, [5], [1.0])
    assert "no variable with value reference 99" in failure(host, host.setReal, [99], [1.0])
    failure(host, host.getReal, [99])
    host.initialize()
    assert "mass.inertia is a fixed parameter" in failure(host, host.setReal, [0], [1.0])
    assert "spring.stiffness is -1 N/m" in failure(host, host.setReal, [1], [-1.0])
    assert host["spring.stiffness"] == 50.0


def test_strings_are_refused_as_there_are_none(toy, load):
    """PythonFMU's own error would end the process at the next call."""
    for action, arguments in (("getString", [[0]]), ("setString", [[0], ["on"]]), ("getString", [[99]])):
        host = load(toy.fmu)
        host.initialize()
        said = failure(host, getattr(host, action), *arguments)
        assert said == ("there is no variable with value reference 99" if 99 in arguments[0] else
                        f"{next(iter(host.variables))} is real, not string")
        host.reset()
        host.initialize()
        assert host.run(0, 2)


def test_the_message_reaches_a_host_that_logs_nothing(toy, load, capfd):
    host = load(toy.fmu)
    host.setDebugLogging(False, [])
    host.initialize()
    host["force"] = np.nan
    with pytest.raises(FMICallException):
        host.doStep(0.0, 0.01)
    assert "toy: force is nan" in capfd.readouterr().err


def test_after_an_error_the_instance_can_be_used_reset_and_freed(toy, load):
    """PythonFMU's native layer releases what it still uses; unless that is made good, this crashes."""
    host = load(toy.fmu)
    host.initialize()
    expected = host.run(0, 3)
    for _ in range(20):
        host["force"] = np.nan
        failure(host, host.doStep, 0.0, 0.01)
        host.reset()
        host.initialize()
        assert host.run(0, 3) == expected


def test_reset_forgets_everything(toy, load):
    host, fresh = load(toy.fmu), load(toy.fmu)
    host.initialize(**{"mass.inertia": 9.0, "force": 4.0})
    host.run(0, 10)
    host.reset()
    for instance in (host, fresh):
        instance.initialize()
    assert host["mass.inertia"] == 2.0
    assert host.run(0, 10) == fresh.run(0, 10)


def test_the_models_messages_reach_the_log(toy, load):
    host = load(toy.fmu)
    host.initialize()
    assert host.messages == [(1, "no compiled kernel: running in plain Python")]


def test_an_instance_can_be_freed_at_once(toy, load):
    """The model's messages wait in the model: queued, they would reach a logger that is freed already."""
    for _ in range(3):
        load(toy.fmu).freeInstance()


def test_restored_snapshot_goes_on_with_the_same_bits(toy, load):
    host = load(toy.fmu)
    host.initialize(force=3.0)
    host.run(0, 10)
    snapshot = host.getFMUState()
    ahead = host.run(10, 20)
    host.setFMUState(snapshot)
    assert host.run(10, 20) == ahead
    host.freeFMUState(snapshot)


def test_snapshot_serves_another_instance_with_other_parameters(toy, load):
    host, other = load(toy.fmu), load(toy.fmu)
    host.initialize(**{"force": 3.0, "mass.inertia": 0.3})
    host.run(0, 10)
    saved = host.serializeFMUState(host.getFMUState())
    other.initialize(**{"force": -1.0, "mass.inertia": 5.0})
    other.run(0, 3)
    other.setFMUState(other.deserializeFMUState(saved))
    assert other.run(10, 20) == host.run(10, 20)
    assert "mass.inertia is a fixed parameter" in failure(other, other.setReal, [0], [1.0])


@pytest.mark.parametrize("name", ["toy", "plant_fom", "dskse"])
def test_outputs_in_initialization_mode_are_those_at_its_end(toy, fmus, load, name):
    """As a host asks for them that passes them on to other FMUs before any of them runs."""
    host, other = (load({**fmus, "toy": toy.fmu}[name]) for _ in range(2))
    inputs = {"toy": {"force": 3.0, "mass.inertia": 0.3}, "dskse": {"engine_torque": 100.0, "engine_speed": 150.0},
              "plant_fom": {"engine_torque": 100.0, "start.vehicle_speed": 12.0}}[name]
    host.setupExperiment()
    host.enterInitializationMode()
    before = host.outputs()
    for key, value in inputs.items():
        host[key] = value
    early = host.outputs()
    host.exitInitializationMode()
    other.initialize(**inputs)
    assert early == host.outputs() == other.outputs()
    assert name == "toy" or early != before  # which starts at rest whatever pulls at it
    assert host.run(0, 20) == other.run(0, 20)


def test_snapshot_from_the_initialization(fmus, load):
    """What is set after it is restored acts on outputs again."""
    host = load(fmus["plant_fom"])
    host.setupExperiment()
    host.enterInitializationMode()
    host["start.vehicle_speed"] = 12.0
    before = host.outputs()
    snapshot = host.getFMUState()
    host["start.vehicle_speed"] = 20.0
    faster = host.outputs()
    host.setFMUState(snapshot)
    assert host.outputs() == before != faster
    host["start.vehicle_speed"] = 20.0
    assert host.outputs() == faster
    host.exitInitializationMode()
    assert host.outputs() == faster


def test_snapshot_from_the_initialization_holds_the_start_time(fmus, load):
    """Also for an instance that was never told one: an estimator that began at 0 would miss all frames before 5 s."""
    host, other = load(fmus["dskse"]), load(fmus["dskse"])
    host.setupExperiment(startTime=5.0)
    host.enterInitializationMode()
    other.setFMUState(other.deserializeFMUState(host.serializeFMUState(host.getFMUState())))
    rows = []
    for each in (host, other):
        each.exitInitializationMode()
        each["engine_torque"], each["engine_speed"], each["wheel_speed"] = 100.0, 150.0, 30.0
        rows.append(each.run(500, 3))
    assert rows[0] == rows[1] and rows[0][0] != rows[0][1]
    assert host.messages == other.messages == []


def test_what_cannot_be_initialized_yet_is_told_at_the_end_of_initialization(toy, load):
    host = load(toy.fmu)
    host.setupExperiment()
    host.enterInitializationMode()
    host["mass.inertia"] = -1.0
    host.outputs()
    assert "mass.inertia" in failure(host, host.exitInitializationMode)


def test_snapshot_from_before_the_initialization(toy, load):
    host = load(toy.fmu)
    snapshot = host.getFMUState()
    host.initialize(force=3.0)
    expected = host.run(0, 5)
    host.setFMUState(snapshot)
    assert host["force"] == 0.0
    host.initialize(force=3.0)
    assert host.run(0, 5) == expected


def test_foreign_bytes_are_refused(toy, load):
    host = load(toy.fmu)
    host.initialize()
    state = host.deserializeFMUState(b"\x01 not a snapshot")
    assert "not a saved state of toy" in failure(host, host.setFMUState, state)


@pytest.mark.parametrize("damage", [lambda saved: saved[:1], lambda saved: b"\x07" + saved[1:]])
def test_a_damaged_snapshot_is_refused(toy, load, damage):
    host = load(toy.fmu)
    host.initialize()
    state = host.deserializeFMUState(damage(host.serializeFMUState(host.getFMUState())))
    assert "not a saved state of toy" in failure(host, host.setFMUState, state)
    host.reset()
    host.initialize()
    assert host.run(0, 2)


def test_snapshot_goes_on_in_a_new_process(toy, load, go_on_elsewhere):
    host = load(toy.fmu)
    host.initialize(**{"force": 3.0, "mass.inertia": 0.3})
    host.run(0, 10)
    outputs, _ = go_on_elsewhere(host.unzipDirectory, host.serializeFMUState(host.getFMUState()), 10, 20)
    assert outputs == host.run(10, 20)[-1]


def test_instances_come_and_go(toy, load):
    """Every load takes a reference from the slave's namespace; unless lent one, the process dies."""
    host = load(toy.fmu)
    host.initialize()
    path = list(sys.path)
    module = sys.modules[Path(host.unzipDirectory, "resources", "slavemodule.txt").read_text()]
    references = sys.getrefcount(module.__dict__)
    for _ in range(30):
        load(toy.fmu, Path(host.unzipDirectory)).freeInstance()
    host.run(0, 3)
    gc.collect()
    assert sys.getrefcount(module.__dict__) >= references
    assert sum(isinstance(each, module.Toy) for each in gc.get_objects()) == 1
    assert sys.path == path
