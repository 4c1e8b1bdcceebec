"""How much of an effect outside the catalogue shows: nothing where there is none, much where it is large."""

from types import SimpleNamespace

import pytest
from floors import shortened

from benchmarks.blind.visibility import visibility
from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import plant_for
from cosim.measured import load


def diagnosed(folder):
    """As much of a diagnosis as is looked at: a healthy car was fitted, and nothing else was found."""
    measurement = load(folder)
    car = plant_for(measurement)
    runs = [shortened(run, 4.0) for run in car.runs(measurement)]
    fitter = Fitter(Predictor(car, runs, coordinates(car, runs)))
    file = fitter.nominal()
    noise = fitter.noise(file)
    healthy = fitter.assess(fitter.refine(file, noise, 3), noise)
    found = SimpleNamespace(healthy=healthy, best=healthy, noise=noise)
    return SimpleNamespace(car=car, runs=runs, identification=found)


@pytest.mark.parametrize(("size", "least", "most"), [("0 rad", -2.0, 2.0), ("0.02 rad", 1000.0, float("inf"))])
def test_what_shows_is_the_evidence_that_a_healthy_car_lacks(tmp_path, size, least, most):
    for name, effects in (("with", [f"outside:wavy_road={size}"]), ("without", [])):
        hide(effects, 11, tmp_path / name, structure="same", manoeuvres=["step:5"])
    with_it, without = diagnosed(tmp_path / "with"), diagnosed(tmp_path / "without")
    shown = visibility(with_it, without.runs)
    assert least < shown["healthy"] < most
    assert shown["found"] >= shown["healthy"] - 2.0  # which was not fitted to the end
