"""The FMU under a host that is not written in Python."""

import numpy as np
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

STEP = 2.0**-7  # the host adds up times in nanoseconds: these it can


def start(fmu, step=STEP):
    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_step_size(int(step * 1e9))
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmu), instance_name="toy"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    return execution, slave, observer


def test_libcosim_gives_the_same_trajectory(toy, load):
    execution, slave, observer = start(toy.fmu)
    execution.real_initial_value(slave, 4, 3.0)
    execution.integer_initial_value(slave, 5, 2)
    host = load(toy.fmu)
    host.initialize(force=3.0, gear=2)
    for step in range(50):
        assert execution.step()
        in_fmpy = host.run(step, 1, STEP)[0]
        assert [*observer.last_real_values(slave, [7, 8]),
                *observer.last_integer_values(slave, [9])] == in_fmpy[:3]


def test_libcosim_gives_the_plants_trajectory(fmus, load):
    step = 2.0**-9  # about 2 ms, whole nanoseconds
    host = load(fmus["plant_fom"])
    values = {"engine_torque": 150.0, "start.vehicle_speed": 15.0}
    host.initialize(**values)
    execution, slave, observer = start(fmus["plant_fom"], step)
    for name, value in values.items():
        execution.real_initial_value(slave, host.variables[name].valueReference, value)
    execution.integer_initial_value(slave, host.variables["gear"].valueReference, host["gear"])
    outputs = [v.valueReference for v in host.variables.values() if v.causality == "output"]
    for i in range(50):
        assert execution.step()
        assert observer.last_real_values(slave, outputs) == host.run(i, 1, step)[0]


def test_libcosim_lives_on_after_an_error(toy):
    execution, slave, _ = start(toy.fmu)
    manipulator = CosimManipulator.create_override()
    execution.add_manipulator(manipulator)
    assert execution.step()
    manipulator.slave_real_values(slave, [4], [np.nan])
    assert not execution.step()
    del execution
    execution, *_ = start(toy.fmu)
    assert execution.step()
