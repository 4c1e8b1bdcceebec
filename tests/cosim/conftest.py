"""FMUs for the master's tests: the toy models in the shell every FMU has, and a foreign one."""

import shutil
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

sys.path.insert(0, str(HERE))  # toys.py is shipped in FMUs, so it is no module of a package here

SHELL = '''
from driveline.toys import MODELS

from fmus.shell import ModelSlave


class ToySlave(ModelSlave):
    """Holds one of the toy models."""

    models = MODELS
'''


@pytest.fixture(scope="session")
def fmus(tmp_path_factory):
    """A folder with lag.fmu and counter.fmu."""
    import toys

    from fmus.packaging import write_fmu

    folder = tmp_path_factory.mktemp("toy fmus")
    payload = folder / "payload"
    payload.mkdir()
    for name in ("__init__.py", "model.py", "quantities.py"):
        shutil.copy(ROOT / "driveline" / name, payload)
    shutil.copy(HERE / "toys.py", payload)
    slave = folder / "toy_slave.py"
    slave.write_text(SHELL)
    for name, model in toys.MODELS.items():
        write_fmu(folder / f"{name}.fmu", model({}), slave, payload=payload)
    return folder


FOREIGN = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class Foreign(Fmi2Slave):
    """As anybody might write one: no units, no dependencies, a string and an internal variable."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.label, self.level, self.doubled, self.root, self.inner = "", 0.0, 0.0, 0.0, 0
        self.register_variable(String("label", causality=Fmi2Causality.parameter,
                                      variability=Fmi2Variability.tunable))
        self.register_variable(Real("level", causality=Fmi2Causality.input))
        self.register_variable(Real("doubled", causality=Fmi2Causality.output))
        self.register_variable(Real("root", causality=Fmi2Causality.output))
        self.register_variable(Integer("inner", causality=Fmi2Causality.local))

    def do_step(self, current_time, step_size):
        self.doubled = 2.0 * self.level
        self.root = self.level**0.5 if self.level >= 0.0 else float("nan")
        self.inner += 1
        return True
'''


WORDED = '''
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real, String


class Worded(Fmi2Slave):
    """Has a string for an input and one for an output: shows how long the first is, negative while off."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.words, self.said, self.on, self.shown = "hi", "", False, 0.0
        self.register_variable(String("words", causality=Fmi2Causality.input))
        self.register_variable(String("said", causality=Fmi2Causality.output))
        self.register_variable(Boolean("on", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed))
        self.register_variable(Real("shown", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.shown = len(self.words) * (1.0 if self.on else -1.0)
        return True
'''

SILENT = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Silent(Fmi2Slave):
    """Has no outputs."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.level = 0.0
        self.register_variable(Real("level", causality=Fmi2Causality.input))

    def do_step(self, current_time, step_size):
        return True
'''


@pytest.fixture(scope="session")
def foreign_fmus(tmp_path_factory):
    """A folder with foreign.fmu, worded.fmu and silent.fmu, made without this project."""
    from pythonfmu import FmuBuilder

    folder = tmp_path_factory.mktemp("foreign")
    for name, script in (("foreign", FOREIGN), ("worded", WORDED), ("silent", SILENT)):
        (folder / f"{name}.py").write_text(script)
        FmuBuilder.build_FMU(folder / f"{name}.py", dest=folder).rename(folder / f"{name}.fmu")
    return folder


@pytest.fixture(scope="session")
def foreign_fmu(foreign_fmus):
    """As anybody might write one."""
    return foreign_fmus / "foreign.fmu"
