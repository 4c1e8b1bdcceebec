"""The simpler methods: each finds what it should where nothing makes it hard."""

import pytest

from benchmarks.blind import baselines, reading
from benchmarks.blind import run as blind
from benchmarks.blind.cases import BlindCase
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.measured import load

FEW = ("engine_inertia", "torque_meter_offset", "engine_speed_delay")


def squares(folder, effects):
    """Two recordings of a plant of the model's own structure, of which only a few effects may be the cause."""
    hide(effects, 3, folder, structure="same", drift="none", manoeuvres=("tip_in:5", "pulse_train:4"))
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs = [run.free for run in car.runs(measurement)]
    few = baselines.Squares(Predictor(car, runs, coordinates(car, runs), 1))
    few.effects = {name: few.effects[name] for name in FEW}
    return few


def truth(name, size):
    return {"category": "single", "effects": [name], "truth": {"effects": {name: {name: size}}}}


@pytest.mark.parametrize("name, size", [("engine_inertia", 1.1), ("torque_meter_offset", -14.0)])
def test_least_squares_find_a_small_effect_among_a_few(tmp_path, name, size):
    few = squares(tmp_path / "m", [f"{name}={size}"])
    for method in (baselines.fit_all, baselines.bic):
        found = {**truth(name, size), "finding": method(few)}
        assert reading.right_first(found), method.__name__
        assert max(reading.size_errors(found)) < 0.1, method.__name__


def test_sparse_regression_finds_a_zero_that_is_off(tmp_path):
    pytest.importorskip("pysindy", reason="pysindy is not installed: extra `blind`")
    few = squares(tmp_path / "m", ["torque_meter_offset=60"])
    assert reading.right_first({**truth("torque_meter_offset", 60.0), "finding": baselines.sparse_regression(few)})


def test_a_method_that_fails_is_a_result_and_stands_in_the_table(monkeypatch):
    def fails(few):
        raise ValueError("no use")

    monkeypatch.setattr(baselines, "METHODS", {"useless": fails, "silent": lambda few: baselines._finding([])})
    case = BlindCase("null-0", "null", (), 1, "same", ("tip_in:5",))
    result = baselines.compared(case)
    assert result["methods"]["useless"]["error"].startswith("ValueError: no use")
    diagnosis = {**result, "finding": {"verdict": "cause", "causes": [], "ambiguous_with": []}, "seconds": 2.0}
    rows = {row[0]: dict(zip(baselines.HEADS, row)) for row in baselines.rows([diagnosis], [result])}
    alarms = {name: row["false alarms"].partition(" %")[0] for name, row in rows.items()}
    assert alarms == {"diagnosis": "100", "useless": "100", "silent": "0"}


def test_the_same_case_is_compared_in_its_own_vehicle(monkeypatch, tmp_path):
    """The table leaves out whose truth is another one: in the usual vehicle no case of another was in it."""
    monkeypatch.setattr(baselines, "METHODS", {"silent": lambda few: baselines._finding([])})
    case = BlindCase("single-0", "single", ("vehicle_mass",), 1, "same", ("tip_in:5",), "suv_6l80")
    result = baselines.compared(case)
    assert result["truth"] == blind.truth(blind.hide_case(case, case.manoeuvres, tmp_path / "m"))
    assert baselines.rows([{**result, "finding": None}], [result])
