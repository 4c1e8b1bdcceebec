"""A few of the blind cases, with three recordings each: the diagnosis gets the folder and nothing else.

How often it is right, and where it is wrong, is measured by `benchmarks.blind`; these it got right, and has to go on
getting right.
"""

from dataclasses import replace

import pytest

from benchmarks.blind import score
from benchmarks.blind.cases import cases
from benchmarks.blind.run import examined
from cosim.studies.sweep import Case, Sweep, cores

RECORDINGS = ("tip_in:5", "pulse_train:4", "tip_in:5")
CHOSEN = ("single-001", "single-008", "null-000")


@pytest.fixture(scope="module")
def results():
    """By name; spread over the cores there are, one process a case."""
    jobs = [Case(case.name, examined, {"case": replace(case, manoeuvres=RECORDINGS)})
            for case in cases({"single": 9, "null": 1}) if case.name in CHOSEN]
    found = Sweep(workers=min(cores(), 4)).run(jobs)
    print(*(score.line(result) for result in found.values()), sep="\n")
    return found


@pytest.mark.parametrize("name", CHOSEN)
def test_what_was_hidden_is_what_is_found(results, name):
    result = results[name]
    assert result["error"] is None
    if result["category"] in score.NOTHING:
        assert score.verdict(result) == "none", score.line(result)
    else:
        assert score.right_first(result), score.line(result)
        assert max(score.size_errors(result)) < 0.25, score.line(result)
    assert not score.confidently_wrong(result)
