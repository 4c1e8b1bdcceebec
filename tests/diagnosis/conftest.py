"""A healthy car's tip-in, for tests of every step of a diagnosis."""


import pytest

from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.plants.led import LedPlant
from cosim.measured import load
from driveline.plants.plant import Plant


@pytest.fixture(scope="module")
def measurement(tmp_path_factory):
    folder = tmp_path_factory.mktemp("led") / "m"
    hide([], 2, folder, structure="same", drift="none", manoeuvres=["tip_in:5"])
    return load(folder)


@pytest.fixture
def by_short_steps(monkeypatch):
    """Call it, and cars are simulated in sub-steps from then on, with no step taken at once."""
    return lambda: monkeypatch.setattr(
        LedPlant, "simulate", lambda plant, *given, propagated: Plant.simulate(plant, *given))


@pytest.fixture(scope="module")
def car_and_run(measurement):
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    return car, car.runs(measurement)[0]
