"""Predictions and their sensitivities."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from floors import FLOORS, measured, shortened

from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import WANDERS, Predictor, amplitude, coordinates, zero_of
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.plants.hats import hats


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


def test_what_is_not_there_cannot_be_taken_away(car_and_run):
    """Here the axle is rigid, and the torque meter has the filter of the file."""
    car, run = car_and_run
    by_name = {c.name: c for c in coordinates(car, [run])}
    compliance, period, gap = (by_name[name] for name in (
        "suspension_compliance", "torque_meter_filter_period", "backlash_shift"))
    assert compliance.low == 0.0 < compliance.high
    assert period.low == pytest.approx(-1.0 / car.values["torque_meter.stopband_frequency"])
    assert gap.high == car.values["final_drive.half_gap"]
    # all that there is may be gone; what is at an end of what is plausible would have to be beyond
    assert all(c.plausible(c.low) for c in (compliance, period, gap))
    assert not compliance.plausible(compliance.high) and not by_name["vehicle_mass"].plausible(
        by_name["vehicle_mass"].low)


def test_an_accelerometer_that_is_not_level_says_nothing_of_the_car(car_and_run):
    """At one degree a healthy car's log likelihood fell by thousands."""
    car, run = car_and_run
    short = shortened(run, 3.0)
    seat, scores = "seat_acceleration", []
    for tilt in (0.0, 0.17):
        tilted = replace(short, measured={**short.measured, seat: short.measured[seat] + tilt})
        with Predictor(car, [tilted], coordinates(car, [tilted])) as predictor:
            fitter = Fitter(predictor)
            file = fitter.nominal()
            noise = fitter.noise(file)
            fit = fitter.settle(fitter.refine(file, noise, 3), noise)
        scores.append(fit.score)
    [place] = [i for i, c in enumerate(predictor.coordinates) if c.name == zero_of(seat)]
    assert fit.points[0][place] == pytest.approx(0.17, abs=0.03)
    assert scores[1] == pytest.approx(scores[0], abs=2.0)


def test_a_damper_that_rubs_is_healthy(car_and_run):
    """Its one viscous number stands for friction: here there is a third of it, and 10 N.m of that."""
    car, run = car_and_run
    rubs = {"damper.damping": car.values["damper.damping"] / 3.0, "damper_friction.torque": 10.0}
    run = measured(car, run, car.raw(car.values | rubs, run.free))
    scores, declared = [], coordinates(car, [run])
    for known in (declared, [c for c in declared if c.name not in rubs]):
        with Predictor(car, [run], known) as predictor:
            fitter = Fitter(predictor)
            file = fitter.nominal()
            noise = fitter.noise(file)
            fit = fitter.settle(fitter.refine(file, noise, 3), noise)
            scores.append(fit.score)
    assert scores[0] > scores[1] + 10.0


def test_no_damper_rubs_by_less_than_nothing(car_and_run):
    car, run = car_and_run
    declared = coordinates(car, [run])
    less = np.array([-3.0 if c.name == "damper_friction.torque" else 0.0 for c in declared])
    values, _ = Predictor(car, [run], declared).values(less, 0)
    assert values["damper_friction.torque"] == 0.0


GAPS = ("transmission.half_gap", "final_drive.half_gap")


@pytest.mark.parametrize("changes", [
    {"engine.air_delay": 0.0},
    dict.fromkeys(GAPS, 0.0),
    {"coulomb_drag.torque": 40.0, "slip_control.target": 1.0, "asymmetric_friction.coast_loss_fraction": 0.1},
], ids=lambda changes: next(iter(changes)))
def test_a_car_with_none_of_something_or_more_than_others_is_fitted(car_and_run, changes):
    """With no delay in the file one that noise made 0.1 ms less was refused, and no fit moved at all."""
    _, run = car_and_run
    car = FullOrderCar("pickup_10r80", "modified", changes)
    zero = np.zeros(len(coordinates(car, [run])))
    heavier = car.raw(car.values | {"vehicle.mass": 1.2 * car.values["vehicle.mass"]}, run.free)
    with Predictor(car, [measured(car, run, heavier)], coordinates(car, [run])) as predictor:
        declared = predictor.coordinates
        assert all(c.low < c.high for c in declared)
        for i, c in enumerate(declared):
            for end in (c.low, c.high):
                if c.effect and c.run is None:
                    assert predictor.predict(np.eye(zero.size)[i] * np.clip(end, -c.spread, c.spread), 0) is not None
        fitter = Fitter(predictor)
        file = fitter.nominal()
        noise = fitter.noise(file)
        fitted = fitter.settle(fitter.assess(replace(file, causes=("vehicle_mass",)), noise), noise)
        [mass] = predictor.index("vehicle_mass")
    assert fitted.shared[mass] == pytest.approx(np.log(1.2), abs=0.01)


def test_what_the_file_has_of_an_effect_can_be_taken_away(car_and_run):
    car, run = car_and_run
    had = {"coulomb_drag.torque": 40.0, "slip_control.target": 1.0, "asymmetric_friction.coast_loss_fraction": 0.1}
    other = FullOrderCar(car.vehicle, car.variant, had)
    declared = coordinates(other, [run])
    gone = np.array([c.low if c.parameter and c.parameter.targets[0] in had else 0.0 for c in declared])
    assert np.count_nonzero(gone) == len(had)
    assert all(c.plausible(x) for c, x in zip(declared, gone) if x)
    values, _ = Predictor(other, [run], declared).values(gone, 0)
    assert values == pytest.approx(other.values | dict.fromkeys(had, 0.0))


