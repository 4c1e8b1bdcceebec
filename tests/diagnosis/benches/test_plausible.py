"""Units, clocks and signs that are not right are said before anything of a bench is explained by them."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.benches.bench import diagnose_bench
from cosim.diagnosis.benches.inverse import Torques
from cosim.diagnosis.benches.plausible import check
from driveline.quantities import InputError


@pytest.fixture(params=[True, False], ids=["inline", "motor alone"])
def inline(request):
    return request.param


def scaled(runs, factors):
    """The runs with some channels multiplied; the drive's torque is what they are driven by."""
    return [replace(run, inputs=factors.get("motor_torque", 1.0) * run.inputs,
                    measured={name: factors.get(name, 1.0) * values for name, values in run.measured.items()})
            for run in runs]


def test_what_the_catalogue_can_explain_is_possible(tmp_path, made_up):
    plant, runs = made_up(tmp_path, seconds=12.0, inertia=2.5 * 2.82e-5, with_speed=True)
    check(Torques(plant, runs))
    check(Torques(plant, scaled(runs, {"inline_torque": 2.0})))
    check(Torques(plant, scaled(runs, {"motor_torque": 0.6, "inline_torque": 0.5})))


@pytest.mark.parametrize(("channel", "factor", "said"), [
    ("motor_torque", 30.0, r"motor_torque goes with the acceleration .* is the unit of motor_torque right\?$"),
    ("motor_torque", 1e-3, r"motor_torque goes with .* motor_torque right\? It is as if kN.m were taken for N.m"),
    ("motor_torque", -1.0, "motor_torque has the other sign than what motor_position needs: .* of motor_torque right"),
    ("inline_torque", 1e3, r"inline_torque goes with .* inline_torque right\? It is as if N.m were taken for kN.m"),
    ("inline_torque", -1.0, "inline_torque has the other sign .*: is the sign of inline_torque right"),
    ("motor_position", 180.0 / np.pi, r"goes with .* unit of motor_position right\? It is as if deg .* for rad"),
    ("motor_position", 0.5 / np.pi, r"goes with .* unit of motor_position right\? It is as if rev .* for rad"),
    ("motor_position", -1.0, "has the other sign than what motor_position needs: is the sign of motor_position right")])
def test_of_two_torques_the_one_says_whose_unit_is_wrong(tmp_path, made_up, channel, factor, said):
    plant, runs = made_up(tmp_path, seconds=12.0)
    with pytest.raises(InputError, match=said):
        check(Torques(plant, scaled(runs, {channel: factor})))


@pytest.mark.parametrize(("channel", "factor", "said"), [
    ("motor_torque", 1e-3, r"is the unit of motor_torque right\? It is as if kN.m were taken for N.m"),
    ("motor_position", 180.0 / np.pi, r"is the unit of motor_position right\? It is as if deg were taken for rad"),
    ("motor_torque", -1.0, "is the sign of motor_torque or motor_position right")])
def test_of_one_torque_friction_says_whose_unit_is_wrong(tmp_path, made_up, channel, factor, said):
    plant, runs = made_up(tmp_path, seconds=12.0, inline=False)
    with pytest.raises(InputError, match=said):
        check(Torques(plant, scaled(runs, {channel: factor})))


@pytest.mark.parametrize(("channel", "factor", "said"), [
    ("motor_speed", 30.0 / np.pi, r"motor_speed is 9\.5.* unit of motor_speed right\? It is as if rpm .* for rad/s"),
    ("motor_speed", -1.0, "motor_speed has the other sign .* makes it: is the sign of motor_speed right"),
    ("motor_position", np.pi / 180.0, r"unit of motor_position right\? It is as if rad were taken for deg"),
    ("motor_position", -1.0, "motor_speed has the other sign .*: is the sign of motor_position right")])
def test_torques_say_which_of_two_motions_is_wrong(tmp_path, made_up, inline, channel, factor, said):
    plant, runs = made_up(tmp_path, seconds=12.0, with_speed=True, inline=inline)
    with pytest.raises(InputError, match=said):
        check(Torques(plant, scaled(runs, {channel: factor})))


@pytest.mark.parametrize(("late", "said"), [
    ([("motor_torque", 0.7)], r"motor_torque is about 0\.7. s late against motor_position.*\[channels.motor_torque"),
    ([("inline_torque", -0.45)], "inline_torque is about 0.45 s early against motor_position"),
    ([("motor_position", 0.7)], "motor_position is about 0.7. s late against all else"),
    ([("motor_torque", 1.0), ("inline_torque", 1.0)], "motor_position is about 1.00 s early against all else")])
def test_a_channel_of_another_logger_is_named(tmp_path, made_up, late, said):
    plant, runs = made_up(tmp_path, seconds=12.0, late=late)
    with pytest.raises(InputError, match=said):
        check(Torques(plant, runs))


def test_a_delay_that_the_catalogue_has_is_left_to_it(tmp_path, made_up, inline):
    plant, runs = made_up(tmp_path, seconds=12.0, inertia=2.5 * 2.82e-5, inline=inline, late=[("motor_torque", 0.3)])
    check(Torques(plant, runs))


def test_a_noisy_position_makes_no_speed_wrong(tmp_path, made_up):
    plant, runs = made_up(tmp_path, seconds=12.0, with_speed=True)
    random = np.random.default_rng(1)
    noisy = [replace(run, measured=run.measured | {"motor_position": run.measured["motor_position"] + 0.03
                                                   * random.standard_normal(run.measured["motor_position"].size)})
             for run in runs]
    check(Torques(plant, noisy))


def test_of_a_bench_that_friction_holds_nothing_is_asked(tmp_path, made_up):
    plant, runs = made_up(tmp_path, seconds=12.0, inline=False, extra=lambda time, angle, speed: 5.0 * np.sign(speed))
    check(Torques(plant, scaled(runs, {"motor_position": 10.0})))


def test_the_diagnosis_refuses_it(tmp_path, made_up):
    plant, runs = made_up(tmp_path, seconds=12.0)
    with pytest.raises(InputError, match="other sign"):
        diagnose_bench(plant, scaled(runs, {"motor_torque": -1.0}))


@pytest.mark.parametrize("torque", [0.0, 0.01, 0.5])
def test_a_torque_that_always_reads_the_same_says_nothing(tmp_path, made_up, torque):
    """As in a coast-down: no gain and all of it offset would explain it without error, whatever moves."""
    plant, runs = made_up(tmp_path, seconds=12.0)
    still = [replace(run, inputs=np.full_like(run.inputs, torque)) for run in runs]
    assert Torques(plant, still).channels == ["inline_torque"]
    alone = [run.only({"motor_position"}) for run in still]
    with pytest.raises(InputError, match=f"motor_torque always reads {torque:g}: .*record one that does"):
        diagnose_bench(plant, alone)
    assert Torques(plant, [*alone, *runs]).channels == ["motor_torque", "inline_torque"]  # it does in another
    whole = diagnose_bench(plant, still, still)
    assert "motor_torque always reads the same, which says nothing of what moves" in whole.notices
    found = whole.finding
    assert found["verdict"] == "none" and {row["signal"] for row in found["gain"]["held_out"]} == {"inline_torque"}
    assert {row["signal"] for row in diagnose_bench(plant, still, alone).finding["gain"]["held_out"]} == set()
