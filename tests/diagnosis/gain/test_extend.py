from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.catalogue import apply, effect
from cosim.diagnosis.gain.extend import changed_values, co_simulate, gain, read_off, write_vehicle
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.measured import load
from driveline import vehicles
from driveline.plants.full_order import FullOrderPlant


@pytest.fixture(scope="module")
def car():
    return FullOrderCar("pickup_10r80", "modified")


def test_the_extended_file_holds_what_was_found_and_everything_else_as_it_was(car, tmp_path):
    values = apply(effect("coulomb_drag"), {"coulomb_drag_torque": 40.0}, car.values)
    values = apply(effect("vehicle_mass"), {"vehicle_mass": 1.1}, values)
    changes = changed_values(car.values, values)
    assert set(changes) == {"coulomb_drag.torque", "vehicle.mass"}
    path = write_vehicle(car.source, changes, car.units, 'why "it" is so', tmp_path / "extended.toml")
    read = vehicles.load(path)
    assert read.values["coulomb_drag.torque"] == 40.0
    assert read.values["vehicle.mass"] == pytest.approx(1.1 * car.values["vehicle.mass"])
    assert {k: v for k, v in read.values.items() if k not in changes} == {
        k: v for k, v in car.source.values.items() if k not in changes}
    FullOrderPlant(FullOrderPlant.defaults_from(read)).initialize()


def test_whatever_a_source_says_the_extended_file_says_and_can_be_read(car, tmp_path):
    odd = 'two\nlines, a "quote", a \\ and \x01 \x7f'
    source = replace(car.source, sources=car.source.sources | {"seat.mass": odd})
    path = write_vehicle(source, {"vehicle.mass": 2000.0}, car.units, "of\nm", tmp_path / "extended.toml")
    read = vehicles.load(path)
    assert read.sources["seat.mass"] == odd and read.sources["vehicle.mass"] == "of\nm"


def test_errors_of_sensors_are_no_part_of_a_vehicle(car):
    values = apply(effect("wheel_speed_delay"), {"wheel_speed_delay": 0.03}, car.values)
    assert changed_values(car.values, values) == {}


@pytest.mark.parametrize("later", [0.0, 292.6960000000427])  # a clock that counts no nanoseconds
def test_the_fmu_drives_a_recording_as_the_twin_does(later, car, fmus, tmp_path, by_short_steps):
    hide([], 3, tmp_path / "m", structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(tmp_path / "m")
    own = FullOrderCar(measurement.vehicle, measurement.variant)
    run = own.runs(measurement)[0].free
    run = replace(run, start=run.start + later, clocks={name: clock + later for name, clock in run.clocks.items()})
    # short: the FMU's sensors sample every millisecond, which cuts steps that begin between; the twin has none
    substep = {"solver.maximum_substep": 5e-5}
    outputs = co_simulate(fmus["plant_fom"], {**substep, "start.vehicle_speed": run.start_speed}, run, run.start_speed)
    at_once = own.raw(own.values | substep, run)
    by_short_steps()
    raw = own.raw(own.values | substep, run)
    for name in ("engine_speed", "propeller_shaft_torque"):
        assert np.max(np.abs(outputs[name] - raw[name])) < 1e-6 * np.ptp(raw[name])
        assert np.max(np.abs(outputs[name] - at_once[name])) < 2e-5 * np.ptp(raw[name])
    rows = gain([run], lambda extended, run: raw, lambda extended, run: own.values, {name: 1.0 for name in run.clocks})
    assert all(row.nrmse_before == row.nrmse_after for row in rows) and len(rows) == len(run.clocks)


def test_what_one_reads_off_a_recording_is_right_after_though_its_waves_come_late(tmp_path):
    """Soft shafts, and a torque that is a moment earlier than the plant knows: most of the error in time stays."""
    hide(["shaft_stiffness=axle_shaft_stiffness:0.6", "engine_torque_delay=-15 ms"], 3, tmp_path / "m",
         structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(tmp_path / "m")
    own = FullOrderCar(measurement.vehicle, measurement.variant)
    run = own.runs(measurement)[0].free
    before, after = (own.predict(apply(effect("shaft_stiffness"), {"axle_shaft_stiffness": size}, own.values), run)
                     for size in (1.0, 0.6))
    place = run.slices["engine_speed"]
    was, now = (np.std(run.stacked[place] - shown[place]) for shown in (before, after))
    assert now > 0.7 * was
    rows = read_off(run, before, after, [("engine_speed", "amplitude"), ("engine_speed", "no such feature")])
    amplitude, *others = rows
    assert (amplitude["feature"], amplitude["before"]) == ("amplitude", pytest.approx(1.0))
    [frequency] = [row for row in others if (row["signal"], row["feature"]) == ("engine_speed", "shuffle frequency")]
    for row in (amplitude, frequency):
        assert abs(row["before"] / row["measured"] - 1.0) > 0.1
        assert row["after"] == pytest.approx(row["measured"], rel=0.01)
    assert frequency["unit"] == "Hz" and {row["manoeuvre"] for row in rows} == {run.name}
