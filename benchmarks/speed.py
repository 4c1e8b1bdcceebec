"""How fast plants, FMUs, the master and another host are: printed as ratios of one run, never asserted.

    python -m benchmarks.speed [--seconds S] [--repeats N]

Everything is timed in the same manoeuvre, a step of the requested torque that crosses the lash, with a
communication step of 1 ms. The shortest of some repeats counts: other work on the machine only adds time.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from cosim.master import Master, Step
from driveline.kernels import native
from driveline.models import MODELS, SHIPPED_VARIANT, SHIPPED_VEHICLE
from driveline.vehicles import load
from fmus.packaging import build

STEP = 1e-3
NANOSECONDS = 1_000_000  # of a step
BEFORE, AFTER, CHANGE = -20.0, 200.0, 100  # requested torque [N.m], and the step at which it changes
START = {"start.vehicle_speed": 12.5, "engine_torque": BEFORE}
FULL, REDUCED = "plant_fom", "plant_rom_3dof"
TORQUE, SHOWN, FEED = "engine_torque", "propeller_shaft_torque", "crankshaft_torque"
THESIS = {FULL: 9.38, REDUCED: 3.85}  # run time over simulated time, thesis table 2.8
MANOEUVRE = 7.0  # [s], one of those that fits and studies run by the thousand


@dataclass(frozen=True)
class Figure:
    """One line of the report.

    Attributes:
        name: What was measured.
        value, unit: The figure.
        note: What to compare it with.
    """

    name: str
    value: float
    unit: str
    note: str = ""


@dataclass(frozen=True)
class Trip:
    """A timed run.

    Attributes:
        pace: Run time over simulated time, start-up left out.
        rows: The recorded torques after each step.
    """

    pace: float
    rows: np.ndarray


def fastest(repeats: int, run: Callable[[], Trip]) -> Trip:
    """The run with the best pace."""
    return min((run() for _ in range(repeats)), key=lambda trip: trip.pace)


def seconds_of(repeats: int, run: Callable[[], object]) -> float:
    """The shortest of some run times [s]."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return min(times)


# -- the same two FMUs under three hosts -------------------------------------------------------------


class Bare:
    """An FMU as FMPy shows it and nothing around it: the least that a Python host can do.

    Args:
        path: The FMU.
        folder: Where it is extracted; shared by all instances of it.
    """

    def __init__(self, path: Path, folder: Path) -> None:
        folder = folder / path.stem
        if not folder.exists():
            fmpy.extract(str(path), str(folder))
        described = fmpy.read_model_description(str(folder))
        self._references = {v.name: v.valueReference for v in described.modelVariables}
        self.slave = FMU2Slave(guid=described.guid, unzipDirectory=str(folder), instanceName=path.stem,
                               modelIdentifier=described.coSimulation.modelIdentifier)
        self.slave.instantiate()

    def references(self, *names: str) -> list[int]:
        return [self._references[name] for name in names]

    def initialize(self, **values: float) -> None:
        values = START | values
        self.slave.setReal(self.references(*values), list(values.values()))
        self.slave.setupExperiment()
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def close(self) -> None:
        self.slave.terminate()
        self.slave.freeInstance()


def bare_single(path: Path, folder: Path, steps: int) -> Trip:
    """One FMU in a hand-written loop."""
    fmu = Bare(path, folder)
    fmu.initialize()
    slave, torque, shown = fmu.slave, fmu.references(TORQUE), fmu.references(SHOWN)
    rows = np.empty((steps, 1))
    began = time.perf_counter()
    for i in range(steps):
        slave.setReal(torque, [AFTER if i >= CHANGE else BEFORE])
        slave.doStep(i * NANOSECONDS / 1e9, STEP)
        rows[i] = slave.getReal(shown)
    pace = (time.perf_counter() - began) / (steps * STEP)
    fmu.close()
    return Trip(pace, rows)


