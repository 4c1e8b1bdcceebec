"""The command: exit codes, what stands where, and nothing half-written."""

import contextlib
import json
import logging
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from cosim import cli
from cosim.diagnosis.hidden import hide
from cosim.master import Result
from driveline.quantities import InputError

SHARED = Path(__file__).parents[3] / "shared" / "measured" / "tahoe_6l80_drive.csv.gz"

SCENARIO = """\
title = "Lag"
stop = {stop}
step = 0.001
[fmu.a]
file = "lag.fmu"
[connections]
"a.u" = 1.0
"""


@pytest.fixture
def folder(fmus, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lag.fmu").symlink_to(fmus / "lag.fmu")
    (tmp_path / "lag.toml").write_text(SCENARIO.format(stop=0.5))
    (tmp_path / "long.toml").write_text(SCENARIO.format(stop=1e5))
    return tmp_path


def driveline(*arguments, **options):
    return subprocess.run([sys.executable, "-m", "cosim.cli", *map(str, arguments)], capture_output=True,
                          text=True, timeout=120, **options)


def test_run_writes_results_and_pictures_and_json_alone(folder):
    done = driveline("run", "lag.toml", "--json", "--set", "a.time_constant=20 ms", "--out", "here",
                     cwd=folder)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["complete"]
    assert answer["simulated_seconds"] == 0.5
    assert {Path(name).name for name in answer["files"]} == {p.name for p in (folder / "here").iterdir()}
    parquet, csv = (Result.read(folder / "here" / f"result.{ending}") for ending in ("parquet", "csv"))
    assert (parquet["a.y"] == csv["a.y"]).all()
    assert parquet.provenance["participants"]["a"]["parameters"] == {"time_constant": 0.02}
    assert (folder / "here" / "signals.png").read_bytes().startswith(b"\x89PNG")
    assert "a.gear is not connected" in done.stderr


def test_the_text_for_people_names_the_files(folder, capsys):
    assert cli.main(["run", "lag.toml"]) == 0
    out = capsys.readouterr().out
    assert "Lag: 0.5 s simulated in" in out
    assert str(Path("out") / "lag" / "result.csv") in out


@pytest.mark.parametrize(("arguments", "words"), [
    (["run", "gone"], "there is no scenario 'gone'"),
    (["run", "gone.toml"], "gone.toml cannot be read"),
    (["run", "lag.toml", "--set", "a.u"], "FMU.PARAMETER=VALUE is needed"),
    (["run", "lag.toml", "--set", "a.tau=1"], "--set a.tau=1"),
    (["run", "lag.toml", "--measurement", "gone"], "there is no measurement gone"),
    (["run", "lag.toml", "--out", "lag.fmu"], "a folder that can be written to is needed"),
    (["run", "road_log"], "--measurement PATH"),
    (["study", "nothing"], "there is no study 'nothing'"),
    (["study", "size-estimator-robustness", "--workers", "0"], "workers"),
    (["study", "gears", "--workers", "2", "--out", "a/b"], "study 'gears' takes no --workers: it has no options"),
    (["study", "size-estimator", "--measurement", "a"], "takes no --measurement, but --workers, --cluster"),
])
def test_wrong_input_is_2_and_one_message(folder, capsys, arguments, words):
    assert cli.main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert words in captured.err
    assert "Traceback" not in captured.err
    assert captured.err.count("driveline:") == 1
    assert sorted(p.name for p in folder.iterdir()) == ["lag.fmu", "lag.toml", "long.toml"]


@pytest.mark.parametrize("arguments", [[], ["ruin"], ["run"], ["list", "cars"], ["hide", "x"],
                                       ["run", "a", "--fast"]])
def test_wrong_usage_is_2(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(arguments)
    assert caught.value.code == 2
    assert "usage: driveline" in capsys.readouterr().err


def test_a_failure_in_the_run_is_1_and_leaves_what_was_recorded(folder, capfd):
    text = SCENARIO.format(stop=1.0).replace('"a.u" = 1.0', '"a.u" = "s"')
    (folder / "bad.toml").write_text(
        text + '[signals.s]\nkind = "step"\nbefore = 0\nafter = 1e12\ntime = 0.3\n')
    assert cli.main(["run", "bad.toml", "--out", "bad"]) == 1
    err = capfd.readouterr().err
    assert "a (lag.fmu) at t = 0.3 s" in err
    assert "result_partial.csv" in err
    partial = Result.read(folder / "bad" / "result_partial.csv")
    assert not partial.complete
    assert partial.time[-1] == 0.3


def test_a_run_leaves_nothing_of_an_earlier_one(folder, capfd):
    """A failure leaves the whole result of an earlier run beside its part, a success no part; the user's own stays."""
    out = folder / "out"
    out.mkdir()
    (out / "mine.csv").write_text("")
    text = (SCENARIO.format(stop=1.0).replace('"a.u" = 1.0', '"a.u" = "s"')
            + '[signals.s]\nkind = "step"\nbefore = 0\nafter = 1e12\ntime = 0.3\n')
    (folder / "bad.toml").write_text(text)
    whole = {"result.csv", "result.json", "result.parquet", "signals.png"}
    part = {"result_partial.csv", "result_partial.json", "result_partial.parquet"}
    for scenario, code, names in (("lag", 0, whole), ("bad", 1, whole | part), ("lag", 0, whole)):
        assert cli.main(["run", f"{scenario}.toml", "--out", "out"]) == code
        assert {path.name for path in out.iterdir()} == {"mine.csv", *names}
    assert cli.main(["run", "lag.toml", "--out", "out", "--set", "a.time_konstant=1"]) == 2
    assert {path.name for path in out.iterdir()} == {"mine.csv", *names}


def test_a_pair_to_compare_that_is_not_there_is_said_before_the_run(folder, capsys):
    (folder / "log.csv").write_text("time,gear\n0,1\n1,2\n")
    (folder / "long.toml").write_text(SCENARIO.format(stop=1e5) + '[measurement]\npath = "log.csv"\n'
                                      '[compare]\n"a.gear_ot" = "gear"\n')
    assert cli.main(["run", "long.toml"]) == 2
    assert "did you mean 'a.gear_out'" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_a_study_prints_a_table_and_where_its_files_are(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["study", "torque-meter-filter", "--out", "here"]) == 0
    shown = capsys.readouterr().out.splitlines()
    rows = json.loads(Path("here/torque-meter-filter.json").read_text())["rows"]
    head, table, files = shown[1], shown[2:2 + len(rows)], shown[2 + len(rows):]
    assert all(line[head.index("unit"):].startswith(f"{row['unit']} ") for line, row in zip(table, rows, strict=True))
    assert {Path(file) for file in files} == set(Path("here").iterdir())


def test_an_fmu_without_outputs_runs_without_a_picture(foreign_fmus, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(f'stop = 0.1\n[fmu.f]\nfile = "{foreign_fmus / "silent.fmu"}"\n')
    assert cli.main(["run", "s.toml", "--out", "out", "--json"]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["result.csv", "result.json", "result.parquet"]


@pytest.mark.parametrize("words", [
    ["run", "{}"], ["run", "demo", "--out", "{}"], ["study", "gears", "--out", "{}"], ["diagnose", "{}"],
    ["hide", "--seed", "1", "--out", "{}"], ["hide", "--seed", "1", "--out", "h", "--vehicle", "{}"],
    ["hide", "--seed", "1", "--out", "h", "--truth", "{}"]])
def test_a_name_that_is_too_long_for_a_file_is_wrong_input(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    long = 400 * "a"
    assert cli.main([word.format(long) for word in words]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("driveline: ") and long in said and "--out h" not in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("out", "truth"), [
    ("m", "m.truth.json"), (".", "../here.truth.json"), ("a/..", "../here.truth.json"), ("..", "../../{}.truth.json")])
def test_the_truth_lies_beside_the_folder_however_it_is_written(tmp_path, monkeypatch, out, truth):
    asked = []
    (tmp_path / "here" / "a").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr("cosim.diagnosis.hidden.hide", lambda *args, truth, **kwargs: asked.append(truth))
    assert cli.main(["hide", "--seed", "1", "--quiet", "--out", out]) == 0
    assert [path.resolve() for path in asked] == [Path(truth.format(tmp_path.name)).resolve()]


@pytest.mark.skipif(os.name != "posix", reason="sends signals")
@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_ctrl_c_and_whatever_else_ends_a_run_leaves_a_readable_partial_result(folder, number, code):
    with _started(folder, "run", "long.toml", "--out", f"part_{code}", "--json") as process:
        line = process.stderr.readline()  # the notices come when everything is put together
        assert "not connected" in line
        time.sleep(1.0)
        process.send_signal(getattr(signal, number))
        out, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    assert out == ""
    assert "interrupted at t = " in err
    assert "Traceback" not in err
    partial = Result.read(folder / f"part_{code}" / "result_partial.parquet")
    assert not partial.complete
    assert partial.time.size > 100
    assert not list((folder / f"part_{code}").glob("result.*"))


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="asks /proc for processes")
@pytest.mark.parametrize("number", ["SIGTERM", "SIGHUP"])
def test_a_diagnosis_that_is_terminated_leaves_nothing_and_nobody(tmp_path, number):
    """Neither a folder with half of it nor workers, as `timeout` or a batch system ends it."""
    hide(["shaft_stiffness=0.75"], 1, tmp_path / "m", manoeuvres=["tip_in:5", "tip_in:5"])
    with _started(tmp_path, "diagnose", "m", "--out", "o", "--workers", "2", "--no-fmu") as process:
        workers = _wait(lambda: len(_of_session(process.pid)) > 2 and _of_session(process.pid))
        process.send_signal(getattr(signal, number))
        _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + getattr(signal, number) and err.splitlines()[-1] == "driveline: terminated"
    assert "Traceback" not in err
    assert len(workers) > 2 and _wait(lambda: not _of_session(process.pid))
    assert [path.name for path in tmp_path.iterdir()] == ["m"]


@contextlib.contextmanager
def _started(folder, *arguments):
    """The command in a process and a session of its own, to which signals come also where the tests run under nohup."""
    process = subprocess.Popen(
        [sys.executable, "-m", "cosim.cli", *arguments], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL))
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _of_session(number):
    """Processes of a session, but for those that have ended."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            state, _, _, session = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
            found += [folder.name] * (int(session) == number and state != "Z")
    return found


def _wait(asked, seconds=60.0):
    """What is asked for as soon as it is true."""
    until = time.monotonic() + seconds
    while not (answer := asked()) and time.monotonic() < until:
        time.sleep(0.1)
    return answer


def test_list_tells_what_there_is(capfd):
    assert cli.main(["list", "--json", "scenarios"]) == 0
    scenarios = json.loads(capfd.readouterr().out)
    assert scenarios["tip_in_5th"] == "Tip-in in 5th gear"
    assert cli.main(["list", "vehicles", "--json"]) == 0
    assert "modified" in json.loads(capfd.readouterr().out)["pickup_10r80"]


FINDING = {"verdict": "cause", "wrong": [
    {"signal": "engine_speed", "where": "tip_in", "what": "shuffle frequency 22 % high", "size": 1.3, "unit": "Hz",
     "p_value": 1e-9, "feature": "shuffle frequency"}],
    "causes": [{"effect": "shaft_stiffness", "probability": 0.93, "parameters": {
         "axle_shaft_stiffness": {"nominal": 10.0, "value": 7.5, "low90": 7.4, "high90": 7.6, "unit": "N.m/rad"}}}],
    "together": ["shaft_stiffness"], "ambiguous_with": [{"effects": ["engine_inertia"], "separation_sigma": 2.5}],
    "next_manoeuvre": {"kind": "ramp", "gear": 4, "back": True, "separation_sigma": 6.0, "why": "because"},
    "unknown": None, "extension": None,
    "gain": {"held_out": [{"signal": "wheel_speed", "nrmse_before": 0.35, "nrmse_after": 0.02}], "features": [
        {"signal": "engine_speed", "feature": feature, "unit": "Hz", "measured": 5.9, "before": 7.19, "after": 5.91}
        for feature in ("shuffle frequency", "overshoot")]}}


def test_causes_that_act_together_are_told_with_what_they_have_together():
    parameters = {"vehicle_mass": {"nominal": 2200.0, "value": 2530.0, "low90": 2500.0, "high90": 2560.0, "unit": "kg"}}
    second = {"effect": "vehicle_mass", "probability": 0.4, "parameters": parameters}
    first = {**FINDING["causes"][0], "probability": 0.5}
    lines = cli._summary({**FINDING, "causes": [first, second], "together": ["shaft_stiffness", "vehicle_mass"]})
    assert "90 % these together: shaft_stiffness, vehicle_mass" in "\n".join(lines)
    rivals = [{"effects": effects, "in_place_of": gone, "separation_sigma": 1.0}
              for effects, gone in ((["road_grade"], ["vehicle_mass"]), (["vehicle_mass"], ["shaft_stiffness"]))]
    lines = cli._summary({**FINDING, "causes": [first, second], "together": ["shaft_stiffness", "vehicle_mass"],
                          "ambiguous_with": rivals})
    assert "  cannot be told from road_grade in place of vehicle_mass (1.0 sigma)" in lines
    assert "  cannot be told from vehicle_mass alone (1.0 sigma)" in lines
    assert "together" not in "\n".join(cli._summary(FINDING))
    none = "\n".join(cli._summary({**FINDING, "verdict": "none", "together": []}))
    assert "is not excluded: engine_inertia (2.5 sigma)" in none and "cannot be told" not in none
    assert "drive next: ramp in gear 4: because" in "\n".join(cli._summary(FINDING))
    told = {**FINDING, "directly": [{"effect": "engine_inertia", "how": "a pendulum"}]}
    assert "  or measure engine_inertia: a pendulum" in cli._summary(told)
    assert "  measure engine_inertia: a pendulum" in cli._summary({**told, "next_manoeuvre": None})
    again = {**FINDING, "next_manoeuvre": {**FINDING["next_manoeuvre"], "times": 3}}
    assert "drive next: ramp in gear 4, 3 times: because" in "\n".join(cli._summary(again))


def test_a_factor_is_told_without_a_unit():
    lash = {"backlash": {"nominal": 1.0, "value": 1.5, "low90": 1.4, "high90": 1.6, "unit": "1"}}
    lines = cli._summary({**FINDING, "causes": [{"effect": "backlash_size", "probability": 0.9, "parameters": lash}]})
    assert "   90 % backlash_size: backlash 1.5 [1.4, 1.6] (file: 1)" in lines
    assert any("[7.4, 7.6] N.m/rad (file: 10)" in line for line in cli._summary(FINDING))


@pytest.mark.parametrize(("value", "shown"), [
    (10748.0, "10750"), (8037.3, "8037"), (123456.0, "123500"), (0.98765, "0.9877"), (-4.7e-10, "-4.7e-10"), (0, "0")])
def test_numbers_of_a_cause_are_written_alike(value, shown):
    """A stiffness was 8037 N.m/rad, and 1.075e+04 in the file."""
    shaft = {"axle_shaft_stiffness": {**dict.fromkeys(("nominal", "value", "low90", "high90"), value), "unit": "1"}}
    cause = {"effect": "shaft_stiffness", "probability": 0.9, "parameters": shaft}
    told = f"   90 % shaft_stiffness: axle_shaft_stiffness {shown} [{shown}, {shown}] (file: {shown})"
    assert told in cli._summary({**FINDING, "causes": [cause]})


def test_manoeuvres_to_hide_in_are_listed_or_repeated(monkeypatch):
    asked = []
    monkeypatch.setattr("cosim.diagnosis.hidden.hide", lambda *args, manoeuvres, **kwargs: asked.append(manoeuvres))
    for given in ([], ["--manoeuvres", "tip_in:5,ramp:6"], ["--manoeuvres", "tip_in:5", "--manoeuvre", "ramp:6"]):
        assert cli.main(["hide", "--seed", "1", "--quiet", *given]) == 0
    assert asked == [None, ["tip_in:5", "ramp:6"], ["tip_in:5", "ramp:6"]]


@pytest.mark.parametrize(("options", "said"), [([], ["ours"]), (["--quiet"], [])])
def test_libraries_say_only_what_is_wrong(monkeypatch, capfd, options, said):
    def lists(options):
        logging.getLogger("cosim").info("ours")
        logging.getLogger("of_a_library").info("theirs")
        return {}, ""

    monkeypatch.setattr(cli, "_list", lists)
    assert cli.main(["list", *options]) == 0
    assert capfd.readouterr().err.split() == said


@pytest.fixture
def diagnosing(monkeypatch):
    """What ``diagnose`` writes and then raises, in place of the pipeline; its options as they arrive."""
    state = SimpleNamespace(files={"finding.json": "{}", "report.html": "<p>"}, error=None, options=None)

    def diagnose(path, out, *, vehicle, variant, workers, say, build):
        state.options = SimpleNamespace(path=path, workers=workers, build=build)
        say("halfway")
        for name, text in state.files.items():
            (out / name).write_text(text)
        if state.error is not None:
            raise state.error
        return SimpleNamespace(finding=FINDING)

    monkeypatch.setitem(sys.modules, "cosim.diagnosis.diagnose", SimpleNamespace(diagnose=diagnose))
    return state


def test_a_diagnosis_is_told_in_lines_or_as_json(diagnosing, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["diagnose", "m", "--workers", "3"]) == 0
    said = capfd.readouterr()
    assert "halfway" in said.err
    for words in ("verdict: cause", "shuffle frequency 22 % high", "93 % shaft_stiffness: axle_shaft_stiffness 7.5",
                  "cannot be told from engine_inertia", "ramp in gear 4", "35.00 % before, 2.00 % after",
                  "engine_speed: shuffle frequency 5.9 measured, 7.19 before, 5.91 after [Hz]",
                  str(Path("out") / "diagnosis" / "report.html")):
        assert words in said.out
    assert "overshoot" not in said.out  # was not wrong
    assert diagnosing.options.workers == 3 and callable(diagnosing.options.build)
    assert cli.main(["diagnose", "m", "--json", "--no-fmu", "--out", "here"]) == 0
    assert json.loads(capfd.readouterr().out) == FINDING
    assert diagnosing.options.build is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["here", "out"]


def test_a_diagnosis_leaves_nothing_of_an_earlier_one_and_nothing_else_out(diagnosing, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("mine.txt", "extended.toml", "plant_fom_extended.fmu", "finding.json"):
        (out / name).write_text("old")
    assert cli.main(["diagnose", "m", "--out", str(out)]) == 0
    assert {path.name: path.read_text() for path in out.iterdir()} == {
        "mine.txt": "old", "finding.json": "{}", "report.html": "<p>"}


@pytest.mark.parametrize(("error", "code"), [
    (InputError("wrong"), 2), (ValueError("oh"), 1), (RuntimeError("oh"), 1), (KeyboardInterrupt(), 130)])
def test_a_diagnosis_that_fails_leaves_nothing_half_written(diagnosing, tmp_path, capsys, error, code):
    diagnosing.error = error
    out = tmp_path / "new" / "out"
    assert cli.main(["diagnose", "m", "--out", str(out)]) == code
    assert list(tmp_path.iterdir()) == []
    out.mkdir(parents=True)
    (out / "finding.json").write_text("old")
    assert cli.main(["diagnose", "m", "--out", str(out)]) == code
    assert [path.read_text() for path in out.iterdir()] == ["old"]
    assert "Traceback" not in capsys.readouterr().err


def test_a_diagnosis_wants_a_folder_and_a_worker(diagnosing, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert cli.main(["diagnose", "m", "--out", str(tmp_path / "file" / "x")]) == 2
    assert "file is no folder that can be written to" in capsys.readouterr().err
    assert cli.main(["diagnose", "m", "--workers", "0"]) == 2
    assert "--workers 0: at least 1 is needed" in capsys.readouterr().err
    assert diagnosing.options is None


MEASUREMENT = """\
vehicle = "pickup_10r80"
[[manoeuvre]]
file = "a.csv"
kind = "tip_in"
gear = 5
[channels]
time = { column = "t", unit = "s" }
engine_torque = { column = "trq", unit = "N.m" }
engine_speed = { column = "n", unit = "rpm" }
vehicle_speed = { column = "v", unit = "km/h" }
"""
ROWS = "t,trq,n,v\n" + "".join(f"{k / 100:.2f},{50 + k % 3},{1500 + k},{70 + k / 100:.2f}\n" for k in range(400))


@pytest.mark.parametrize(("change", "data", "words"), [
    (("", ""), None, "a.csv"),
    (('column = "n"', 'column = "rev"'), ROWS, "there is no column 'rev'"),
    (('"rpm"', '"N.m"'), ROWS, "engine_speed is measured in rad/s"),
    (('"rpm"', '"rmp"'), ROWS, "'rmp'"),
    (('engine_torque = { column = "trq", unit = "N.m" }', ""), ROWS, "no channel 'engine_torque'"),
    (("gear = 5", "gear = 17"), ROWS, "gear"),
    (("gear = 5", 'gear = "fifth"'), ROWS, "gear is 'fifth'"),
    (('kind = "tip_in"', 'kind = "tipin"'), ROWS, "did you mean 'tip_in'"),
    (('"pickup_10r80"', '"pickup"'), ROWS, "pickup"),
    (('vehicle = "pickup_10r80"', ""), ROWS, "which vehicle?"),
    (("", ""), "", "a.csv"),
    (("", ""), "t,trq,n,v\n", "a.csv"),
    (("", ""), re.sub(",5.,", ",nan,", ROWS), "holds no values"),
    (("", ""), "\n".join(ROWS.splitlines()[:40]), "at least 2 s"),
    (("[[manoeuvre]]", "[[manoeuvre]"), ROWS, "measurement.toml"),
], ids=["no file", "column", "dimension", "unit", "no torque", "gear", "gear no number", "kind", "vehicle",
        "no vehicle", "empty", "no rows", "nan", "short", "toml"])
def test_a_wrong_measurement_is_2_and_one_message(tmp_path, monkeypatch, capsys, change, data, words):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "m"
    folder.mkdir()
    (folder / "measurement.toml").write_text(MEASUREMENT.replace(*change) if change[0] else MEASUREMENT)
    if data is not None:
        (folder / "a.csv").write_text(data)
    assert cli.main(["diagnose", "m"]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert said.err.count("driveline:") == 1 and "Traceback" not in said.err
    assert said.out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["m"]


@pytest.mark.parametrize("name", ["gone", "empty", "picture.png"])
def test_what_is_no_measurement_is_2(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "picture.png").write_bytes(b"\x89PNG")
    assert cli.main(["diagnose", name]) == 2
    assert name in capsys.readouterr().err


@pytest.mark.skipif(not SHARED.is_file(), reason=f"the road log is not beside the checkout ({SHARED})")
def test_the_road_log_drives_the_plant_and_is_compared(tmp_path, monkeypatch):
    """Its first seconds, on the twin; the whole of it is a run of half a minute."""
    from cosim.master import Scenario

    scenario = Scenario.load("road_log", measurement=SHARED, twins=True)
    assert (scenario.start, round(scenario.stop)) == (0.597, 800)
    result = scenario.master().run(start=scenario.start, stop=scenario.start + 5.0)
    turbine, vehicle = scenario.compare(result)
    assert turbine.samples > 100
    assert vehicle.samples > 80
    assert abs(vehicle.mean_error) < 1.0
