"""Truth and readings of the estimators' studies, on signals whose answer is known, and twins against FMUs."""

import numpy as np
import pytest

from cosim.result import Result
from cosim.studies.estimation import (
    MISSED,
    Bus,
    Drive,
    Estimates,
    Reading,
    estimated_traversal,
    every,
    has_parameter,
    largest_difference,
    listen,
    measure_position,
    measure_size,
    position_estimators,
    run_plant,
    size_errors,
    size_estimators,
    size_readings,
    sizes_after,
    through_master,
    traversal_error,
    true_traversal,
)
from cosim.studies.torque_profiles import ramp, ramps
from driveline.quantities import InputError

TIME = np.arange(4001) / 1000.0
SHORT = Drive(stop=1.6)


def plant_at(position):
    return Result(TIME, {"lash_position": position}, {"lash_position": "rad"})


def crossing(start, end, half):
    """Leaves the coast flank with the square of time and arrives."""
    return half * np.clip(2.0 * np.square(np.clip((TIME - start) / (end - start), 0.0, 1.0)) - 1.0, -1.0, 1.0)


def test_truth_is_the_last_departure_before_the_first_arrival():
    half = 0.5 * SHORT.lash_size()
    lifted = np.where((TIME > 1.1) & (TIME < 1.15), -0.9 * half, -half)  # lifts off and falls back
    position = np.maximum(crossing(1.2004, 1.3337, half), lifted)
    position[TIME > 2.0] = -half
    position = np.maximum(position, crossing(3.0, 3.1, half))
    found = true_traversal(plant_at(position), SHORT)
    assert found.start == pytest.approx(1.2004, abs=1e-5) and found.end == pytest.approx(1.3337, abs=2e-5)


@pytest.mark.parametrize("position", [np.full(TIME.size, -1.0), np.full(TIME.size, 1.0)])
def test_truth_needs_a_traversal(position):
    with pytest.raises(ValueError, match="a torque that"):
        true_traversal(plant_at(0.5 * SHORT.lash_size() * position), SHORT)


def test_an_estimator_is_taken_at_its_word_about_the_first_traversal():
    time = np.arange(1, 401) / 100.0
    contact = np.where(time < 1.2, -1.0, np.where(time < 1.35, 0.0, 1.0))
    contact[time < 0.5] = 1.0  # what it says before the tip-in does not count
    end = np.where(time < 1.3745, 1.35, 1.348)  # it looks back, and corrects itself
    end[time > 2.0] = 9.0
    contact[time > 1.9] = 0.0
    estimates = Estimates(time, {"contact": contact, "traversal_start": np.full(400, 1.2), "traversal_end": end})
    found = estimated_traversal(estimates, 1.0)
    assert (found.start, found.end) == (1.2, 1.348)
    assert estimated_traversal(estimates, 1.5) is None


def test_errors_have_a_sign_and_a_missed_traversal_counts():
    case = {"truth": [1.0, 1.2], "readings": [[1.0, 1.22], [1.05, 1.2], None]}
    assert [traversal_error(case, i) for i in range(3)] == pytest.approx([10.0, -25.0, MISSED])


def test_sizes_are_read_before_the_next_tip_in():
    drive = Drive(ramps(250.0, count=3), stop=14.5)
    time = np.arange(1, 1451) / 100.0
    estimates = Estimates(time, {"lash_size": np.floor((time - 1.0) / 5.0) + np.where(time % 5 < 1.3, 0.5, 0.0)})
    assert sizes_after(estimates, drive) == [0.5, 1.5, 2.0]
    assert size_errors({"truth": 2.0, "readings": [{"size": [1.0, 2.5]}]}, 0) == pytest.approx([-50.0, 25.0])


def test_estimators_are_found_by_what_they_give():
    assert position_estimators()[0] == "dskse" and size_estimators()[0] == "tkbse"
    assert "tkbse" not in position_estimators() and "dskse" not in size_estimators()
    assert has_parameter("dskse", "shaft.stiffness") and not has_parameter("dskse", "shaft.length")
    assert not has_parameter("dskse", "lash_position")


def test_without_delay_and_jitter_the_speeds_arrive_as_they_are():
    plant = run_plant(SHORT)
    for speed in ("engine_speed", "wheel_speed"):
        np.testing.assert_array_equal(plant[f"{speed}_measured"], plant[speed])