def bare_pair(fmus: dict[str, Path], folder: Path, steps: int) -> Trip:
    """The full-order plant's torque drives the reduced plant: hand-written loop, Jacobi order."""
    full, reduced = (Bare(fmus[name], folder) for name in (FULL, REDUCED))
    full.initialize()
    a, b = full.slave, reduced.slave
    torque, shown_a = full.references(TORQUE), full.references(FEED, SHOWN)
    fed, shown_b = reduced.references(TORQUE), reduced.references(SHOWN)
    carried = a.getReal(shown_a)[0]
    reduced.initialize(engine_torque=carried)
    rows = np.empty((steps, 2))
    began = time.perf_counter()
    for i in range(steps):
        now = i * NANOSECONDS / 1e9
        a.setReal(torque, [AFTER if i >= CHANGE else BEFORE])
        b.setReal(fed, [carried])
        a.doStep(now, STEP)
        b.doStep(now, STEP)
        carried, rows[i, 0] = a.getReal(shown_a)
        rows[i, 1] = b.getReal(shown_b)[0]
    pace = (time.perf_counter() - began) / (steps * STEP)
    full.close()
    reduced.close()
    return Trip(pace, rows)


def master_pair(fmus: dict[str, Path], steps: int) -> Trip:
    """The same through ``cosim.master``, checks, provenance and all; two blocks of steps at least."""
    start = {"start.vehicle_speed": START["start.vehicle_speed"]}
    master = Master(step=STEP)
    master.add("full", fmus[FULL], parameters=start).add("reduced", fmus[REDUCED], parameters=start)
    master.connect(Step(before=BEFORE, after=AFTER, time=CHANGE * STEP), f"full.{TORQUE}")
    master.connect(f"full.{FEED}", f"reduced.{TORQUE}")
    master.record(f"full.{SHOWN}", f"reduced.{SHOWN}")
    clock = []  # instants reached, and when
    result = master.run(steps * STEP, progress=lambda at: clock.append((at, time.perf_counter())))
    (first, began), (last, ended) = clock[0], clock[-1]
    return Trip((ended - began) / (last - first), np.column_stack(list(result.signals.values()))[1:])


def libcosim_pair(fmus: dict[str, Path], steps: int) -> Trip:
    """The same under libcosim, whose loop is C++ and steps both FMUs in threads of its own."""
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_step_size(NANOSECONDS)
    observer = CosimObserver.create_time_series(steps + 1)
    manipulator = CosimManipulator.create_override()
    execution.add_observer(observer)
    execution.add_manipulator(manipulator)
    members = []  # number of the slave, value references by name
    for name in (FULL, REDUCED):
        described = fmpy.read_model_description(str(fmus[name]))
        number = execution.add_local_slave(CosimLocalSlave(fmu_path=str(fmus[name]), instance_name=name))
        members.append((number, {v.name: v.valueReference for v in described.modelVariables}))
    for number, references in members:
        for variable, value in START.items():
            execution.real_initial_value(number, references[variable], value)
        observer.start_time_series(number, references[SHOWN], CosimVariableType.REAL)
    (full, of_full), (reduced, of_reduced) = members
    execution.connect_real_variables(full, of_full[FEED], reduced, of_reduced[TORQUE])
    execution.step(CHANGE)
    manipulator.slave_real_values(full, [of_full[TORQUE]], [AFTER])
    began = time.perf_counter()
    execution.step(steps - CHANGE)
    pace = (time.perf_counter() - began) / ((steps - CHANGE) * STEP)
    rows = [observer.time_series_real_samples(number, references[SHOWN], 1, steps)[2]
            for number, references in members]
    return Trip(pace, np.column_stack(rows))


# -- what is reported ----------------------------------------------------------------------------------


def hosts(fmus: dict[str, Path], folder: Path, steps: int, repeats: int) -> list[Figure]:
    """FMUs alone, and two of them under three hosts."""
    figures = []
    for name, printed in THESIS.items():
        trip = fastest(repeats, lambda name=name: bare_single(fmus[name], folder, steps))
        note = f"run time over simulated time; thesis {printed}: {printed / trip.pace:.0f} times"
        figures.append(Figure(f"{name}, bare FMPy loop", trip.pace, "s/s", note))
    bare = fastest(repeats, lambda: bare_pair(fmus, folder, steps))
    master = fastest(repeats, lambda: master_pair(fmus, steps))
    other = fastest(repeats, lambda: libcosim_pair(fmus, steps))
    return [
        *figures,
        Figure("both connected, bare FMPy loop", bare.pace, "s/s", "the next two are relative to this"),
        Figure("both connected, cosim.master", master.pace / bare.pace, "x"),
        Figure("both connected, libcosim", other.pace / bare.pace, "x"),
        Figure("largest difference, cosim.master", np.abs(master.rows - bare.rows).max(), "N.m",
               f"of the trajectories, peak {np.abs(bare.rows).max():.0f} N.m"),
        Figure("largest difference, libcosim", np.abs(other.rows - bare.rows).max(), "N.m", "it counts time otherwise"),
    ]


