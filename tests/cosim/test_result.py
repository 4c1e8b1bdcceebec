"""Results come back from files to the bit, with units and provenance."""

import numpy as np
import pytest

from cosim.master import Result
from driveline.quantities import InputError


@pytest.fixture
def result():
    random = np.random.default_rng(3)
    time = np.arange(500) / 1000
    signals = {"plant.engine_speed": random.normal(size=500) * 1e3,
               "plant.axle[1], left": random.normal(size=500), "gear": np.full(500, 5.0),
               "tiny": random.normal(size=500) * 1e-300}
    units = {"plant.engine_speed": "rad/s", "plant.axle[1], left": "N.m/rad", "gear": "1", "tiny": ""}
    return Result(time, signals, units,
                  {"scenario": "x.toml", "notices": ["größer"], "participants": {"a": 1}})


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_there_and_back_to_the_bit(result, tmp_path, ending):
    path = tmp_path / f"r.{ending}"
    getattr(result, f"to_{ending}")(path)
    back = Result.read(path)
    assert back.names == result.names
    assert (back.time == result.time).all()
    assert all((back[name] == result[name]).all() for name in result.names)
    assert back.units == result.units
    assert back.provenance == result.provenance
    assert back.complete


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("units", [{"b": "m", "a": "s"}, {"a": "s"}, {"a": "s", "b": "m", "gone": "N"}])
def test_signals_come_back_under_their_own_names_whatever_units_are_told(tmp_path, ending, units):
    result = Result(np.zeros(2), {"a": np.full(2, 1.0), "b": np.full(2, 2.0)}, units)
    getattr(result, f"to_{ending}")(tmp_path / f"r.{ending}")
    back = Result.read(tmp_path / f"r.{ending}")
    assert back.names == ["a", "b"] and back["a"][0] == 1.0 and back["b"][0] == 2.0
    assert back.units == {"a": "s", "b": units.get("b", "")}


def test_a_table_without_a_column_that_its_metadata_name_is_refused(tmp_path):
    Result(np.zeros(2), {"a": np.ones(2), "b": np.ones(2), "c": np.ones(2)}, {}).to_csv(tmp_path / "r.csv")
    rows = [line.split(",") for line in (tmp_path / "r.csv").read_text().splitlines()]
    (tmp_path / "r.csv").write_text("\n".join(",".join(row[:2] + row[3:]) for row in rows) + "\n")
    with pytest.raises(InputError, match=r"does not have the columns that its metadata name: b \[\]$"):
        Result.read(tmp_path / "r.csv")
    (tmp_path / "r.json").write_text("{}")
    with pytest.raises(InputError, match="is not a result of this package: 'units'"):
        Result.read(tmp_path / "r.csv")


def test_a_table_does_not_go_where_its_metadata_go(result, tmp_path):
    with pytest.raises(InputError, match="the table needs another"):
        result.to_csv(tmp_path / "r.json")
    assert list(tmp_path.iterdir()) == []


def test_the_csv_header_carries_the_units(result, tmp_path):
    result.to_csv(tmp_path / "r.csv")
    header = (tmp_path / "r.csv").read_text().splitlines()[0]
    assert header.startswith("time [s],plant.engine_speed [rad/s],")


def test_an_unknown_signal_is_named_with_what_is_close(result):
    with pytest.raises(InputError, match=r"no signal 'plant.enginespeed'; did you mean 'plant.engine_speed'"):
        result["plant.enginespeed"]


def test_a_failed_write_leaves_what_was_there(result, tmp_path, monkeypatch):
    import polars

    path = tmp_path / "r.parquet"
    result.to_parquet(path)
    before = path.read_bytes()

    def half(self, file, **_):
        file.write_bytes(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(polars.DataFrame, "write_parquet", half)
    with pytest.raises(OSError, match="disk full"):
        result.to_parquet(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["r.parquet"]


@pytest.mark.parametrize(("name", "content"), [("x.csv", "time,a\n0,1\n"), ("x.parquet", "no parquet")])
def test_what_is_no_result_is_refused(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=f"{name} is not a result"):
        Result.read(tmp_path / name)
    with pytest.raises(InputError, match="there is no result"):
        Result.read(tmp_path / "gone.csv")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_path_that_looks_like_a_pattern_is_a_path(result, tmp_path, ending):
    path = tmp_path / "o[1]" / f"r.{ending}"
    getattr(result, f"to_{ending}")(path)
    getattr(Result(result.time, {}, {}), f"to_{ending}")(tmp_path / "o1" / f"r.{ending}")
    assert Result.read(path).names == result.names


def test_numpys_numbers_in_the_provenance_become_plain_ones(result, tmp_path):
    result.provenance["signals"] = {"before": np.int64(-20), "times": np.array([0.5, 1.0]), "on": np.bool_(True)}
    result.to_csv(tmp_path / "r.csv")
    result.to_parquet(tmp_path / "r.parquet")
    for ending in ("csv", "parquet"):
        assert Result.read(tmp_path / f"r.{ending}").provenance["signals"] == {
            "before": -20, "times": [0.5, 1.0], "on": True}


def test_a_provenance_that_cannot_be_written_leaves_no_file(result, tmp_path):
    result.provenance["odd"] = object()
    for write in (result.to_csv, result.to_parquet):
        with pytest.raises(TypeError, match="cannot be written as JSON"):
            write(tmp_path / "r.csv")
    assert list(tmp_path.iterdir()) == []


def test_no_signal_is_called_as_the_time_axis():
    with pytest.raises(InputError, match="a signal cannot be called 'time'"):
        Result(np.zeros(1), {"time": np.zeros(1)}, {"time": "s"})
