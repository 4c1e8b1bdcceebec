"""The gain of a finding: errors before and after in pairs of blocks, and what they prove."""

import json

import numpy as np
import pytest
from scipy.stats import t as student

from cosim.diagnosis.fit.regression import _with_memory, remaining
from cosim.diagnosis.judge.finding import BLOCK, Gain, believed, doubts, gained, something_else

CLOCK = np.arange(0.0, 7.0, 0.01)


def row(run="tip_in", signal="engine_speed", after=0.3, clock=CLOCK, seed=0):
    """A channel whose error is ``after`` times what it was, under noise that the simulation cannot have."""
    random = np.random.default_rng(seed)
    measured, noise = 100.0 * np.sin(clock), random.standard_normal(clock.size)
    return Gain.of(run, signal, clock, measured, measured + noise, measured + after * noise, 0.1)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.7])
def test_the_interval_holds_the_true_ratio_as_often_as_it_says(memory):
    """And hardly less often where neighbours are alike, as those of half a second are."""
    random, hits = np.random.default_rng(1), []
    for _ in range(200):
        noise = random.standard_normal(14)
        for k in range(1, noise.size):
            noise[k] = memory * noise[k - 1] + np.sqrt(1.0 - memory**2) * noise[k]
        left = remaining(np.log(0.5) + 0.4 * noise)
        hits.append(left.low <= 0.5 <= left.high)
    assert np.mean(hits) > 0.92


def test_many_blocks_are_as_sure_as_student_says():
    """Where nothing is alike, and enough of it to see that."""
    change = np.log(0.5) + 0.4 * np.random.default_rng(2).standard_normal(400)
    left = remaining(change)
    reach = student.isf(0.025, 399) * change.std(ddof=1) / 20.0
    said, mean = np.log([left.low, left.high]), change.mean()
    assert said == pytest.approx([mean - reach, mean + reach], abs=0.2 * reach)


def test_with_a_known_memory_the_error_of_the_mean_is_that_of_the_dense_covariance():
    """And the likelihood that of generalised least squares."""
    change, memory = np.random.default_rng(3).standard_normal(12), 0.6
    covariance = memory ** np.abs(np.subtract.outer(np.arange(12), np.arange(12)))
    inverse, one = np.linalg.inv(covariance), np.ones(12)
    likeliest = one @ inverse @ change / (one @ inverse @ one)
    square = (change - likeliest) @ inverse @ (change - likeliest)
    likelihood = -0.5 * (np.linalg.slogdet(covariance)[1] + np.log(one @ inverse @ one) + 11 * np.log(square))
    of_mean = covariance.sum() / 12**2
    assert _with_memory(change, memory) == pytest.approx((np.sqrt(square / 11 * of_mean), likelihood, 1.0 / of_mean))


def test_too_little_time_says_nothing():
    assert remaining(np.array([-1.0, -1.1])) is None
    assert gained([row(clock=CLOCK[:90])])["remains"] is None


def test_what_remains_is_what_is_left_of_the_error():
    left = gained([row(), row(signal="wheel_speed", seed=1), row("ramp", seed=2)])["remains"]
    assert [left[key] for key in ("share", "low", "high")] == pytest.approx([0.3] * 3)
    assert left["blocks"] == 2 * 7.0 / BLOCK


def test_gaps_and_other_clocks_are_no_blocks():
    gap = CLOCK[(CLOCK < 2.0) | (CLOCK > 4.0)]
    told = gained([row(clock=gap), row(signal="wheel_speed", clock=CLOCK[::3], seed=1)])
    assert told["remains"]["blocks"] == 14 and told["remains"]["share"] == pytest.approx(0.3)
    assert gained([row(clock=gap)])["remains"]["blocks"] == 10


def test_blocks_that_follow_each_other_say_less_than_the_same_in_any_order():
    change = np.log(0.5) + 0.1 * np.sin(np.linspace(0.0, 3.0, 14))
    left, mixed = remaining(change), remaining(np.random.default_rng(4).permutation(change))
    assert left.share == pytest.approx(mixed.share) and left.alone < 0.6 * mixed.alone
    assert np.log(left.high / left.low) > 1.3 * np.log(mixed.high / mixed.low)


