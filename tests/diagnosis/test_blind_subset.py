"""A dozen of the blind cases, with three recordings each: the diagnosis gets the folder and nothing else.

Their findings are what they are; what is asserted are the targets of the blind benchmark as far as so few cases
can hold them, and what must never happen.
"""

from dataclasses import replace

import pytest

from benchmarks.blind import score
from benchmarks.blind.cases import cases
from benchmarks.blind.run import examined
from cosim.studies.sweep import Case, Sweep, cores

pytestmark = pytest.mark.skip(reason="the diagnosis does not run yet")

RECORDINGS = ("tip_in:5", "pulse_train:4", "tip_in:5")
SINGLE = ("engine_inertia", "shaft_stiffness", "vehicle_mass", "torque_meter_filter", "wheel_speed_delay",
          "backlash_size", "engine_torque_gain")
OTHERS = ("pair-000", "null-000", "null-001", "strange-000", "outside-002", "cocktail-000")


def chosen():
    every = cases({"single": 30, "pair": 1, "null": 2, "strange": 1, "outside": 3, "cocktail": 1})
    for case in every:
        if case.name in OTHERS or case.category == "single" and case.effects[0] in SINGLE:
            yield replace(case, manoeuvres=case.manoeuvres[:3] if case.manoeuvres else RECORDINGS)


@pytest.fixture(scope="module")
def results():
    """By name; spread over the cores there are, one process a case."""
    jobs = [Case(case.name, examined, {"case": case}) for case in chosen()]
    found = Sweep(workers=min(cores(), 4)).run(jobs)
    print(*(score.line(result) for result in found.values()), sep="\n")
    return found


def of(results, *categories):
    return [result for result in results.values() if result["category"] in categories]


def test_no_case_fails(results):
    assert len(results) == len(SINGLE) + len(OTHERS)
    assert not [result["error"] for result in results.values() if result["error"]]


def test_the_right_cause_is_first_in_four_of_five(results):
    wrong = [score.line(r) for r in of(results, "single") if not score.right_first(r)]
    assert len(wrong) <= 0.2 * len(SINGLE), wrong


def test_the_right_cause_is_stated_but_for_one(results):
    wrong = [score.line(r) for r in of(results, "single") if not score.in_set(r)]
    assert len(wrong) <= 1, wrong


def test_where_nothing_is_hidden_nothing_is_found(results):
    assert not [score.line(r) for r in of(results, *score.NOTHING) if score.verdict(r) != "none"]


def test_no_stiffness_is_named_for_an_inertia_and_nothing_is_wrong_for_sure(results):
    wrong = [score.line(r) for r in of(results, "single", "pair", "outside")
             if score.stiffness_for_inertia(r) or score.confidently_wrong(r)]
    assert not wrong


def test_what_no_effect_explains_is_unknown_and_has_its_place(results):
    assert not [score.line(r) for r in of(results, "outside") if not score.right_unknown(r)]


def test_the_cocktail_of_the_thesis(results):
    [cocktail] = of(results, "cocktail")
    before, after, true = cocktail["shuffle"]
    assert abs(before / true - 1.0) > 0.2
    assert abs(after / true - 1.0) < 0.01
    assert "torque_meter_filter" in score.named(cocktail["finding"])
