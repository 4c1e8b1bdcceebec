"""From the torque request to the crankshaft: delay, lag, bounds, uncertainty."""

import numpy as np
import pytest
from runs import plant, run, steps

from driveline.elements.engine_torque import engine_friction, indicated_target

LAG, DELAY = 0.1, 0.0137
QUIET = {"engine.friction_constant": 0.0, "engine.friction_viscous": 0.0, "engine.accessory_torque": 0.0,
         "engine.idle_gain": 0.0, "engine.air_lag": LAG, "engine.air_delay": DELAY,
         "start.vehicle_speed": 15.0}


@pytest.mark.parametrize("dt", [0.25e-3, 1e-3, 2.5e-3, 10e-3, 50e-3])
@pytest.mark.parametrize("delay", [0.0, DELAY, 0.02])
def test_air_path_is_a_delay_and_a_first_order_lag_whatever_the_communication_step(dt, delay):
    model = plant("plant_fom", {**QUIET, "engine.air_delay": delay}, engine_torque=40.0)
    record = run(model, 0.5, dt, engine_torque=steps((0.0, 40.0), (0.1, 140.0)))
    since = np.clip(record["time"] - 0.1 - delay, 0.0, None)
    assert record["crankshaft_torque"] == pytest.approx(140.0 - 100.0 * np.exp(-since / LAG), rel=1e-10)


def test_without_a_lag_the_delayed_request_arrives_at_its_instant():
    changes = {**QUIET, "engine.air_lag": 0.0, "engine.air_delay": 0.0372}
    model = plant("plant_fom", changes, engine_torque=40.0)
    record = run(model, 0.2, engine_torque=steps((0.0, 40.0), (0.1, 140.0)))
    late = record["time"] > 0.1372
    assert record["crankshaft_torque"][late] == pytest.approx(140.0)
    assert record["crankshaft_torque"][~late] == pytest.approx(40.0)


def test_spark_gain_and_offset_act_on_the_crankshaft_as_written():
    """gain * spark * (request + friction) + offset - friction - accessories, at a running engine."""
    changes = {**QUIET, "engine.friction_constant": 20.0, "engine.accessory_torque": 5.0,
               "engine.torque_gain": 1.1, "engine.torque_offset": -7.0, "engine.air_lag": 0.0}
    model = plant("plant_fom", changes, engine_torque=100.0)
    record = run(model, 0.05, spark_efficiency=0.6)
    assert record["crankshaft_torque"] == pytest.approx(1.1 * 0.6 * 120.0 - 7.0 - 20.0 - 5.0)


def test_noise_is_seeded_held_over_its_period_and_of_its_standard_deviation():
    changes = {**QUIET, "engine.torque_noise": 3.0, "engine.noise_period": 0.01}
    first, again, other = (
        run(plant("plant_fom", {**changes, "engine.noise_seed": seed}, engine_torque=40.0), 10.0, dt)
        for seed, dt in ((1.0, 2.5e-3), (1.0, 1e-2), (2.0, 1e-2)))
    noise = first["crankshaft_torque"] - 40.0
    assert noise[3::4] == pytest.approx(again["crankshaft_torque"] - 40.0, abs=1e-9)
    assert np.abs(noise[3::4] - (other["crankshaft_torque"] - 40.0)).max() > 1.0
    held = noise.reshape(-1, 4)
    assert np.ptp(held[:, :3], axis=1).max() < 1e-9
    # 1000 values: the standard deviation is known to 1 / sqrt(2000), the mean to 3 / sqrt(1000)
    assert held[:, 0].std() == pytest.approx(3.0, rel=4.0 / np.sqrt(2000.0))
    assert abs(held[:, 0].mean()) < 4.0 * 3.0 / np.sqrt(1000.0)
    assert abs(np.corrcoef(held[1:, 0], held[:-1, 0])[0, 1]) < 4.0 / np.sqrt(1000.0)


def test_noise_that_is_not_there_cuts_no_step_until_it_is():
    """Steps that end on no multiple of its period are the same to the bit; sensors cut them every millisecond."""
    periods = [plant("plant_fom", {**QUIET, "engine.noise_period": period}, engine_torque=40.0)
               for period in (0.01, 1.7e-3)]
    records = [run(model, 0.28, 7e-3) for model in periods]
    assert all(np.array_equal(values, records[1][name]) for name, values in records[0].items())
    shaken = []
    for model in periods:
        model["engine.torque_noise"] = 3.0
        model.retune()
        shaken.append(run(model, 0.28, 7e-3, start=0.28)["crankshaft_torque"])
    assert np.ptp(shaken[0]) > 3.0 and not np.allclose(*shaken)


def test_friction_opposes_the_rotation_and_vanishes_at_standstill():
    assert engine_friction(0.0, 30.0, 0.08) == 0.0
    for speed in (0.1, 7.0, 400.0):
        assert engine_friction(speed, 30.0, 0.08) > 0.0
        assert engine_friction(-speed, 30.0, 0.08) == -engine_friction(speed, 30.0, 0.08)
    assert engine_friction(200.0, 30.0, 0.08) == pytest.approx(46.0)


def test_the_control_unit_asks_for_nothing_below_zero_above_the_maximum_or_below_idle():
    assert indicated_target(-100.0, 200.0, 46.0, 600.0, 68.0, 4.0) == 0.0  # fuel cut
    assert indicated_target(900.0, 200.0, 46.0, 600.0, 68.0, 4.0) == 600.0
    assert indicated_target(50.0, 200.0, 46.0, 600.0, 68.0, 4.0) == 96.0
    assert indicated_target(-100.0, 58.0, 35.0, 600.0, 68.0, 4.0) == 40.0  # governor: 4 per rad/s below idle
    assert indicated_target(80.0, 58.0, 35.0, 600.0, 68.0, 4.0) == 115.0


def test_overrun_is_bounded_by_friction_and_accessories():
    model = plant("plant_fom", {"start.vehicle_speed": 20.0}, engine_torque=-500.0)
    record = run(model, 0.1)
    engine = model.parameters.engine
    drag = (engine.friction_constant + engine.friction_viscous * record["engine_speed"]
            + engine.accessory_torque)
    assert record["crankshaft_torque"] == pytest.approx(-drag)


def test_idling_in_neutral_settles_where_the_governor_balances_the_drag():
    """gain (idle - speed) is what friction, accessories and the gearbox turned by the converter take."""
    model = plant("plant_fom", gear=0, lockup_command=0.0, engine_torque=-100.0)
    record = run(model, 10.0, 2e-3)
    engine, box = model.parameters.engine, model.parameters.transmission
    speed, turbine = record["engine_speed"][-1], record["turbine_speed"][-1]
    assert np.ptp(record["engine_speed"][-500:]) < 1e-4 * speed
    drag = engine.friction_constant + engine.friction_viscous * speed + engine.accessory_torque
    governed = engine.idle_gain * (engine.idle_speed - speed)
    assert record["crankshaft_torque"][-1] == pytest.approx(governed - drag, abs=1e-3)
    assert governed - drag == pytest.approx(box.loss_constant[1] + box.loss_viscous[1] * turbine, rel=0.05)
    assert 0.8 * engine.idle_speed < speed < engine.idle_speed
