"""How much of an effect shows: nothing where there is none, much where it is large, or was not looked for."""

from types import SimpleNamespace

import pytest
from floors import shortened

from benchmarks.blind.visibility import beside, evident, missed, visibility
from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import plant_for
from cosim.measured import load


def diagnosed(folder, seconds=4.0):
    """As much of a diagnosis as is looked at: a healthy car was fitted, and nothing else was found."""
    measurement = load(folder)
    car = plant_for(measurement)
    runs = [shortened(run, seconds) for run in car.runs(measurement)]
    fitter = Fitter(Predictor(car, runs, coordinates(car, runs)))
    file = fitter.nominal()
    noise = fitter.noise(file)
    healthy = fitter.assess(fitter.refine(file, noise, 3), noise)
    found = SimpleNamespace(healthy=healthy, best=healthy, alternatives=[healthy], noise=noise,
                            coordinates=fitter.coordinates)
    return SimpleNamespace(car=car, runs=runs, identification=found)


@pytest.mark.parametrize(("size", "least", "most"), [("0 rad", -2.0, 2.0), ("0.02 rad", 1000.0, float("inf"))])
def test_what_shows_is_the_evidence_that_a_healthy_car_lacks(tmp_path, size, least, most):
    for name, effects in (("with", [f"outside:wavy_road={size}"]), ("without", [])):
        hide(effects, 11, tmp_path / name, structure="same", manoeuvres=["step:5"])
    with_it, without = diagnosed(tmp_path / "with"), diagnosed(tmp_path / "without")
    shown = visibility(with_it, without.runs)
    assert least < shown["healthy"] < most
    assert shown["found"] >= shown["healthy"] - 2.0  # which was not fitted to the end


def test_what_a_search_missed_is_what_a_fit_from_the_truth_gains(tmp_path):
    truth = {"tyre_slip": {"slip_stiffness": 0.55}}
    hide(["tyre_slip=slip_stiffness:0.55"], 12, tmp_path / "m", structure="same", drift="none", manoeuvres=["tip_in:5"])
    diagnosis = diagnosed(tmp_path / "m", 2.5)
    found = diagnosis.identification
    gained = missed(diagnosis, evident(diagnosis, truth))
    assert gained > 20.0  # nothing but a healthy car was fitted
    found.alternatives.append(SimpleNamespace(score=found.healthy.score + 100.0))
    further = {**truth, "vehicle_mass": {"vehicle_mass": 1.6}}  # which nobody hid
    assert missed(diagnosis, evident(diagnosis, further)) < gained - 100.0
    assert evident(diagnosis, {"torque_meter_filter": {"no_such_number": 0.1}}) is None  # no recording has it
    assert missed(diagnosis, None) is None


def test_both_show_where_they_are_more_evident_than_either(monkeypatch):
    """Each by a fit that begins at the truth, or by what the search had, whichever is better; nothing else counts."""
    fits = {("a",): 3.0, ("b",): 5.0, ("a", "b"): 4.0, ("c",): 90.0, (): 0.0}
    found = [SimpleNamespace(effects=effects, score=score) for effects, score in fits.items()]
    diagnosis = SimpleNamespace(identification=SimpleNamespace(alternatives=found))
    begun = {"a": 7.0, "b": None}
    monkeypatch.setattr("benchmarks.blind.visibility.evident", lambda _, sizes: begun["".join(sizes)])
    both = {"a": {}, "b": {}}
    assert beside(diagnosis, both, 9.0) == 2.0
    assert beside(diagnosis, both, None) == -3.0
    del found[1], found[1]
    assert beside(diagnosis, both, 9.0) is None  # nobody knows of one of them