def finding(gain=None, together=("mesh_loss",), verdict="cause", lacking=0.0, parameters=()):
    causes = [{"effect": name, "parameters": dict.fromkeys(parameters)} for name in together]
    return {"verdict": verdict, "together": list(together), "causes": causes, "gain": gain,
            "left_over": {"place": "vehicle", "log_evidence": lacking}}


def test_what_makes_the_recording_kept_back_worse_is_not_confirmed():
    [doubt] = doubts(finding(gained([row(after=1.2)])))
    assert "does not confirm it: block by block the error there is 120 %" in doubt
    assert not doubts(finding(gained([row()]))) and not doubts(finding(None))
    assert not doubts(finding(gained([row(clock=CLOCK[:90])])))


def test_the_more_evident_a_missing_torque_the_likelier_is_something_else():
    told = [something_else(1, lacking) for lacking in (-5.0, 5.0, 10.0, 20.0, 30.0)]
    assert told[0] == told[1] == something_else(1) and told == sorted(told) and told[3] == 0.5 and told[4] > 0.9
    assert something_else(3, 5.0) == something_else(3)
    [doubt] = doubts(finding(lacking=22.0))
    assert doubt.startswith("a torque may be missing, vehicle, by 22 units") and "imitate" in doubt
    [doubt] = doubts(finding(lacking=22.0, together=(), verdict="none"))
    assert "too small to be sure of" in doubt
    assert not doubts(finding(lacking=9.0)) and not doubts(finding(lacking=50.0, verdict="unknown"))


@pytest.mark.parametrize(("verdict", "probability", "meant"), [
    ("cause", 0.4, True), ("unknown", 0.09, False), ("unknown", 0.97, True)])
def test_what_is_named_beside_something_unknown_is_meant_only_if_it_is_likely(verdict, probability, meant):
    assert believed({"verdict": verdict, "together": ["a", "b"], "causes": [
        {"effect": "a", "probability": 0.5 * probability}, {"effect": "b", "probability": 0.5 * probability}]}) is meant


def test_many_effects_at_once_are_as_likely_something_else_that_they_imitate():
    """A pair is not: less is left for what nobody thought of, and nothing is said."""
    assert something_else(3) == something_else(5) == 0.5 > 10.0 * something_else(2) == 10.0 * something_else(1)
    three = ("backlash_size", "shaft_stiffness", "two_stage_stiffness")
    assert ["3 effects together" in doubt for doubt in doubts(finding(together=three))] == [True]
    assert not doubts(finding(together=three[:2])) and not doubts(finding(together=three, verdict="unknown"))


def test_two_effects_that_bend_one_curve_are_as_likely_something_else_of_that_shaft():
    """Not those of two shafts; nor a name that happens to be in a set of three, which says enough."""
    stages = {"first_stage_stiffness", "first_stage_twist"}
    both = {*stages, "axle_shaft_stiffness"}
    assert something_else(2, parameters=both) == 0.5 > 10.0 * something_else(2, parameters=stages)
    assert something_else(2, parameters={*stages, "propeller_shaft_stiffness"}) == something_else(2)
    two = ("shaft_stiffness", "two_stage_stiffness")
    [doubt] = doubts(finding(together=two, parameters=both))
    assert doubt.startswith("shaft stiffness and two stage stiffness bend one curve")
    assert len(doubts(finding(together=(*two, "backlash_size"), parameters=both))) == 1


def test_errors_of_nothing_are_numbers_still():
    """A channel that nothing changes, one that was exact and one that becomes so."""
    flat = np.sin(CLOCK)
    rows = [Gain.of("tip_in", name, CLOCK, flat, flat + before, flat + after, 0.1)
            for name, before, after in (("a", 1.0, 1.0), ("b", 0.0, 0.0), ("c", 1.0, 0.0))]
    assert json.dumps(gained(rows), allow_nan=False)


def test_a_channel_that_stands_still_has_no_range_to_be_compared_with():
    still = np.full(CLOCK.size, 0.1)
    for course in (still, 0.0 * still, still + 1e-17 * np.sin(CLOCK)):
        unchanged = Gain.of("tip_in", "wheel_speed", CLOCK, course, course + 0.2, course + 0.1, 0.1)
        assert gained([row(), unchanged]) == gained([row()])
        nothing = gained([unchanged])
        assert nothing == {"held_out": [], "fraction_of_noise_floor": None, "remains": None}
