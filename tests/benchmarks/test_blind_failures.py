"""Cases in a line."""

from findings import perfect

from benchmarks.blind import failures


def test_a_result_of_when_there_was_one_vehicle_is_still_told():
    before = {key: value for key, value in perfect()[0].items() if key != "vehicle"}
    assert failures.line(before) == failures.line(perfect()[0])
