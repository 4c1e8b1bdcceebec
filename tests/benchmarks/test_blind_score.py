"""Scores of blind cases: what a perfect diagnosis, a wrong one and a modest one get."""

import math

import numpy as np
import pytest

from benchmarks.blind import score
from benchmarks.blind.cases import CATEGORIES
from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.hidden.outside import OUTSIDE

SINGLE = [{"engine_inertia": {"engine_inertia": 1.2}}, {"shaft_stiffness": {"axle_shaft_stiffness": 0.75}},
          {"torque_meter_offset": {"torque_meter_offset": -8.0}}, {"wheel_speed_delay": {"wheel_speed_delay": 0.02}},
          {"mesh_loss": {"transmission_loss": 1.6}}]
NOMINAL = {"engine.inertia": 0.31, "axle_shaft.stiffness": 1.1e4, "propeller_shaft.stiffness": 1.2e4,
           "observe.propeller_shaft_torque.offset": 2.5}


def cause(effect, sizes, probability=1.0, off=0.0, width=0.1):
    """As a finding has it, its sizes off by a share of them."""
    parameters = {}
    for p in CATALOGUE[effect].parameters:
        size = sizes.get(p.name, p.neutral)
        nominal = p.physical(p.neutral, NOMINAL)[0]
        value, low, high = (p.physical(size * (1.0 + off + d), NOMINAL)[1] for d in (0.0, -width, width))
        parameters[p.name] = {"nominal": nominal, "value": value, "low90": min(low, high), "high90": max(low, high)}
    return {"effect": effect, "probability": probability, "parameters": parameters}


def finding(verdict, causes=(), ambiguous=(), unknown=None, gain=None):
    instead = {effect for effects in ambiguous for effect in effects}
    return {"verdict": verdict, "causes": list(causes), "unknown": unknown, "gain": gain,
            "together": [c["effect"] for c in causes if c["effect"] not in instead],
            "ambiguous_with": [{"effects": list(effects)} for effects in ambiguous]}


def result(category, found, effects=None, outside=None, **more):
    truth = {"effects": effects or {}, "changed": {}, "structure": "same", "outside": {
        name: {"size": 1.0, "unit": "1", "balance": OUTSIDE[name].balance,
               "driving_variables": list(OUTSIDE[name].driving_variables)} for name in outside or ()}}
    return {"name": f"{category}-0", "category": category, "effects": [*(effects or {})], "seed": 0,
            "structure": "same", "manoeuvres": None, "vehicle": "pickup_10r80", "truth": truth, "finding": found,
            "error": None, "seconds": 1.0, "gain": None, "shuffle": None, "again": None} | more


def perfect():
    results = [result("single", finding("cause", [cause(e, s) for e, s in truth.items()]), truth) for truth in SINGLE]
    for a, b in zip(SINGLE, SINGLE[1:]):
        found = finding("cause", [cause(e, s, 0.5) for e, s in (b | a).items()])
        results.append(result("pair", found, a | b))
    results += [result(name, finding("none")) for name in score.NOTHING]
    results += [result("outside", finding("unknown", unknown={
        "balance": about.balance, "driving_variable": about.driving_variables[0]}), outside=[name])
        for name, about in OUTSIDE.items()]
    return results


def rows(results):
    return {(row.cases, row.quantity): row for row in score.score(results)}


def test_a_perfect_diagnosis_meets_every_target_but_for_intervals_that_are_never_wrong():
    found = [row for row in score.score(perfect()) if row.met is False]
    assert {row.quantity for row in found} == {"90 % intervals that hold the truth"}
    assert all(score.is_right(r) for r in perfect()) and not score.confusions(perfect())


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
    assert "ValueError: no" in score.line(broken[0])
    assert "failed" in next(iter(score.confusions(broken)))


def test_wilson_interval():
    row = score.rate("", "", [True] * 7 + [False] * 3)
    z, n, p = 1.959964, 10, 0.7
    middle, half = p + z**2 / (2 * n), z * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert row.low == pytest.approx((middle - half) / (1 + z**2 / n), rel=1e-5)
    assert row.high == pytest.approx((middle + half) / (1 + z**2 / n), rel=1e-5)
    # so many cases without an alarm it takes to show a rate of 1 %
    assert score.rate("", "", [False] * 381).high < 0.01 < score.rate("", "", [False] * 380).high + 1e-5


