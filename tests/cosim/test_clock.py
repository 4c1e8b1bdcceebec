"""The clock counts whole nanoseconds and ends where it should."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.master.clock import Clock, nanoseconds, step_length
from driveline.quantities import InputError

lengths = st.integers(1, 50_000)


@given(stop=st.integers(1, 400_000), periods=st.lists(lengths, min_size=1, max_size=4),
       block=st.integers(1, 40))
def test_visits_every_multiple_of_every_period_once_and_ends_at_the_stop(
        stop, periods, block):
    periods = [max(period, stop // 300) for period in periods]
    clock = Clock(7, 7 + stop, periods)
    times, masks = (np.concatenate(parts) for parts in zip(*clock.blocks(block)))
    expected = {k for period in periods for k in range(0, stop + 1, period)} | {stop}
    assert (times - 7).tolist() == sorted(expected)
    for period in periods:
        due = times[masks & clock.bit(period) != 0] - 7
        assert due.tolist() == list(range(0, stop + 1, period))
        assert clock.count(period) == due.size + (stop % period > 0)


@pytest.mark.parametrize("step", [0.0007, 0.1, 0.3, 1e-9, 0.000123457, 68080.035637, 86400.000000001])
def test_a_step_written_in_seconds_is_that_many_nanoseconds(step):
    assert step_length(step, "step") / 1e9 == step
    assert nanoseconds(-step, "start") == -step_length(step, "step")


@pytest.mark.parametrize(("seconds", "words"), [
    (1 / 3, "whole number of nanoseconds"), (2 / 3, "whole number"), (1 / 1024, "whole number"),
    (float("nan"), "at most"), (float("inf"), "at most"), (1e9, "at most"), (0.5e-9, "whole number")])
def test_times_between_two_nanoseconds_are_refused(seconds, words):
    with pytest.raises(InputError, match=words):
        nanoseconds(seconds, "step")


@pytest.mark.parametrize("seconds", [0.0, -1e-3])
def test_a_step_has_a_positive_length(seconds):
    with pytest.raises(InputError, match="positive"):
        step_length(seconds, "step of a")


def test_a_run_ends_after_it_starts():
    with pytest.raises(InputError, match="later stop"):
        Clock(5, 5, [1])
