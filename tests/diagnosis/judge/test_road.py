"""Roads that nobody measured."""

from dataclasses import replace

import numpy as np
import pytest
from drives import FLOORS, driven

from cosim.diagnosis.fit.predict import coordinates
from cosim.diagnosis.judge.road import on_its_road
from cosim.diagnosis.plants import FullOrderCar


@pytest.fixture(scope="module")
def car():
    return FullOrderCar("pickup_10r80", "modified")


def test_a_road_is_as_steep_as_the_car_says(car):
    run = driven(car, np.random.default_rng(1), 0, slope=0.015)
    found = on_its_road(car, car.values, run, FLOORS)
    assert found.inputs[:, car.columns["road_grade"]] == pytest.approx(0.015, abs=1e-3)
    assert found.graded and not run.graded
    left = (run.stacked - car.predict(car.values, found)) / run.stack(FLOORS)
    assert np.sqrt(np.mean(left**2)) == pytest.approx(1.0, abs=0.1)


def test_a_lighter_car_goes_as_fast_on_a_steeper_road(car):
    run = driven(car, np.random.default_rng(1), 0, slope=0.0)
    slope = on_its_road(car, {**car.values, "vehicle.mass": 0.8 * car.values["vehicle.mass"]}, run, FLOORS)
    assert slope.inputs[0, car.columns["road_grade"]] > 0.003


@pytest.mark.parametrize("known", [{"kind": "tip_in"}, {"graded": True}])
def test_a_road_that_is_known_stays_as_it_is(car, known):
    run = replace(driven(car, np.random.default_rng(1), 0, slope=0.015), **known)
    assert np.array_equal(on_its_road(car, car.values, run, FLOORS).inputs, run.inputs)


def test_the_slope_of_a_road_that_nobody_measured_may_be_any(car):
    random = np.random.default_rng(1)
    runs = [driven(car, random, 0), driven(car, random, 1, kind="tip_in")]
    drive, known = (c.tolerance for c in coordinates(car, runs) if c.name == "grade")
    assert drive > 10.0 * known


def test_a_car_that_cannot_drive_there_leaves_the_road_as_it_is(car):
    run = driven(car, np.random.default_rng(1), 0, slope=0.015)
    refused = on_its_road(car, {**car.values, "axle_shaft.stiffness": -1.0}, run, FLOORS)
    assert np.array_equal(refused.inputs, run.inputs)