def fresh(path: Path, instances: int) -> list[Figure]:
    """Start-up and memory in a new process."""
    began = time.perf_counter()
    done = subprocess.run([sys.executable, Path(__file__).with_name("fresh.py"), path, str(instances)],
                          capture_output=True, text=True, check=True)
    whole = time.perf_counter() - began
    cost = json.loads(done.stdout.splitlines()[-1])
    ready = cost["import"] + cost["extract"] + cost["start"]
    figures = [
        Figure(f"{path.stem}, start-up", cost["extract"] + cost["start"], "s",
               f"extract, load, initialize, step; target 2; {ready:.2f} with the import of FMPy, "
               f"{whole:.2f} the whole process with {instances} more instances"),
        Figure(f"{path.stem}, another instance", cost["another"], "s"),
    ]
    if cost["resident"] is not None:
        figures.append(Figure(f"{path.stem}, memory of an instance", cost["resident"] / 2**20, "MiB",
                              f"growth of the resident memory over {instances} instances"))
    return figures


def in_process(seconds: float, repeats: int) -> list[Figure]:
    """The plant without an FMU: rates for fits, one call of the kernel, compiled against plain Python."""
    values = MODELS[FULL].defaults_from(load(SHIPPED_VEHICLE, SHIPPED_VARIANT))

    def ready(backend: str):
        model = MODELS[FULL](values, backend=backend)
        for name, value in START.items():
            model[name] = value
        model.initialize()
        return model

    model = ready("auto")
    at_start = model.save()
    rows = np.tile(model.values[:len(model.inputs)], (round(MANOEUVRE / STEP), 1))
    rows[CHANGE:, 0] = AFTER

    def manoeuvre(model, steps: int, propagated: bool = False) -> None:
        model.restore(at_start)
        model.simulate(rows[:steps], STEP, propagated=propagated)

    def step_by_step() -> None:
        model.restore(at_start)
        for i in range(len(rows)):
            model.step(i * NANOSECONDS / 1e9, STEP)

    whole = seconds_of(repeats, lambda: manoeuvre(model, len(rows)))
    at_once = seconds_of(repeats, lambda: manoeuvre(model, len(rows), propagated=True))
    single = seconds_of(repeats, step_by_step) / len(rows)
    figures = [
        Figure("in process, simulate()", 1.0 / whole, "1/s", f"manoeuvres of {MANOEUVRE:g} s, one core"),
        Figure("in process, 1 ms within simulate()", whole / len(rows) * 1e6, "us", "the kernel alone"),
        Figure("in process, simulate(propagated=True)", at_once / whole, "x",
               "time of whole steps at once over that of sub-steps"),
        Figure("in process, step() of 1 ms", single * 1e6, "us", "with checks and the call of the kernel"),
    ]
    steps = max(round(seconds / STEP), 2)
    if native.load("network_run").backend == "native":
        plain = ready("python")
        slow = seconds_of(1, lambda: manoeuvre(plain, steps))
        fast = seconds_of(repeats, lambda: manoeuvre(model, steps))
        figures.append(Figure("in process, plain Python over compiled", slow / fast, "x",
                              f"{slow / (steps * STEP):.1f} s/s uncompiled"))
    return figures


def measure(seconds: float, repeats: int, instances: int, folder: Path) -> list[Figure]:
    """All figures.

    Args:
        seconds: Simulated time of a run; above 2, so that the master's steps can be told from its start.
        folder: For FMUs and what is extracted from them.
    """
    fmus = {path.stem: path for path in build(folder / "fmus")}
    return [
        *hosts(fmus, folder / "extracted", round(seconds / STEP), repeats),
        *fresh(fmus[FULL], instances),
        *in_process(seconds / 10.0, repeats),
    ]


def processor() -> str:
    """Model of the processor and number of its cores, where the system tells."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{model}, {os.cpu_count()} cores"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=2.5, help="simulated time of a run (default: 2.5)")
    parser.add_argument("--repeats", type=int, default=25, help="the shortest of so many counts (default: 25)")
    options = parser.parse_args()
    print(processor())
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for figure in measure(options.seconds, options.repeats, 20, Path(folder)):
            print(f"{figure.name:42} {figure.value:10.4g} {figure.unit:4} {figure.note}".rstrip())


if __name__ == "__main__":
    main()