@pytest.mark.parametrize("copies", [True, False])
def test_several_processes_say_the_same(car_and_run, monkeypatch, copies):
    """Also where the system has no copies of a process, as Windows."""
    monkeypatch.setattr("cosim.workers.COPIES", copies)
    car, run = car_and_run
    declared = coordinates(car, [run])
    zero = np.zeros(len(declared))
    columns = [0, 5, *(i for i, c in enumerate(declared) if c.name == WANDERS)]
    found = []
    for workers in (1, 2):
        with Predictor(car, [run], declared, workers) as predictor:
            found.append(predictor.jacobian([zero], predictor.all_runs([zero]), {0: columns})[0])
    assert np.array_equal(*found)


def test_runs_repeat_each_other_that_are_of_one_kind_gear_and_way(car_and_run):
    """Stretches of a drive and what nobody named repeat nothing."""
    car, run = car_and_run
    runs = [replace(run, kind=kind, gear=gear, back=back) for kind, gear, back in (
        ("ramp", 5, False), ("ramp", 5, True), ("ramp", 5, False), ("ramp", 3, False), ("step", 5, False),
        ("drive", 5, False), ("drive", 5, False), ("", 5, False), ("", 5, False))]
    assert Predictor(car, runs, []).repeats == [2, 1, 2, 1, 1, 1, 1, 1, 1]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_function_of_each_comes_back_in_order(car_and_run, workers):
    car, run = car_and_run
    with Predictor(car, [run], coordinates(car, [run]), workers) as predictor:
        assert predictor.each(abs, range(-30, 30)) == [abs(x) for x in range(-30, 30)]


def test_tasks_at_once_return_in_their_order_and_an_error_of_one_is_told(car_and_run):
    car, run = car_and_run
    declared = coordinates(car, [run])
    points = [x * np.eye(len(declared))[0] for x in (0.0, 0.05, 0.1, 0.15)]
    with Predictor(car, [run], declared, 2) as predictor:
        found = predictor.at_once([partial(predictor.all_runs, [point]) for point in points])
        assert np.array_equal(found, [predictor.all_runs([point]) for point in points])
        with pytest.raises(ZeroDivisionError):
            predictor.at_once([lambda: 1, lambda: 1 // 0])


def test_what_only_instruments_feel_takes_no_new_simulation(car_and_run, monkeypatch):
    """Also of more runs than a jacobian has side by side."""
    car, run = car_and_run
    runs, simulated = [run] * 6, []
    declared = coordinates(car, runs)
    monkeypatch.setattr(car, "raw", lambda *given, raw=car.raw: simulated.append(given) or raw(*given))
    predictor = Predictor(car, runs, declared)
    [offset] = predictor.index("torque_meter_offset")
    shown = []
    for size in (0.0, 5.0, -5.0):
        point = size * np.eye(len(declared))[offset]
        shown.append(predictor.all_runs([point] * len(runs))[-1])
    assert len(simulated) == len(runs)
    place = run.slices["propeller_shaft_torque"]
    assert shown[1][place] - shown[0][place] == pytest.approx(5.0) and not np.array_equal(shown[1], shown[2])


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


def test_what_noise_adds_to_a_swing_is_taken_off():
    """On average of its square, which is what noise adds to."""
    random, deviations = np.random.default_rng(1), np.full(6, 2.0)
    noisy = np.tile([3.0, 4.0], 3) + deviations * random.standard_normal((4000, 6))
    assert amplitude([3.0, 4.0] * 3) == pytest.approx(5.0)
    assert np.mean([amplitude(parts) ** 2 for parts in noisy]) == pytest.approx(25.0 + 8.0, rel=0.02)
    assert np.mean([amplitude(parts, deviations) ** 2 for parts in noisy]) == pytest.approx(25.0, rel=0.02)
    assert amplitude([1.0, 1.0], [2.0, 2.0]) == 0.0


@pytest.mark.parametrize("missing", [(), ("vehicle_speed",), ("vehicle_speed", "engine_speed")])
def test_the_slopes_of_a_row_of_hats_are_those_of_each(car_and_run, missing):
    """What leads forgets a hat; where the speed of the whole car is missing nothing does, and none shares a run."""
    car, run = car_and_run
    run = replace(run.only({*run.clocks} - {*missing}),
                  anchors={name: shown for name, shown in run.anchors.items() if name not in missing})
    declared = coordinates(car, [run])
    zero = np.zeros(len(declared))
    places = [i for i, c in enumerate(declared) if c.name == WANDERS]
    with Predictor(car, [run], declared) as predictor:
        base = predictor.all_runs([zero])[0]
        slopes = predictor.jacobian([zero], [base], {0: places})[0]
        one = zero.copy()
        one[places[40]] = 1.0
        alone = predictor.predict(one, 0) - base
    scale = run.stack(FLOORS)
    assert np.abs((slopes[:, 40] - alone) / scale).max() < 0.1 * np.abs(alone / scale).max()
    late = np.concatenate([clock > hats(run)[40] + 2.0 for clock in run.clocks.values()])
    left = np.sum(((slopes[:, 40] - alone) / scale)[late] ** 2)
    assert left < (1e-2 if missing else 0.2) * np.sum((alone / scale) ** 2)
