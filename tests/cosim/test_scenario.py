"""Scenario files: what they say is what runs, and what is wrong is named with file, line and key."""

import json

import numpy as np
import pytest

from cosim.master import Master, Ramp, Scenario
from cosim.master.scenario import names
from driveline.quantities import InputError

TEXT = """\
title = "Lag and counter"
stop = "0.5 s"
step = "1 ms"
record = ["ramp", "a.*", "b.seen"]
record_step = "5 ms"

[fmu.a]
file = "lag.fmu"

[fmu.a.parameters]
time_constant = "50 ms"
start_angle = "10 deg"

[fmu.b]
file = "counter.fmu"
step = 0.005

[signals.ramp]
kind = "ramp"
unit = "deg"
before = 0
after = 90
time = 0.1
duration = 0.1

[connections]
"a.u" = "ramp"
"a.gear" = 3
"b.u" = "a.y"
"""

MEASURED = """
[measurement]
path = "log.csv"

[signals.engine_speed]
kind = "measured"

[compare]
"a.y_speed" = "engine_speed"
"""


@pytest.fixture
def folder(fmus, tmp_path):
    for name in ("lag.fmu", "counter.fmu"):
        (tmp_path / name).symlink_to(fmus / name)
    for path in (tmp_path / "log.csv", tmp_path / "m" / "log.csv"):
        path.parent.mkdir(exist_ok=True)
        path.write_text("time,engine_speed [rpm],gear\n0.0104,60,3\n0.25,90,4\n0.4999,60,4\n")
    (tmp_path / "m" / "measurement.toml").write_text('[[manoeuvre]]\nfile = "log.csv"\n')
    return tmp_path


def write(folder, text=TEXT):
    path = folder / "scenario.toml"
    path.write_text(text)
    return path


def test_a_file_and_the_same_in_python_give_the_same_bits(folder):
    result = Scenario.load(write(folder)).run()
    same = (Master(step=1e-3)
            .add("a", folder / "lag.fmu", parameters={"time_constant": 0.05, "start_angle": np.pi / 18})
            .add("b", folder / "counter.fmu", step=5e-3)
            .signal("ramp", Ramp(before=0, after=90, time=0.1, duration=0.1, unit="deg"))
            .connect("ramp", "a.u").connect(3, "a.gear").connect("a.y", "b.u")
            .record("ramp", "a.*", "b.seen", step=5e-3).run(stop=0.5))
    assert result.names == ["ramp", "a.u", "a.gear", "a.y", "a.y_speed", "a.gear_out", "b.seen"]
    assert result.names == same.names
    assert all((result[name] == same[name]).all() for name in result.names)
    assert result.units["ramp"] == "deg"
    assert result["a.u"][-1] == pytest.approx(np.pi / 2)


def test_provenance_tells_what_ran(folder):
    path = write(folder)
    provenance = Scenario.load(path, {"a.time_constant": "20 ms"}).run().provenance
    assert provenance["participants"]["a"]["parameters"]["time_constant"] == 0.02
    assert provenance["set"] == {"a.time_constant": "20 ms"}
    assert len(provenance["participants"]["a"]["guid"]) > 30
    assert provenance["participants"]["b"]["step"] == 0.005
    path.write_text(path.read_text() + "# a remark\n")
    assert Scenario.load(path).run().provenance["scenario_sha256"] != provenance["scenario_sha256"]
    assert str(folder) not in json.dumps(provenance)  # a result file may be passed on


def test_an_input_can_be_held_from_outside(folder):
    result = Scenario.load(write(folder), {"a.gear": "5", "a.u": "180 deg"}).run()
    assert set(result["a.gear_out"][1:]) == {5.0}
    assert result["a.u"].tolist() == [np.pi] * result.time.size


def test_a_measurement_drives_and_is_compared_on_its_own_clock(folder):
    text = TEXT.replace('stop = "0.5 s"\n', "").replace('"a.gear" = 3', '"a.gear" = "gear"')
    text = text.replace('start_angle = "10 deg"', "start_angle = 0.0") + MEASURED.replace(
        "[compare]", '[signals.gear]\nkind = "measured"\n[compare]')
    scenario = Scenario.load(write(folder, text))
    assert (scenario.start, scenario.stop) == (0.011, 0.499)
    result = scenario.run()
    assert (result.time[0], result.time[-1]) == (0.011, 0.499)
    assert result["a.gear"].tolist() == np.where(result.time < 0.25, 3.0, 4.0).tolist()
    assert result["a.gear"][0] == 3.0
    row, = scenario.compare(result)
    assert row.samples == 1  # the first and the last lie outside the whole steps
    assert row.measured == pytest.approx([3 * np.pi])


