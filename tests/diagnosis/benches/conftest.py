"""A dynamometer's recordings, made up by its equations of motion."""

import numpy as np
import pytest

from cosim.diagnosis.plants import plant_for
from cosim.measured import load


@pytest.fixture
def made_up():
    """A function that writes a folder of measurements, and gives the plant and its runs."""
    return _made_up


def _made_up(folder, seconds=40.0, inertia=2.82e-5, rotor=8.26e-5, zero=0.0, gain=1.0, inline=True, seed=5, extra=None,
             lost=(), with_speed=False, late=()):
    """A dynamometer's recording by the equations of motion: sampled unevenly, quantised, noisy, with frames lost.

    ``late`` are pairs of a channel and of how late it is.
    """
    random = np.random.default_rng(seed)
    time = np.cumsum(random.choice([4.2e-3, 10e-3], int(seconds / 6e-3), p=[0.7, 0.3]))
    frequencies, phases = random.uniform(0.3, 6.0, 12), random.uniform(0.0, 6.28, 12)
    size = 400.0 / frequencies / np.sqrt(12.0)
    angle = np.zeros(time.size)
    speed, acceleration = np.zeros(time.size), np.zeros(time.size)
    for f, p, a in zip(2.0 * np.pi * frequencies, phases, size / (2.0 * np.pi)):
        angle += 2.0 * a / f * np.sin(f * time + p)
        speed += 2.0 * a * np.cos(f * time + p)
        acceleration -= 2.0 * a * f * np.sin(f * time + p)
    load_torque = inertia * acceleration + 7e-4 * np.sign(speed)
    torque = load_torque + rotor * acceleration + 0.0227 * np.sign(speed) + 5.2e-4 * speed
    torque = torque / gain + (0.0 if extra is None else extra(time, angle, speed))
    table = {"time": time, "motor_torque": torque + 0.01 * random.standard_normal(time.size),
             "motor_position": np.round(angle / 3.83e-4) * 3.83e-4,
             "inline_torque": np.round((load_torque + zero) / 1.25e-4) * 1.25e-4
             + 1e-3 * random.standard_normal(time.size)}
    if with_speed:
        table["motor_speed"] = speed + 0.01 * random.standard_normal(time.size)
    if not inline:
        del table["inline_torque"]
    header, kept = ",".join(table), np.ones(time.size, dtype=bool)
    for begin, end in lost:
        kept &= (time < begin) | (time > end)
    rows = np.column_stack(list(table.values()))[kept]
    np.savetxt(folder / "bench.csv", rows, "%.9g", ",", header=header, comments="")
    delays = dict.fromkeys(table, "") | {name: f"delay = {-seconds}\n" for name, seconds in late}
    channels = "".join(f'[channels.{name}]\ncolumn = "{name}"\n{delays[name]}' for name in table)
    (folder / "measurement.toml").write_text(
        f'vehicle = "dyno_5nm"\n{channels}[[manoeuvre]]\nfile = "bench.csv"\nkind = "bench"\n', encoding="utf-8")
    found = load(folder)
    plant = plant_for(found)
    return plant, plant.runs(found)
