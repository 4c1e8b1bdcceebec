import numpy as np
import pytest

from cosim.diagnosis import proposal
from cosim.diagnosis.fitting import Fit
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.noise import floors
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.predict import Predictor, coordinates
from cosim.measured import load


@pytest.fixture(scope="module")
def predictor(tmp_path_factory):
    folder = tmp_path_factory.mktemp("proposal") / "m"
    hide([], 2, folder, structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs = car.runs(measurement)
    return Predictor(car, runs, coordinates(car, runs))


def supposed(predictor, cause, value):
    shared = np.zeros(len(predictor.coordinates))
    shared[predictor.index(cause)] = value
    return Fit((cause,), shared, [shared], [], [])


def separation(predictor, kind, gear, one, other):
    car = predictor.car
    run = proposal._candidate(car, predictor.runs[0], kind, proposal._PROFILES[kind], gear, 220.0, 12.0)
    return proposal._separations(predictor, floors(predictor.runs), run, one, [other])[0]


def test_a_supposition_is_not_apart_from_itself(predictor):
    one = supposed(predictor, "vehicle_mass", 0.1)
    assert separation(predictor, "tip_in", 5, one, one) == pytest.approx(0.0, abs=1e-6)


def test_what_another_size_imitates_is_not_apart(predictor):
    """A little more inertia is no other cause."""
    one, other = (supposed(predictor, "engine_inertia", x) for x in (0.1, 0.12))
    stiffness = supposed(predictor, "shaft_stiffness:axle_shaft_stiffness", -0.2)
    same = separation(predictor, "tip_in", 5, one, other)
    assert same < 0.3 * separation(predictor, "tip_in", 5, one, stiffness)


def test_air_drag_and_rolling_resistance_part_where_it_is_fast(predictor):
    drag, rolling = (supposed(predictor, cause, 0.5) for cause in ("aerodynamic_drag", "rolling_resistance"))
    assert separation(predictor, "tip_in", 7, drag, rolling) > separation(predictor, "coast_down", 3, drag, rolling)


def test_the_best_candidate_is_proposed_with_words(predictor, monkeypatch):
    monkeypatch.setattr(proposal, "_GEARS", (5,))
    monkeypatch.setattr(proposal, "_TORQUES", (220.0,))
    monkeypatch.setattr(proposal, "_PROFILES", {k: proposal._PROFILES[k] for k in ("tip_in", "cruise")})
    one = supposed(predictor, "engine_inertia", 0.15)
    other = supposed(predictor, "shaft_stiffness:axle_shaft_stiffness", -0.12)

    class Quiet:
        floors = floors(predictor.runs)

    found = proposal.propose(predictor, Quiet, one, [(other, 0.5)])
    assert (found.kind, found.gear) == ("tip_in", 5) and found.separation_sigma > 3.0 and found.nearest is other
    assert "engine inertia" in proposal.words(found, one)


def test_a_manoeuvre_has_to_tell_all_rivals_apart(predictor, monkeypatch):
    """At speed air drag shows; what only tells the tyres would leave it where it is."""
    monkeypatch.setattr(proposal, "_GEARS", (3, 7))
    monkeypatch.setattr(proposal, "_TORQUES", (220.0,))
    monkeypatch.setattr(proposal, "_PROFILES", {"tip_in": proposal._PROFILES["tip_in"]})

    class Quiet:
        floors = floors(predictor.runs)

    rolling, drag = (supposed(predictor, cause, 0.3) for cause in ("rolling_resistance", "aerodynamic_drag"))
    tyres = supposed(predictor, "tyre_stiffness", 0.5)
    alone = proposal.propose(predictor, Quiet, rolling, [(tyres, 0.0)])
    both = proposal.propose(predictor, Quiet, rolling, [(tyres, 0.0), (drag, 0.0)])
    told = proposal.propose(predictor, Quiet, rolling, [(tyres, 0.0), (drag, 100.0)])
    assert both.nearest is drag and both.separation_sigma < alone.separation_sigma
    assert both.gear == proposal.propose(predictor, Quiet, rolling, [(drag, 0.0)]).gear
    assert (told.gear, told.separation_sigma) == (alone.gear, alone.separation_sigma)