def test_a_switch_made_of_a_measured_channel(folder):
    text = TEXT + MEASURED.replace('kind = "measured"', 'kind = "measured"\nabove = "75 rpm"').replace(
        "[compare]", "").replace('"a.y_speed" = "engine_speed"', "")
    text = text.replace('"ramp", "a.*"', '"engine_speed", "a.*"')
    result = Scenario.load(write(folder, text)).run()
    assert result["engine_speed"].tolist() == ((result.time >= 0.25) & (result.time < 0.4999)).tolist()


@pytest.mark.parametrize(("missing", "on"), [(1.0, 0.0), (3.0, 1.0), ('"4"', 1.0)])
def test_a_switch_made_of_a_channel_that_is_missing(folder, missing, on):
    text = TEXT.replace("[connections]", "[signals.lockup]\nkind = 'measured'\nchannel = 'brake_torque'\nabove = 2.5\n"
                        f"missing = {missing}\n[measurement]\npath = 'log.csv'\n[connections]")
    assert set(Scenario.load(write(folder, text.replace('"ramp", "a.*"', '"lockup", "a.*"'))).run()["lockup"]) == {on}


def test_a_column_of_a_file_has_the_clock_its_header_says(folder):
    (folder / "torque.csv").write_text("t [ms],x [deg]\n0,0\n100,10\n400,10\n")
    text = TEXT.replace("[connections]", "[signals.x]\nkind = 'csv'\nfile = 'torque.csv'\ncolumn = 'x'\ntime = 't'\n"
                        "[connections]").replace('record = ["ramp"', 'record = ["x"')
    result = Scenario.load(write(folder, text)).run()
    assert result["x"] == pytest.approx(np.minimum(100.0 * result.time, 10.0))
    (folder / "torque.csv").write_text("t [m],x [deg]\n0,0\n100,10\n")
    with pytest.raises(InputError, match=r"signals.x: 'm' cannot be converted to 's'"):
        Scenario.load(write(folder, text)).master()


@pytest.mark.parametrize(("old", "new", "words"), [
    ('"a.y_speed" =', '"a.y_sped" =', "no signal 'a.y_sped'; did you mean 'a.y_speed'"),
    ('= "engine_speed"', '= "engine_sped"', "no channel 'engine_sped'; did you mean 'engine_speed'"),
    ('= "engine_speed"', '= "gear"', "'a.y_speed' is compared with 'gear', but 'rad/s' cannot be converted to '1'"),
])
def test_what_cannot_be_compared_is_said_before_the_run(folder, old, new, words):
    assert old in MEASURED
    with pytest.raises(InputError, match=rf"scenario.toml, line \d+: compare: .*{words}"):
        Scenario.load(write(folder, TEXT + MEASURED.replace(old, new))).master()


CANONICAL_LOG = "time [ms],engine_torque [N.m],gear,vehicle_speed [km/h],turbine_speed [rpm]\n" + "".join(
    f"{100 * k},{50 + k},5,72,{1500 + k}\n" for k in range(6))


