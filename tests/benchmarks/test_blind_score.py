"""Scores of blind cases: what a perfect diagnosis, a wrong one and a modest one get."""

import pytest
from findings import SINGLE, cause, finding, perfect, result

from benchmarks.blind import failures, reading
from benchmarks.blind.cases import CATEGORIES
from benchmarks.blind.score import score


def rows(results):
    return {(row.cases, row.quantity): row for row in score(results)}


def test_a_perfect_diagnosis_meets_every_target_but_for_intervals_that_are_never_wrong():
    found = [row for row in score(perfect()) if row.met is False]
    assert {row.quantity for row in found} == {"90 % intervals that hold the truth"}
    assert all(reading.is_right(r) for r in perfect()) and not failures.confusions(perfect())


def test_a_diagnosis_that_always_says_the_same_meets_none_it_should_not():
    always = finding("cause", [cause("driveline_damping", {"driveline_damping": 2.0}, 0.95)])
    found = rows([{**r, "finding": always} for r in perfect()])
    for key in (("single", "right cause first"), ("single", "right cause in the stated set"),
                ("pair", "both first"), ("null and strange", "false alarms"),
                ("outside", "called unknown, at the right balance"), ("outside", "confidently wrong"),
                ("all but pairs and cocktails", "expected calibration error")):
        assert found[key].met is False, key
    assert found["outside", "confidently wrong"].here == 1.0
    assert ("single", "error of parameters") not in found  # nothing true is named


def test_a_failure_is_wrong_everywhere():
    broken = [{**r, "finding": None, "error": "ValueError: no"} for r in perfect()]
    found = rows(broken)
    assert found["single", "right cause first"].here == 0.0
    assert found["null and strange", "false alarms"].here == 1.0
    assert found["all", "failed"].here == 1.0
    assert "ValueError: no" in failures.line(broken[0])
    assert "failed" in next(iter(failures.confusions(broken)))


def test_what_is_not_excluded_is_stated_and_no_alarm():
    """And what comes of the manoeuvre that was proposed counts for itself, whatever was hidden."""
    truth, open_to = SINGLE[0], finding("none", [cause("engine_inertia", {}, 0.4)], [["engine_inertia"]])
    then = finding("cause", [cause("engine_inertia", {})])
    given = [result("single", open_to, truth, again={"finding": then, "error": None}),
             result("single", finding("none"), truth), result("null", open_to, again={"finding": open_to}),
             result("strange", open_to, again={"finding": finding("none")})]
    found = {key: row.here for key, row in rows(given).items()}
    assert found["single", "right cause first"] == 0.0 and found["single", "right cause in the stated set"] == 0.5
    assert found["single, called none", "right cause not excluded"] == 0.5
    assert found["single and pair, something not excluded", "resolved by the proposed manoeuvre"] == 1.0
    assert found["null and strange", "false alarms"] == 0.0 and found["null and strange", "something not excluded"] == 1
    assert found["null and strange, something not excluded", "ended by the proposed manoeuvre"] == 0.5
    assert ("single and pair", "resolved by the proposed manoeuvre") not in found


@pytest.mark.parametrize("below, above, seen", [(0.27, 0.33, True), (0.2, 0.4, False), (None, None, False)])
def test_a_single_effect_counts_by_whether_its_recordings_can_show_it(below, above, seen):
    shown = [{"effect": "engine_inertia", "parameter": "engine_inertia", "nominal": 0.3, "below": below,
              "above": above, "unit": "kg.m2"}]
    found = rows([result("single", finding("none") | {"would_show": shown}, SINGLE[0])])
    assert (("single, as large as the recordings show", "right cause first") in found) is seen
    assert (("single, smaller than the recordings show", "called none") in found) is not seen


def test_an_unknown_effect_is_stated_where_its_place_is_among_those_that_cannot_be_told():
    told = [{"balance": "axle", "balances": ["axle", "propeller shaft", "wheel"]},
            {"balance": "propeller shaft", "balances": ["propeller shaft"]}, {"balance": "engine"}]
    rows = score([result("outside", finding("unknown", unknown={"driving_variable": "time", **where}),
                               outside=["warming_oil"]) for where in told])
    found = {(row.cases, row.quantity): row.here for row in rows}
    assert found["outside", "called unknown, at the right balance"] == pytest.approx(1 / 3)
    assert found["outside", "called unknown, its balance among those stated"] == pytest.approx(2 / 3)
    assert found["outside", "balances stated, where it is called unknown"] == pytest.approx(5 / 3)


