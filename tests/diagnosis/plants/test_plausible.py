"""Units and gears that are not right are said before anything is fitted to them."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar, plausible
from cosim.measured import Channel, Manoeuvre, Measurement, load
from driveline.quantities import InputError


def check(car, runs):
    """Of the recordings nothing but what runs say of them."""
    plausible.check(car, Measurement("m", None, None, ()), runs)


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


def test_clocks_are_asked_after_units(recorded, tmp_path):
    """A unit that is wrong would do anything to what is simulated; a clock that is late may turn a sign round."""
    hide([], 3, tmp_path / "m", manoeuvres=["pulse_train:4"])
    measurement = load(tmp_path / "m")
    manoeuvre = measurement.manoeuvres[0]
    torque = manoeuvre["propeller_shaft_torque"]

    def with_it(channel):
        late = replace(manoeuvre, channels={**manoeuvre.channels, channel.name: channel})
        return replace(measurement, manoeuvres=(late,))

    car = FullOrderCar(measurement.vehicle, measurement.variant)
    late = with_it(replace(torque, time=torque.time + 1.5))
    with pytest.raises(InputError, match="propeller_shaft_torque is about 1.5. s late"):
        plausible.check(car, late, car.runs(late))
    wrong = with_it(replace(torque, time=torque.time + 1.5, values=1e3 * torque.values))
    with pytest.raises(InputError, match="propeller_shaft_torque changes by .* is its unit right"):
        plausible.check(car, wrong, car.runs(wrong))


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
    ("propeller_shaft_torque", 1e-3, "propeller_shaft_torque changes by .*is its unit right"),
    ("propeller_shaft_torque", -1.0, "propeller_shaft_torque goes down where .* up: is its sign right"),
    ("seat_acceleration", -1.0, "seat_acceleration goes down where .* up: is its sign right"),
    ("seat_acceleration", 1.0 / 9.80665, "seat_acceleration is 0.0.*as if g were taken for m/s2"),
    ("seat_acceleration", 9.80665, "seat_acceleration is .*as if m/s2 were taken for g")])
def test_a_unit_that_is_not_right_is_said(recorded, channel, factor, said):
    car, runs = recorded
    with pytest.raises(InputError, match=said):
        check(car, with_units(runs, {channel: factor}))


@pytest.mark.parametrize(("one", "other"), [
    ("wheel_speed", "transmission_output_speed"), ("turbine_speed", "wheel_speed"), ("vehicle_speed", "wheel_speed")])
def test_two_speeds_under_the_names_of_one_another_are_said_to_be(recorded, one, other):
    """Of a wheel speed that was 3.31 times what the others make it, the final drive's ratio, the unit was asked."""
    car, runs = recorded
    turned = {one: other, other: one}
    exchanged = [replace(run, clocks={name: run.clocks[turned.get(name, name)] for name in run.clocks},
                         measured={name: run.measured[turned.get(name, name)] for name in run.clocks}) for run in runs]
    with pytest.raises(InputError, match=f"({one}.*and that of {other}|{other}.*and that of {one}) exchanged"):
        check(car, exchanged)


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


def test_signs_are_asked_of_the_vehicle_and_not_of_what_another_channel_says(recorded, tmp_path):
    """A channel that is wrong leads the simulation, and turned the seat round."""
    hide([], 1, tmp_path / "m", structure="same", manoeuvres=["tip_in:5"])
    measurement = load(tmp_path / "m")
    manoeuvre, = measurement.manoeuvres
    speed = manoeuvre["engine_speed"]
    twice = replace(manoeuvre, channels={
        **manoeuvre.channels, "engine_speed": replace(speed, values=2.0 * speed.values)})
    car, _ = recorded
    runs = car.runs(replace(measurement, manoeuvres=(twice,)))
    plausible._check_signs(car, runs)
    seat = {**runs[0].measured, "seat_acceleration": -runs[0].measured["seat_acceleration"]}
    with pytest.raises(InputError, match="seat_acceleration goes down"):
        plausible._check_signs(car, [replace(runs[0], measured=seat)])


@pytest.mark.parametrize("others", [1.0, -1.0])
def test_a_torque_that_goes_against_the_speeds_is_said(recorded, others):
    """Not that what is beside it has the other sign, whichever that has."""
    car, runs = recorded
    signs = np.where([name == "engine_torque" for name in car.columns], -1.0, 1.0)
    turned = [replace(run, inputs=signs * run.inputs) for run in with_units(runs, {"propeller_shaft_torque": others})]
    with pytest.raises(InputError, match="all else goes up where engine_torque goes down: is its sign right"):
        check(car, turned)
    check(car, [replace(run, inputs=0.1 * run.inputs) for run in turned])  # too little to tell