def test_a_description_of_columns_is_for_files_that_do_not_say_it_themselves(tmp_path):
    """The shipped one describes a log; a file with canonical names is taken by those, also for some channels only."""
    log = tmp_path / "log.csv"
    for text in (CANONICAL_LOG, CANONICAL_LOG.replace("turbine_speed [rpm]", "turbine_speed_rpm")):
        log.write_text(text)
        scenario = Scenario.load("road_log", measurement=log, twins=True)
        manoeuvre = scenario.manoeuvre
        assert set(manoeuvre.channels) == {"engine_torque", "gear", "vehicle_speed", "turbine_speed"}
        assert (manoeuvre.start, manoeuvre.stop, manoeuvre.kind) == (0.0, 0.5, "drive")
        assert manoeuvre["turbine_speed"].values[0] == pytest.approx(50 * np.pi)
        result = scenario.run()
        assert set(result["brake_torque"]) == {0.0}
        assert len(scenario.compare(result)) == 2
    log.write_text("time_s,engine_torque_nm,gear,vehicle_speed_mph,turbine_speed\n0,1,5,30,1500\n1,1,5,30,1500\n")
    assert set(Scenario.load("road_log", measurement=log).manoeuvre.channels) == {
        "engine_torque", "gear", "vehicle_speed", "turbine_speed"}
    log.write_text("time_s,engine_torque_nm,gear,vehicle_speed_mph\n0,1,5,30\n1,1,5,30\n")
    with pytest.raises(InputError, match="there is no column 'brake_pressure_kpa'"):
        Scenario.load("road_log", measurement=log)


def test_a_line_is_found_beside_texts_that_look_like_keys(folder):
    text = TEXT.replace('title = "Lag and counter"', 'title = """\n"quoted = 1\nstep = 2\n[fmu.a.parameters]\n"""')
    with pytest.raises(InputError, match=r"line 15: fmu.a.parameters.time_constant: .*'kg'"):
        Scenario.load(write(folder, text.replace('"50 ms"', '"50 kg"'))).master()
    marks = TEXT.replace('title = "Lag and counter"', '# once """ here\ntitle = "\'\'\'"') + '\n# and """ here\n'
    with pytest.raises(InputError, match=r"line 12: fmu.a.parameters.time_constant: .*'kg'"):
        Scenario.load(write(folder, marks.replace('"50 ms"', '"50 kg"'))).master()


def test_a_mark_at_the_beginning_of_the_file_is_no_obstacle(folder):
    path = write(folder)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert Scenario.load(path).title == "Lag and counter"


@pytest.mark.parametrize(("gear", "own", "takes"), [
    ("", "", 4), ("gear = 7\n", "", 7), ("gear = 7\n", "gear = 2\n", 2)])
def test_parameters_of_a_vehicle_are_those_of_the_gear_that_was_measured_in_unless_another_is_said(
        folder, gear, own, takes):
    (folder / "m" / "measurement.toml").write_text('[[manoeuvre]]\nfile = "log.csv"\ngear = 4\n')
    vehicle = 'vehicle = "pickup_10r80"\n'
    table = f"stop = 0.5\n{vehicle}{gear}[fmu.p]\ntwin = 'plant_rom_3dof'\n{own}[measurement]\npath = 'm'\n"
    plain = f"stop = 0.5\n{vehicle}gear = {takes}\n[fmu.p]\ntwin = 'plant_rom_3dof'\n"
    found, expected = (Scenario.load(write(folder, text)).run().provenance["participants"]["p"]["parameters"]
                       for text in (table, plain))
    assert found == expected


def test_words_and_switches_can_be_set_from_outside(foreign_fmus, tmp_path):
    text = f'stop = 0.2\nstep = 0.1\n[fmu.f]\nfile = "{foreign_fmus / "worded.fmu"}"\n'
    for on in ("true", True):
        result = Scenario.load(write(tmp_path, text), {"f.on": on, "f.words": "hello"}).run()
        assert result["f.shown"].tolist() == [0.0, 5.0, 5.0]


def test_a_parameter_can_be_what_was_measured_at_the_start(folder):
    """Between two samples too, and in the parameter's own unit."""
    (folder / "log.csv").write_text("time,road_grade [deg]\n0,0\n0.1,4\n0.5,12\n")
    start = TEXT.replace('stop = "0.5 s"', 'stop = "0.5 s"\nstart = 0.2') + "[measurement]\npath = 'log.csv'\n"
    result = Scenario.load(write(folder, start.replace('"10 deg"', '{ measured = "road_grade" }'))).run()
    assert result["a.y"][0] == pytest.approx(np.radians(6.0))


def test_a_parameter_that_was_not_measured_in_such_a_unit_is_named(folder):
    text = TEXT.replace('stop = "0.5 s"', 'stop = "0.5 s"\nstart = 0.25') + MEASURED
    text = text.replace('time_constant = "50 ms"', 'start_angle = { measured = "gear" }').replace(
        'start_angle = "10 deg"', "")
    with pytest.raises(InputError, match=r"start_angle: .*'1' cannot be converted to 'rad'"):
        Scenario.load(write(folder, text)).master()
    with pytest.raises(InputError, match=r"start_angle: the value is {'measured': 5}: a number, text with a unit"):
        Scenario.load(write(folder, text.replace('"gear" }', "5 }"))).master()


