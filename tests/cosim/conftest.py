"""FMUs for the master's tests: the toy models in the shell every FMU has, foreign ones, and a strict one in C."""

import shutil
import subprocess
import sys
import zipfile
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


STRICT = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="Strict" guid="{8c4e810f}" generationTool="somebody's">
<CoSimulation modelIdentifier="strict" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions>
<Unit name="engineRev"><BaseUnit rad="1" s="-1" factor="0.1"/></Unit>
<Unit name="level"><BaseUnit K="1" factor="2" offset="273.15"/></Unit>
<Unit name="undefined"/>
</UnitDefinitions>
<TypeDefinitions>
<SimpleType name="Speed"><Real unit="engineRev" min="-9000" max="9000"/></SimpleType>
<SimpleType name="Mode"><Enumeration><Item name="off" value="1"/><Item name="on" value="2"/></Enumeration></SimpleType>
</TypeDefinitions>
<ModelVariables>
<ScalarVariable name="u" valueReference="0" causality="input"><Real declaredType="Speed" start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="1" causality="output"><Real declaredType="Speed" max="5000"/></ScalarVariable>
<ScalarVariable name="k" valueReference="2" causality="parameter" variability="tunable"><Real start="1"/>
</ScalarVariable>
<ScalarVariable name="n" valueReference="10" causality="parameter" variability="fixed"><Integer start="1"/>
</ScalarVariable>
<ScalarVariable name="mode" valueReference="11" causality="input" variability="discrete">
<Enumeration declaredType="Mode" start="1"/></ScalarVariable>
<ScalarVariable name="count" valueReference="11" causality="input" variability="discrete"><Integer start="1"/>
</ScalarVariable>
<ScalarVariable name="shown" valueReference="12" causality="output" variability="discrete"><Integer/>
</ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2"/><Unknown index="7" dependencies=""/></Outputs></ModelStructure>
</fmiModelDescription>
"""


# what a host looks for when it loads the library, and does not call here
UNUSED = ("SetDebugLogging", "Reset", "GetBoolean", "SetBoolean", "GetString", "SetString", "GetFMUstate",
          "SetFMUstate", "FreeFMUstate", "SerializedFMUstateSize", "SerializeFMUstate", "DeSerializeFMUstate",
          "GetDirectionalDerivative", "SetRealInputDerivatives", "GetRealOutputDerivatives", "CancelStep", "GetStatus",
          "GetRealStatus", "GetIntegerStatus", "GetBooleanStatus", "GetStringStatus")


@pytest.fixture(scope="session")
def strict_fmu(tmp_path_factory):
    """strict.c, which is no Python and refuses whatever the standard forbids, with units of its own definition."""
    import fmpy

    from driveline.kernels import native

    if fmpy.platform != "linux64":
        pytest.skip("compiled for Linux")
    folder = tmp_path_factory.mktemp("strict")
    library, unused = folder / "strict.so", folder / "unused.c"
    unused.write_text("".join(f"int fmi2{name}(void) {{ return 3; }}\n" for name in UNUSED))
    subprocess.run([sys.executable, "-m", "ziglang", "cc", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror",
                    "-I", str(Path(fmpy.__file__).parent / "c-code"), str(HERE / "strict.c"), str(unused), "-o",
                    str(library)], check=True, env=native.compiling())
    with zipfile.ZipFile(folder / "strict.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", STRICT)
        archive.write(library, "binaries/linux64/strict.so")
    return folder / "strict.fmu"
