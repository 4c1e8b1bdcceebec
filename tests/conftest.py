"""What several folders of tests share."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # runs.py, which several folders use


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every FMU of the package, built once: its file by model name."""
    from fmus.packaging import build

    return {path.stem: path for path in build(tmp_path_factory.mktemp("fmus"))}
