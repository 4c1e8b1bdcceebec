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
