"""Roads that nobody measured, and causes judged on stretches that were left out."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.catalogue import apply_all
from cosim.diagnosis.confirm import FEWEST, Jury, words
from cosim.diagnosis.fitting import Fit
from cosim.diagnosis.identify import Identification
from cosim.diagnosis.plants import STEP, FullOrderCar, Run
from cosim.diagnosis.predict import Predictor, coordinates
from cosim.diagnosis.road import on_its_road

FLOORS = {"engine_speed": 0.1, "turbine_speed": 0.1, "vehicle_speed": 0.02}
SLIP, MASS = "converter_slip:slip_target", "vehicle_mass"
SIZES = {SLIP: 2.0, MASS: np.log(0.8)}


@pytest.fixture(scope="module")
def car():
    return FullOrderCar("pickup_10r80", "modified")


def driven(car, random, number, hidden=(), kind="drive", slope=None):
    """Three seconds of a drive: the torque goes up or down, the road is any."""
    inputs = np.tile(car.idle_inputs, (3000, 1))
    columns = car.columns
    low, high = random.uniform(60.0, 120.0), random.uniform(150.0, 250.0)
    time = STEP * np.arange(1, 3001)
    inputs[:, columns["engine_torque"]] = low + (high - low) / (1.0 + np.exp(-(time - 1.5) / 0.15))
    inputs[:, columns["gear"]] = 5
    clock = time[300::20]
    run = Run(f"{number}", kind, 5, 0.0, inputs, 18.0, dict.fromkeys(FLOORS, clock), {})
    values = apply_all({cause.partition(":")[0]: {name: size} for cause, name, size in (
        (SLIP, "slip_target", 2.0), (MASS, "vehicle_mass", 0.8)) if cause in hidden}, car.values)
    uphill = inputs.copy()
    uphill[:, columns["road_grade"]] += random.uniform(-0.02, 0.02) if slope is None else slope
    noise = run.stack(FLOORS) * random.standard_normal(3 * clock.size)
    shown = car.predict(values, replace(run, inputs=uphill)) + noise
    return replace(run, measured={name: shown[place] for name, place in run.slices.items()})


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


def supposed(declared, causes, score):
    shared = np.array([SIZES.get(c.cause, 0.0) if c.cause in causes else 0.0 for c in declared])
    return Fit(causes, shared, [shared], [], [], score=score)


@pytest.mark.parametrize("hidden", [(SLIP,), (SLIP, MASS)])
def test_what_only_the_fitted_stretches_show_is_no_cause(car, hidden):
    """The best by their evidence has one cause too many, or none; the others were not asked."""
    random = np.random.default_rng(2)
    declared = coordinates(car, [driven(car, random, 0, hidden)])
    further = [driven(car, random, number, hidden) for number in range(1, FEWEST + 1)]
    predictor = Predictor(car, [driven(car, random, 0, hidden)], declared)
    fits = [supposed(declared, causes, score) for causes, score in (
        ((SLIP, MASS), -100.0), ((SLIP,), -104.0), ((), -108.0))]
    found = Identification(fits[0], fits, fits[-1], None, [], {})
    judged, verdicts = Jury(predictor, further, FLOORS).judged(found)
    assert judged.best.causes == hidden
    assert {verdict.cause: verdict.confirmed for verdict in verdicts} == {SLIP: True, MASS: MASS in hidden}
    assert all(fit.causes in ((), (SLIP,), hidden) for fit in judged.alternatives)
    slip, mass = words(verdicts, len(further))
    assert slip.startswith(f"{FEWEST} further stretches confirm converter slip, slip target: the error there is ")
    assert ("do not confirm vehicle mass" in mass) == (MASS not in hidden)


def test_where_nothing_is_confirmed_nothing_is_found(car):
    random = np.random.default_rng(3)
    run = driven(car, random, 0)
    declared = coordinates(car, [run])
    fits = [supposed(declared, causes, score) for causes, score in (((SLIP,), -100.0), ((), -120.0))]
    further = [driven(car, random, number) for number in range(1, FEWEST + 1)]
    judged, [verdict] = Jury(Predictor(car, [run], declared), further, FLOORS).judged(
        Identification(fits[0], fits, fits[-1], None, [], {}))
    assert judged.best.causes == () and not verdict.confirmed and verdict.share > 1.0
