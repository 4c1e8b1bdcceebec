"""What several folders of tests share."""

import os
import sys
from pathlib import Path

import pytest

# a process a core runs them, so linear algebra has one each; before anything imports numpy
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parent))  # runs.py, drives.py ... for several


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every FMU of the package, built once: its file by model name."""
    from fmus.packaging import build

    return {path.stem: path for path in build(tmp_path_factory.mktemp("fmus"))}
