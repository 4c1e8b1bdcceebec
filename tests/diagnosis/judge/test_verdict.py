"""What is said of what was found."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.fit.predict import Coordinate
from cosim.diagnosis.judge.verdict import (
    LIKELY,
    MISSING,
    STRANGE,
    beside,
    beside_unknown,
    counted,
    finding_of,
    is_strange,
    not_excluded,
    probabilities,
    rivals_of,
    told_once,
)


@pytest.mark.parametrize(("told", "counts"), [
    ([0.5], 0.5), ([2.0, 1.0, 3.0], 1.5),
    ([9.0, 0.1, 0.5], 0.3),  # one recording, where the lash is crossed at another moment
    ([0.5, 9.0], 8.0)])  # of two the torque shows in one
def test_a_torque_is_missing_by_what_several_recordings_say(told, counts):
    assert counted(8.0 if len(told) == 2 else told[0], told) == pytest.approx(counts)


@pytest.mark.parametrize(("excess", "told", "there"), [(0.5, 0.5, False), (1.5, 0.5, True), (0.5, 1.5, True)])
def test_strange_is_what_leaves_too_much_or_lacks_a_torque(excess, told, there):
    assert is_strange({"excess": excess * STRANGE, "log_evidence": told * MISSING}) is there


def test_beside_something_unknown_only_what_was_confirmed_stays_as_probable():
    causes = [{"effect": name, "probability": 0.4} for name in ("converter_slip", "vehicle_mass")]
    beside_unknown(causes, {"converter_slip"})
    assert causes[0]["probability"] == 0.4 and causes[1]["probability"] < 0.2


def test_what_is_left_counts_in_probabilities_until_it_is_called_unknown():
    """A cause that was confirmed elsewhere stays what it is beside something unknown."""
    fit = SimpleNamespace(effects=("converter_slip",), causes=("converter_slip",))
    found = SimpleNamespace(alternatives=[fit], shares=lambda: np.ones(1))
    told = [probabilities([], found, ["converter_slip"], {"excess": 0.0, "log_evidence": x})["converter_slip"]
            for x in (2.0, 0.85 * MISSING, 1.1 * MISSING)]
    assert told[0] == told[2] > 0.95 and told[1] < 0.6


def test_what_it_could_be_as_well_is_told_once_at_its_nearest():
    """A rival without the best one's second cause has the same other effects as one with it."""
    best, *others = (SimpleNamespace(effects=effects) for effects in (
        ("backlash_size", "road_grade"), ("backlash_size", "rolling_resistance"), ("rolling_resistance",),
        ("backlash_size", "coulomb_drag")))
    assert told_once(best, list(zip(others, (0.4, 0.2, 1.0)))) == [
        {"effects": ["rolling_resistance"], "in_place_of": ["backlash_size", "road_grade"], "separation_sigma": 0.2},
        {"effects": ["coulomb_drag"], "in_place_of": ["road_grade"], "separation_sigma": 1.0}]


@pytest.mark.parametrize(("rival", "told", "gone"), [
    (("torque_meter_gain", "rolling_resistance"), ["rolling_resistance"], ["road_grade"]),
    (("coulomb_drag", "vehicle_mass"), ["coulomb_drag", "vehicle_mass"], ["road_grade", "torque_meter_gain"]),
    (("torque_meter_gain",), ["torque_meter_gain"], ["road_grade"]),
    (("torque_meter_gain", "road_grade", "mesh_loss"), ["mesh_loss"], [])])  # in place of a second cause of one effect
def test_what_it_could_be_as_well_is_told_with_what_it_stands_in_place_of(rival, told, gone):
    best, other = (SimpleNamespace(effects=effects) for effects in (("road_grade", "torque_meter_gain"), rival))
    assert told_once(best, [(other, 0.4)]) == [{"effects": told, "in_place_of": gone, "separation_sigma": 0.4}]


@pytest.mark.parametrize(("behind", "needed", "rivals"), [(1.0, 1.5, 1), (1.6, 1.5, 0), (1.6, 3.0, 1)])
def test_a_further_cause_that_may_as_well_not_be_there_is_told_so(behind, needed, rivals):
    """As far as the best has to be told from what lacks it; and nothing wrong is no rival here."""
    best, lacking, healthy, other = (SimpleNamespace(effects=effects, causes=effects) for effects in (
        ("backlash_size", "shaft_stiffness"), ("backlash_size",), (), ("backlash_size", "tyre_stiffness")))
    apart = {id(best): 0.0, id(lacking): behind, id(healthy): 1.0, id(other): 3.1}
    found = SimpleNamespace(best=best, alternatives=[best, lacking, healthy, other], apart=lambda fit: apart[id(fit)],
                            told_without=lambda fit: needed)
    assert rivals_of(found) == [(lacking, behind)][:rivals]
    told = {"effects": ["backlash_size"], "in_place_of": ["shaft_stiffness"], "separation_sigma": behind}
    assert told_once(best, rivals_of(found)) == [told][:rivals]


