from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.gain.extend import changed_values
from cosim.diagnosis.gain.profit import delivered, profit
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.measured import load
from driveline.estimators import ESTIMATORS


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


def test_estimators_hear_the_torque_that_the_crankshaft_gets(car_and_run):
    """Not the one that was asked for, which comes 0.1 s earlier."""
    car, run = car_and_run
    given = car.raw(car.values, run)["crankshaft_torque"]
    heard = delivered(car.source, run)
    assert np.abs(heard - given).max() < 0.02 * np.ptp(given)
    assert np.abs(run.inputs[:, 0] - given).max() > 0.3 * np.ptp(given)
    other = replace(car.source, values=car.source.values | {"engine.torque_gain": 1.1, "engine.torque_offset": 5.0})
    assert delivered(other, run) + car.values["engine.accessory_torque"] == pytest.approx(
        1.1 * (heard + car.values["engine.accessory_torque"]) + 5.0)


def test_estimators_begin_in_the_drive_and_not_at_standstill(tmp_path):
    """A torque that is there from the start is no tip-in, and the first speed no jump from 0."""
    hide([], 7, tmp_path / "m", structure="same", drift="none", manoeuvres=["cruise:5"])
    measurement = load(tmp_path / "m")
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    [row] = profit(car.source, {}, car.runs(measurement))
    assert row["estimator"] == "DSKSE" and row["before"] < 10.0


def test_of_a_vehicle_without_lash_estimators_say_nothing(car_and_run):
    _, run = car_and_run
    car = FullOrderCar("pickup_10r80", "modified", {"transmission.half_gap": 0.0, "final_drive.half_gap": 0.0})
    without = replace(car.source, values=car.source.values | {
        "transmission.half_gap": 0.0, "final_drive.half_gap": 0.0})
    assert profit(without, {"vehicle.mass": 2500.0}, [run]) == []


def test_who_had_nothing_to_do_is_left_out(tmp_path):
    hide([], 5, tmp_path / "m", structure="same", manoeuvres=["tip_out:5"])
    measurement = load(tmp_path / "m")
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    assert {row["estimator"] for row in profit(car.source, {}, car.runs(measurement))} == {"DSKSE"}


@pytest.mark.parametrize("name", [name for name, effect in CATALOGUE.items() if effect.kind == "plant"])
def test_whatever_the_extended_vehicle_has_estimators_can_be_made_for_it(name):
    """Also what its file does not mention, as a drag."""
    car = FullOrderCar("pickup_10r80", "modified")
    effect = CATALOGUE[name]
    sizes = {p.name: p.within(p.size(2.0 * p.detection), car.values) for p in effect.parameters}
    changes = changed_values(car.values, effect.changes(sizes, car.values))
    extended = replace(car.source, values={**car.source.values, **changes})
    for estimator in ESTIMATORS.values():
        assert estimator.defaults_from(extended, 5)
    assert profit(car.source, changes, []) == []
