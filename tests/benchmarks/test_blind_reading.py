"""How a finding is read beside the truth."""

import pytest
from findings import SINGLE, cause, finding, result

from benchmarks.blind import reading
from cosim.diagnosis.catalogue import CATALOGUE


def test_what_is_first_stated_and_named():
    causes = [cause("vehicle_mass", {}, 0.5), cause("engine_inertia", {}, 0.3), cause("tyre_slip", {}, 0.1)]
    found = {**finding("ambiguous", causes, [["backlash_size", "tyre_slip"]]),
             "together": ["vehicle_mass", "engine_inertia"]}
    assert reading.listed(found)[0] == "vehicle_mass" and reading.named(found) == ["vehicle_mass", "engine_inertia"]
    del found["together"]
    assert reading.named(found) == ["vehicle_mass"]
    assert reading.stated(found) == {"vehicle_mass", "engine_inertia", "tyre_slip", "backlash_size"}
    for other, stated in (("none", {"tyre_slip", "backlash_size"}), ("unknown", set())):
        assert not reading.listed({**found, "verdict": other}) and reading.stated({**found, "verdict": other}) == stated


@pytest.mark.parametrize("verdict, first, second, share, counts", [
    ("cause", "tyre_stiffness", None, 0.0, True),
    ("ambiguous", "tyre_stiffness", "engine_inertia", 0.4, True),
    ("cause", "engine_inertia", "shaft_stiffness", 0.6, True),
    ("ambiguous", "engine_inertia", "shaft_stiffness", 0.4, False),
    ("none", "shaft_stiffness", None, 0.0, False)])
def test_a_stiffness_in_place_of_an_inertia_counts_where_it_is_named(verdict, first, second, share, counts):
    causes = [cause(first, {}, 0.6)] + ([cause(second, {}, share)] if second else [])
    found = finding(verdict, causes, [[second]] if verdict == "ambiguous" else [])
    assert reading.stiffness_for_inertia(result("single", found, SINGLE[0])) is counts
    assert not reading.stiffness_for_inertia(result("single", found, SINGLE[1]))


@pytest.mark.parametrize("truth", SINGLE)
def test_sizes_are_read_back_from_what_an_engineer_reads(truth):
    [(effect, sizes)] = truth.items()
    read, low, high = reading.found_sizes(finding("cause", [cause(effect, sizes, width=0.2)]))[effect]
    complete = CATALOGUE[effect].complete(sizes)
    for name, size in complete.items():
        assert read[name] == pytest.approx(size, rel=1e-9, abs=1e-12)
        assert sorted([low[name], high[name]]) == pytest.approx(sorted([0.8 * size, 1.2 * size]), rel=1e-9, abs=1e-12)


def test_errors_and_intervals_of_parameters():
    for truth in SINGLE:
        [(effect, sizes)] = truth.items()
        far = result("single", finding("cause", [cause(effect, sizes, off=0.3, width=0.2)]), truth)
        near = result("single", finding("cause", [cause(effect, sizes, off=-0.1, width=0.2)]), truth)
        assert reading.size_errors(far) == pytest.approx([0.3]) and reading.size_errors(near) == pytest.approx([0.1])
        assert not any(reading.covered(far)) and all(reading.covered(near))
    elsewhere = result("single", finding("cause", [cause("tyre_slip", {})]), SINGLE[0])
    assert reading.size_errors(elsewhere) == reading.covered(elsewhere) == []


WOULD_SHOW = [{"effect": "engine_inertia", "parameter": "engine_inertia", "nominal": 0.3, "below": 0.27, "above": 0.33,
               "unit": "kg.m2"},
              {"effect": "torque_meter_offset", "parameter": "torque_meter_offset", "nominal": 2.5, "below": -1.5,
               "above": None, "unit": "N.m"}]


@pytest.mark.parametrize("inertia, offset, seen", [(1.12, -3.0, False), (1.12, -8.0, True), (1.2, -5.0, True),
                                                   (1.05, -8.0, False)])
def test_both_of_a_pair_have_to_be_as_large_as_the_recordings_show(inertia, offset, seen):
    truth = {"engine_inertia": {"engine_inertia": inertia}, "torque_meter_offset": {"torque_meter_offset": offset}}
    told = finding("none") | {"would_show": WOULD_SHOW}
    assert reading.visible(result("pair", told, truth)) is seen
    assert [reading.visible(result("pair", told, truth, beside=least)) for least in (0.4, -0.4)] == [seen, False]


@pytest.mark.parametrize("effect, name, size, seen", [
    ("engine_inertia", "engine_inertia", 1.2, True), ("engine_inertia", "engine_inertia", 1.05, False),
    ("engine_inertia", "engine_inertia", 0.85, True), ("torque_meter_offset", "torque_meter_offset", -8.0, True),
    ("torque_meter_offset", "torque_meter_offset", 8.0, False),
    ("two_stage_stiffness", "first_stage_twist", 0.02, None)])
def test_a_case_is_judged_by_what_its_recordings_can_show(effect, name, size, seen):
    case = result("single", finding("none") | {"would_show": WOULD_SHOW}, {effect: {name: size}})
    assert reading.visible(case) is seen


def test_gain_is_measured_by_what_the_true_model_gains():
    ideal = {"engine_speed": [0.4, 0.1], "propeller_shaft_torque": [0.2, 0.1]}

    def gained(share):
        rows = [{"signal": name, "nrmse_before": a, "nrmse_after": a - share * (a - b)}
                for name, (a, b) in ideal.items()]
        return reading.gain_share(result("single", finding("cause", gain={"held_out": rows}), SINGLE[0], gain=ideal))

    assert gained(1.0) == pytest.approx(1.0) and gained(0.5) == pytest.approx(0.5)
    without = result("single", finding("none"), SINGLE[0], gain=ideal)
    assert reading.gain_share(without) == 0.0
    assert reading.gain_share({**without, "gain": {"engine_speed": [0.4, 0.39]}}) is None
