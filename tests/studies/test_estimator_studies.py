"""The estimators' studies, small: the JSON of the contract, their pictures, rows that agree with each other."""

import json
from pathlib import Path

import numpy as np
import pytest

from cosim import studies
from cosim.studies import road_log, size_estimator, size_estimator_robustness
from cosim.studies.estimation import THESIS_TKBSE, Drive, position_estimators, size_estimators
from cosim.studies.findings import Findings
from cosim.studies.state_estimator_robustness import DENSITY
from cosim.studies.torque_profiles import RATE, ramps
from driveline.estimators import ESTIMATORS
from driveline.quantities import InputError
from driveline.sensors.can_signal import jitter_density

pytestmark = pytest.mark.usefixtures("no_fmus")

SHORT = Drive(ramps(RATE, count=2), stop=8.0, vehicle_speed=15.0)
SHORTER = Drive(ramps(RATE, count=1), stop=2.5, vehicle_speed=15.0)
PROFILES = {"steps": {"Step 1 (60 N.m)": size_estimator_robustness.PROFILES["steps"]["Step 1 (60 N.m)"]},
            "random": {"Random": size_estimator_robustness.random()}}
SMALL = {
    "state-estimator": {"drive": Drive(stop=2.0), "phases": 2},
    "state-estimator-robustness": {"steps": (300,), "ramps": (250, 500), "jitter_sets": (1, 3), "seeds": (1,),
                                   "phases": (0.0, 0.004), "workers": 1},
    "state-estimator-sensitivity": {"ramps": (250, 500), "factors": (1.2, 1.5), "workers": 1},
    "size-estimator": {"drive": SHORT, "phases": 2, "workers": 1},
    "size-estimator-robustness": {"profiles": PROFILES, "lashes": (1.0,), "jitter_sets": (1, 3),
                                  "validation": SHORTER, "workers": 1},
}
TAHOE = Path(__file__).parents[3] / "shared" / "measured" / "tahoe_6l80_drive.csv.gz"


def row(result, quantity):
    return next(r for r in result["rows"] if r["quantity"] == quantity)


@pytest.mark.parametrize("name", SMALL)
def test_result_is_what_the_contract_says(ran, name):
    out, result, shares = ran(name)
    assert json.loads((out / f"{name}.json").read_text(encoding="utf-8")) == result
    assert result["source"].startswith("000_04412de56ba07ac9.txt, ")
    assert result["rows"] and len({row["quantity"] for row in result["rows"]}) == len(result["rows"])
    for entry in result["rows"]:
        assert list(entry) == ["quantity", "unit", "paper", "here", "deviation_percent", "note"]
        assert entry["here"] is not None or entry["note"]
    assert shares[0] == 0.0 and shares[-1] == 1.0 and shares == sorted(shares)
    for figure in result["figures"]:
        assert (out / figure).read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in out.iterdir()} <= {*result["figures"], f"{name}.json", "cases"}


@pytest.mark.parametrize("name", SMALL)
def test_every_estimator_is_in_the_rows(ran, name):
    _, result, _ = ran(name)
    for estimator in size_estimators() if name.startswith("size") else position_estimators():
        for period in (("10 ms",) if "sensitivity" in name else ("10 ms", "5 ms", "1 ms")):
            assert any(entry["quantity"].endswith(f", {estimator}") and (
                period in entry["quantity"] + entry["note"]) for entry in result["rows"])


@pytest.mark.parametrize("name", SMALL)
def test_missing_fmus_are_said(ran, name):
    _, result, _ = ran(name)
    missing = [entry for entry in result["rows"] if entry["quantity"].startswith("FMUs and master")]
    assert missing and all(entry["here"] is None and "driveline build" in entry["note"] for entry in missing)


def test_every_figure_of_both_chapters_is_redrawn(ran):
    drawn = {figure for name in SMALL for figure in ran(name)[1]["figures"]}
    assert {f"figure_3_{i}.png" for i in range(3, 25)} <= drawn
    left_out = {5 + 3 * i + j for i in (1, 2) for j in range(3)}  # ramps and varying, not in the small case
    assert {f"figure_4_{i}.png" for i in range(2, 25) if i not in left_out} <= drawn
    assert {"figure_A_1.png", "figure_A_2.png"} <= drawn