def test_what_cannot_be_simulated_the_other_way_round_is_no_error(recorded, monkeypatch):
    car, runs = recorded

    def stalls(values, run):
        if values["input.engine_torque.gain"] < 0.0:
            raise ArithmeticError("stalled")
        return run.stacked

    monkeypatch.setattr(car, "predict", stalls)
    check(car, runs)


def test_speeds_count_forward(recorded):
    """A run is made of what drives forward, so this is said where runs are made."""
    car, _ = recorded
    time = np.linspace(0.0, 5.0, 501)
    channels = {name: Channel(name, unit, time, level + time, name) for name, unit, level in (
        ("engine_torque", "N.m", 50.0), ("engine_speed", "rad/s", 150.0), ("wheel_speed", "rad/s", -60.0))}
    with pytest.raises(InputError, match="'m': wheel_speed is negative most of the time.*is its sign right"):
        car.runs(Measurement("m", None, None, (Manoeuvre("m", "tip_in", 4, channels),)))


def test_by_the_engine_alone_a_gear_is_told_from_slip(recorded):
    car, runs = recorded
    tip_in = next(run for run in runs if run.kind == "tip_in")
    alone = tip_in.only([name for name in tip_in.clocks if name != "turbine_speed"])
    check(car, [alone])
    for gear in (3, 5):
        with pytest.raises(InputError, match=f"as in gear 4; gear {gear}, as the measurement says"):
            check(car, [replace(alone, gear=gear)])
    # as far as an engine that drives turns faster than the turbine it slips
    torque = np.interp(alone.clocks["engine_speed"], alone.time, alone.inputs[:, car.columns["engine_torque"]])
    faster = np.where(torque > 0.0, 1.3, 1.0) * alone.measured["engine_speed"]
    check(car, [replace(alone, measured={**alone.measured, "engine_speed": faster}).only(
        [name for name in alone.clocks if name.endswith("speed")])])


def test_another_gear_than_the_measurement_says_is_named(recorded):
    car, runs = recorded
    with pytest.raises(InputError, match=f"{runs[0].name}: .*as in gear 4; gear 5, as the measurement says"):
        check(car, [replace(runs[0], gear=5), runs[1]])
    for enough in (("engine_speed", "turbine_speed", "wheel_speed"), ("turbine_speed", "wheel_speed", "vehicle_speed")):
        with pytest.raises(InputError, match="as in gear 4; gear 5, as the measurement says"):
            check(car, [replace(runs[0].only(enough), gear=5)])
    # of two speeds nobody knows whether the gear is not right or one of them
    check(car, [replace(runs[0].only(("turbine_speed", "wheel_speed")), gear=5)])
    blind = runs[0].only([name for name in runs[0].clocks if name != "turbine_speed"])
    torque = np.arange(len(car.columns)) == car.columns["engine_torque"]
    driving = replace(blind, gear=5, inputs=np.where(torque, np.maximum(blind.inputs, 1.0), blind.inputs))
    check(car, [driving])  # an engine that drives may turn faster than its turbine
    check(car, [replace(runs[0], gear=5, kind="drive")])  # one's gear is a channel, as quick as any


@pytest.mark.parametrize(("channel", "factor", "said"), [
    ("vehicle_speed", 3.6, "vehicle_speed is 3.* times .*as if km/h were taken for m/s"),
    ("propeller_shaft_torque", 1e-3, "propeller_shaft_torque changes by"),
    ("propeller_shaft_torque", -1.0, "propeller_shaft_torque goes down where .* up: is its sign right"),
    ("seat_acceleration", 1.0 / 9.80665, "seat_acceleration is 0.*as if g were taken for m/s2")])
def test_what_is_not_right_in_one_recording_of_three_is_said_to_be_in_that(recorded, channel, factor, said):
    """A vehicle speed in km/h in one file of three was the median's affair, and explained at length."""
    car, (first, second) = recorded
    for place in range(3):
        runs = [first, second, replace(first, name="again")]
        runs[place:place + 1] = with_units(runs[place:place + 1], {channel: factor})
        with pytest.raises(InputError, match=f"^{runs[place].name}: {said}"):
            check(car, runs)


def test_an_engine_torque_that_is_turned_round_in_one_recording_is_said_to_be_in_that(recorded):
    car, (first, second) = recorded
    inputs = second.inputs.copy()
    inputs[:, car.columns["engine_torque"]] *= -1.0
    with pytest.raises(InputError, match=f"^{second.name}: all else goes up where engine_torque goes down"):
        check(car, [first, replace(second, inputs=inputs), replace(first, name="again")])


def test_an_engine_whose_clutch_is_open_in_one_recording_is_possible(recorded):
    """It idles while the car rolls, or turns twice as fast."""
    car, (first, second) = recorded
    for factor in (0.4, 2.5):
        check(car, [first, *with_units([second], {"engine_speed": factor}), replace(first, name="again")])
