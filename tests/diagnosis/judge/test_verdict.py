"""What is said of what was found."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis.judge.verdict import (
    MISSING,
    STRANGE,
    beside_unknown,
    counted,
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
