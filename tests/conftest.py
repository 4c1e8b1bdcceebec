"""What several folders of tests share."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Every FMU of the package, built once: its file by model name."""
    from fmus.packaging import build

    return {path.stem: path for path in build(tmp_path_factory.mktemp("fmus"))}