def test_a_target_that_few_cases_meet_is_not_shown():
    few, many, no = (score.rate("", "", [False] * n, ("<=", 0.01)) for n in (2, 400, 0))
    assert few.met and not few.shown and few.cells()[-1] == "not shown"
    assert many.met and many.shown and many.cells()[-1] == "yes"
    assert no.cells()[-1] == "" and no.n == 0
    assert score.rate("", "", [True, False], (">=", 0.8)).cells()[-1] == "**no**"
    median = score.median("", "", [0.01] * 4 + [0.2], ("<=", 0.05))
    assert median.met and not median.shown


def test_what_is_first_stated_and_named():
    causes = [cause("vehicle_mass", {}, 0.5), cause("engine_inertia", {}, 0.3), cause("tyre_slip", {}, 0.1)]
    found = {**finding("ambiguous", causes, [["backlash_size", "tyre_slip"]]),
             "together": ["vehicle_mass", "engine_inertia"]}
    assert score.listed(found)[0] == "vehicle_mass" and score.named(found) == ["vehicle_mass", "engine_inertia"]
    del found["together"]
    assert score.named(found) == ["vehicle_mass"]
    assert score.stated(found) == {"vehicle_mass", "engine_inertia", "tyre_slip", "backlash_size"}
    for other, stated in (("none", {"tyre_slip", "backlash_size"}), ("unknown", set())):
        assert not score.listed({**found, "verdict": other}) and score.stated({**found, "verdict": other}) == stated


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


@pytest.mark.parametrize("verdict, first, second, share, counts", [
    ("cause", "tyre_stiffness", None, 0.0, True),
    ("ambiguous", "tyre_stiffness", "engine_inertia", 0.4, True),
    ("cause", "engine_inertia", "shaft_stiffness", 0.6, True),
    ("ambiguous", "engine_inertia", "shaft_stiffness", 0.4, False),
    ("none", "shaft_stiffness", None, 0.0, False)])
def test_a_stiffness_in_place_of_an_inertia_counts_where_it_is_named(verdict, first, second, share, counts):
    causes = [cause(first, {}, 0.6)] + ([cause(second, {}, share)] if second else [])
    found = finding(verdict, causes, [[second]] if verdict == "ambiguous" else [])
    assert score.stiffness_for_inertia(result("single", found, SINGLE[0])) is counts
    assert not score.stiffness_for_inertia(result("single", found, SINGLE[1]))


@pytest.mark.parametrize("truth", SINGLE)
def test_sizes_are_read_back_from_what_an_engineer_reads(truth):
    [(effect, sizes)] = truth.items()
    read, low, high = score.found_sizes(finding("cause", [cause(effect, sizes, width=0.2)]))[effect]
    complete = CATALOGUE[effect].complete(sizes)
    for name, size in complete.items():
        assert read[name] == pytest.approx(size, rel=1e-9, abs=1e-12)
        assert sorted([low[name], high[name]]) == pytest.approx(sorted([0.8 * size, 1.2 * size]), rel=1e-9, abs=1e-12)


def test_errors_and_intervals_of_parameters():
    for truth in SINGLE:
        [(effect, sizes)] = truth.items()
        far = result("single", finding("cause", [cause(effect, sizes, off=0.3, width=0.2)]), truth)
        near = result("single", finding("cause", [cause(effect, sizes, off=-0.1, width=0.2)]), truth)
        assert score.size_errors(far) == pytest.approx([0.3]) and score.size_errors(near) == pytest.approx([0.1])
        assert not any(score.covered(far)) and all(score.covered(near))
    elsewhere = result("single", finding("cause", [cause("tyre_slip", {})]), SINGLE[0])
    assert score.size_errors(elsewhere) == score.covered(elsewhere) == []


WOULD_SHOW = [{"effect": "engine_inertia", "parameter": "engine_inertia", "nominal": 0.3, "below": 0.27, "above": 0.33,
               "unit": "kg.m2"},
              {"effect": "torque_meter_offset", "parameter": "torque_meter_offset", "nominal": 2.5, "below": -1.5,
               "above": None, "unit": "N.m"}]


@pytest.mark.parametrize("inertia, offset, seen", [(1.12, -3.0, False), (1.12, -8.0, True), (1.2, -5.0, True),
                                                   (1.05, -8.0, False)])
def test_both_of_a_pair_have_to_be_as_large_as_the_recordings_show(inertia, offset, seen):
    truth = {"engine_inertia": {"engine_inertia": inertia}, "torque_meter_offset": {"torque_meter_offset": offset}}
    assert score.visible(result("pair", finding("none") | {"would_show": WOULD_SHOW}, truth)) is seen


