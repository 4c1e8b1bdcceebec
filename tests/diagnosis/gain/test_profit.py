import pytest

from cosim.diagnosis.gain.profit import profit
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.measured import load


def test_estimators_are_less_surprised_by_the_vehicle_that_was_driven(tmp_path):
    hide(["vehicle_mass=1.3"], 5, tmp_path / "m", structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(tmp_path / "m")
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs = car.runs(measurement)
    rows = profit(car.source, {"vehicle.mass": 1.3 * car.values["vehicle.mass"]}, runs)
    torque = {row["estimator"]: row for row in rows if row["unit"] == "N.m"}
    assert set(torque) == {"DSKSE", "TKBSE"}
    assert torque["DSKSE"]["after"] < torque["DSKSE"]["before"]
    same = profit(car.source, {}, runs)
    assert all(row["before"] == pytest.approx(row["after"]) for row in same)


def test_who_had_nothing_to_do_is_left_out(tmp_path):
    hide([], 5, tmp_path / "m", structure="same", manoeuvres=["tip_out:5"])
    measurement = load(tmp_path / "m")
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    assert {row["estimator"] for row in profit(car.source, {}, car.runs(measurement))} == {"DSKSE"}