def test_a_second_run_gives_the_same_from_what_is_kept(ran):
    name = "size-estimator"
    out, first, _ = ran(name)
    kept = {path: path.stat().st_mtime_ns for path in (out / "cases").iterdir()}
    again = studies.run(name, out, **SMALL[name])
    assert again["rows"] == first["rows"]
    assert {path: path.stat().st_mtime_ns for path in (out / "cases").iterdir()} == kept


def test_robustness_and_validation_agree_where_they_are_the_same_run(ran):
    _, validation, _ = ran("state-estimator")
    _, robustness, _ = ran("state-estimator-robustness")
    for estimator in position_estimators():
        quantities = (f"lash traversal time, error, 10 ms, {estimator}",
                      f"lash traversal time, error, ramp 250 N.m/s, 10 ms, {estimator}")
        assert row(validation, quantities[0])["here"] == row(robustness, quantities[1])["here"]


def test_means_are_those_of_the_rows(ran):
    _, result, _ = ran("state-estimator-robustness")
    single = [row(result, f"lash traversal time, error, {what}, 5 ms, dskse")["here"]
              for what in ("step 300 N.m", "ramp 250 N.m/s", "ramp 500 N.m/s")]
    mean = row(result, "mean error of the lash traversal time, steps and ramps, 5 ms, dskse")["here"]
    assert mean == pytest.approx(np.mean(single))


def test_the_right_parameters_are_the_baseline(ran):
    _, result, _ = ran("state-estimator-sensitivity")
    for estimator in position_estimators():
        for name in ("q_1", "q_6"):
            found = [entry["here"] for entry in result["rows"]
                     if entry["quantity"] == f"lash traversal time, error, {name} times 1, {estimator}"]
            if found:
                assert found == [row(ran("state-estimator")[1],
                                     f"lash traversal time, error, 10 ms, {estimator}")["here"]]


def test_errors_are_those_of_the_sizes_said(ran):
    _, result, _ = ran("size-estimator")
    for entry in result["rows"]:
        if entry["quantity"].startswith("lash size, error after the last tip-in"):
            said, true = (float(text.split(" deg")[0].split()[-1]) for text in entry["note"].split(", "))
            assert entry["here"] == pytest.approx(100.0 * abs(said / true - 1.0), abs=0.1)


def test_the_thesis_estimator_alone_stands_beside_the_one_that_ships(ran):
    """On the same runs, and told of the delays where there are any."""
    _, size, _ = ran("size-estimator")
    _, robustness, _ = ran("size-estimator-robustness")
    for entry in [*size["rows"], *robustness["rows"]]:
        if entry["quantity"].endswith("ms, tkbse"):
            row(size if entry in size["rows"] else robustness, f"{entry['quantity']} of the thesis")
    late = "lash size, error, wheel speed 30 ms late, 10 ms"
    alone, told, found = (row(robustness, f"{late}, {name}")["here"] for name in (
        f"{THESIS_TKBSE}", f"{THESIS_TKBSE}, told", "tkbse"))
    assert alone > 5.0 > 2.0 > max(told, found)


def test_where_the_frames_fall_is_averaged(ran):
    _, result, _ = ran("size-estimator")
    entry = row(result, "lash size, mean error wherever the frames fall, 2 alpha, 10 ms, tkbse")
    low, high = (float(text.split(" %")[0]) for text in entry["note"].split("from ")[1].split(" to "))
    first = row(result, "lash size, error after the last tip-in, 2 alpha, 10 ms, tkbse")["here"]
    assert min(abs(low), abs(high)) - 0.01 <= entry["here"] <= max(abs(low), abs(high)) + 0.01
    assert min(abs(first - abs(low)), abs(first - abs(high))) <= 0.01


def test_true_sizes_are_two_four_and_six_alpha():
    sizes = [size_estimator._with_lash(SHORT, factor).lash_size() for factor in size_estimator.LASHES]
    np.testing.assert_allclose(np.array(sizes) / sizes[0], [1.0, 2.0, 3.0])


def test_jitter_that_is_drawn_has_the_density_it_is_shown_with():
    share = jitter_density("engine", 3, DENSITY)
    assert np.trapezoid(share, DENSITY) == pytest.approx(1.0, rel=1e-2)


def test_an_argument_a_study_does_not_take_is_named(tmp_path):
    with pytest.raises(InputError, match="'gears' takes no --workers"):
        studies.run("gears", tmp_path, workers=2)
    with pytest.raises(InputError, match="'gears' takes no 'gaers'; did you mean 'gears'"):
        studies.run("gears", tmp_path, gaers=(5,))


