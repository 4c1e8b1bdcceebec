"""Recordings made ready for a car, and a car simulated as they say."""

from dataclasses import replace

import numpy as np
import pytest
from drives import a_drive
from floors import FLOORS

from cosim.diagnosis.fit.noise import floors
from cosim.diagnosis.plants import STEP, Bench, FullOrderCar, Nuisance
from cosim.diagnosis.plants.observation import CHANNELS
from cosim.measured import CANONICAL, Channel, Manoeuvre, Measurement
from driveline.plants.full_order import FullOrderPlant
from driveline.quantities import InputError

FINE = {"solver.maximum_substep": STEP / 3.0}


def on_its_own(values, run):
    """What the full-order plant shows in a run, with nothing of a diagnosis: by the names of its outputs.

    With sub-steps that first gear allows too: on its own it may be shifted.
    """
    plant = FullOrderPlant(values | FINE)
    plant["start.vehicle_speed"] = run.start_speed
    for i, variable in enumerate(plant.inputs):
        plant[variable.name] = run.inputs[0, i]
    plant.initialize()
    table = plant.simulate(run.inputs[:, :len(plant.inputs)], STEP, run.start, propagated=True)
    return {variable.name: table[:, i] for i, variable in enumerate(plant.output_variables)}


def test_without_anchors_it_is_the_full_order_plant(car_and_run):
    car, run = car_and_run
    run = replace(run.free, start=0.0)  # its sensors sample every millisecond, which cuts steps that begin between
    itself, free = on_its_own(car.values, run), car.raw(car.values | FINE, run)
    assert set(free) == {*CHANNELS, "axle_shaft_torque", "crankshaft_torque", "differential_speed"}
    for name in set(free) & set(itself) - {"differential_acceleration"}:
        assert np.array_equal(free[name], itself[name]), name


@pytest.mark.parametrize("changes", [{}, {"torque_ripple.amplitude": 10.0}, {"engine.torque_noise": 5.0}],
                         ids=["as it is", "ripple", "noise"])
def test_steps_taken_at_once_show_what_short_steps_show(car_and_run, by_short_steps, changes):
    """To a twentieth of what a sensor can tell; where there is noise of the torque it cuts steps as it changes."""
    car, run = car_and_run
    values = car.values | changes
    at_once = car.raw(values, run)
    by_short_steps()
    short = car.raw(values | {"solver.maximum_substep": STEP / 20.0}, run)
    for name, floor in FLOORS.items():
        rms = np.sqrt(np.mean((at_once[name] - short[name]) ** 2))
        assert 0.0 < rms < 0.05 * floor, name
    without = car.raw(car.values | {"solver.maximum_substep": STEP / 20.0}, run)
    assert np.array_equal(without["engine_speed"], short["engine_speed"]) == (not changes)


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


def test_what_stays_one_number_in_a_stretch_is_not_compared_there():
    """A coarse speed in a cruise: nothing says how finely it is read, so any error had counted as one of its noise."""
    car = FullOrderCar("suv_6l80")
    coarse = a_drive(car, (4, 5), vehicle_speed=lambda t: np.where(t < 7.5, 20.0, np.round(20.0 + 2.0 * np.sin(t))))
    first, second = car.runs(coarse)
    assert "vehicle_speed" not in first.clocks and "vehicle_speed" in second.clocks
    assert "vehicle_speed" in first.anchors
    assert floors([first, second])["vehicle_speed"] > 0.1


@pytest.mark.parametrize(("stop", "said"), [(1.99, "1.99"), (1.9999, "1.999"), (0.5, "0.5"), (-1.0, "0")])
def test_too_short_is_never_said_to_be_as_long_as_is_needed(stop, said):
    times = {"engine_speed": np.array([0.0, 5.0]), "engine_torque": np.array([-9.0, stop])}
    short = Manoeuvre("short", "", 4, {name: Channel(name, CANONICAL[name].unit, time, np.ones(2), "")
                                       for name, time in times.items()})
    with pytest.raises(InputError, match=f"together are there for {said} s; at least 2 s are needed"):
        FullOrderCar("suv_6l80")._span(short)


@pytest.mark.parametrize("plant", [FullOrderCar("suv_6l80"), Bench("dyno_5nm")])
def test_a_clock_in_another_unit_than_it_is_read_in_is_asked_for(plant):
    """Milliseconds taken for seconds would be simulated for hours."""
    time = np.arange(0.0, 5000.0, 10.0)
    names = ("engine_torque", "wheel_speed", "motor_torque", "motor_speed")
    wrong = Manoeuvre("m", "tip_in", 4, {n: Channel(n, CANONICAL[n].unit, time, np.sin(time), n) for n in names})
    with pytest.raises(InputError, match="torque are 10 s apart, and at most 1 s are of use: is the unit of its clock"):
        plant.runs(Measurement("m", plant.vehicle, None, (wrong,)))


def test_nobody_knows_what_drove_in_a_pause_of_the_logger(measurement, car_and_run):
    car, _ = car_and_run
    [manoeuvre] = measurement.manoeuvres
    assert car.whole(manoeuvre) is not None
    for pause, known in ((10.0, True), (80000.0, False)):
        paused = {name: replace(c, time=c.time + pause * (c.time > 3.0)) for name, c in manoeuvre.channels.items()}
        assert (car.whole(replace(manoeuvre, channels=paused)) is not None) == known


