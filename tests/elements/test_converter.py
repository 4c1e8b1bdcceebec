"""The hydrodynamic converter: its tables, its stall, and that it only ever makes heat."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import plant, run

from driveline.elements.converter import POINTS, Converter, converter_table, converter_torques
from driveline.quantities import InputError
from driveline.vehicles import load, names

SPEEDS = st.floats(-700.0, 700.0)
VEHICLES = pytest.mark.parametrize(  # benches have none
    "vehicle", [name for name in names() if "converter.speed_ratio[1]" in load(name).values])


def table(vehicle):
    values, columns = load(vehicle).values, ("speed_ratio", "torque_ratio", "capacity")
    return np.array([values[f"converter.{column}[{i}]"] for column in columns for i in range(1, POINTS + 1)])


@VEHICLES
def test_the_tables_give_their_own_points_and_lie_straight_between(vehicle):
    work = table(vehicle)
    ratio, torque_ratio, capacity = work.reshape(3, POINTS)
    for x in np.linspace(-0.2, 1.2, 57):
        assert converter_table(work, 0, x) == pytest.approx(
            (np.interp(x, ratio, capacity), np.interp(x, ratio, torque_ratio)), rel=1e-12, abs=1e-15)


@VEHICLES
@given(SPEEDS, SPEEDS)
def test_a_converter_only_makes_heat(vehicle, impeller, turbine):
    taken, given_ = converter_torques(table(vehicle), 0, impeller, turbine)
    assert taken * impeller - given_ * turbine >= -1e-9 * (1.0 + abs(taken * impeller))


@VEHICLES
def test_both_torques_pass_continuously_through_zero_at_equal_speeds(vehicle):
    work = table(vehicle)
    for speed in (0.0, 80.0, 300.0):
        for offset in (1e-7, -1e-7):
            assert np.abs(converter_torques(work, 0, speed + offset, speed)).max() < 1e-3
    assert converter_torques(work, 0, 100.0, 120.0)[0] < 0.0  # overrun: the turbine turns the engine


def test_torque_grows_with_the_square_of_the_speed():
    work = table("pickup_10r80")
    low, high = (np.array(converter_torques(work, 0, s, 0.63 * s)) for s in (100.0, 250.0))
    assert high == pytest.approx(6.25 * low)


def test_a_braked_vehicle_stalls_the_engine_where_capacity_meets_torque():
    """Steady stall: engine torque = capacity(0) w^2; the gearbox gets the torque ratio times that."""
    torque = 200.0
    quiet = {"engine.accessory_torque": 0.0, "lockup_clutch.drag": 0.0}
    model = plant("plant_fom", quiet, gear=1, lockup_command=0.0, brake_torque=9000.0, engine_torque=torque)
    record = run(model, 8.0, 2e-3)
    converter = model.parameters.converter
    assert record["engine_speed"][-1] == pytest.approx(np.sqrt(torque / converter.capacity[0]), rel=1e-5)
    at_turbine = torque * converter.torque_ratio[0]
    assert record["transmission_input_torque"][-1] == pytest.approx(at_turbine, rel=1e-5)
    assert abs(record["vehicle_speed"][-1]) < 1e-6


@pytest.mark.parametrize("change, named", [
    ({"speed_ratio": (0.0, 1.0)}, "converter.speed_ratio has 2 entries: 11"),
    ({"capacity": (1.0,) * 12}, "converter.capacity has 12 entries: 11"),
    ({"speed_ratio": (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.7, 0.8, 0.9, 1.0)}, "speed_ratio must ascend"),
])
def test_a_table_of_another_shape_is_refused_by_name(change, named):
    good = {"speed_ratio": tuple(np.linspace(0.0, 1.0, 11)), "torque_ratio": (1.0,) * 11,
            "capacity": (0.0,) * 11}
    Converter(0.1, 0.1, **good)
    with pytest.raises(InputError, match=named):
        Converter(0.1, 0.1, **{**good, **change})