@pytest.mark.parametrize(("shares", "told"), [
    ((0.1, 0.05, 0.0), []),  # less than one in five together
    ((0.4, 0.06, 0.01), [0, 1])])
def test_beside_a_healthy_car_what_is_likely_is_not_excluded(shares, told):
    names = ("coulomb_drag", "road_grade", "vehicle_mass")
    rivals = [(SimpleNamespace(effects=(name,)), 0.5) for name in names]
    assert not_excluded(rivals, dict(zip(names, shares))) == [rivals[i] for i in told]


def test_a_supposition_of_two_divides_its_share_and_all_add_up_to_what_is_not_nothing():
    """Less what may be something else, which is the more the more is left."""
    names = ("shaft_stiffness", "vehicle_mass", "coulomb_drag")
    fits = [SimpleNamespace(effects=e, causes=e) for e in (names[:2], names[:1], ())]
    found = SimpleNamespace(alternatives=fits, shares=lambda: np.array([0.5, 0.3, 0.2]))
    nothing_left = probabilities([], found, names, {"excess": 0.0, "log_evidence": -20.0})
    assert nothing_left["shaft_stiffness"] / nothing_left["vehicle_mass"] == pytest.approx(0.55 / 0.25)
    assert nothing_left["coulomb_drag"] == 0.0 and 0.75 < sum(nothing_left.values()) <= 0.8
    some = probabilities([], found, names, {"excess": 0.0, "log_evidence": 0.9 * MISSING})
    assert 0.0 < sum(some.values()) < 0.9 * sum(nothing_left.values())


@pytest.mark.parametrize(("lead", "other", "place"), [(30.0, 20.0, "within the axle shafts"), (20.0, 30.0, "vehicle"),
                                                      (20.0, 20.0, "vehicle")])
def test_a_curve_of_the_shafts_is_what_is_left_where_it_is_more_evident(lead, other, place):
    left = {"excess": 0.01, "place": "vehicle", "log_evidence": other, "recordings": [other]}
    curve = SimpleNamespace(lead=lead, disturbance=SimpleNamespace(place="within the axle shafts"))
    told = beside(left, curve)
    assert told["place"] == place and told["log_evidence"] == max(lead, other) and told["excess"] == 0.01
    assert bool(told["recordings"]) == (place == "vehicle")  # of each nothing was asked of a curve
    assert beside(left, None) == left


def coordinate(effect, name, run=None, part=0, low=-1.0, high=1.0):
    parameter = next(p for p in CATALOGUE[effect].parameters if p.name == name)
    phase = "" if run is None else "torque_ripple.phase"
    return Coordinate(name, effect, effect, run, parameter, 0.05, 0.5, 0.1, low, high, phase, part)


COORDINATES = [coordinate("vehicle_mass", "vehicle_mass"),
               Coordinate("start", "", "", 0, None, 0.3, 0.3, 0.1),  # not shared: what is behind it has another place
               coordinate("shaft_stiffness", "axle_shaft_stiffness"),
               *(coordinate("torque_ripple", "torque_ripple_amplitude", r, k, -400.0, 400.0)
                 for r in (0, 1) for k in (0, 1)),
               coordinate("coulomb_drag", "coulomb_drag_torque", low=0.0, high=300.0)]
DEVIATIONS = {"vehicle_mass": 0.1, "shaft_stiffness": 0.02, "torque_ripple": 3.0, "coulomb_drag": 5.0}


def supposed(causes, sizes=()):
    """A fit of some causes with the sizes of their coordinates, in order."""
    shared = np.zeros(len(COORDINATES))
    shared[[i for i, c in enumerate(COORDINATES) if c.cause in causes]] = sizes
    wide = np.array([DEVIATIONS[c.effect] for c in COORDINATES if c.effect])
    return SimpleNamespace(effects=tuple(causes), causes=tuple(causes), shared=shared,
                           posterior=SimpleNamespace(covariance=np.diag(wide**2)))


def judged(alternatives, shares, apart, left=0.0, confirmed=()):
    """The finding of a search that ended with these."""
    car = SimpleNamespace(values={"vehicle.mass": 2000.0, "axle_shaft.stiffness": 1e4, "torque_ripple.amplitude": 0.0,
                                  "coulomb_drag.torque": 0.0})
    predictor = SimpleNamespace(coordinates=COORDINATES, car=car, index=lambda cause: [
        i for i, c in enumerate(COORDINATES) if c.cause == cause])
    distances = {id(fit): distance for fit, distance in zip(alternatives, apart)}
    found = SimpleNamespace(best=alternatives[0], alternatives=alternatives, detectable={},
                            apart=lambda fit: distances[id(fit)], told_without=lambda fit: 1.5)
    names = ("vehicle_mass", "shaft_stiffness", "torque_ripple", "coulomb_drag")
    return finding_of(predictor, found, {"excess": 0.0, "log_evidence": left},
                      {**dict.fromkeys(names, 0.0), **shares}, confirmed)


