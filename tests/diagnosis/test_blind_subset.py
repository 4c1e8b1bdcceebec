"""A dozen of the blind cases, each with the beginning of a tip-in: the diagnosis gets the folder and nothing else.

How often it is right, and where it is wrong, is measured by `benchmarks.blind`; these it got right, and has to go on
getting right.
"""

import pytest

from benchmarks.blind import reading
from benchmarks.blind.cases import cases
from benchmarks.blind.failures import line
from benchmarks.blind.run import examined
from cosim.studies.sweep import Case, Sweep
from cosim.workers import cores

# those that take longest first, so that no process is left alone with one of them in the end
CHOSEN = ("pair-012", "outside-004", "single-002", "pair-008", "single-001", "single-004", "single-015", "single-014",
          "null-000", "null-003", "null-005", "null-007")


@pytest.fixture(scope="module")
def results():
    """By name; spread over the cores there are, one process a case."""
    counts = {"single": 16, "pair": 13, "null": 8, "outside": 5}
    drawn = {case.name: case for case in cases(counts, manoeuvres=("tip_in:5",))}
    jobs = [Case(name, examined, {"case": drawn[name], "method": "brief:diagnose", "shows": False}) for name in CHOSEN]
    found = Sweep(workers=min(cores(), 4)).run(jobs)
    print(*(line(result) for result in found.values()), sep="\n")
    return found


@pytest.mark.parametrize("name", CHOSEN)
def test_what_was_hidden_is_what_is_found(results, name):
    result = results[name]
    assert result["error"] is None
    assert reading.is_right(result), line(result)
    if result["category"] in reading.CATALOGUED:
        assert max(reading.size_errors(result)) < 0.25, line(result)
    assert not reading.confidently_wrong(result)
    # what is ambiguous by now was driven again as was proposed
    assert reading.verdict(result) != "ambiguous" or reading.resolved(result), line(result)
