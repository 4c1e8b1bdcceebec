"""What speeds say of gears, and what a drive is cut into by them."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from drives import a_drive

from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.plants.gearing import LOCKED, Gearing, coupled
from driveline.quantities import InputError


@pytest.mark.parametrize("vehicle", ["pickup_10r80", "suv_6l80"])
def test_every_gear_is_the_nearest_to_its_own_ratio_and_speeds_roll_by_it(vehicle):
    gearing = Gearing.of(FullOrderCar(vehicle).values)
    assert list(gearing.ratios) == list(range(1, {"pickup_10r80": 11, "suv_6l80": 7}[vehicle]))
    for gear, ratio in gearing.ratios.items():
        assert gearing.nearest(1.03 * gearing.final_drive * ratio) == gear
        speed = {name: 20.0 / over for name, over in gearing.rolling(gear).items()}  # rad/s; of the vehicle m/s
        assert speed["vehicle_speed"] == 20.0
        assert gearing.radius * speed["wheel_speed"] == pytest.approx(20.0)
        assert speed["transmission_output_speed"] == pytest.approx(gearing.final_drive * speed["wheel_speed"])
        assert speed["engine_speed"] == speed["turbine_speed"] == pytest.approx(
            ratio * speed["transmission_output_speed"])
    assert set(gearing.rolling(0)) == {"vehicle_speed", "wheel_speed", "transmission_output_speed"}


@pytest.mark.parametrize("by", ["wheel_speed", "vehicle_speed", "gear"])
def test_a_drive_is_cut_where_its_speeds_or_who_knows_say_that_the_gear_changes(by):
    car, gears = FullOrderCar("suv_6l80"), (4, 5, 4, 6)
    measured = a_drive(car, gears, vehicle_speed=lambda t: car.gearing.radius * (60.0 + np.sin(t)))
    [drive] = measured.manoeuvres
    engaged = np.array(gears)[(drive["wheel_speed"].time // 7.0).astype(int)]
    told = replace(drive["wheel_speed"], name="gear", unit="1", values=engaged.astype(float))
    drive = replace(drive, channels={**drive.channels, "gear": told})
    drive = drive.without([name for name in ("wheel_speed", "vehicle_speed", "gear") if name != by])
    parts = np.array([part[:2] for part in car.gearing.parts(drive, 8.0, 20.0)])
    assert parts == pytest.approx(np.array([[8.0, 14.0], [14.0, 20.0]]), abs=0.03)
    found, further, _ = car.stretches(replace(measured, manoeuvres=(drive,)))
    assert not further
    assert [run.gear for run in found] == [4, 5, 4, 6]
    for i, run in enumerate(found):
        assert 7.0 * i <= run.start < run.time[-1] <= 7.0 * (i + 1)


@pytest.mark.parametrize("wrong", [1.0, 1.05, 0.95])
def test_stretches_are_in_the_gears_that_they_were_cut_by(wrong):
    """With a ratio 5 % off in all, that of the tenth gear alone is nearer to the ninth's."""
    car = FullOrderCar("pickup_10r80")
    found = car.runs(a_drive(car, (6, 7, 8, 10), wrong=wrong))
    assert [run.gear for run in found] == [6, 7, 8, 10]


def test_a_short_drive_is_compared_where_clutch_and_brake_let_it_be():
    car = FullOrderCar("suv_6l80")
    braked = a_drive(car, (4,), gear=4, brake_torque=lambda t: np.where(t > 4.0, 2000.0, 0.0))
    [run] = car.runs(braked)
    assert run.time[-1] < 4.0


def test_what_an_open_clutch_or_a_brake_drives_is_left_out_with_half_a_second_on_either_side():
    """A clutch that slips a little by its control is closed; in another manoeuvre than a drive its slip is a finding.
    """
    car = FullOrderCar("suv_6l80")
    turbine = a_drive(car, (4, 4)).manoeuvres[0]["turbine_speed"].values

    def turns(t):
        return turbine + LOCKED * (0.9 + 0.2 * ((t >= 3.0) & (t < 5.0)))

    [drive] = a_drive(car, (4, 4), engine_speed=turns, turbine_speed=lambda t: turbine,
                      brake_torque=lambda t: 50.0 * ((t >= 9.0) & (t < 10.0))).manoeuvres
    parts = coupled(drive, 0.0, 13.9)
    assert np.array(parts) == pytest.approx(np.array([[0.0, 2.5], [5.5, 8.5], [10.5, 13.9]]), abs=0.03)
    assert coupled(replace(drive, kind="tip_in"), 0.0, 13.9) == [(0.0, 13.9)]


@pytest.mark.parametrize(("off", "turns"), [(1.1, 3.9), (0.9, 3.19)])
def test_where_the_speeds_have_no_gears_ratio_a_drive_is_not_compared(off, turns):
    car = FullOrderCar("suv_6l80")
    between = off * car.gearing.ratios[4] * car.values["final_drive.ratio"]
    odd = a_drive(car, (4,), turbine_speed=lambda t: between * (60.0 + np.sin(t)))
    with pytest.raises(InputError, match=f"{turns} times as fast as the wheels, in gear 12.4, 7.28, .*write gear = N"):
        car.runs(odd)


@pytest.mark.parametrize(("wrong", "slips"), [(1.0, 0.06), (1.05, 0.0), (0.94, 0.06)])
def test_a_lash_that_is_crossed_or_a_radius_that_is_wrong_is_no_shift(wrong, slips):
    """A tip-in may carry the ratio off its gear's for a moment, which is what is to be looked at."""
    car = FullOrderCar("suv_6l80")
    ratio = wrong * car.gearing.ratios[4] * car.values["final_drive.ratio"]

    def turns(t):
        return ratio * (60.0 + np.sin(t)) * (1.0 + slips * (np.abs(t - 5.0) < 0.05))

    [run] = car.runs(a_drive(car, (4, 4), engine_speed=turns, turbine_speed=turns))
    assert (run.gear, run.start) == (4, 0.0) and run.time[-1] > 13.9


def test_a_gear_that_the_speeds_say_is_told_once(caplog):
    """Also where clocks are asked, for which the recording is made ready once more."""
    caplog.set_level(logging.INFO, "cosim")
    car = FullOrderCar("suv_6l80")
    measured = a_drive(car, (4,))
    tip_in = replace(measured, manoeuvres=(replace(measured.manoeuvres[0], name="a", kind="tip_in"),))
    [run] = car.runs(tip_in)
    assert car.whole(tip_in.manoeuvres[0]).gear == run.gear == 4
    assert caplog.text.count("a: the speeds say gear 4") == 1
    car.runs(a_drive(car, (4,), gear=4))
    assert caplog.text.count("the speeds say gear") == 1
