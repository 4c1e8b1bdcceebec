"""Measurements: every channel on its own clock in SI, repairs said aloud, faults named."""

import gzip
import logging
from pathlib import Path

import numpy as np
import pytest

from cosim.master import Result
from cosim.measured import CANONICAL, compare, load
from cosim.measured.columns import listed
from cosim.measured.measurement import KINDS
from driveline.quantities import InputError

SHARED = Path(__file__).parents[3] / "shared" / "measured"

TOML = """
vehicle = "pickup_10r80"
[[manoeuvre]]
file = "log.csv"
kind = "tip_in"
gear = 5
[channels.time]
column = "t"
unit = "ms"
[channels.engine_speed]
column = "nEng"
unit = "rpm"
[channels.vehicle_speed]
column = "v"
unit = "km/h"
[channels.wheel_speed]
column = ["wl", "wr"]
unit = "rad/s"
[channels.engine_torque]
column = "T"
unit = "N.m"
factor = -1
"""
CSV = """t,nEng,v,wl,wr,T
0,600,,1,3,-5
10,,36,,,
25,1200,NaN,2,4,6
40,,72,,,
"""


def write(folder, toml=TOML, csv=CSV):
    (folder / "measurement.toml").write_text(toml)
    (folder / "log.csv").write_text(csv)
    return folder


def test_channels_are_in_si_on_their_own_clocks(tmp_path):
    measurement = load(write(tmp_path))
    manoeuvre = measurement["log"]
    assert (measurement.vehicle, manoeuvre.kind, manoeuvre.gear) == ("pickup_10r80", "tip_in", 5)
    assert manoeuvre["engine_speed"].time == pytest.approx([0.0, 0.025], abs=1e-15)
    assert manoeuvre["engine_speed"].values == pytest.approx([20 * np.pi, 40 * np.pi])
    assert manoeuvre["vehicle_speed"].time == pytest.approx([0.010, 0.040], abs=1e-15)
    assert manoeuvre["vehicle_speed"].values == pytest.approx([10.0, 20.0])
    assert manoeuvre["wheel_speed"].values == pytest.approx([2.0, 3.0])
    assert manoeuvre["engine_torque"].values.tolist() == [5.0, -6.0]
    assert (manoeuvre.start, manoeuvre.stop) == (0.010, 0.025)
    assert {c.unit for c in manoeuvre.channels.values()} == {"rad/s", "m/s", "N.m"}


def test_parts_of_one_log_have_names_of_their_own_and_all_else_as_it_is(tmp_path):
    """One of them was driven the other way, the other was not."""
    part = '[[manoeuvre]]\nfile = "log.csv"\nkind = "ramp"\ngear = 5\nstart = "0 s"\nstop = "20 ms"\n'
    toml = TOML.replace("[[manoeuvre]]", f'{part}back = true\n[[manoeuvre]]\nstart = "20 ms"')
    back, there = load(write(tmp_path, toml)).manoeuvres
    assert (there.name, there.kind, there.back, there.provenance["file"]) == ("log_2", "tip_in", False, "log.csv")
    assert (back.name, back.kind, back.back, back.provenance["file"]) == ("log_1", "ramp", True, "log.csv")
    assert all(isinstance(notice, str) for m in (there, back) for notice in m.notices)


def test_who_was_given_a_name_keeps_it_and_who_has_it_of_the_file_gets_another(tmp_path, caplog):
    """Also where that comes later, and nobody else is called otherwise."""
    named = '[[manoeuvre]]\nfile = "{}.csv"\nkind = "ramp"\nname = "{}"\n'
    toml = TOML.replace("[[manoeuvre]]", named.format("a", "log") + named.format("b", "b") + "[[manoeuvre]]")
    for number, name in enumerate("ab"):
        (tmp_path / f"{name}.csv").write_text(CSV.replace("1200", str(number)))
    with caplog.at_level(logging.INFO, "cosim"):
        read = load(write(tmp_path, toml)).manoeuvres
    assert [(m.name, m.provenance["file"]) for m in read] == [("log", "a.csv"), ("b", "b.csv"), ("log_3", "log.csv")]
    assert "more than one manoeuvre 'log': that of log.csv, number 3, is called 'log_3'" in caplog.text
    read = load(write(tmp_path, toml.replace('"b"', '"log"'))).manoeuvres
    assert [m.name for m in read] == ["log_1", "log_2", "log_3"]
    read = load(write(tmp_path, toml.replace('"b"', '"log_3"'))).manoeuvres
    assert [m.name for m in read] == ["log", "log_3", "log_3_"]