def test_an_effect_in_the_car_is_not_found_where_a_sensor_is_called_wrong():
    right = {"balance": "propeller shaft", "balances": ["propeller shaft"], "driving_variable": "time"}
    wrong = right | {"sensor": {"channel": "wheel_speed", "kind": "delay", "size": 0.05, "unit": "s"}}
    rows = score([result("outside", finding("unknown", unknown=unknown), outside=["warming_oil"])
                  for unknown in (right, wrong)])
    found = {(row.cases, row.quantity): row.here for row in rows}
    assert found["outside", "called unknown, at the right balance"] == 0.5
    assert found["outside", "called unknown, its balance among those stated"] == 0.5


def test_an_effect_outside_the_catalogue_is_large_enough_where_a_healthy_car_lacks_evidence():
    seen, hardly, before = (result("outside", finding("none"), outside=["wavy_road"], **more) for more in (
        {"visibility": {"healthy": 9.0, "found": 8.0}}, {"visibility": {"healthy": 2.0, "found": 2.0}}, {}))
    assert [reading.visible(r) for r in (seen, hardly, before)] == [True, False, None]
    found = rows([seen, hardly, before])
    assert found["outside, as large as the recordings show", "called unknown, at the right balance"].n == 1
    assert found["outside, smaller than the recordings show", "called none"].here == 1.0
    assert "9 units of evidence, 8 beside what was found" in failures.line(seen)


def test_an_ambiguity_is_resolved_when_the_right_cause_stands_alone():
    [(effect, sizes)] = SINGLE[0].items()
    vague = finding("ambiguous", [cause(effect, sizes, 0.6)], [["vehicle_mass"]])
    clear = finding("cause", [cause(effect, sizes, 0.9)])
    wrong = finding("cause", [cause("vehicle_mass", {}, 0.9)])
    outcomes = [None, *({"manoeuvre": "step:4", "finding": f, "error": None} for f in (clear, vague, wrong))]
    results = [result("single", vague, SINGLE[0], again=again) for again in outcomes]
    row = rows(results)["ambiguous", "resolved by the proposed manoeuvre"]
    assert (row.here, row.n, row.met) == (0.25, 4, False)


def test_cocktail():
    truth = {"engine_inertia": {"engine_inertia": 1.25}, "shaft_stiffness": {"axle_shaft_stiffness": 0.75},
             "torque_meter_filter": {"torque_meter_filter_period": 0.033}}
    found = finding("ambiguous", [cause("torque_meter_filter", {}), cause("engine_inertia", {}, 0.5)],
                    [["shaft_stiffness"]])
    some = rows([result("cocktail", found, truth, shuffle=[7.14, 5.9, 5.88])])
    assert some["cocktail", "error of the shuffle frequency before"].here == pytest.approx(7.14 / 5.88 - 1.0)
    assert some["cocktail", "error of the shuffle frequency after"].met
    assert some["cocktail", "torque meter's filter named"].here == 1.0
    assert some["cocktail", "inertia and stiffness told as alternatives"].here == 1.0
    assert some["cocktail", "hidden effects that are named"].here == pytest.approx(2 / 3)


def test_every_category_is_scored():
    of = {r["category"] for r in perfect()} | {"weak", "cocktail"}
    assert of == set(CATEGORIES)


def test_what_was_not_found_is_told_from_what_is_not_to_be_found():
    given = [result("single", finding("none"), SINGLE[0], **more) for more in ({"missed": 7.3}, {"missed": -2.0}, {})]
    assert rows(given)["single and pair, not first", "fits that begin at the truth more evident"].here == 0.5
    assert [text.count("begins at the truth") for text in map(failures.line, given)] == [1, 1, 0]
    both = result("pair", finding("none"), {**SINGLE[0], **SINGLE[1]}, beside=-0.6)
    assert "both are 0.6 less evident than one of them alone" in failures.line(both)
    assert "7.3 more evident" in failures.line(given[0]) and "2.0 less evident" in failures.line(given[1])
    again = {"manoeuvre": "ramp:3", "finding": finding("none"), "error": None, "missed": 8.4}
    driven = failures.line(result("single", finding("ambiguous"), SINGLE[0], missed=-2.0, again=again))
    assert driven.index("2.0 less evident") < driven.index("with ramp:3: none") < driven.index("8.4 more evident")
