"""Drives on roads that nobody measured, for the tests of several files."""

from dataclasses import replace

import numpy as np

from cosim.diagnosis.catalogue import apply_all
from cosim.diagnosis.plants import STEP, Run
from cosim.measured import CANONICAL, Channel, Manoeuvre, Measurement

FLOORS = {"engine_speed": 0.1, "turbine_speed": 0.1, "vehicle_speed": 0.02}
SLIP, MASS = "converter_slip:slip_target", "vehicle_mass"


def driven(car, random, number, hidden=(), kind="drive", slope=None):
    """Three seconds of a drive: the torque goes up or down, the road is any."""
    inputs = np.tile(car.idle_inputs, (3000, 1))
    columns = car.columns
    low, high = random.uniform(60.0, 120.0), random.uniform(150.0, 250.0)
    time = STEP * np.arange(1, 3001)
    inputs[:, columns["engine_torque"]] = low + (high - low) / (1.0 + np.exp(-(time - 1.5) / 0.15))
    inputs[:, columns["gear"]] = 5
    clock = time[300::20]
    run = Run(f"{number}", kind, 5, 0.0, inputs, 18.0, dict.fromkeys(FLOORS, clock), {})
    values = apply_all({cause.partition(":")[0]: {name: size} for cause, name, size in (
        (SLIP, "slip_target", 2.0), (MASS, "vehicle_mass", 0.8)) if cause in hidden}, car.values)
    uphill = inputs.copy()
    uphill[:, columns["road_grade"]] += random.uniform(-0.02, 0.02) if slope is None else slope
    noise = run.stack(FLOORS) * random.standard_normal(3 * clock.size)
    shown = car.predict(values, replace(run, inputs=uphill)) + noise
    return replace(run, measured={name: shown[place] for name, place in run.slices.items()})


def a_drive(car, gears, *, gear=None, wrong=1.0, **more):
    """Of channels that say nothing but speeds in a row of gears, 7 s each, all wrong by a factor."""
    time = np.arange(0.0, 7.0 * len(gears), 0.01)
    ratio = np.array([car.gearing.ratios[gears[int(t // 7.0)]] for t in time]) * car.values["final_drive.ratio"] * wrong
    wheel = 60.0 + np.sin(time)
    shown = {"engine_torque": 100.0 + 20.0 * np.sin(3.0 * time), "engine_speed": ratio * wheel,
             "turbine_speed": ratio * wheel, "wheel_speed": wheel, **{name: of(time) for name, of in more.items()}}
    channels = {name: Channel(name, CANONICAL[name].unit, time, values, name) for name, values in shown.items()}
    return Measurement("m", car.vehicle, None, (Manoeuvre("drive", "drive", gear, channels),))
