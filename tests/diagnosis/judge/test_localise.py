"""Where a torque is missing, and what it goes with."""

import numpy as np
import pytest
from floors import measured, shortened
from scipy.integrate import solve_ivp

from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.noise import wander
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.judge.localise import Disturbance, disturbances, each_its_own, goes_with, tied
from cosim.diagnosis.judge.torques import ENGINE_TORQUE
from cosim.diagnosis.judge.verdict import MISSING, WITNESSES
from cosim.diagnosis.plants import STEP, Nuisance
from cosim.diagnosis.plants.hats import hats
from cosim.diagnosis.plants.led import PLACES


def missing(car, run, raw, places=PLACES, loaded=False, settled=False):
    """The disturbances found at some places where this was measured, and the run as measured.

    Beside a car that is fitted once, from the file, or settled as a search does: again from where it ended, as the
    first time ends in a minimum that another rounding makes another (27 units of evidence better or worse).
    """
    led = measured(car, run, raw)
    with Predictor(car, [led], coordinates(car, [led])) as predictor:
        fitter = Fitter(predictor)
        fit = fitter.nominal()
        noise = fitter.noise(fit)
        if settled:
            for _ in range(2):
                fit = fitter.settle(fitter.cooled(fit, noise), noise)
        else:
            fit = fitter.renewed(fitter.refine(fit, noise, 5), noise)
        return disturbances(predictor, fit, noise, places, loaded), led


def bent(car, run, torque):
    """A car whose axle shafts carry a further torque, a function of their twist, which depends on it."""
    raw = car.raw(car.values, run.free)
    for _ in range(8):
        twist = raw["axle_shaft_torque"] / (2.0 * car.values["axle_shaft.stiffness"])
        raw = car.pushed(car.values, run.free, Nuisance(), "within the axle shafts", torque(twist))
    return raw


@pytest.mark.parametrize("place", ["vehicle", "propeller shaft", "within the axle shafts", "within the transmission"])
def test_a_torque_nobody_knew_of_is_found_where_it_acts(car_and_run, place):
    car, run = car_and_run
    # a slow torque within a shaft is not seen, and one on the pinion is one on the axle; of a quick one the numbers of
    # healthy cars explain a part
    frequency, alike = (0.5, 0.9) if place == "vehicle" else (2.0, 0.65)
    push = 3.0 * PLACES[place].size * np.sin(2.0 * np.pi * frequency * run.time)
    (first, *_), led = missing(car, run, car.pushed(car.values, run.free, Nuisance(), place, push), settled=True)
    assert (first.place, first.follows) == (place, "")
    true = np.interp(hats(led), run.time, push)
    inside = slice(8, -8)
    assert np.corrcoef(first.table["torque"][inside], true[inside])[0, 1] > alike


@pytest.mark.parametrize("place", ["engine", "transmission", "wheel"])
def test_a_torque_that_is_missing_elsewhere_shows_at_a_witness(car_and_run, place):
    car, run = car_and_run
    push = 3.0 * PLACES[place].size * np.sin(2.0 * np.pi * 2.0 * run.time)
    (first, *others), _ = missing(car, run, car.pushed(car.values, run.free, Nuisance(), place, push), WITNESSES)
    assert first.gain > 2.0 * MISSING and {first.place, *(d.place for d in others)} == set(WITNESSES)


def test_slow_torques_behind_the_meter_are_not_told_apart(car_and_run, measurement):
    """Of a drag on the propeller shaft, on the axle or on the wheels its shaft bears the same."""
    car, _ = car_and_run
    run = shortened(car.runs(measurement)[0], 4.0)  # it has to be slow
    push = -9.0 * np.exp(-run.time / 4.0)
    found, _ = missing(car, run, car.pushed(car.values, run.free, Nuisance(), "propeller shaft", push), settled=True)
    places = {d.place for d in tied(found)}
    assert {"propeller shaft", "axle"} <= places and not {"engine", "transmission"} & places