@pytest.mark.parametrize(("old", "new", "words"), [
    ('stop = "0.5 s"', "", "stop is missing"),
    ('stop = "0.5 s"', 'stop = "0.5 m"', r"line 2: stop: stop is '0.5 m': 'm' cannot be converted"),
    ('step = "1 ms"', "step = 0", r"line 3: step: .*positive"),
    ('stop = "0.5 s"', "stop = true", r"line 2: stop: stop is True: a number is needed, in s"),
    ('stop = "0.5 s"', 'stop = "0.5 s"\nstart = false', r"line 3: start: start is False: a number is needed, in s"),
    ('step = "1 ms"', "step = true", r"line 3: step: step is True: a number"),
    ('record_step = "5 ms"', "record_step = true", r"line 5: record_step: record_step is True: a number"),
    ("step = 0.005", "step = true", r"line 14: fmu.b: step of b is True: a number"),
    ('"50 ms"', "true", r"line 11: fmu.a.parameters.time_constant: 'a.time_constant' is True: a number"),
    ('step = "1 ms"', 'setp = "1 ms"', r"line 3: setp: a scenario has no such key; did you mean .*'step'"),
    ('step = "1 ms"', 'order = "jakobi"', r"line 3: order: .*did you mean 'jacobi'"),
    ("[fmu.a]", "[fmus.a]", r"fmus: a scenario has no such key; did you mean 'fmu'"),
    ('file = "lag.fmu"', 'file = "leg.fmu"', r"line 7: fmu.a: there is no FMU leg.fmu"),
    *(('file = "lag.fmu"', f'file = "{name}"', rf"line 7: fmu.a: there is no FMU '{name}': the path of .*{hint}")
      for name, hint in (("", "known: dskse, "), (".", "known: dskse, "), ("plant_fim", "did you mean 'plant_fom'"))),
    ('file = "lag.fmu"', 'flie = "lag.fmu"', r"line 8: fmu.a.flie: .*did you mean 'file'"),
    ('file = "lag.fmu"', 'file = "lag.fmu"\ntwin = "plant_fom"', r"fmu.a: either file"),
    ('file = "lag.fmu"', 'twin = "plant_fim"', r"fmu.a: .*no model 'plant_fim'; did you mean 'plant_fom'"),
    ('file = "lag.fmu"', 'file = "lag.fmu"\nvehicle = "pickup_10r80"', r"fmu.a: there is no model 'lag'"),
    ("time_constant =", "time_konstant =", r"line 11: fmu.a.parameters.time_konstant: .*'time_constant'"),
    ('"50 ms"', '"-50 ms"', r"line 11: fmu.a.parameters.time_constant: .*at least 1e-06"),
    ('"50 ms"', '"50 kg"', r"line 11: .*'kg' cannot be converted to 's'"),
    ('"50 ms"', "{ measured = 'gear' }", r"line 11: .*with a \[measurement\]"),
    *(("[connections]", f'[compare]\n"a.y" = {channel}\n[connections]',
       r"line 27: compare.a.y: it is .*: the name of a channel") for channel in ("5", '["gear"]', "{ a = 1 }")),
    ("step = 0.005", 'step = "fast"', r"fmu.b: step of b is 'fast': a number"),
    ('kind = "ramp"', 'kind = "ram"', r"line 18: signals.ramp: kind is 'ram'; did you mean 'ramp'"),
    ('kind = "ramp"', 'kind = "csv"\nfile = 5', r"line 20: signals.ramp.(file|before): "),
    ("after = 90", 'after = "high"', r"signals.ramp: after is 'high': a number"),
    ("[signals.ramp]", "[signals.time]", r"line 18: signals.time: a signal cannot be called 'time'"),
    ('record = ["ramp", "a.*", "b.seen"]', "record = [1]", r"line 4: record: what to record is 1"),
    ("after = 90", "", r"signals.ramp: .*also needs after"),
    ('unit = "deg"', 'unit = "grd"', r"signals.ramp: unknown unit 'grd'"),
    ('unit = "deg"', 'unit = "kg"', r"line 27: connections.a.u: .*'kg' cannot be converted"),
    ('"a.u" = "ramp"', '"a.v" = "ramp"', r"line 27: connections.a.v: 'a.v': a has no variable 'v'"),
    ('"a.u" = "ramp"', '"a.u" = "rampe"', r"line 27: connections.a.u: .*did you mean 'ramp'"),
    ('"a.u" = "ramp"', '"a.u" = [1]', r"line 27: connections.a.u: the source is \[1\]"),
    ('"a.gear" = 3', '"a.gear" = 7', r"a.gear is 7: at most 6"),
    ('"b.seen"]', '"b.sen"]', r"nothing to record is called 'b.sen'; did you mean 'b.seen'"),
    ('title = "Lag', 'title = Lag', r"scenario.toml: this is not TOML: Invalid value .*line 1"),
    ("[connections]", '[compare]\n"a.y" = "gear"\n[connections]', r"compare: there is no measurement"),
    ("[connections]", '[measurement]\nkey = 1\n[connections]', r"needs a measurement"),
    ("[connections]", '[measurement]\npath = "log.csv"\nnmae = "a"\n[connections]',
     r"line 28: measurement.nmae: a measurement has no such key; did you mean 'name'"),
    ("[connections]", '[measurement]\npath = "log.csv"\nstop = 3\n[connections]', r"measurement.stop: .*no such key"),
    ("[connections]", '[measurement]\npath = "log.csv"\nmanoeuvre = {}\n[connections]', r"manoeuvre: .*a list is"),
    ("[connections]", '[measurement]\npath = "m"\n[measurement.channels.gear]\ncolumn = "g"\n[connections]',
     r"line 26: measurement.channels: what is in .*m is said by its measurement.toml"),
    ("[connections]", '[measurement]\npath = "gone"\n[connections]',
     r"line 27: measurement.path: there is no measurement .*gone$"),
])
def test_what_is_wrong_is_named_with_file_and_key(folder, old, new, words):
    assert old in TEXT
    path = write(folder, TEXT.replace(old, new, 1))
    with pytest.raises(InputError, match=words) as caught:
        scenario = Scenario.load(path)
        scenario.compare(scenario.run())
    assert str(caught.value).count("scenario.toml") == 1
    assert "\n" not in str(caught.value)


