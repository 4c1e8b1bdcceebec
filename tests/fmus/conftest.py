"""A toy FMU, built twice from different sources, and a host that keeps what an FMU logs."""

import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import fmpy
import fmpy.fmi2 as fmi2
import pytest

from driveline.model import Model
from fmus.packaging import DRIVELINE, write_fmu

TOY = Path(__file__).parent / "toy"


@dataclass(frozen=True, eq=False)
class Toy:
    """One build: its payload, its slave script, its FMU and the model's class in process."""

    payload: Path
    slave: Path
    fmu: Path
    model: type[Model]


def build_toy(folder: Path, gain: str, identifier: str = "toy") -> Toy:
    """A payload as small as possible; the gain is a number in its source, not a parameter."""
    payload = folder / f"toy_payload_{gain.replace('.', '_')}"
    payload.mkdir(parents=True)
    for name in ("__init__.py", "model.py", "quantities.py"):
        shutil.copy(DRIVELINE / name, payload)
    source = (TOY / "models.py").read_text(encoding="utf-8").replace("GAIN = 1.0", f"GAIN = {gain}")
    (payload / "models.py").write_text(source, encoding="utf-8")
    place = {"submodule_search_locations": [str(payload)]}
    package = importlib.util.spec_from_file_location(payload.name, payload / "__init__.py", **place)
    sys.modules[payload.name] = importlib.util.module_from_spec(package)
    package.loader.exec_module(sys.modules[payload.name])
    model = importlib.import_module(f"{payload.name}.models").SprungMass
    slave = TOY / "toy_slave.py"
    fmu = write_fmu(folder / f"{identifier}.fmu", model({}), slave, payload=payload)
    return Toy(payload, slave, fmu, model)


@pytest.fixture(scope="session")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Toy:
    """The toy FMU."""
    return build_toy(tmp_path_factory.mktemp("toy"), "1.0")


@pytest.fixture(scope="session")
def other_toy(tmp_path_factory: pytest.TempPathFactory) -> Toy:
    """The toy FMU from other sources, under the same name."""
    return build_toy(tmp_path_factory.mktemp("other_toy"), "2.0")


class FMU2Host(fmi2.FMU2Slave):  # FMPy finds the FMI version in the name of the class
    """An instance of an FMU; ``messages`` holds (status, text) of all it logged."""

    def __init__(self, fmu: Path, folder: Path) -> None:
        if not folder.exists():  # a binary that is loaded already must not be written again
            fmpy.extract(str(fmu), str(folder))
        described = fmpy.read_model_description(str(folder))
        super().__init__(guid=described.guid, unzipDirectory=str(folder), instanceName=fmu.stem,
                         modelIdentifier=described.coSimulation.modelIdentifier)
        self.variables = {variable.name: variable for variable in described.modelVariables}
        self.messages: list[tuple[int, str]] = []
        self._logger = fmi2.fmi2CallbackLoggerTYPE(
            lambda environment, name, status, category, text: self.messages.append((status, text.decode())))
        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = self._logger
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self.instantiate(callbacks=callbacks, loggingOn=True)

    def freeInstance(self) -> None:
        """Free the instance, once."""
        if self.component is not None:
            super().freeInstance()
            self.component = None

    def __setitem__(self, name: str, value: float) -> None:
        variable = self.variables[name]
        getattr(self, f"set{variable.type}")([variable.valueReference], [value])

    def __getitem__(self, name: str) -> float:
        variable = self.variables[name]
        return getattr(self, f"get{variable.type}")([variable.valueReference])[0]

    def initialize(self, **values: float) -> None:
        """Set values and leave the initialization."""
        for name, value in values.items():
            self[name] = value
        self.setupExperiment()
        self.enterInitializationMode()
        self.exitInitializationMode()

    def outputs(self) -> list[float]:
        """All outputs, in the order of their declaration."""
        return [self[name] for name, v in self.variables.items() if v.causality == "output"]

    def run(self, first: int, count: int, dt: float = 0.01) -> list[list[float]]:
        """The outputs after each of ``count`` steps from step number ``first`` on."""
        rows = []
        for step in range(first, first + count):
            self.doStep(step * dt, dt)
            rows.append(self.outputs())
        return rows


_BARE = """
import sys
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"scipy", "numba", "llvmlite", "ziglang", "driveline", "fmus", "cosim",
                                      "pythonfmu", "platformdirs", "pint", "polars"}:
            raise ModuleNotFoundError(f"{name} is not here", name=name)
sys.meta_path.insert(0, Missing())
import fmpy
for path in sys.argv[1:]:
    print(len(fmpy.simulate_fmu(path, stop_time=0.05, output_interval=0.01, debug_logging=True)), "points")
"""


@pytest.fixture
def simulate_with_numpy_alone(tmp_path: Path) -> Callable[..., str]:
    """Simulates 5 steps of each FMU in a process that has FMPy and numpy; gives what it prints."""

    def simulate(*fmus: Path) -> str:
        done = subprocess.run([sys.executable, "-I", "-c", _BARE, *map(str, fmus)], cwd=tmp_path,
                              capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return simulate


_ELSEWHERE = """
import sys
from pathlib import Path
from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave
folder, snapshot, first, count, dt = sys.argv[1:]
described = read_model_description(folder)
fmu = FMU2Slave(guid=described.guid, unzipDirectory=folder, instanceName="elsewhere",
                modelIdentifier=described.coSimulation.modelIdentifier)
fmu.instantiate(loggingOn=True)
fmu.setFMUState(fmu.deserializeFMUState(Path(snapshot).read_bytes()))
for step in range(int(first), int(first) + int(count)):
    fmu.doStep(step * float(dt), float(dt))
outputs = [v for v in described.modelVariables if v.causality == "output"]
print()
print(*[float(getattr(fmu, "get" + v.type)([v.valueReference])[0]).hex() for v in outputs])
"""


@pytest.fixture
def go_on_elsewhere(tmp_path: Path) -> Callable[..., tuple[list[float], str]]:
    """Restores a snapshot in a new process and runs on; gives the last outputs, and what was logged."""

    def run(folder: Path, saved: bytes, first: int, count: int, dt: float = 0.01) -> tuple[list[float], str]:
        snapshot = tmp_path / "snapshot"
        snapshot.write_bytes(saved)
        arguments = map(str, (folder, snapshot, first, count, dt))
        done = subprocess.run([sys.executable, "-c", _ELSEWHERE, *arguments], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return [float.fromhex(value) for value in done.stdout.splitlines()[-1].split()], done.stdout

    return run


@pytest.fixture
def load(tmp_path: Path) -> Iterator[Callable[..., FMU2Host]]:
    """Extracts and instantiates an FMU; frees what the test loaded."""
    hosts: list[FMU2Host] = []

    def load(fmu: Path, folder: Path | None = None) -> FMU2Host:
        hosts.append(FMU2Host(fmu, folder or tmp_path / f"instance {len(hosts)}"))
        return hosts[-1]

    yield load
    for host in hosts:
        host.freeInstance()
