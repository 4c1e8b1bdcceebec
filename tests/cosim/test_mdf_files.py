"""MDF files as measured data: groups, clocks, conversions, damage."""

import gc
import importlib.util
import os
import re
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from cosim.measured import load
from driveline.quantities import InputError


@pytest.fixture
def twice(tmp_path):
    """An MDF file with an engine speed in two groups; how many samples each has."""
    asammdf = pytest.importorskip("asammdf")

    def write(*counts, together=False):
        with asammdf.MDF(version="4.10") as file:
            signals = [asammdf.Signal(samples=np.arange(float(count)) + 100.0 * i, timestamps=np.arange(count) * 0.1,
                                      name="engine_speed", unit="rad/s") for i, count in enumerate(counts)]
            for group in [signals] if together else [[signal] for signal in signals]:
                file.append(group)
            file.save(tmp_path / "a.mf4", overwrite=True)
        return tmp_path / "a.mf4"
    return write


def test_a_channel_that_is_in_two_groups_of_an_mdf_file_is_told_by_its_group(twice, capfd, caplog):
    path = twice(5, 3)
    with pytest.raises(InputError) as caught:
        load(path)
    assert str(caught.value) == (
        f"{path}: channel 'engine_speed' is there 2 times, in channel group 0 (5 samples) and 1 (3 samples): say which "
        "by group = N beside its column in measurement.toml")
    assert not caplog.records and capfd.readouterr() == ("", "")
    for group, values in ((0, np.arange(5.0)), (1, 100.0 + np.arange(3.0))):
        channel = load(path, {"channels": {"engine_speed": {"group": group}}}).manoeuvres[0]["engine_speed"]
        assert channel.values.tolist() == values.tolist() and channel.source == f"engine_speed [rad/s], group {group}"
    for group, words in ((2, "column 'engine_speed' is not in channel group 2; it is in 0 and 1"),
                         (True, "channels.engine_speed.group is True: the number"), ("0", "group is '0': the number")):
        with pytest.raises(InputError, match=words):
            load(path, {"channels": {"engine_speed": {"group": group}}})


def test_a_clock_that_is_named_is_that_of_the_channels_group(twice):
    """Every group calls its own clock the same."""
    path = twice(5, 3)
    told = {"channels": {"engine_speed": {"group": 1, "time": "time", "delay": 1.0}}}
    assert load(path, told).manoeuvres[0]["engine_speed"].time == pytest.approx([-1.0, -0.9, -0.8])


def test_a_group_without_samples_leaves_no_doubt(twice):
    assert load(twice(0, 3)).manoeuvres[0]["engine_speed"].values.tolist() == [100.0, 101.0, 102.0]
    with pytest.raises(InputError, match="column 'engine_speed' holds no values"):
        load(twice(0, 0))
    with pytest.raises(InputError, match=r"is there 2 times, in channel group 0 \(3 samples\): give each its own name"):
        load(twice(3, 3, together=True))


def test_an_mdf_file_that_is_cut_off_is_named_and_nothing_else_is_said(twice, tmp_path, capfd, monkeypatch):
    """Not by asammdf either, when what it has half read is deleted."""
    heard = []
    monkeypatch.setattr("sys.unraisablehook", lambda what: heard.append(what.exc_value))
    whole = twice(500).read_bytes()
    for size in (len(whole) // 2, 200, 70):
        (tmp_path / "b.mf4").write_bytes(whole[:size])
        with pytest.raises(InputError, match="b.mf4 (is not a readable MDF file|has no channels)"):
            load(tmp_path / "b.mf4")
        gc.collect()
    assert not heard and capfd.readouterr() == ("", "")


@pytest.mark.parametrize("block", [b"##DG", b"##CG"])
def test_an_mdf_file_with_a_damaged_block_is_named(tmp_path, block):
    converted(tmp_path / "a.mf4", np.arange(4, dtype=np.uint16), {"a": 2.0, "b": 1.0})
    whole = (tmp_path / "a.mf4").read_bytes()
    (tmp_path / "a.mf4").write_bytes(whole.replace(block, b"##??"))
    with pytest.raises(InputError, match="a.mf4 is not a readable MDF file"):
        load(tmp_path / "a.mf4")


def test_a_channel_of_an_mdf_file_beyond_its_records_is_named(tmp_path):
    """Of the memory there, asammdf would make a signal, or the process would end."""
    asammdf = pytest.importorskip("asammdf")
    converted(tmp_path / "a.mf4", np.arange(4, dtype=np.uint16), None)
    with asammdf.MDF(tmp_path / "a.mf4") as file:
        address = file.groups[0].channels[1].address
    whole = bytearray((tmp_path / "a.mf4").read_bytes())
    place = address + 24 + 8 * int.from_bytes(whole[address + 16:address + 24], "little") + 4  # of the byte offset
    assert whole[place:place + 4] == (8).to_bytes(4, "little")  # behind the clock
    whole[place:place + 4] = (9).to_bytes(4, "little")
    (tmp_path / "a.mf4").write_bytes(whole)
    with pytest.raises(InputError, match="a.mf4, channel 'force' cannot be read: it, or its clock, lies beyond"):
        load(tmp_path / "a.mf4")


def test_an_mdf_file_without_channels_is_named(twice):
    with pytest.raises(InputError, match="a.mf4 has no channels$"):
        load(twice())


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="looks into /proc")
@pytest.mark.parametrize("groups", [(3,), ()])
def test_an_mdf_file_is_closed_once_it_was_read(twice, groups):
    """On some systems nobody could delete it otherwise."""
    path = twice(*groups)
    with nullcontext() if groups else pytest.raises(InputError):
        load(path)
    opened = [os.path.realpath(entry) for entry in Path("/proc/self/fd").iterdir()]
    assert str(path) not in opened


