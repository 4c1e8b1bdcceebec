"""A toy FMU, built twice from different sources, and a host that keeps what an FMU logs."""

import importlib.util
import shutil
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
