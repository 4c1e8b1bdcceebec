"""Units and gears that are not right are said before anything is fitted to them."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.plants.plausible import check
from cosim.measured import load
from driveline.quantities import InputError


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A car with another tyre, slip and torque meter, and its recordings."""
    folder = tmp_path_factory.mktemp("plausible") / "m"
    hide(["effective_radius=1.08", "converter_slip=slip_target:2", "torque_meter_gain=2"], 2, folder,
         manoeuvres=["tip_in:4", "tip_out:7"])
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    return car, car.runs(measurement)


def with_units(runs, factors):
    return [replace(run, measured={name: factors.get(name, 1.0) * values for name, values in run.measured.items()})
            for run in runs]


def test_what_the_catalogue_can_explain_is_possible(recorded):
    car, runs = recorded
    check(car, runs)
    check(car, [replace(run, measured={}, clocks={}) for run in runs])
    check(car, with_units(runs, {name: 0.0 for name in runs[0].measured if name.endswith("speed")}))  # it stands


@pytest.mark.parametrize(("channel", "factor", "said"), [
    ("wheel_speed", 30.0 / np.pi, "wheel_speed is .* times .*as if rpm were taken for rad/s"),
    ("engine_speed", np.pi / 30.0, "engine_speed is 0.1.*as if rad/s were taken for rpm"),
    ("engine_speed", 30.0 / np.pi, "engine_speed is .*as if rpm were taken for rad/s"),
    ("propeller_shaft_torque", 1e3, "propeller_shaft_torque changes by .* times what the gears make"),
    ("propeller_shaft_torque", 0.0, "propeller_shaft_torque changes by 0 times"),
    ("propeller_shaft_torque", 1e-3, "propeller_shaft_torque changes by .*is its unit right")])
def test_a_unit_that_is_not_right_is_said(recorded, channel, factor, said):
    car, runs = recorded
    with pytest.raises(InputError, match=said):
        check(car, with_units(runs, {channel: factor}))


@pytest.mark.parametrize(("is_", "taken", "factor"), [("km/h", "m/s", 3.6), ("km/h", "mph", 1.609344),
                                                      ("m/s", "km/h", 1.0 / 3.6)])
def test_the_units_that_were_mistaken_are_named(tmp_path, is_, taken, factor):
    hide([], 3, tmp_path / "m", manoeuvres=["tip_in:3"], vehicle="suv_6l80")
    measurement = load(tmp_path / "m")
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    with pytest.raises(InputError, match=f"vehicle_speed is .*as if {is_} were taken for {taken}"):
        check(car, with_units(car.runs(measurement), {"vehicle_speed": factor}))


def test_a_torque_that_no_engine_gives_is_said(recorded):
    car, runs = recorded
    with pytest.raises(InputError, match="engine_torque is up to .* at most 690"):
        check(car, [replace(run, inputs=1e3 * run.inputs) for run in runs])


def test_another_gear_than_the_measurement_says_is_named(recorded):
    car, runs = recorded
    with pytest.raises(InputError, match=f"{runs[0].name}: .*as in gear 4; gear 5, as the measurement says"):
        check(car, [replace(runs[0], gear=5), runs[1]])
    blind = {name: values for name, values in runs[0].measured.items() if name != "turbine_speed"}
    check(car, [replace(runs[0], gear=5, measured=blind)])  # an engine may turn faster than its turbine
    check(car, [replace(runs[0], gear=5, kind="drive")])  # one's gear is a channel, as quick as any