@pytest.mark.parametrize("file", ["log.csv", "copy.csv"])
@pytest.mark.parametrize("stop, shared", [("", "0.04"), ('stop = "12 ms"\n', "0.01")])
def test_the_same_data_are_no_second_recording(tmp_path, file, stop, shared):
    """They would count as a repeat, and a fit be judged by what was fitted."""
    again = f'[[manoeuvre]]\nfile = "{file}"\nkind = "tip_in"\ngear = 5\n{stop}'
    folder = write(tmp_path, TOML.replace("[[manoeuvre]]", f"{again}[[manoeuvre]]"))
    (folder / "copy.csv").write_text(CSV)
    with pytest.raises(InputError, match=rf"{shared} s of '{file}'.* in two manoeuvres.*leave one out"):
        load(folder)
    (folder / "copy.csv").write_text(CSV.replace("1200", "1201"))
    if file == "copy.csv":
        assert len(load(folder).manoeuvres) == 2


def test_one_file_with_canonical_names_needs_no_description(tmp_path):
    path = tmp_path / "bench.csv.gz"
    path.write_bytes(gzip.compress(b"time [ms],motor_speed [rpm],force\n0,60,1\n500,120,2\n"))
    manoeuvre = load(path).manoeuvres[0]
    assert manoeuvre.name == "bench"
    assert manoeuvre["motor_speed"].time.tolist() == [0.0, 0.5]
    assert manoeuvre["motor_speed"].values == pytest.approx([2 * np.pi, 4 * np.pi])
    assert manoeuvre["force"].values.tolist() == [1.0, 2.0]


def test_semicolons_and_decimal_commas(tmp_path):
    (tmp_path / "a.csv").write_text("time;force\n0,0;1,5\n0,1;2,5\n")
    assert load(tmp_path / "a.csv").manoeuvres[0]["force"].values.tolist() == [1.5, 2.5]


@pytest.mark.parametrize(("time", "speed"), [("0,01", "1.200"), ("0.01", "1,200")])
def test_points_and_commas_in_one_file_are_refused(tmp_path, time, speed):
    """One of them parts thousands: a speed of 1200 rpm was read as 1.2."""
    (tmp_path / "a.csv").write_text(f"time;engine_speed [rpm];other\n0;900;1.5\n{time};{speed};2,5\n")
    with pytest.raises(InputError, match="a.csv: column '(time|engine_speed)' has decimal commas and column "
                                         "'(time|engine_speed)' decimal points"):
        load(tmp_path / "a.csv")
    for one in (time, speed):  # of columns that nobody asks for nothing is said
        (tmp_path / "a.csv").write_text(f"time;force;other\n0;900;1.5\n{one};{one};2,5\n")
        assert load(tmp_path / "a.csv").manoeuvres[0]["force"].values[1] == float(one.replace(",", "."))


@pytest.mark.parametrize("row", ["ms,1/min,N,-", "[ms],(1/min),[N],[-]", " ms, 1/min ,,", "ms,1/min,N,1"])
def test_units_may_stand_in_a_row_of_their_own(tmp_path, row):
    (tmp_path / "a.csv").write_text(f"time,motor_speed,force [kN],state\n{row}\n500,60,1,on\n1000,120,2,off\n")
    manoeuvre = load(tmp_path / "a.csv").manoeuvres[0]
    assert manoeuvre["motor_speed"].time == pytest.approx([0.5, 1.0])
    assert manoeuvre["motor_speed"].values == pytest.approx([2 * np.pi, 4 * np.pi])
    assert manoeuvre["force"].values == pytest.approx([1000.0, 2000.0])  # what stands beside the name counts


@pytest.mark.parametrize(("name", "unit", "factor"), [
    *(("engine_speed", unit, np.pi / 30) for unit in ("1/min", "min-1", "min^-1", "U/min", "rpm")),
    ("seat_acceleration", "g", 9.80665), ("seat_acceleration", "m/s²", 1.0)])
def test_a_unit_means_what_it_does_on_such_an_instrument(tmp_path, name, unit, factor):
    (tmp_path / "a.csv").write_text(f"time,{name} [{unit}]\n0,1\n1,2\n")
    assert load(tmp_path / "a.csv").manoeuvres[0][name].values == pytest.approx([factor, 2.0 * factor])


def test_a_slope_in_per_cent_is_what_the_road_rises_over_what_it_runs(tmp_path):
    (tmp_path / "a.csv").write_text("time,road_grade [%]\n0,100\n1,-5\n2,0\n")
    assert load(tmp_path / "a.csv").manoeuvres[0]["road_grade"].values == pytest.approx(
        [np.pi / 4, -np.arctan(0.05), 0.0])
    downhill = {"channels": {"road_grade": {"factor": -1}}}
    assert load(tmp_path / "a.csv", downhill).manoeuvres[0]["road_grade"].values[0] == pytest.approx(-np.pi / 4)


@pytest.mark.parametrize(("name", "unit"), [("engine_speed", "1/s"), ("engine_speed", "Hz"), ("force", "1/min"),
                                            ("force", "g"), ("force", "%"), ("road_grade", "1")])
def test_a_unit_that_may_mean_something_else_is_refused(tmp_path, name, unit):
    (tmp_path / "a.csv").write_text(f"time,{name} [{unit}]\n0,60\n1,120\n")
    with pytest.raises(InputError, match="cannot be converted"):
        load(tmp_path / "a.csv")