def test_places_are_told_apart_as_causes_are():
    def places(*gains):
        return len(tied([Disturbance("axle", gain, np.empty(0), 1.0, {}) for gain in gains]))

    assert places(100.0, 92.0, 90.0) == 2 and places(-3.0, -4.0) == 2
    assert places(2000.0, 1985.0, 1970.0) == 2  # of much evidence a hundredth is no difference


def test_a_torque_that_follows_what_is_fast_is_found_as_a_curve(car_and_run):
    """Shuffle is too fast for hats."""
    car, run = car_and_run
    raw = bent(car, run, lambda twist: 100.0 * (twist / 0.04) ** 3)
    (first, *_), _ = missing(car, run, raw)
    assert (first.place, first.follows) == ("within the axle shafts", "twist")
    true = 100.0 * (first.table["twist"] / 0.04) ** 3
    assert np.corrcoef(first.table["torque"], true)[0, 1] > 0.9
    assert np.all(np.abs(first.table["torque"] - true) < 2.5 * first.table["std"])
    assert np.ptp(true) > 2.0 * first.table["std"].max()
    name, shape, _ = goes_with(first.table, first.follows)
    assert name == "twist" and shape.startswith("rises")


def test_a_housing_that_turns_by_the_torque_of_the_engine_is_found_at_the_gears(car_and_run):
    """Before any shaft carries it: while the lash is crossed, within a tenth of a second, and by no curve over it."""
    car, run = car_and_run
    bears = car.raw(car.values, run.free)["crankshaft_torque"]
    turned = 0.008 * np.tanh(bears / 15.0)
    (first, *_), _ = missing(car, run, car.pushed(car.values, run.free, Nuisance(), "within the transmission", turned),
                             WITNESSES)
    assert (first.place, first.follows) == ("within the transmission", ENGINE_TORQUE) and first.gain > 2.0 * MISSING
    assert goes_with(first.table, first.follows)[1].startswith("rises")


def rolled(torque, hard):
    """How far a housing rolls at 9.2 Hz, on mounts whose stiffness grows with the square of that [rad]; by SciPy."""
    time, stiffness, rate = STEP * np.arange(torque.size), 500.0, 2.0 * np.pi * 9.2

    def rates(t, y):
        borne = stiffness * (1.0 + hard * (y[0] / 0.03) ** 2) * y[0]
        return y[1], rate**2 * (np.interp(t, time, torque) - borne) / stiffness - 0.24 * rate * y[1]

    first = np.roots([stiffness * hard / 0.03**2, 0.0, stiffness, -torque[0]] if hard else [stiffness, -torque[0]])
    start = float(first[np.abs(first.imag) < 1e-9].real[0])
    return solve_ivp(rates, (0.0, time[-1]), (start, 0.0), t_eval=time, max_step=2e-3, rtol=1e-6).y[0]


@pytest.mark.parametrize("hard, how", [(0.0, "on mounts"), (1.0, "on mounts that harden")])
def test_a_powertrain_that_rolls_on_its_mounts_is_found_by_how_it_rings(car_and_run, hard, how):
    """On mounts that harden by another law than those that are supposed."""
    car, run = car_and_run
    raw, ratio = car.raw(car.values, run.free), car.gearing.ratios[run.gear]
    bears = raw["crankshaft_torque"] + (ratio - 1.0) / ratio * raw["propeller_shaft_torque"]
    roll = rolled(bears, hard)
    turned = 0.03 * roll / np.ptp(roll)
    (first, *others), _ = missing(car, run, car.pushed(car.values, run.free, Nuisance(), "within the transmission",
                                                       turned), WITNESSES, settled=True)
    assert (first.place, first.follows) == ("within the transmission", ENGINE_TORQUE)
    assert first.gain > max(MISSING, *(d.gain + 15.0 for d in others))  # units of log evidence
    assert first.alone == pytest.approx([first.gain])  # of one recording; the choice of mounts has its price in both
    name, shape, _ = goes_with(first.table, first.follows, first.shape)
    assert name == ENGINE_TORQUE and shape.startswith("as a powertrain that rolls at") and shape.endswith(how)