def test_one_of_the_projects_fmus_that_is_not_built_is_told_from_an_unknown_one(folder, monkeypatch):
    monkeypatch.setattr("cosim.master.parameters.build_folders", lambda: [folder / "here", folder / "there"])
    path = write(folder, TEXT.replace('file = "lag.fmu"', 'file = "plant_fom"'))
    with pytest.raises(InputError, match="no FMU 'plant_fom' in .*here and .*there: run `driveline build`"):
        Scenario.load(path).master()


@pytest.mark.parametrize(("name", "value", "words"), [
    ("a.tim_constant", "1", "--set a.tim_constant=1: .*did you mean 'time_constant'"),
    ("c.x", "1", "--set c.x=1: .*no participant 'c'"),
    ("a.time_constant", "1 kg", "--set a.time_constant=1 kg: .*cannot be converted"),
    ("a.y", "1", "--set a.y=1: .*causality output"),
])
def test_a_wrong_override_is_named(folder, name, value, words):
    with pytest.raises(InputError, match=words):
        Scenario.load(write(folder), {name: value}).master()


def test_an_unknown_scenario_names_those_that_ship():
    with pytest.raises(InputError, match="there is no scenario 'tip_in_6th'; did you mean 'tip_in_5th'"):
        Scenario.load("tip_in_6th")


@pytest.mark.parametrize("name", [name for name in names() if name != "road_log"])
def test_every_shipped_scenario_runs_on_the_twins(name):
    """Half a second of each: every name, unit and range in them is right."""
    scenario = Scenario.load(name, twins=True)
    result = scenario.master().run(stop=0.5)
    assert result.complete
    assert all(np.isfinite(result[name]).all() for name in result.names)
    assert any(np.ptp(result[name]) > 0.0 for name in result.names if name.endswith("_speed"))