@pytest.mark.parametrize("row", ["na,,-", "nan,NaN,NA"])
def test_a_row_of_nothing_has_no_units(tmp_path, row):
    (tmp_path / "a.csv").write_text(f"time [ms],force,position\n{row}\n0,1,2\n500,3,4\n")
    assert load(tmp_path / "a.csv").manoeuvres[0]["force"].time.tolist() == [0.0, 0.5]


def test_a_row_of_ones_is_a_sample(tmp_path):
    (tmp_path / "a.csv").write_text("time,force,state\n1,1,\n2,3,on\n")
    assert load(tmp_path / "a.csv").manoeuvres[0]["force"].time.tolist() == [1.0, 2.0]


def test_lines_are_counted_as_an_editor_does_also_below_units(tmp_path):
    (tmp_path / "a.csv").write_text("time,force\ns,N\n0,1\n1,two\n")
    with pytest.raises(InputError, match="line 4, column 'force': 'two' is not a number"):
        load(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("time,force\ns,N\n")
    with pytest.raises(InputError, match="has a header but no rows"):
        load(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("time,force\ns,parsec\n0,1\n")
    with pytest.raises(InputError, match="force is measured in N"):
        load(tmp_path / "a.csv")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_letters_beyond_ascii_as_programs_on_windows_write_them(tmp_path, encoding):
    (tmp_path / "a.csv").write_bytes("time [s];force [N];Öltemperatur [°C]\n0;1,5;80\n".encode(encoding))
    assert load(tmp_path / "a.csv").manoeuvres[0]["force"].values.tolist() == [1.5]


@pytest.mark.parametrize("above", ["", "\n", "\r\n \r\n", "sep=;\n", '"SEP=;"\r\n\n', "\nsep=;\n"])
def test_what_spreadsheets_put_above_the_names_is_skipped(tmp_path, above):
    (tmp_path / "a.csv").write_text(above + "time;force\n0,5;1,5\n", newline="")
    assert load(tmp_path / "a.csv").manoeuvres[0]["force"].values.tolist() == [1.5]
    (tmp_path / "a.csv").write_text(above + "time;force\n0;x\n", newline="")
    with pytest.raises(InputError, match=f"line {above.count(chr(10)) + 2}, column 'force': 'x'"):
        load(tmp_path / "a.csv")


def test_a_separator_that_is_told_counts(tmp_path):
    (tmp_path / "a.csv").write_text("sep=|\ntime|force, or so|force\n0|1|2\n")
    assert load(tmp_path / "a.csv").manoeuvres[0]["force"].values.tolist() == [2.0]


def test_a_description_may_begin_with_a_byte_order_mark(tmp_path):
    write(tmp_path)
    (tmp_path / "measurement.toml").write_text(TOML, encoding="utf-8-sig")
    assert load(tmp_path).vehicle == "pickup_10r80"


def test_gaps_are_found(tmp_path):
    times = np.concatenate([np.arange(100), np.arange(150, 200)]) * 0.01
    (tmp_path / "a.csv").write_text("time,force\n" + "".join(f"{t:.2f},1\n" for t in times))
    assert load(tmp_path / "a.csv").manoeuvres[0]["force"].gaps() == [(0.99, 1.5)]


def test_a_discrete_channel_is_held_and_a_continuous_one_interpolated(tmp_path):
    (tmp_path / "a.csv").write_text("time,gear,force\n0,3,0\n1,4,10\n")
    manoeuvre = load(tmp_path / "a.csv").manoeuvres[0]
    assert float(manoeuvre["gear"].at(0.9)) == 3.0
    assert float(manoeuvre["force"].at(0.9)) == pytest.approx(9.0)


def test_small_faults_of_the_clock_are_repaired_and_said(tmp_path, caplog):
    caplog.set_level(logging.WARNING, "cosim")
    rows = "0,1,1,1,1,1\n20,3,3,3,3,3\n10,2,2,2,2,2\n20,9,9,9,9,9\n,7,7,7,7,7\n"
    manoeuvre = load(write(tmp_path, csv="t,nEng,v,wl,wr,T\n" + rows)).manoeuvres[0]
    assert manoeuvre["vehicle_speed"].values * 3.6 == pytest.approx([1.0, 2.0, 3.0])
    notices = " | ".join(manoeuvre.notices)
    assert "steps back 1 times" in notices
    assert "1 repeated instants" in notices
    assert "1 rows without a time" in notices
    assert "repeated instants" in caplog.text


@pytest.mark.parametrize("distance", [0.001, 0.0031, 0.0033, 0.007])
@pytest.mark.parametrize("read", [np.round, np.floor])
@pytest.mark.parametrize("begin", [1.2342, 1.2402])  # within a step of the clock, or with one
def test_samples_that_share_a_coarse_reading_of_the_clock_are_spread_evenly_about_it(tmp_path, distance, read, begin):
    """Of a torque every 3.3 ms under stamps of 10 ms the first of three was kept, 3 ms late beside slower channels."""
    true = begin + np.arange(0.0, 5.0, distance)
    readings = read(true * 100.0) / 100.0
    rows = "".join(f"{t:.2f},{v:.9f}\n" for t, v in zip(readings, true))
    (tmp_path / "a.csv").write_text("time,force\n" + rows)
    manoeuvre = load(tmp_path / "a.csv").manoeuvres[0]
    late = manoeuvre["force"].time - manoeuvre["force"].values
    assert late.size == true.size and (np.diff(manoeuvre["force"].time) > 0.0).all()
    assert np.mean(late) == pytest.approx(0.0 if read is np.round else -0.005, abs=0.6 * distance)  # of slow ones too
    assert np.abs(late - np.mean(late)).max() < distance
    reading, first, count = np.unique(readings, return_index=True, return_counts=True)
    about = np.add.reduceat(manoeuvre["force"].time, first) / count
    assert about[1:-1] == pytest.approx(reading[1:-1], abs=1e-9)
    spread, doubt = manoeuvre.notices
    assert "spread evenly" in spread and all("read every 0.01 s" in notice for notice in (spread, doubt))


def test_rows_that_are_there_twice_count_once_and_of_a_clock_that_is_uneven_or_stopped_the_first(tmp_path):
    twice = [(t, v) for t in range(40) for v in [t] * (1 + t % 2)]
    uneven = [(t**2, v) for t in range(40) for v in [t, -1][:1 + t % 2]]
    stopped = [(min(t, 39), t) for t in range(60)]
    for rows in (twice, uneven, stopped):
        (tmp_path / "a.csv").write_text("time,force\n" + "".join(f"{t},{v}\n" for t, v in rows))
        manoeuvre = load(tmp_path / "a.csv").manoeuvres[0]
        assert manoeuvre["force"].values.tolist() == list(range(40))
        assert manoeuvre.notices == ("a.csv: column 'force': 20 repeated instants, the first value was kept",)


@pytest.mark.parametrize("zero", [0.0, 180.0])
def test_an_angle_that_starts_again_after_every_turn_is_unwound(tmp_path, caplog, zero):
    time = np.arange(0.0, 6.0, 0.01)
    angle = 500.0 * np.sin(time) + 90.0 * time  # both ways, over several turns
    rows = zip(time, (angle + zero) % 360.0 - zero, angle)
    (tmp_path / "a.csv").write_text("time,motor_position [deg],whole\n" + "".join(
        f"{t:.2f},{a:.6f},{b:.6f}\n" for t, a, b in rows))
    found = load(tmp_path / "a.csv").manoeuvres[0]
    assert np.diff(found["motor_position"].values) == pytest.approx(np.diff(np.radians(angle)), abs=1e-7)
    turns = int(np.sum(np.diff((angle + zero) // 360.0) != 0))
    assert f"the angle starts again after a turn, {turns} times" in caplog.text and found.notices
    # one that goes on is what it is, however far from one sample to the next
    description = {"channels": {"motor_position": {"column": "whole", "unit": "rad"}}}
    whole = load(tmp_path / "a.csv", description).manoeuvres[0]
    assert np.abs(np.diff(angle)).max() > np.pi and not whole.notices
    assert whole["motor_position"].values == pytest.approx(angle, abs=1e-5)
    (tmp_path / "b.csv").write_text("time,motor_position [deg]\n0,0\n1,100\n2,300\n3,400\n")
    little = load(tmp_path / "b.csv").manoeuvres[0]  # more than one turn, from the first to the last
    assert np.degrees(little["motor_position"].values) == pytest.approx([0, 100, 300, 400]) and not little.notices


def test_a_clock_of_its_own_that_ends_before_the_others_loses_nothing(tmp_path):
    """Nine rows "without a time were left out", in which nothing was."""
    rows = "".join(f"{0.01 * i:.2f},{i},{0.1 * i if i < 3 else ''},{2 * i if i < 3 else ''}\n" for i in range(12))
    (tmp_path / "a.csv").write_text("time,force,slow [s],position\n" + rows + "\n")
    own = {"channels": {"force": {}, "position": {"time": "slow"}}}
    found = load(tmp_path / "a.csv", own).manoeuvres[0]
    assert (found["force"].values.size, found["position"].values.size) == (12, 3) and not found.notices
    (tmp_path / "a.csv").write_text("time,force,slow [s],position\n" + rows + "0.2,3,,9\n")
    assert load(tmp_path / "a.csv", own).manoeuvres[0].notices == (
        "a.csv: 1 rows without a time were left out",)


@pytest.mark.parametrize(("name", "unit", "said"), [
    ("wheel_speed", "km/h", 'unit = "rad/s" and a factor of 1 over 3.6 times the rolling radius'),
    ("engine_torque", "%", 'unit = "N.m" and a factor of 0.01 times that in N.m'),
    ("wheel_speed", "N.m", "cannot be converted to 'rad/s'$"),
    ("vehicle_speed", "rpm", "cannot be converted to 'm/s'$")])
def test_what_control_units_tell_in_place_of_a_signal_is_said_how_to_read(tmp_path, name, unit, said):
    (tmp_path / "a.csv").write_text("time,x\n0,50\n1,51\n")
    with pytest.raises(InputError, match=said):
        load(tmp_path / "a.csv", {"channels": {name: {"column": "x", "unit": unit}}})


def test_what_marks_an_invalid_sample_is_no_value_of_it(tmp_path):
    """The largest number of single precision, or one that has none in SI."""
    (tmp_path / "a.csv").write_text("time,force [kN],position\n0,1,1\n1,-3.4028235e38,2\n2,1e307,3\n3,4,4\n")
    found = load(tmp_path / "a.csv").manoeuvres[0]
    assert found["force"].values.tolist() == [1000.0, 4000.0] and found["position"].values.size == 4
    assert found.notices == ("a.csv: column 'force': 1 infinite values were left out",
                             "a.csv: column 'force': 1 values larger than anything measured were left out, up to "
                             "3.4e+41")


def test_late_samples_are_put_in_order_whichever_way_they_are_late(tmp_path):
    """One stamp of a later time, a packet of three that came late, neighbours swapped: one course all the same."""
    order = [*range(20), 40, *range(20, 40), *range(44, 60), *range(41, 44), *range(61, 80), 60]
    (tmp_path / "a.csv").write_text("time,force\n" + "".join(f"{t / 100},{t}\n" for t in order))
    force = load(tmp_path / "a.csv").manoeuvres[0]["force"]
    assert force.values.tolist() == list(range(80))


def test_keys_without_meaning_are_said(tmp_path, caplog):
    caplog.set_level(logging.WARNING, "cosim")
    load(write(tmp_path, TOML.replace("gear = 5", "geer = 5").replace('unit = "ms"', 'units = "ms"')))
    assert "'geer' has no meaning in a manoeuvre and is ignored; did you mean 'gear'?" in caplog.text
    assert "channels.time: 'units' has no meaning in a clock and is ignored; did you mean 'unit'?" in caplog.text


# -- clocks, means, names --------------------------------------------------------------------------------


def test_a_clock_has_a_factor_like_any_channel(tmp_path):
    manoeuvre = load(write(tmp_path, TOML.replace('unit = "ms"', "factor = 0.001"))).manoeuvres[0]
    assert manoeuvre["vehicle_speed"].time == pytest.approx([0.010, 0.040], abs=1e-15)


@pytest.mark.parametrize(("delay", "seconds"), [("0.6", 0.6), ('"-250 ms"', -0.25)])
def test_a_channel_that_is_late_is_put_where_it_was(tmp_path, delay, seconds):
    manoeuvre = load(write(tmp_path, TOML.replace('column = "v"\n', f'column = "v"\ndelay = {delay}\n'))).manoeuvres[0]
    assert manoeuvre["vehicle_speed"].time == pytest.approx([0.010 - seconds, 0.040 - seconds])
    assert manoeuvre["vehicle_speed"].source == f"v [km/h], {seconds:g} s late"
    assert manoeuvre["engine_speed"].time == pytest.approx([0.0, 0.025], abs=1e-15)


@pytest.mark.parametrize(("header", "scale"), [("slow [s]", 1.0), ("slow [min]", 60.0), ("slow", 1e-3)])
def test_a_clock_of_its_own_has_the_unit_its_header_says_or_else_that_of_the_common_one(tmp_path, header, scale):
    toml = TOML.replace('column = "v"\n', 'column = "v"\ntime = "slow"\n')
    manoeuvre = load(write(tmp_path, toml, f"t,nEng,v,wl,wr,T,{header}\n0,1,1,1,1,1,5\n10,1,1,1,1,1,6\n")).manoeuvres[0]
    assert manoeuvre["vehicle_speed"].time == pytest.approx([5.0 * scale, 6.0 * scale])
    assert manoeuvre["engine_speed"].time == pytest.approx([0.0, 0.010])


def test_a_mean_is_of_columns_each_in_its_own_unit(tmp_path):
    toml = TOML.replace('column = ["wl", "wr"]\nunit = "rad/s"', 'column = ["wl", "wr"]')
    csv = CSV.replace("wl,wr", "wl [rpm],wr [rad/s]")
    wheel = load(write(tmp_path, toml, csv)).manoeuvres[0]["wheel_speed"]
    assert wheel.values == pytest.approx([(np.pi / 30 + 3) / 2, (2 * np.pi / 30 + 4) / 2])
    assert wheel.source == "wl [rpm] and wr [rad/s]"
    with pytest.raises(InputError, match="column 'wr' has no unit"):
        load(write(tmp_path, toml, CSV.replace("wl,wr", "wl [rpm],wr")))


def test_only_the_clock_needs_a_name_where_the_columns_have_theirs(tmp_path):
    toml = '[[manoeuvre]]\nfile = "log.csv"\n[channels.time]\ncolumn = "t"\nunit = "ms"\n'
    force = load(write(tmp_path, toml, "t,force,n\n0,1,5\n10,2,6\n")).manoeuvres[0]["force"]
    assert force.time == pytest.approx([0.0, 0.010])
    with pytest.raises(InputError, match="no column bears a canonical name"):
        load(write(tmp_path, toml, "t,n\n0,1\n"))


def test_a_column_that_is_there_twice_is_refused_where_it_is_needed(tmp_path):
    (tmp_path / "a.csv").write_text("time,engine_speed [rpm],force,engine_speed [rad/s],n,n\n0,1,2,3,4,5\n")
    with pytest.raises(InputError, match=r"'engine_speed' \(engine_speed \[rpm\], engine_speed \[rad/s\]\)"):
        load(tmp_path / "a.csv")
    force = load(tmp_path / "a.csv", {"channels": {"force": {}}}).manoeuvres[0]["force"]
    assert force.values.tolist() == [2.0]


def test_a_description_with_one_manoeuvre_in_single_brackets_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text("time,force\n0,1\n")
    with pytest.raises(InputError, match=r"at least one \[\[manoeuvre\]\] is needed, in two brackets"):
        load(tmp_path / "a.csv", {"manoeuvre": {"kind": "drive"}})


@pytest.mark.parametrize("name", ["run[1].csv", "run*.csv", "part[2]/run.csv"])
def test_the_name_of_a_file_is_no_pattern(tmp_path, name):
    (tmp_path / "part[2]").mkdir()
    (tmp_path / "run1.csv").write_text("time,force\n5,99\n")
    (tmp_path / name).write_text("time,force\n0,1\n")
    assert load(tmp_path / name).manoeuvres[0]["force"].values.tolist() == [1.0]


def test_gzip_is_known_by_either_spelling_and_refused_by_name_where_it_is_damaged(tmp_path):
    packed = gzip.compress(b"time,force\n" + b"".join(b"%d,%d\n" % (i, i * i % 97) for i in range(5000)))
    (tmp_path / "A.CSV.GZ").write_bytes(packed)
    manoeuvre = load(tmp_path / "A.CSV.GZ").manoeuvres[0]
    assert (manoeuvre.name, manoeuvre["force"].values.size) == ("A", 5000)
    middle = len(packed) // 2
    for damaged in (packed[:middle], packed[:-4], packed[:middle] + b"\xff\x00\xff" + packed[middle + 3:]):
        (tmp_path / "b.csv.gz").write_bytes(damaged)
        with pytest.raises(InputError, match=r"b.csv.gz is not a readable CSV file"):
            load(tmp_path / "b.csv.gz")


# -- what is wrong ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("toml", "csv", "words"), [
    (TOML.replace('"nEng"', '"nEgn"'), CSV, r"log.csv: there is no column 'nEgn'; did you mean 'nEng'"),
    (TOML.replace('"nEng"', '"engine"'), CSV, r"no column 'engine'.*known: T, nEng"),
    (TOML.replace('"rpm"', '"rpn"'), CSV, r"channels.engine_speed: .*unknown unit 'rpn'"),
    (TOML.replace('"rpm"', '"N.m"'), CSV, r"engine_speed is measured in rad/s: 'N.m' cannot be converted"),
    (TOML.replace('unit = "rpm"', ""), CSV, r"column 'nEng' has no unit"),
    (TOML.replace('unit = "ms"', 'unit = "m"'), CSV, r"clock 't': time is measured in s: 'm' cannot be converted"),
    (TOML.replace('unit = "ms"', "unit = 1"), CSV, r"clock 't': time is measured in s: '1' cannot be converted"),
    (TOML.replace('unit = "ms"', 'factor = "ms"'), CSV, r"clock 't'.factor is 'ms': a number is needed"),
    (TOML.replace('column = "v"', 'column = "v"\ndelay = "late"'), CSV, r"channels.vehicle_speed.delay is 'late'"),
    (TOML.replace('column = "v"', 'column = "v"\ndelay = "3 m"'), CSV, r"channels.vehicle_speed.delay"),
    *((TOML.replace("factor = -1", f"factor = {factor}"), CSV, f"channels.engine_torque.factor is {shown}: a .*number")
      for factor, shown in (("true", "True"), ("nan", "nan"), ("-inf", "-inf"), ("0", "0"), ("0.0", "0"))),
    *((TOML.replace('unit = "ms"', f'unit = "ms"\nfactor = {factor}'), CSV, f"clock 't'.factor is {shown}: a .*number")
      for factor, shown in (("true", "True"), ("nan", "nan"), ("0", "0"))),
    *((TOML.replace('column = "v"', f'column = "v"\ndelay = {value}'), CSV, f"vehicle_speed.delay is {shown}: a")
      for value, shown in (("true", "True"), ("nan", "nan"), ("inf", "inf"))),
    *((TOML.replace("gear = 5", f"{key} = {value}"), CSV, f"log.csv: {key} is {shown}: a")
      for key in ("start", "stop") for value, shown in (("true", "True"), ("nan", "nan"))),
    (TOML, CSV.replace("1,3,-5", "1,,-5").replace("2,4,6", ",4,6"),
     "channels.wheel_speed: columns 'wl' and 'wr' of log.csv are never sampled together.*: name one"),
    (TOML.replace('"wr"]', '"wr", "v"]'), CSV, "columns 'wl' and 'wr' and 'v' of log.csv are never sampled together"),
    (TOML, CSV.replace("1,3,-5", "1,,-5").replace("2,4,6", "2,,6"), "column 'wl and wr' holds no values"),
    (TOML.replace("channels.engine_speed", "channels.engine_sped"), CSV, r"did you mean 'engine_speed'"),
    (TOML.replace('"pickup_10r80"', "3"), CSV, r"measurement.toml: vehicle is 3: text is needed"),
    ('variant = ["modified"]\n' + TOML, CSV, r"measurement.toml: variant is \['modified'\]: text is needed"),
    (TOML.replace('"tip_in"', "0"), CSV, r"log.csv: kind is 0: text is needed"),
    (TOML, "# logger 3\n" + CSV, r"log.csv, line 2: 6 fields, but line 1, which has to name the columns, has 1"),
    (TOML, "\n" + CSV.replace("36,,,", "36,,,,,,"), r"log.csv, line 4: 9 fields, but line 2, which .*, has 6"),
    (TOML.replace("tip_in", "tipin"), CSV, r"kind is 'tipin'; did you mean 'tip_in'"),
    (TOML.replace("gear = 5", "gear = 5.5"), CSV, r"gear is 5.5: a whole number"),
    (TOML.replace("gear = 5", 'back = "yes"'), CSV, r"back is 'yes': true is needed"),
    (TOML.replace('file = "log.csv"', 'file = "gone.csv"'), CSV, r"there is no data file .*gone.csv"),
    (TOML.replace('file = "log.csv"', 'file = "measurement.toml"'), CSV, r"unknown kind of data file"),
    (TOML.replace('file = "log.csv"', ""), CSV, r"needs file"),
    (TOML.replace("[[manoeuvre]]", "[manoeuvre]"), CSV, r"at least one \[\[manoeuvre\]\] is needed, in two brackets"),
    (TOML.replace('column = "t"', "column = 3"), CSV, r"time is 3: the name of a column"),
    (TOML + "x = = 1\n", CSV, r"measurement.toml: .*line"),
    (TOML, CSV.replace("1200", "fast"), r"log.csv, line 4, column 'nEng': 'fast' is not a number"),
    (TOML, "", r"log.csv is empty"),
    (TOML, "t,nEng,v,wl,wr,T\n", r"no rows"),
    (TOML, "t,nEng,v,wl,wr,T\n0,,1,1,1,1\n", r"column 'nEng' holds no values"),
    (TOML, "t,nEng,v,wl,wr,T\n0,1,1,1,1,1\n9000,1,1,1,1,1\n0,1,1,1,1,1\n",
     r"jumps back by 9 s at data row 3"),
    (TOML, "t,nEng,v,wl,wr,T\n" + "".join(f"{t},{n},1,1,1,1\n" for n in (1000, 2000) for t in range(n % 7, 400, 10)),
     r"jumps back by 0.391 s at data row 41: two recordings in one file"),
    *((TOML, "t,nEng,v,wl,wr,T\n" + "".join(f"{t if t != 200 else wrong},1,1,1,1,1\n" for t in range(0, 400, 10)),
       rf"'nEng' is {wrong / 1000:g} s at data row 21, and in order before and after it: leave that row out")
      for wrong in (9000, -9000)),
    (TOML, "t,nEng,v,wl,wr,T\n0,1,1,1,1,1\n10,1,1,1,1,1\n1.7e12,1,1,1,1,1\n",
     r"column 'nEng' jumps on by 1.7e\+09 s at data row 3: was its clock set there, or is it not in the unit"),
    (TOML, "t,nEng,v,wl,wr,T\n" + "500,1,1,1,1,1\n" * 9, r"column 'nEng' reads 0.5 s in all its rows: is it the right"),
    (TOML, 't,nEng,v,wl,wr,T\n0,1,1,1,1,"1\n' + "10,1,1,1,1,1\n" * 20000, r"log.csv is not a readable CSV file"),
    (TOML, CSV.replace("t,nEng,v,", "t,nEng,nEng,"), r"log.csv: 2 columns are called 'nEng' \(nEng, nEng\): leave"),
])
def test_what_is_wrong_is_named(tmp_path, toml, csv, words):
    with pytest.raises(InputError, match=words) as caught:
        load(write(tmp_path, toml, csv))
    assert "\n" not in str(caught.value)


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(InputError, match=r"has no measurement.toml"):
        load(tmp_path)
    with pytest.raises(InputError, match="there is no measurement"):
        load(tmp_path / "gone")
    (tmp_path / "odd.csv").write_text("time,speed\n0,1\n")
    with pytest.raises(InputError, match="no column bears a canonical name.*there are time, speed"):
        load(tmp_path / "odd.csv")
    for contents in (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", b"time,\x81\n0,1\n"):
        (tmp_path / "bad.csv").write_bytes(contents)
        with pytest.raises(InputError, match="not a readable CSV"):
            load(tmp_path / "bad.csv")
    (tmp_path / "bad.csv.gz").write_text("no gzip")
    with pytest.raises(InputError, match="not a readable CSV"):
        load(tmp_path / "bad.csv.gz")


def test_a_clock_without_values_is_named_as_the_clock(tmp_path):
    (tmp_path / "a.csv").write_text("time,force\n,1\n,2\n")
    with pytest.raises(InputError, match="a.csv: the time of column 'force' holds no values$"):
        load(tmp_path / "a.csv")
    for rows in (",\n1,\n", ",3\n1,\n"):
        (tmp_path / "a.csv").write_text("time,force\n" + rows)
        with pytest.raises(InputError, match="a.csv: column 'force' holds no values$"):
            load(tmp_path / "a.csv")


@pytest.mark.parametrize(("names", "words"), [("", ""), ("a", "a"), ("ab", "a and b"), ("abc", "a, b and c"), (
    "abcdefgh", "a, b, c, d, e, f, g and h"), ("abcdefghi", "a, b, c, d, e, f, g, h, ...")])
def test_names_in_a_sentence(names, words):
    assert listed(list(names)) == words


def test_other_files_have_no_groups(tmp_path):
    write(tmp_path, TOML.replace('column = "nEng"', 'column = "nEng"\ngroup = 0'))
    with pytest.raises(InputError, match="column 'nEng' is not in channel group 0; a file of this kind has no groups"):
        load(tmp_path)


def test_a_result_equal_to_the_measurement_has_no_error_on_any_clock(tmp_path):
    """A straight line is its own interpolation, whatever the instants."""
    random = np.random.default_rng(0)
    clock = np.sort(random.uniform(0.0, 1.2, 40))
    rows = "".join(f"{t!r},{30 * t + 20!r}\n" for t in clock.tolist())
    (tmp_path / "a.csv").write_text("time,vehicle_speed [km/h]\n" + rows)
    manoeuvre = load(tmp_path / "a.csv").manoeuvres[0]
    time = np.arange(101) / 100
    result = Result(time, {"plant.v": (30 * time + 20) * 1000}, {"plant.v": "m/h"})
    same, = compare(result, manoeuvre, {"plant.v": "vehicle_speed"})
    assert same.samples == (clock <= 1.0).sum() < clock.size
    assert same.rms_error == pytest.approx(0.0, abs=1e-12)
    shifted = Result(time, {"plant.v": result["plant.v"] + 3600.0}, result.units)
    other, = compare(shifted, manoeuvre, {"plant.v": "vehicle_speed"})
    assert (other.mean_error, other.rms_error, other.max_error) == pytest.approx((1.0, 1.0, 1.0))
    inside = (30 * clock[clock <= 1.0] + 20) / 3.6
    assert other.nrmse == pytest.approx(1.0 / np.ptp(inside))
    assert other.nrmse_deviation == pytest.approx(1.0 / np.std(inside))


def test_what_cannot_be_compared_is_named(tmp_path):
    (tmp_path / "a.csv").write_text("time,vehicle_speed\n5,1\n6,2\n")
    manoeuvre = load(tmp_path / "a.csv").manoeuvres[0]
    result = Result(np.array([0.0, 1.0]), {"v": np.zeros(2), "w": np.zeros(2)}, {"v": "m/s", "w": "rad/s"})
    for signal, channel, words in (("v", "vehicle_speed", "no common time"),
                                   ("w", "vehicle_speed", "cannot be converted"),
                                   ("v", "engine_speed", "no channel 'engine_speed'"),
                                   ("x", "vehicle_speed", "no signal")):
        with pytest.raises(InputError, match=words):
            compare(result, manoeuvre, {signal: channel})


def test_every_canonical_signal_has_a_unit_that_is_known():
    from cosim import units

    assert all(units.parse(signal.unit) is not None for signal in CANONICAL.values())
    assert len(set(KINDS)) == len(KINDS)


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"the road log is not beside the checkout ({SHARED})")
def test_the_road_log_is_read_as_it_came(tmp_path):
    (tmp_path / "measurement.toml").write_text(
        f'[[manoeuvre]]\nfile = "{SHARED / "tahoe_6l80_drive.csv.gz"}"\nkind = "drive"\n'
        '[channels.time]\ncolumn = "time_s"\n'
        '[channels.vehicle_speed]\ncolumn = "vehicle_speed_mph"\nunit = "mph"\n'
        '[channels.gear]\ncolumn = "gear"\n')
    manoeuvre = load(tmp_path).manoeuvres[0]
    speed, gear = manoeuvre["vehicle_speed"], manoeuvre["gear"]
    assert speed.time.size != gear.time.size
    assert 25 < speed.values.max() < 28
    assert set(gear.values) <= set(range(7))
