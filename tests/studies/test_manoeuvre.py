"""Reading shuffle and lash crossing off signals whose answer is known; model and FMU in the tip-in."""

import numpy as np
import pytest

from cosim.studies.manoeuvre import (
    TipIn,
    drive,
    drive_fmu,
    lash_crossing,
    parameters,
    shuffle,
    shuffle_after,
)
from driveline import vehicles
from driveline.models import MODELS
from driveline.plants.linear import shuffle_mode

TIME = np.arange(0.0, 3.0, 1e-3)


@pytest.fixture(scope="module")
def vehicle():
    return vehicles.load("pickup_10r80", "modified")


@pytest.mark.parametrize(
    ("frequency", "decay", "phase"), [(7.14, 5.0, 0.3), (4.39, 0.4, -2.0), (11.0, 8.0, 3.0)])
def test_shuffle_recovers_a_damped_sinusoid(frequency, decay, phase):
    t = TIME - 0.5
    signal = 280.0 - 3.0 * TIME + 12.0 * np.exp(-decay * t) * np.cos(2.0 * np.pi * frequency * t + phase)
    found = shuffle(TIME, signal, 0.5, 2.5)
    assert found.frequency == pytest.approx(frequency, rel=1e-6)
    assert found.decay == pytest.approx(decay, rel=1e-5)
    assert found.damping_ratio == pytest.approx(decay / np.hypot(decay, 2.0 * np.pi * frequency), rel=1e-5)
    assert found.amplitude == pytest.approx(12.0, rel=1e-5)
    assert np.angle(np.exp(1j * (found.phase - phase))) == pytest.approx(0.0, abs=1e-5)
    assert found.residual < 1e-6


def test_shuffle_wants_enough_samples():
    with pytest.raises(ValueError, match="at least 20"):
        shuffle(TIME, TIME, 0.5, 0.51)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("start", [0.5, 0.50037, 0.50081])
def test_lash_crossing_lies_between_the_samples(start, direction):
    half_gap, acceleration = 0.06, 20.0
    end = start + np.sqrt(2.0 * 2.0 * half_gap / acceleration)
    travel = np.where(start < TIME, 0.5 * acceleration * (TIME - start) ** 2, 0.0)
    position = direction * (np.minimum(travel, 2.0 * half_gap) - half_gap)
    found = lash_crossing(TIME, position)
    assert found.start == pytest.approx(start, abs=2e-6)
    assert found.end == pytest.approx(end, abs=2e-5)
    assert found.duration == pytest.approx(end - start, abs=2e-5)


def test_a_lash_that_is_not_crossed_is_an_error():
    with pytest.raises(ValueError, match="not crossed"):
        lash_crossing(TIME, np.full(TIME.size, -0.06))


@pytest.mark.parametrize("model", ["plant_rom_2dof", "plant_rom_3dof"])
def test_fit_of_the_tip_in_agrees_with_the_linearised_model(vehicle, model):
    tip_in = TipIn()
    values = parameters(model, vehicle)
    plant = MODELS[model](values)
    plant["start.vehicle_speed"], plant["engine_torque"] = tip_in.vehicle_speed, tip_in.after
    plant.initialize()
    expected = shuffle_mode(plant)
    found = shuffle_after(drive(model, values, tip_in), tip_in)
    assert found.frequency == pytest.approx(expected.frequency, rel=2e-3)
    assert found.damping_ratio == pytest.approx(expected.damping_ratio, rel=0.02)


def test_lash_crossing_does_not_depend_on_the_communication_step(vehicle):
    values = parameters("plant_rom_3dof", vehicle)
    found = [lash_crossing(r.time, r["lash_position"]) for r in (
        drive("plant_rom_3dof", values, TipIn(stop=1.5, step=step)) for step in (1e-3, 1e-4))]
    # the input is held over a step, so all is half a step late; what is left is read off between samples
    assert found[0].duration == pytest.approx(found[1].duration, abs=3e-4)
    assert found[0].end - found[1].end == pytest.approx(0.45e-3, abs=1e-4)


def test_less_takes_the_torque_off_everywhere():
    tip_in = TipIn(before=-30.0, after=200.0).less(4.0)
    assert tip_in.torque.values(np.array([0.0, 10.0])).tolist() == [-34.0, 196.0]
    assert tip_in.end == TipIn().end


@pytest.mark.parametrize("model", ["plant_fom", "plant_rom_3dof"])
def test_fmu_through_the_master_gives_the_run_in_process(vehicle, model, fmus, tmp_path, monkeypatch):
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "fmus").symlink_to(fmus[model].parent, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    tip_in, values = TipIn(stop=1.4), parameters(model, vehicle)
    ours, theirs = drive(model, values, tip_in), drive_fmu(model, values, tip_in)
    assert set(theirs.names) == set(ours.names)
    for name in ours.names:
        scale = 1.0 + np.abs(ours[name]).max()
        np.testing.assert_allclose(theirs[name], ours[name], atol=1e-9 * scale, rtol=0.0, err_msg=name)


def test_without_an_fmu_there_is_no_run_through_it(vehicle, monkeypatch):
    def nothing_built(name):
        from driveline.quantities import InputError
        raise InputError("nothing is built")

    monkeypatch.setattr("cosim.studies.manoeuvre.find_fmu", nothing_built)
    assert drive_fmu("plant_rom_3dof", parameters("plant_rom_3dof", vehicle), TipIn()) is None
