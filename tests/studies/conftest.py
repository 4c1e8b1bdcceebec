"""What the tests of studies share."""

import pytest

from cosim import studies
from driveline.quantities import InputError


@pytest.fixture(scope="module")
def no_fmus():
    """In process only: studies must do without built FMUs, and say so."""
    def nothing_built(name):
        raise InputError("nothing is built")

    with pytest.MonkeyPatch.context() as patch:
        for module in ("estimation", "manoeuvre"):
            patch.setattr(f"cosim.studies.{module}.find_fmu", nothing_built)
        yield


@pytest.fixture(scope="module")
def ran(request, no_fmus, tmp_path_factory):
    """Runs a small case of a study once; its folder, result and what progress it told.

    The module's ``SMALL`` has what makes each small.
    """
    cache = {}

    def run(name):
        if name not in cache:
            out, shares = tmp_path_factory.mktemp(name), []
            cache[name] = out, studies.run(name, out, shares.append, **request.module.SMALL[name]), shares
        return cache[name]

    return run
