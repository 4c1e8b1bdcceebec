"""Simulations led along measured speeds, pushed, and their sensitivities."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from cosim.diagnosis.fitting import Fitter
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.localise import Disturbance, disturbances, each_its_own, goes_with, tied
from cosim.diagnosis.noise import wander
from cosim.diagnosis.plants import STEP, FullOrderCar, Nuisance
from cosim.diagnosis.plants.car import CHANNELS, PLACES, led_by
from cosim.diagnosis.plants.hats import EVERY, MEMORY, comb, fast, hats, row, teeth
from cosim.diagnosis.predict import WANDERS, Predictor, coordinates
from cosim.diagnosis.torques import ENGINE_TORQUE
from cosim.diagnosis.verdict import MISSING, WITNESSES
from cosim.measured import Channel, load
from driveline.plants.full_order import FullOrderPlant
from driveline.quantities import InputError

FINE = {"solver.maximum_substep": STEP / 3.0}
FLOORS = {"engine_speed": 0.06, "turbine_speed": 0.06, "transmission_output_speed": 0.06, "wheel_speed": 0.012,
          "vehicle_speed": 0.005, "propeller_shaft_torque": 1.5, "seat_acceleration": 0.03,
          "differential_acceleration": 0.5}


@pytest.fixture(scope="module")
def measurement(tmp_path_factory):
    folder = tmp_path_factory.mktemp("led") / "m"
    hide([], 2, folder, structure="same", drift="none", manoeuvres=["tip_in:5"])
    return load(folder)


@pytest.fixture(scope="module")
def car_and_run(measurement):
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    return car, car.runs(measurement)[0]


def on_its_own(values, run):
    """What the full-order plant shows in a run, with nothing of a diagnosis: by the names of its outputs.

    With sub-steps that first gear allows too: on its own it may be shifted.
    """
    plant = FullOrderPlant(values | FINE)
    plant["start.vehicle_speed"] = run.start_speed
    for i, variable in enumerate(plant.inputs):
        plant[variable.name] = run.inputs[0, i]
    plant.initialize()
    table = plant.simulate(run.inputs[:, :len(plant.inputs)], STEP, run.start)
    return {variable.name: table[:, i] for i, variable in enumerate(plant.output_variables)}


def test_without_anchors_it_is_the_full_order_plant(car_and_run):
    car, run = car_and_run
    run = replace(run.free, start=0.0)  # its sensors sample every millisecond, which cuts steps that begin between
    itself, free = on_its_own(car.values, run), car.raw(car.values | FINE, run)
    assert set(free) == {*CHANNELS, "axle_shaft_torque", "crankshaft_torque", "differential_speed"}
    for name in set(free) & set(itself) - {"differential_acceleration"}:
        assert np.array_equal(free[name], itself[name]), name


@pytest.mark.parametrize("delay", [0.0, 0.0005, 0.0437])
def test_torque_that_arrives_within_a_step_does_what_its_mean_over_the_step_does(car_and_run, delay):
    car, run = car_and_run
    run, values = replace(run.free, start=0.0), car.values | FINE | {"engine.air_delay": delay}
    itself, free = on_its_own(values, run), car.raw(values, run)
    for name, floor in FLOORS.items():
        if name != "differential_acceleration":
            assert free[name] == pytest.approx(itself[name], abs=0.1 * floor), name


def test_torque_before_it_is_asked_for_is_refused(car_and_run):
    car, run = car_and_run
    with pytest.raises(InputError, match="air_delay"):
        car.raw(car.values | {"engine.air_delay": -0.001}, run)


def test_what_was_simulated_before_leaves_no_trace(car_and_run):
    """Also where the next begins alike, so that nothing is initialised anew, or values between were refused."""
    car, run = car_and_run
    later = np.where(run.time > run.time[1000], 3.0, 0.0)
    softer, refused = ({**car.values, "axle_shaft.stiffness": x} for x in (8000.0, -1.0))

    def simulated(car, job):
        values, place = job
        try:
            return car.pushed(values, run, Nuisance(), place, later) if place else car.raw(values, run, torque=later)
        except InputError:
            return None

    jobs = [(car.values, ""), (car.values, ""), (refused, ""), (car.values, ""), (car.values, "axle"),
            (car.values, "axle"), (car.values, "wheel"), (car.values, ""), (softer, ""), (softer, "")]
    for job in jobs:
        shown, alone = simulated(car, job), simulated(FullOrderCar(car.vehicle, car.variant), job)
        assert (shown is None) == (alone is None) == (job[0] is refused)
        assert shown is None or all(np.array_equal(shown[name], alone[name]) for name in alone)


def test_a_slope_that_nobody_recorded_falls_on_the_way_back(car_and_run):
    car, run = car_and_run
    column = car.columns["road_grade"]
    slope = {**car.values, "input.road_grade.offset": 0.01}
    grades = [replace(run, back=back).driven_by(slope, car.columns)[:, column] for back in (False, True)]
    assert np.all(grades[0] == 0.01) and np.all(grades[1] == -0.01)
    assert np.array_equal(car.predict(slope, replace(run, back=True)),
                          car.predict({**slope, "input.road_grade.offset": -0.01}, run))


def test_a_slope_sensor_that_is_not_level_shows_the_same_offset_on_the_way_back(measurement, car_and_run):
    car, run = car_and_run
    [manoeuvre] = measurement.manoeuvres
    level = Channel("road_grade", "rad", np.array([manoeuvre.start, manoeuvre.stop]), np.zeros(2), "made")
    recorded = replace(manoeuvre, back=True, channels={**manoeuvre.channels, "road_grade": level})
    runs = [car.runs(replace(measurement, manoeuvres=(one,))) for one in (replace(manoeuvre, back=True), recorded)]
    assert [one.back for [one] in runs] == [True, False]
    assert [one.graded for [one] in runs] == [False, True]  # that of a level road too


def test_an_accelerometer_shows_the_mean_and_misses_no_impact(car_and_run):
    car, run = car_and_run
    raw = car.raw(car.values | FINE, run.free)
    arm = car.values["differential_case.lever_arm"]
    shown, speed = raw["differential_acceleration"], arm * raw["differential_speed"]
    # its integral is the speed, whatever happened within a step
    assert np.sum(shown[1:-1]) * STEP == pytest.approx(0.5 * (speed[-1] + speed[-2] - speed[1] - speed[0]), abs=1e-9)
    itself = on_its_own(car.values, run)["differential_acceleration"]
    # where it does not jump it is the acceleration itself
    assert np.median(np.abs(shown - itself)) < 0.01 * np.std(itself)


def test_led_by_its_own_speeds_it_goes_its_own_way(car_and_run):
    car, run = car_and_run
    free = car.raw(car.values, run.free)
    led = car.raw(car.values, led_by(run, free))
    for name in ("engine_speed", "propeller_shaft_torque", "wheel_speed"):
        # what leads it is half a step old, sampled once a step
        assert np.max(np.abs(led[name] - free[name])) < 2e-2 * np.ptp(free[name])


@pytest.mark.parametrize(("noisy", "ripple", "lost", "most"), [
    (False, 0.0, 0.0, 0.03), (True, 0.0, 0.0, 0.25), (False, 35.0, 0.0, 0.04), (False, 0.0, 0.1, 0.03)])
def test_what_leads_it_leaves_little_beside_the_noise_of_the_channels(car_and_run, noisy, ripple, lost, most):
    """Straight lines between samples damp shuffle, by 0.09 of the speeds' noise; noise that leads moves the seat.

    Little enough to be overlooked, and slow enough to move the parameters of five recordings by 3 sigma. Ripple of 70
    to 120 Hz, sampled every 10 ms, would shake the driveline slowly, by 0.37 of the noise. A curve through both ends of
    a tenth of a second without frames would miss a trough of the shuffle, by 0.18.
    """
    car, run = car_and_run
    values = {**car.values, "torque_ripple.amplitude": ripple, "torque_ripple.phase": 1.0}
    raw, random = car.raw(values, run.free), np.random.default_rng(1)
    anchors, swing = {}, run.time[np.argmax(raw["propeller_shaft_torque"])]  # the engine is slowed down most there
    for name, every in (("engine_speed", 10), ("vehicle_speed", 50)):
        time, shown = run.time[every // 2::every], raw[name][every // 2::every]
        seen = np.abs(time - swing) > 0.5 * lost
        time, shown = time[seen], shown[seen]
        anchors[name] = CubicSpline(time, shown + noisy * FLOORS[name] * random.standard_normal(time.size))
    left = car.predict(values, replace(run, anchors=anchors)) - car.predict(values, run.free)
    for name, place in run.slices.items():
        assert np.sqrt(np.mean(left[place] ** 2)) < most * FLOORS[name], name


def test_a_led_driveline_forgets_a_torque(car_and_run):
    car, run = car_and_run
    led = led_by(run, car.raw(car.values, run.free))
    kick = np.zeros(len(run.inputs))
    kick[2500:2600] = 5.0
    for one, forgets in ((led, True), (run.free, False)):
        change = np.abs(car.raw(car.values, one, Nuisance(), kick)["vehicle_speed"]
                        - car.raw(car.values, one)["vehicle_speed"])
        assert (change[-500:].max() < 0.3 * change.max()) == forgets


def test_zero_is_the_vehicle_file_and_every_coordinate_moves_something(car_and_run):
    car, run = car_and_run
    declared = coordinates(car, [run])
    zero = np.zeros(len(declared))
    with Predictor(car, [run], declared) as predictor:
        base = predictor.all_runs([zero])
        assert np.array_equal(base[0], car.predict(car.values, run))
        slopes = predictor.jacobian([zero], base, {0: range(len(declared))})[0]
    moves = np.abs(slopes).max(axis=0)
    idle = [c.name for c, m in zip(declared, moves) if m == 0.0]
    # these do nothing while they are small, or where the file has no suspension
    assert set(idle) <= {"lockup_capacity", "slip_target", "first_stage_stiffness", "first_stage_twist",
                         "suspension.damping"}


def test_several_processes_say_the_same(car_and_run):
    car, run = car_and_run
    declared = coordinates(car, [run])
    zero = np.zeros(len(declared))
    columns = [0, 5, *(i for i, c in enumerate(declared) if c.name == WANDERS)]
    found = []
    for workers in (1, 2):
        with Predictor(car, [run], declared, workers) as predictor:
            found.append(predictor.jacobian([zero], predictor.all_runs([zero]), {0: columns})[0])
    assert np.array_equal(*found)


def test_a_swing_has_the_amplitude_of_its_components(car_and_run):
    car, run = car_and_run
    declared = coordinates(car, [run])
    predictor = Predictor(car, [run], declared)
    u = np.zeros(len(declared))
    for i in predictor.index("torque_ripple"):
        u[i] = (3.0, 4.0)[declared[i].part]
    values, _ = predictor.values(u, 0)
    assert values["torque_ripple.amplitude"] == pytest.approx(5.0)
    assert values["torque_ripple.phase"] == pytest.approx(np.arctan2(4.0, 3.0))


def test_hats_apart_make_up_every_hat(car_and_run):
    _, run = car_and_run
    whole = sum(row(run, comb(hats(run).size, k, MEMORY)) for k in range(teeth(MEMORY)))
    inside = (run.time - 1e-3 > hats(run)[0]) & (run.time - 1e-3 < hats(run)[-1])
    assert np.allclose(whole[inside], 1.0)


def test_hats_follow_what_is_slow_and_leave_what_is_fast(car_and_run):
    _, run = car_and_run
    inside = (run.time > hats(run)[1]) & (run.time < hats(run)[-2])
    for period, left in ((20.0 * EVERY, 0.03), (EVERY, 0.6)):
        torque = np.sin(2.0 * np.pi * run.time / period)
        rest = np.std(fast(run, torque)[inside]) / np.std(torque[inside])
        assert rest < left if period > 5.0 * EVERY else rest > left


def test_the_slopes_of_a_row_of_hats_are_those_of_each(car_and_run):
    car, run = car_and_run
    declared = coordinates(car, [run])
    zero = np.zeros(len(declared))
    places = [i for i, c in enumerate(declared) if c.name == WANDERS]
    with Predictor(car, [run], declared) as predictor:
        base = predictor.all_runs([zero])[0]
        slopes = predictor.jacobian([zero], [base], {0: places})[0]
        one = zero.copy()
        one[places[40]] = 1.0
        alone = predictor.predict(one, 0) - base
    assert np.abs(slopes[:, 40] - alone).max() < 0.1 * np.abs(alone).max()


def missing(car, run, raw, places=PLACES, loaded=False):
    """The disturbances found at some places where this was measured, and the run as measured."""
    random = np.random.default_rng(1)
    shown = car.instruments(raw, car.values, run)
    read = {name: shown[place] + FLOORS[name] * random.standard_normal(place.stop - place.start)
            for name, place in run.slices.items()}
    led = replace(led_by(run, raw), measured=read)
    with Predictor(car, [led], coordinates(car, [led]), 2) as predictor:
        fitter = Fitter(predictor)
        fit = fitter.nominal()
        noise = fitter.noise(fit)
        return disturbances(predictor, fitter.renewed(fitter.refine(fit, noise, 5), noise), noise, places, loaded), led


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
    (first, *_), led = missing(car, run, car.pushed(car.values, run.free, Nuisance(), place, push))
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


def test_slow_torques_behind_the_meter_are_not_told_apart(car_and_run):
    """Of a drag on the propeller shaft, on the axle or on the wheels its shaft bears the same."""
    car, run = car_and_run
    push = -10.0 * np.exp(-run.time / 4.0)
    found, _ = missing(car, run, car.pushed(car.values, run.free, Nuisance(), "propeller shaft", push))
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