def test_without_a_road_log_it_is_said(ran):
    _, result, _ = ran("state-estimator-robustness")
    assert "--measurement" in row(result, "road log")["note"]


@pytest.mark.parametrize(("change", "said"), [
    (lambda folder: folder / "gone", "there is no measurement"),
    (lambda folder: (folder / "drive.csv").write_text("time,vehicle_speed,gear\n0,1,5\n1,1,5\n") and folder,
     "has no channel 'engine_torque'"),
    (lambda folder: (folder / "measurement.toml").write_text((folder / "measurement.toml").read_text().replace(
        "pickup_10r80", "suv_6l80")) and (folder / "drive.csv").write_text((folder / "drive.csv").read_text().replace(
            ",5\n", ",7\n")) and folder, "gear is 7"),
    (lambda folder: (folder / "drive.csv").write_text(
        "\n".join((folder / "drive.csv").read_text().splitlines()[:3])) and folder, "0.02 s long: at least 0.5 s"),
])
def test_what_is_wrong_with_a_road_log_is_said_before_the_runs(tmp_path, monkeypatch, change, said):
    log = change(a_drive(tmp_path / "log", [5], "pickup_10r80"))
    monkeypatch.setattr("cosim.studies.sweep.Sweep.run", None)
    with pytest.raises(InputError, match=said):
        studies.run("state-estimator-robustness", tmp_path, measurement=log)


@pytest.mark.skipif(not TAHOE.is_file(), reason=f"the road log is not at {TAHOE}")
def test_estimators_stay_finite_on_a_road_log(tmp_path):
    findings = Findings()
    road_log.road_log(findings, tmp_path, road_log.RoadLog.read(TAHOE), seconds=60.0)
    rows = {entry.quantity: entry for entry in findings.rows}
    assert rows["road log: every output of every estimator is finite (0 no, 1 yes)"].here == 1.0
    for estimator in ESTIMATORS:
        assert any(quantity.endswith(f", {estimator}") for quantity in rows)
    assert (tmp_path / findings.figures[0]).is_file()


def a_drive(folder, gears, vehicle):
    """20 s of a steady drive without a turbine speed; a gear after the other, each for as long."""
    folder.mkdir()
    time = np.arange(0.0, 20.0, 0.02)
    gear = np.repeat(gears, -(-time.size // len(gears)))[:time.size]
    rows = [f"{t:.2f},{100 * (np.sin(t) > 0) - 20},{150 + np.sin(t):.3f},{12 + 0.05 * np.sin(t):.3f},{g}"
            for t, g in zip(time, gear)]
    (folder / "drive.csv").write_text("\n".join(
        ["time [s],engine_torque [N.m],engine_speed [rad/s],vehicle_speed [m/s],gear", *rows]) + "\n")
    (folder / "measurement.toml").write_text(
        f'vehicle = "{vehicle}"\n[[manoeuvre]]\nfile = "drive.csv"\nkind = "drive"\n')
    return folder


def test_a_road_log_is_that_of_its_own_vehicle(tmp_path):
    findings = Findings()
    road_log.road_log(findings, tmp_path, road_log.RoadLog.read(a_drive(tmp_path / "log", [5], "pickup_10r80")))
    rows = {entry.quantity: entry for entry in findings.rows}
    finite = rows["road log: every output of every estimator is finite (0 no, 1 yes)"]
    assert finite.here == 1.0 and finite.note.startswith("pickup_10r80, 20 s")
    assert "not known without a turbine speed" in rows["road log: time in gear 5"].note


@pytest.mark.parametrize(("gears", "said"), [([0], "no forward gear is engaged"),
                                             ([4, 5] * 25, "never for 0.5 s on end")])
def test_a_road_log_without_a_gear_to_look_at_says_so(tmp_path, gears, said):
    findings = Findings()
    road_log.road_log(findings, tmp_path, road_log.RoadLog.read(a_drive(tmp_path / "log", gears, "pickup_10r80")))
    gears = [gear for gear in sorted(set(gears)) if gear]
    assert sum(said in entry.note for entry in findings.rows) == max(len(gears), 1)
    assert all(entry.here is None or np.isfinite(entry.here) for entry in findings.rows)
