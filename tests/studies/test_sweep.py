"""A sweep gives the same numbers on one worker, on several, on a cluster, and when it was interrupted."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import pytest

from cosim.studies import sweep
from cosim.studies.sweep import Case, Sweep
from driveline.quantities import InputError


@dataclass(frozen=True)
class Angle:
    value: float


@dataclass(frozen=True)
class Number:
    value: float


def cases(count=4):
    return [Case(f"root {i}", root, {"angle": Angle(i / 7.0)}) for i in range(count)]


def root(angle):
    return {"root": math.sqrt(angle.value), "nothing": None}


def picky(angle):
    if angle.value > 0.2:
        raise ZeroDivisionError("too large")
    return angle.value


def refused(angle):
    raise InputError("angle is wrong: a right one is needed")


def test_results_have_the_order_of_the_cases_and_are_exact(tmp_path):
    found = Sweep(tmp_path, workers=1).run(cases()[::-1])
    assert list(found) == [case.name for case in cases()[::-1]]
    assert found["root 3"]["root"] == math.sqrt(3 / 7.0) and found["root 3"]["nothing"] is None


def test_several_workers_give_the_same_as_one():
    # functions of the package: workers import them, and the tests are not importable there
    from cosim.studies.estimation import Drive, Reading, measure_position
    from cosim.studies.torque_profiles import ramp

    some = [Case(f"{rate}", measure_position, {"drive": Drive(ramp(rate), stop=1.6),
                                               "readings": [Reading("dskse", 0.01)]})
            for rate in (300.0, 500.0, 800.0)]
    assert Sweep(workers=2).run(some) == Sweep(workers=1).run(some[::-1])


def test_what_was_done_is_not_done_again(tmp_path):
    Sweep(tmp_path, workers=1).run(cases(2))
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    shares = []
    found = Sweep(tmp_path, workers=1).run(cases(4), shares.append)
    assert shares == [0.75, 1.0]
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())
    assert found == Sweep(None, workers=1).run(cases(4))


def test_a_failure_names_its_case_and_keeps_the_others(tmp_path):
    some = [Case(f"angle {i}", picky, {"angle": Angle(i / 7.0)}) for i in range(3)]
    with pytest.raises(RuntimeError, match="case 'angle 2': ZeroDivisionError: too large"):
        Sweep(tmp_path, workers=1).run(some)
    assert sorted(json.loads(path.read_text()) for path in tmp_path.glob("*.json")) == [0.0, 1 / 7.0]
    with pytest.raises(InputError, match="case 'x': angle is wrong"):
        Sweep(workers=1).run([Case("x", refused, {"angle": Angle(0.0)})])


def test_a_file_that_is_half_written_is_done_again(tmp_path):
    [case] = cases(1)
    (tmp_path / f"{case.key}.json").write_text('{"root": 1')
    assert Sweep(tmp_path, workers=1).run([case])["root 0"]["root"] == 0.0


def test_keys_follow_the_content():
    one = Case("a", root, {"angle": Angle(0.5)})
    assert one.key == Case("another name", root, {"angle": Angle(0.5)}).key
    others = [Case("a", root, {"angle": Angle(0.25)}), Case("a", root, {"angle": Number(0.5)}),
              Case("a", picky, {"angle": Angle(0.5)})]
    assert len({one.key, *(case.key for case in others)}) == 4


def test_keys_follow_the_code(monkeypatch):
    before = cases(1)[0].key
    monkeypatch.setattr(sweep, "_code", lambda: "another version")
    assert cases(1)[0].key != before


def test_two_cases_of_one_name_are_refused():
    with pytest.raises(InputError, match="same name"):
        Sweep(workers=1).run(cases(1) * 2)


def test_no_workers_are_refused():
    with pytest.raises(InputError, match="at least 1"):
        Sweep(workers=0)


def test_a_cluster_gives_the_same_numbers():
    distributed = pytest.importorskip("distributed", reason="dask is not installed: extra `cluster`")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False,
                                  dashboard_address=":0") as cluster:
        found = Sweep(cluster=cluster.scheduler_address).run(cases())
    assert found == Sweep(workers=1).run(cases())


def test_a_cluster_that_is_not_there_is_an_input_error():
    pytest.importorskip("distributed", reason="dask is not installed: extra `cluster`")
    with pytest.raises(InputError, match="there is no dask scheduler"):
        Sweep(cluster="no-address-at-all://").run(cases(1))


def test_without_dask_it_is_said_how_to_get_it(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match=r"driveline-cosim\[cluster\]"):
        Sweep(cluster="tcp://localhost:1").run(cases(1))


def test_nothing_is_left_but_results(tmp_path):
    Sweep(tmp_path, workers=1).run(cases(2))
    assert {path.suffix for path in Path(tmp_path).iterdir()} == {".json"}
