"""What a diagnosis makes of what was found."""

import numpy as np
import pytest

from cosim.diagnosis.diagnose import MISSING, is_missing


@pytest.mark.parametrize(("told", "is_there"), [
    ([0.5], False), ([2.0], True), ([2.0, 2.0, 2.0], True),
    ([9.0, 0.1, 0.5], False),  # one recording, where the lash is crossed at another moment
    ([9.0, 2.5, 0.0], True), ([0.5, 9.0], False), ([2.0, 9.0], True)])
def test_a_torque_is_missing_where_more_than_one_recording_says_so(told, is_there):
    assert is_missing(MISSING * np.array(told)) is is_there
