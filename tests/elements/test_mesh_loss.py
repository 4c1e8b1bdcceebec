"""Losses oppose the rotation, and their fraction is one of the torque that passes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import plant, run

from driveline.elements.fade import fade
from driveline.elements.mesh_loss import loss_torque

NUMBERS = st.floats(-1e3, 1e3)
SIZES = st.floats(0.0, 1e2)


@given(NUMBERS, NUMBERS, SIZES, SIZES, st.floats(0.0, 0.9))
def test_losses_only_take(speed, carried, constant, viscous, fraction):
    loss = loss_torque(speed, carried, constant, viscous, fraction)
    assert loss * speed >= 0.0
    assert loss_torque(-speed, carried, constant, viscous, fraction) == -loss
    assert loss_torque(speed, -carried, constant, viscous, fraction) == loss


def test_well_above_the_fading_speed_the_law_is_the_plain_sum():
    assert loss_torque(50.0, -200.0, 3.0, 0.1, 0.02) == pytest.approx(3.0 + 0.02 * 200.0 + 0.1 * 50.0)


@given(st.floats(-1e6, 1e6))
def test_fading_is_a_smooth_odd_sign(x):
    assert -1.0 <= fade(x) <= 1.0
    assert fade(-x) == -fade(x)
    assert (fade(x) > 0.0) == (x > 0.0)


@pytest.mark.parametrize("gear", [1, 5, 10])
def test_the_gearbox_loses_its_tabulated_share(gear):
    """Steady acceleration a: crankshaft torque less losses less inertia times a reaches the gears."""
    model = plant("plant_fom", {"start.vehicle_speed": 12.0}, gear=gear, engine_torque=120.0)
    p, box = model.parameters, model.parameters.transmission
    a = {name: values[-1] for name, values in run(model, 1e-3).items()}
    ratio, carried = box.ratio[gear + 1], a["transmission_input_torque"]
    loss = (box.loss_constant[gear + 1] + box.loss_viscous[gear + 1] * a["turbine_speed"]
            + box.loss_fraction[gear + 1] * abs(carried))
    inertia = (p.engine.inertia + p.converter.impeller_inertia + p.lockup_clutch.plate_inertia
               + p.converter.turbine_inertia + box.input_inertia + box.inertia[gear + 1])
    acceleration = a["vehicle_acceleration"] / p.tyre.radius * p.final_drive.ratio * ratio
    assert carried == pytest.approx(a["crankshaft_torque"] - loss - inertia * acceleration, rel=2e-3)
    assert a["turbine_speed"] == pytest.approx(ratio * a["transmission_output_speed"], rel=1e-6)
