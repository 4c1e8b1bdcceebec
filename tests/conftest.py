"""What several folders of tests share."""

import os
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# how long an example takes says how busy the machine is, not whether the law holds
settings.register_profile("timeless", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("timeless")
# a process a core runs them, so linear algebra has one each; before anything imports numpy
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parent))  # runs.py, drives.py ... for several


def pytest_configure() -> None:
    """Compile the kernels once, before there are processes that would each do it."""
    from driveline.kernels import native

    if "PYTEST_XDIST_WORKER" not in os.environ:
        with suppress(native.Unavailable):  # tests that need them say why there are none
            native.libraries()


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every FMU of the package, built once: its file by model name."""
    from fmus.packaging import build

    return {path.stem: path for path in build(tmp_path_factory.mktemp("fmus"))}