def test_a_dead_speed_neither_leads_the_plant_nor_tells_its_gear():
    car = FullOrderCar("suv_6l80")
    for dead in ("engine_speed", "turbine_speed"):
        measured = a_drive(car, (4, 4), vehicle_speed=lambda t: 0.36 * (60.0 + np.sin(t)), **{dead: np.zeros_like})
        [run] = car.runs(measured)
        assert run.gear == 4 and dead not in run.clocks and dead not in run.anchors
    [manoeuvre] = a_drive(car, (4, 4), vehicle_speed=np.zeros_like).manoeuvres
    [run] = car.runs(Measurement("m", car.vehicle, None, (replace(manoeuvre, kind="ramp", gear=4),)))
    assert "vehicle_speed" not in run.anchors
    assert run.start_speed == pytest.approx(60.0 * car.values["tyre.radius"], rel=0.05)


def test_a_sensor_that_always_reads_the_same_is_left_out_and_that_is_told():
    car = FullOrderCar("suv_6l80")
    [run], _, told = car.stretches(a_drive(car, (4,), seat_acceleration=np.zeros_like))
    assert "seat_acceleration" not in run.clocks and "wheel_speed" in run.clocks
    assert told == ["drive: seat_acceleration always reads 0, so it is left out"]
    dead = a_drive(car, (4,), gear=4, **dict.fromkeys(("engine_speed", "turbine_speed", "wheel_speed"), np.zeros_like))
    with pytest.raises(InputError, match="has no speed: .*wheel_speed always reads 0"):
        car.runs(dead)


@pytest.mark.parametrize("turbine", [np.zeros_like, lambda t: 65.0 + np.sin(t)])  # in gear, in neutral
@pytest.mark.parametrize("gear", [None, 4])
def test_a_car_that_idles_has_no_dead_speeds_but_stands(gear, turbine):
    """With a gear it was one that rolls at what its idling engine turns in that, and was fitted; without one it was
    refused, with all others."""
    car = FullOrderCar("suv_6l80")
    shown = a_drive(car, (4, 4), gear=gear, vehicle_speed=lambda t: 0.36 * (60.0 + np.sin(t)))
    [drive] = shown.manoeuvres
    rolling = replace(drive, name="rolling", kind="tip_in")
    speeds = {"engine_speed": lambda t: 68.0 + np.sin(t), "turbine_speed": turbine,
              **dict.fromkeys(("wheel_speed", "vehicle_speed"), np.zeros_like)}
    idles = replace(rolling, name="idles", channels={
        name: replace(of, values=speeds[name](of.time)) if name in speeds else of
        for name, of in drive.channels.items()})
    [run], _, told = car.stretches(replace(shown, manoeuvres=(idles, rolling)))
    assert run.name == "rolling" and len(told) == 1 and "it begins at a standstill" in told[0]


def test_what_begins_at_a_standstill_is_left_out_and_that_is_told():
    """A recording of two that was left out without a word was called one recording; with the only one of them it was
    said that nothing changes."""
    car = FullOrderCar("suv_6l80")
    shown = a_drive(car, (4, 4), gear=4)
    [drive] = shown.manoeuvres
    rolling = replace(drive, name="rolling", kind="tip_in")
    begins = {name: replace(of, values=np.where((of.time < 9.0) & name.endswith("speed"), 0.0, of.values))
              for name, of in drive.channels.items()}
    stands = replace(rolling, name="stands", channels=begins)
    [run], _, told = car.stretches(replace(shown, manoeuvres=(stands, rolling)))
    assert run.name == "rolling"
    assert told == ['stands: nothing is compared from 0 to 14 s: it begins at a standstill or walking pace; where it '
                    'rolls later, write start = "... s" in its [[manoeuvre]]']
    with pytest.raises(InputError, match="nothing to compare; stands: .* a standstill"):
        car.runs(replace(shown, manoeuvres=(stands,)))
    standing = replace(drive, channels={**begins, "turbine_speed": begins["engine_speed"]})
    assert car.stretches(replace(shown, manoeuvres=(standing, rolling))).left_out == []


def test_a_run_can_be_compared_by_some_channels_only(car_and_run):
    _, run = car_and_run
    some = run.only({"engine_speed", "odd"})
    assert list(some.clocks) == list(some.measured) == ["engine_speed"]
    assert np.array_equal(some.stacked, run.measured["engine_speed"])


@pytest.mark.parametrize(("zero", "cut"), [(40000.0, 0.0), (300.0, 0.0), (0.0, 1.5), (-7.0, 1.5)])
def test_a_logger_drifts_from_when_it_began_whatever_its_clock_says(measurement, car_and_run, zero, cut):
    car, run = car_and_run
    [manoeuvre] = measurement.manoeuvres
    later = {name: replace(channel, time=channel.time + zero) for name, channel in manoeuvre.channels.items()}
    if cut:
        later = {name: replace(c, time=c.time[c.time >= zero + cut], values=c.values[c.time >= zero + cut])
                 for name, c in later.items()}
    moved = replace(manoeuvre, channels=later, begun=manoeuvre.begun + zero)
    [other] = car.runs(replace(measurement, manoeuvres=(moved,)))
    shown = {}
    for drift in (0.0, 0.01):
        values = {**car.values, "observe.propeller_shaft_torque.clock_drift": drift}
        shown[drift] = [car.instruments(car.raw(values, r), values, r)[r.slices["propeller_shaft_torque"]]
                        for r in (run, other)]
    clocks = [r.clocks["propeller_shaft_torque"] for r in (run, other)]
    assert other.start == pytest.approx(run.start + cut, abs=0.02)
    moves = [np.interp(np.arange(3.0, 6.0, 0.004), clock, after - before)
             for clock, before, after in zip(clocks, shown[0.0], shown[0.01])]
    assert np.abs(moves[0]).max() > 1.0
    assert moves[1] == pytest.approx(moves[0], abs=0.2 * np.abs(moves[0]).max() if cut else 1e-3)