def test_sizes_are_told_with_what_holds_the_truth_in_nine_of_ten():
    found = judged([supposed(["vehicle_mass", "shaft_stiffness"], [np.log(1.2), np.log(0.8)])],
                   {"vehicle_mass": 0.4, "shaft_stiffness": 0.5}, [0.0])
    assert found["verdict"] == "cause" and found["together"] == ["vehicle_mass", "shaft_stiffness"]
    stiffness, mass = (cause["parameters"] for cause in found["causes"])  # the likelier first
    assert mass["vehicle_mass"] == pytest.approx({
        "nominal": 2000.0, "value": 2400.0, "low90": 2400.0 * np.exp(-0.1645), "high90": 2400.0 * np.exp(0.1645),
        "unit": "kg"})
    assert stiffness["axle_shaft_stiffness"]["value"] == pytest.approx(8000.0)
    assert stiffness["axle_shaft_stiffness"]["low90"] == pytest.approx(8000.0 * np.exp(-0.0329))


def test_no_interval_goes_beyond_what_is_plausible():
    drag = judged([supposed(["coulomb_drag"], [4.0])], {"coulomb_drag": 0.9}, [0.0])["causes"][0]["parameters"]
    (told,) = drag.values()
    assert (told["low90"], told["value"]) == pytest.approx((0.0, 4.0)) and told["high90"] == pytest.approx(12.225)


@pytest.mark.parametrize(("parts", "amplitude", "low"), [
    ([30.0, 40.0, 0.0, 50.0], 49.82, 47.33),  # 50 N.m in both, less what noise adds; by four numbers
    ([1.0, 4.0, 2.0, 4.0], 0.707, 0.0)])  # an amplitude is not less than none
def test_a_swing_is_as_large_as_in_all_recordings_together(parts, amplitude, low):
    """Noise of 3 N.m in each component adds 9 to each square; the amplitude is as sure as 3 N.m over sqrt(2 runs)."""
    found = judged([supposed(["torque_ripple"], parts)], {"torque_ripple": 0.9}, [0.0])
    (told,) = found["causes"][0]["parameters"].values()
    assert told["value"] == pytest.approx(np.sqrt(np.mean(np.square(parts)) * 2.0 - 18.0))
    assert told["value"] == pytest.approx(amplitude, abs=0.01)
    assert told["low90"] == pytest.approx(low, abs=1.01)
    assert told["high90"] - told["value"] == pytest.approx(1.645 * 3.0 / np.sqrt(2.0))


def test_verdicts():
    """By whether something is the likeliest, what it cannot be told from, and what is missing beside it."""
    mass, shafts, healthy = (supposed(["vehicle_mass"], [0.1]), supposed(["shaft_stiffness"], [-0.2]), supposed([]))
    sure = judged([mass, shafts, healthy], {"vehicle_mass": 0.9, "shaft_stiffness": 0.5 * LIKELY}, [0.0, 3.1, 4.0])
    assert sure["verdict"] == "cause" and not sure["ambiguous_with"]
    assert [cause["effect"] for cause in sure["causes"]] == ["vehicle_mass"]  # the other is too unlikely to be listed
    near = judged([mass, shafts, healthy], {"vehicle_mass": 0.6, "shaft_stiffness": 0.3}, [0.0, 2.9, 4.0])
    assert near["verdict"] == "ambiguous" and near["ambiguous_with"] == [
        {"effects": ["shaft_stiffness"], "in_place_of": ["vehicle_mass"], "separation_sigma": 2.9}]
    assert near["directly"] == [{"effect": name, "how": CATALOGUE[name].directly}  # what settles it by no manoeuvre
                                for name in ("vehicle_mass", "shaft_stiffness")]
    assert near["causes"][1]["parameters"]["axle_shaft_stiffness"]["value"] == pytest.approx(1e4 * np.exp(-0.2))
    none = judged([healthy, mass, shafts], {"vehicle_mass": 0.3, "shaft_stiffness": 0.01}, [0.0, 0.5, 2.0])
    assert none["verdict"] == "none" and [row["effects"] for row in none["ambiguous_with"]] == [["vehicle_mass"]]
    assert [row["effect"] for row in none["directly"]] == ["vehicle_mass"] and sure["directly"] == []
    strange = judged([mass, healthy], {"vehicle_mass": 0.9}, [0.0, 4.0], left=1.1 * MISSING)
    assert strange["verdict"] == "unknown" and strange["causes"][0]["probability"] < 0.2
    confirmed = judged([mass, healthy], {"vehicle_mass": 0.9}, [0.0, 4.0], 1.1 * MISSING, {"vehicle_mass"})
    assert confirmed["verdict"] == "unknown" and confirmed["causes"][0]["probability"] == 0.9
