"""What swings is put into a recording at the phase it has there."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from floors import FLOORS

from cosim.diagnosis.catalogue import effect
from cosim.diagnosis.diagnose import _values
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.gain import extend
from cosim.diagnosis.gain.swings import in_phase


@pytest.mark.parametrize("phase", [-2.0, 0.3, 3.0])
def test_the_phase_of_a_swing_is_found_in_every_recording(car_and_run, phase):
    """Also beside another, with noise, and where the size that was found is a fifth too large."""
    car, run = car_and_run
    both = {"observe.wheel_speed.eccentricity": 0.006, "observe.transmission_output_speed.eccentricity": 0.003}
    true = {f"{name}_phase": angle for name, angle in zip(both, (phase, 1.0))}
    noise = run.stack(FLOORS) * np.random.default_rng(3).standard_normal(run.stacked.size)
    shown = car.predict({**car.values, **both, **true}, run) + noise
    run = replace(run, measured={name: shown[place] for name, place in run.slices.items()})
    supposed = {name: 1.2 * size for name, size in both.items()}
    found = in_phase(car, {**car.values, **supposed}, run, FLOORS, effect("speed_sensor_eccentricity").nuisances)
    assert found.keys() == true.keys()
    for name in true:
        assert np.angle(np.exp(1j * (found[name] - true[name]))) == pytest.approx(0.0, abs=0.1)


def test_what_cannot_be_simulated_has_no_phase(car_and_run):
    car, run = car_and_run
    impossible = {**car.values, "axle_shaft.stiffness": -1.0}
    assert in_phase(car, impossible, run, FLOORS, effect("torque_ripple").nuisances) == {}


def test_the_extended_vehicle_swings_as_much_as_was_told_of_all_recordings(car_and_run):
    """Of two recordings, in which noise makes it 8 and 40 N.m; nobody knows its phase in the next."""
    car, run = car_and_run
    declared = coordinates(car, [run, run])
    point = np.array([{0: 8.0, 1: 40.0}.get(c.run, 0.0) if c.phase == "torque_ripple.phase" and c.part else 0.0
                      for c in declared])
    told = [{"effect": "torque_ripple", "parameters": {"torque_ripple_amplitude": {"value": 28.0}}}]
    fit = SimpleNamespace(causes=("torque_ripple",), shared=point)
    values = _values(Predictor(car, [run, run], declared), fit, told)
    assert extend.changed_values(car.values, values) == {"torque_ripple.amplitude": 28.0}