@pytest.mark.parametrize(("size", "is_there"), [(4.0, False), (100.0, True)])
def test_shafts_that_are_a_little_bent_are_healthy(car_and_run, size, is_there):
    """Those of a plant of another structure are, and in a pulse train that is evident: a null was `unknown`."""
    car, run = car_and_run
    raw = bent(car, run, lambda twist: size * np.tanh(twist / 0.005))
    found, _ = missing(car, run, raw, WITNESSES)
    assert (max(d.gain for d in found) > MISSING) is is_there


def test_shafts_are_healthy_if_they_are_bent_by_more_the_more_they_carry(car_and_run):
    """As tyres behind them slip, in low gears: a null in third lacked 24 units."""
    car, run = car_and_run
    raw = bent(car, run, lambda twist: -4e4 * twist * np.abs(twist))
    alike, loaded = (max(d.gain for d in missing(car, run, raw, WITNESSES, of)[0]) for of in (False, True))
    assert alike > 10.0 and loaded < 0.6 * alike, (alike, loaded)


def test_a_torque_that_wanders_as_healthy_ones_do_is_not_missing(car_and_run):
    car, run = car_and_run
    torque = wander(len(run.inputs), STEP, np.random.default_rng(2))
    found, _ = missing(car, run, car.raw(car.values, run.free, Nuisance(), torque))
    assert max(d.gain for d in found) < 10.0


def test_what_a_torque_goes_with():
    random = np.random.default_rng(4)
    n = 400
    table = {"speed": 10.0 + np.linspace(0.0, 5.0, n), "torque": np.zeros(n), "std": np.ones(n),
             "twist": random.uniform(-0.05, 0.05, n), "distance": np.linspace(0.0, 280.0, n),
             "wheel angle": np.linspace(0.0, 800.0, n), "shaft torque": random.uniform(-50.0, 300.0, n),
             "run": np.repeat([0.0, 1.0], n // 2)}
    hard = {**table, "torque": 2e6 * table["twist"] ** 3 + random.standard_normal(n)}
    assert goes_with(hard)[0] == "twist" and "steeper" in goes_with(hard)[1]
    for sign, shape in ((1.0, "falls, then rises"), (-1.0, "rises, then falls")):
        bent = {**table, "torque": sign * 2e3 * (table["twist"] - 0.01) ** 2 + 0.1 * np.sin(np.arange(n))}
        assert goes_with(bent)[:2] == ("twist", shape)
    wavy = {**table, "torque": 80.0 * np.sin(2.0 * np.pi * table["distance"] / 14.0) + random.standard_normal(n)}
    variable, shape, share = goes_with(wavy)
    assert variable == "distance" and "14 m" in shape and share > 0.9
    for torque in (random.standard_normal(n), np.cumsum(random.standard_normal(n))):
        assert goes_with({**table, "torque": torque}) == ("nothing", "no shape", 0.0)


def test_what_goes_its_own_way_in_each_recording_is_told_so():
    """Over the engine's torque; over the twist it is one curve in all of them."""
    x, run = np.tile(np.linspace(-20.0, 200.0, 50), 2), np.repeat([0.0, 1.0], 50)
    table = {ENGINE_TORQUE: x, "twist": x, "torque": np.where(run > 0.0, -x, x), "std": np.ones(100), "run": run}
    assert goes_with(table, ENGINE_TORQUE)[1] == "in each recording its own way: rises, evenly; falls, evenly"
    assert goes_with({**table, "torque": x}, ENGINE_TORQUE)[1] == "rises, evenly"
    assert ";" not in goes_with(table, "twist")[1]
    assert [each_its_own(name) for name in (ENGINE_TORQUE, "twist", "wheel angle", "")] == [True, False, False, False]
