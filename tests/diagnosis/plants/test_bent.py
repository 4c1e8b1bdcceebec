"""The car with bent axle shafts: as without where they are straight, as with stiffer ones where they rise evenly."""

import numpy as np
import pytest

from cosim.diagnosis.plants.bent import HEIGHTS, KNOTS, BentCar

KNOTS_AT = np.linspace(-0.05, 0.15, KNOTS)


@pytest.fixture(scope="module")
def cars(car_and_run):
    car, run = car_and_run
    return car, run, BentCar.like(car), BentCar.like(car).bent(run, KNOTS_AT)


def test_without_a_curve_it_is_the_same_car(cars):
    car, run, bent, its = cars
    assert bent.predict(bent.values, its) == pytest.approx(car.predict(car.values, run), rel=1e-12)


def test_a_curve_that_rises_evenly_is_a_stiffer_shaft_from_the_start_on(cars):
    car, run, bent, its = cars
    stiffness = car.values["axle_shaft.stiffness"]
    heights = {f"input.{name}.offset": 2.0 * 0.2 * stiffness * twist for name, twist in zip(HEIGHTS, KNOTS_AT)}
    shown, stiffer = bent.predict(bent.values | heights, its), car.predict(
        car.values | {"axle_shaft.stiffness": 1.2 * stiffness}, run)
    assert shown == pytest.approx(stiffer, rel=1e-6, abs=1e-6)
    assert np.abs(shown - car.predict(car.values, run)).max() > 1.0


def test_a_curve_has_its_knots(cars):
    car, run, bent, _ = cars
    with pytest.raises(ValueError, match="3 knots"):
        bent.bent(run, np.zeros(3))
