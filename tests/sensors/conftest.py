"""The sensors' kernels as entry points of their own, compiled and plain."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from driveline.kernels import backend, native


@pytest.fixture(scope="session")
def kernels() -> Iterator[Callable[..., native.Entry]]:
    """Loads an entry point of ``sensor_kernels`` by name and backend."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parent)
        patch.setattr(backend, "KERNEL_MODULES", ("sensor_kernels",))
        native._loaded.cache_clear()
        entries = {(name, way): native.load(name, way) for way in ("native", "python")
                   for name in ("filter_signal", "channel_signal", "random_numbers")}
    native._loaded.cache_clear()
    yield lambda name, way="native": entries[name, way]