def test_delay_and_jitter_act_on_the_bus_alone():
    plain, late = run_plant(SHORT), run_plant(SHORT.with_bus(engine_delay=0.01, wheel_delay=0.03))
    np.testing.assert_array_equal(late["engine_speed"], plain["engine_speed"])
    for speed, ticks in (("engine_speed", 10), ("wheel_speed", 30)):
        np.testing.assert_array_equal(late[f"{speed}_measured"][ticks:], plain[speed][:-ticks])
    jittered = run_plant(SHORT.with_bus(engine_jitter=3))
    np.testing.assert_array_equal(jittered["wheel_speed_measured"], plain["wheel_speed"])
    taken = {value: tick for tick, value in enumerate(plain["engine_speed"].tolist())}
    rows = np.arange(1200, 1500)
    age = rows - np.array([taken[value] for value in jittered["engine_speed_measured"][rows].tolist()])
    assert age.min() == 0 and 3 <= age.max() <= 10  # jitter of up to 5 ms either way, frames in order


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_the_plants_lash_is_the_true_size(factor):
    drive = Drive(ramp(300.0), stop=2.0, lash=factor)
    position = run_plant(drive)["lash_position"]
    assert np.ptp(position) == pytest.approx(drive.lash_size(), rel=1e-9)
    assert drive.lash_size() == pytest.approx(factor * Drive().lash_size(), rel=1e-12)


def test_factors_change_the_estimator_and_not_the_plant():
    right, wrong = Reading("dskse").parameters(5), Reading("dskse", 0.005, (("vehicle.mass", 1.5),)).parameters(5)
    assert wrong["vehicle.mass"] == pytest.approx(1.5 * right["vehicle.mass"])
    assert {name for name in right if right[name] != wrong[name]} == {"vehicle.mass", "sampling.period"}


def test_covariances_have_factors_too():
    wrong = Reading("dskse", factors=(("noise.q_2", 100.0),)).parameters(5)
    assert wrong["noise.q_2"] == pytest.approx(1e5)


def test_readings_have_settings_and_know_delays_that_are_told():
    told = Reading("tkbse", settings=(("trigger.tip_ins", 1.0),), label="alone").told(Bus(0.01, 0.03))
    values = told.parameters(5)
    assert told.name == "alone, told" and Reading("tkbse").name == "tkbse"
    assert (values["trigger.tip_ins"], values["delay.engine_speed"], values["delay.wheel_speed"]) == (1.0, 0.01, 0.03)


def test_every_size_reading_has_its_own_name_at_a_period():
    readings = size_readings()
    assert len({(reading.name, reading.period) for reading in readings}) == len(readings)
    assert {reading.name for reading in readings} == {*size_estimators(), "tkbse of the thesis"}


def test_a_case_says_what_listening_says():
    readings = every(position_estimators(), (0.01, 0.001))
    case = measure_position(SHORT, readings)
    plant = run_plant(SHORT)
    assert case["truth"] == pytest.approx([true_traversal(plant, SHORT).start, true_traversal(plant, SHORT).end])
    found = estimated_traversal(listen(plant, readings[0], 5), 1.0)
    assert case["readings"][0] == [found.start, found.end]


def test_a_case_of_sizes_has_one_after_each_tip_in():
    drive = Drive(ramps(250.0, count=2), stop=10.0)
    case = measure_size(drive, [Reading("tkbse")])
    assert case["truth"] == drive.lash_size() and len(case["readings"][0]["size"]) == 2


def test_frames_come_with_the_plants_clock():
    with pytest.raises(InputError, match="a multiple of the plant's 0.001 s"):
        listen(run_plant(SHORT), Reading("dskse", 0.0025), 5)


def test_without_fmus_there_is_no_run_through_the_master(monkeypatch):
    def nothing_built(name):
        raise InputError("nothing is built")

    monkeypatch.setattr("cosim.studies.estimation.find_fmu", nothing_built)
    assert through_master(SHORT, [Reading("dskse")]) is None


@pytest.mark.parametrize("bus", [Bus(), Bus(engine_delay=0.01, wheel_delay=0.03, engine_jitter=3, wheel_jitter=4)])
def test_fmus_through_the_master_give_the_mass_runs_bit_for_bit(bus, fmus, tmp_path, monkeypatch):
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "fmus").symlink_to(fmus["plant_fom"].parent, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    drive = Drive(stop=1.5, bus=bus)
    readings = [Reading(name, period) for name in {*position_estimators(), *size_estimators()}
                for period in (0.01, 0.001)] + [Reading("dskse", 0.005, (("shaft.stiffness", 1.3),))]
    theirs, plant = through_master(drive, readings), run_plant(drive)
    for reading in readings:
        ours = listen(plant, reading, drive.gear)
        np.testing.assert_array_equal(theirs[reading].time, ours.time)
        assert largest_difference(ours, theirs[reading]) == 0.0, reading
