"""The command: exit codes, what stands where, and nothing half-written."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cosim import cli
from cosim.master import Result

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
])
def test_wrong_input_is_2_and_one_message(folder, capsys, arguments, words):
    assert cli.main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert words in captured.err
    assert "Traceback" not in captured.err
    assert captured.err.count("driveline:") == 1
    assert sorted(p.name for p in folder.iterdir()) in (
        ["lag.fmu", "lag.toml", "long.toml"], ["lag.fmu", "lag.toml", "long.toml", "out"])
    assert not list(folder.glob("out/**/*.*"))


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


@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT")
def test_ctrl_c_is_130_and_leaves_a_readable_partial_result(folder):
    process = subprocess.Popen(
        [sys.executable, "-m", "cosim.cli", "run", "long.toml", "--out", "part", "--json"],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    line = process.stderr.readline()  # the notices come when everything is put together
    assert "not connected" in line
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert out == ""
    assert "interrupted at t = " in err
    assert "Traceback" not in err
    partial = Result.read(folder / "part" / "result_partial.parquet")
    assert not partial.complete
    assert partial.time.size > 100
    assert not list((folder / "part").glob("result.*"))


def test_list_tells_what_there_is(capfd):
    assert cli.main(["list", "--json", "scenarios"]) == 0
    scenarios = json.loads(capfd.readouterr().out)
    assert scenarios["tip_in_5th"] == "Tip-in in 5th gear"
    assert cli.main(["list", "vehicles", "--json"]) == 0
    assert "modified" in json.loads(capfd.readouterr().out)["pickup_10r80"]


@pytest.mark.parametrize("arguments", [["diagnose", "x"]])
def test_what_does_not_exist_yet_is_1_and_says_so(arguments, capsys):
    assert cli.main(arguments) == 1
    assert "not implemented yet" in capsys.readouterr().err


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