@pytest.mark.parametrize("effect, name, size, seen", [
    ("engine_inertia", "engine_inertia", 1.2, True), ("engine_inertia", "engine_inertia", 1.05, False),
    ("engine_inertia", "engine_inertia", 0.85, True), ("torque_meter_offset", "torque_meter_offset", -8.0, True),
    ("torque_meter_offset", "torque_meter_offset", 8.0, False),
    ("two_stage_stiffness", "first_stage_twist", 0.02, None)])
def test_a_case_is_judged_by_what_its_recordings_can_show(effect, name, size, seen):
    case = result("single", finding("none") | {"would_show": WOULD_SHOW}, {effect: {name: size}})
    assert score.visible(case) is seen
    found = rows([case])
    assert (("single, as large as the recordings show", "right cause first") in found) is (seen is True)
    assert (("single, smaller than the recordings show", "called none") in found) is (seen is False)


def test_an_unknown_effect_is_stated_where_its_place_is_among_those_that_cannot_be_told():
    told = [{"balance": "axle", "balances": ["axle", "propeller shaft", "wheel"]},
            {"balance": "propeller shaft", "balances": ["propeller shaft"]}, {"balance": "engine"}]
    rows = score.score([result("outside", finding("unknown", unknown={"driving_variable": "time", **where}),
                               outside=["warming_oil"]) for where in told])
    found = {(row.cases, row.quantity): row.here for row in rows}
    assert found["outside", "called unknown, at the right balance"] == pytest.approx(1 / 3)
    assert found["outside", "called unknown, its balance among those stated"] == pytest.approx(2 / 3)
    assert found["outside", "balances stated, where it is called unknown"] == pytest.approx(5 / 3)


def test_an_effect_outside_the_catalogue_is_large_enough_where_a_healthy_car_lacks_evidence():
    seen, hardly, before = (result("outside", finding("none"), outside=["wavy_road"], **more) for more in (
        {"visibility": {"healthy": 9.0, "found": 8.0}}, {"visibility": {"healthy": 2.0, "found": 2.0}}, {}))
    assert [score.visible(r) for r in (seen, hardly, before)] == [True, False, None]
    found = rows([seen, hardly, before])
    assert found["outside, as large as the recordings show", "called unknown, at the right balance"].n == 1
    assert found["outside, smaller than the recordings show", "called none"].here == 1.0
    assert "9 units of evidence, 8 beside what was found" in score.line(seen)


def test_the_fewer_forecasts_the_larger_the_calibration_error_of_exact_ones():
    few, many = (np.mean(score.exact_calibration_errors(np.full(n, 0.5))) for n in (25, 2500))
    assert few == pytest.approx(0.5 * np.sqrt(2.0 / np.pi) / 5.0, rel=0.1)  # mean distance of a binomial share
    assert many == pytest.approx(few / 10.0, rel=0.1)


def test_calibration_error():
    random = np.random.default_rng(1)
    said = random.uniform(size=20000)
    honest = np.column_stack([said, random.uniform(size=said.size) < said])
    assert score.calibration_error(honest) < 0.02
    boastful = np.column_stack([0.5 + 0.5 * said, honest[:, 1]])
    assert score.calibration_error(boastful) == pytest.approx(0.25, abs=0.02)
    assert sum(row["n"] for row in score.reliability(honest)) == said.size
    assert score.calibration_error(np.array([[1.0, 1.0], [0.3, 0.0]])) == pytest.approx(0.15)


def test_gain_is_measured_by_what_the_true_model_gains():
    ideal = {"engine_speed": [0.4, 0.1], "propeller_shaft_torque": [0.2, 0.1]}

    def gained(share):
        rows = [{"signal": name, "nrmse_before": a, "nrmse_after": a - share * (a - b)}
                for name, (a, b) in ideal.items()]
        return score.gain_share(result("single", finding("cause", gain={"held_out": rows}), SINGLE[0], gain=ideal))

    assert gained(1.0) == pytest.approx(1.0) and gained(0.5) == pytest.approx(0.5)
    without = result("single", finding("none"), SINGLE[0], gain=ideal)
    assert score.gain_share(without) == 0.0
    assert score.gain_share({**without, "gain": {"engine_speed": [0.4, 0.39]}}) is None


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


def test_a_result_of_when_there_was_one_vehicle_is_still_told():
    before = {key: value for key, value in perfect()[0].items() if key != "vehicle"}
    assert score.line(before) == score.line(perfect()[0])