def test_mdf_files_have_a_clock_for_each_group(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    slow, fast = np.arange(3) * 0.2, np.arange(5) * 0.1
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(samples=60.0 * fast, timestamps=fast, name="nEng", unit="rpm")])
        file.append([asammdf.Signal(samples=slow**2, timestamps=slow, name="position", unit="mm")])
        file.save(tmp_path / "a.mf4")
    assert load(tmp_path / "a.mf4").manoeuvres[0]["position"].values == pytest.approx(slow**2 / 1000)
    (tmp_path / "measurement.toml").write_text(
        '[[manoeuvre]]\nfile = "a.mf4"\n[channels.engine_speed]\ncolumn = "nEng"\n[channels.position]\n')
    manoeuvre = load(tmp_path).manoeuvres[0]
    assert manoeuvre["engine_speed"].time == pytest.approx(fast)
    assert manoeuvre["engine_speed"].values == pytest.approx(2 * np.pi * fast)
    assert manoeuvre["position"].time == pytest.approx(slow)
    assert not manoeuvre.notices


def test_what_is_said_of_a_common_clock_that_an_mdf_file_does_not_have_is_not_used_and_that_is_said(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(samples=np.ones(3), timestamps=np.arange(3) * 0.2, name="force", unit="N")])
        file.save(tmp_path / "a.mf4")
    manoeuvre = load(tmp_path / "a.mf4", {"channels": {"time": {"column": "nosuch", "unit": "ms"}}}).manoeuvres[0]
    assert manoeuvre["force"].time == pytest.approx([0.0, 0.2, 0.4])
    assert "a.mf4: every channel has its own clock in this file, so [channels.time] is not used" in manoeuvre.notices[0]


def converted(path, raw, conversion):
    """The values that are read from an MDF file which says how to compute them from ``raw``."""
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(samples=raw, timestamps=np.arange(len(raw)) * 0.1, name="force", unit="N",
                                    conversion=conversion)])
        file.save(path, overwrite=True)
    return load(path).manoeuvres[0]["force"].values.tolist()


@pytest.mark.parametrize("conversion, value", [
    ({"formula": "X1*X1"}, 60000.0**2), ({"formula": "X1*100000"}, 6e9), ({"formula": "X1&255"}, 60000 & 255),
    ({"formula": "3"}, 3.0), ({"P1": 1.0, "P2": 0.0, "P3": 0.0, "P4": 0.0, "P5": 0.0, "P6": 1.0}, 60000.0**2)])
def test_what_an_mdf_file_computes_of_integers_does_not_overflow(tmp_path, capfd, conversion, value):
    assert converted(tmp_path / "a.mf4", np.array([60000, 60000], dtype=np.uint16), conversion) == [value, value]
    assert capfd.readouterr().out == ""


@pytest.mark.parametrize("formula", ["pow(X1,2)", "ln(X1)", "X1^2", "X2*2"])
def test_a_formula_of_an_mdf_file_that_cannot_be_computed_is_named(tmp_path, formula):
    """Its raw values would be taken for what it stands for."""
    if importlib.util.find_spec("sympy"):
        pytest.skip("with sympy asammdf computes more formulas")
    with pytest.raises(InputError, match=f"a.mf4, channel 'force': its formula '{re.escape(formula)}' cannot be"):
        converted(tmp_path / "a.mf4", np.array([1, 2], dtype=np.uint16), {"formula": formula})


@pytest.mark.parametrize("values, said", [
    (np.arange(4.0) * (1.0 + 2.0j), "complex numbers: real ones are needed"),
    (np.ones((4, 3), dtype=np.uint8), "3 numbers at every instant: one is needed")])
def test_a_channel_of_an_mdf_file_that_holds_no_real_number_an_instant_is_named(tmp_path, values, said):
    with pytest.raises(InputError, match=f"a.mf4, channel 'force': it holds {said}$"):
        converted(tmp_path / "a.mf4", values, None)


def test_a_mean_of_mdf_channels_needs_one_clock(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name, start, count in (("a", 0.0, 5), ("same", 1e-9, 5), ("later", 0.05, 5), ("longer", 0.0, 6)):
            file.append([asammdf.Signal(samples=np.arange(float(count)), timestamps=start + np.arange(count) * 0.1,
                                        name=name, unit="rad/s")])
        file.save(tmp_path / "a.mf4")

    def mean(*columns):
        return load(tmp_path / "a.mf4", {"channels": {"wheel_speed": {"column": list(columns)}}}).manoeuvres[0]

    assert mean("a", "same")["wheel_speed"].values == pytest.approx(np.arange(5))
    for other in ("later", "longer"):
        with pytest.raises(InputError, match=f"columns 'a' and '{other}' of a.mf4 are sampled at instants of their"):
            mean("a", other)
