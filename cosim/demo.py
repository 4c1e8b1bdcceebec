"""The example measurement the package ships, and the demo that runs on it.

The measurement is *generated*: the full-order plant with a heavier vehicle and softer axle shafts than its
vehicle file says, sampled by several loggers with clocks and noise of their own. ``python -m cosim.demo``
writes it anew. Who runs the demo compares it with the plant as the vehicle file has it, and sees what
these two differences do.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from cosim import units
from cosim.files import write_text
from cosim.master.master import Master
from cosim.master.parameters import build_folders, vehicle_parameters
from cosim.master.scenario import SHIPPED, Scenario
from cosim.measured import CANONICAL
from cosim.report import plot_comparison, plot_signals
from cosim.result import Result
from cosim.signals import Table

FOLDER = SHIPPED / "demo"
VEHICLE, VARIANT, GEAR = "pickup_10r80", "modified", 5
CHANGED = {"vehicle.mass": 1.10, "axle_shaft.stiffness": 0.75}  # factors on the vehicle file
START_SPEED = "45 km/h"
STOP = 10.0  # s
# the driver: tip-in, tip-out, two pulses
TORQUE = Table(
    times=[0.0, 1.0, 1.05, 4.0, 4.1, 6.0, 6.05, 6.6, 6.65, 7.4, 7.45, 8.0, 8.05],
    data=[-20.0, -20.0, 250.0, 250.0, -20.0, -20.0, 150.0, 150.0, -20.0, -20.0, 150.0, 150.0, -20.0],
    unit="N.m")
# channel: column, unit, sampling period [s], jitter of the clock [s], noise and resolution [unit]
LOGGED = {
    "engine_torque": ("EngTrqCmd", "N.m", 0.010, 2e-4, 0.0, 0.25),
    "engine_speed": ("EngSpd", "rpm", 0.010, 5e-4, 1.0, 0.25),
    "turbine_speed": ("TurbSpd", "rpm", 0.010, 5e-4, 1.0, 0.25),
    "wheel_speed": ("WhlSpdRr", "rpm", 0.020, 1e-3, 0.15, 0.05),
    "vehicle_speed": ("VehSpd", "km/h", 0.050, 2e-3, 0.02, 0.01),
    "propeller_shaft_torque": ("PropTrq", "N.m", 0.005, 0.0, 2.0, 0.1),
    "seat_acceleration": ("SeatAcc", "m/s2", 0.005, 0.0, 0.02, 0.001),
}
_SIGNALS = {"propeller_shaft_torque": "plant.propeller_shaft_torque_measured"}  # behind the torque meter

_HEADER = f"""\
# Generated, not measured: the full-order plant of {VEHICLE} ({VARIANT}) in gear {GEAR} with
# {", ".join(f"{name} times {factor:g}" for name, factor in CHANGED.items())},
# sampled with irregular clocks and noise. `python -m cosim.demo` writes it anew.

vehicle = "{VEHICLE}"
variant = "{VARIANT}"

[[manoeuvre]]
file = "tip_in_5th.csv"
kind = "tip_in"
gear = {GEAR}

[channels.time]
column = "Time"
unit = "s"
"""


def generate(folder: Path = FOLDER, seed: int = 1) -> None:
    """Write the example measurement: ``measurement.toml``, and one CSV file as a logger writes it."""
    truth = _truth()
    random = np.random.default_rng(seed)
    rows: dict[float, dict[str, float]] = {}
    toml = _HEADER
    for name, (column, unit, period, jitter, noise, resolution) in LOGGED.items():
        clock = np.arange(random.uniform(0.0, period), STOP, period)
        clock = np.round(np.clip(clock + random.normal(0.0, jitter, clock.size), 0.0, STOP), 4)
        factor, offset = units.conversion(CANONICAL[name].unit, unit)
        values = np.interp(clock, truth.time, truth[_SIGNALS.get(name, f"plant.{name}")]) * factor + offset
        values = np.round((values + random.normal(0.0, noise, clock.size)) / resolution) * resolution
        for instant, value in zip(clock.tolist(), values.tolist()):
            rows.setdefault(instant, {})[column] = value
        toml += f'\n[channels.{name}]\ncolumn = "{column}"\nunit = "{unit}"\n'
    columns = [entry[0] for entry in LOGGED.values()]
    lines = [",".join(["Time", *columns])]
    for instant in sorted(rows):
        cells = (f"{rows[instant][column]:.6g}" if column in rows[instant] else "" for column in columns)
        lines.append(",".join([f"{instant:.4f}", *cells]))
    write_text(folder / "tip_in_5th.csv", "\n".join(lines) + "\n")
    write_text(folder / "measurement.toml", toml)


def _truth() -> Result:
    """The vehicle as it is in the example, which is not what the vehicle file says."""
    nominal = vehicle_parameters("plant_fom", VEHICLE, VARIANT, GEAR)
    master = Master(step=1e-3).add(
        "plant", "plant_fom", twin=True, vehicle=VEHICLE, variant=VARIANT, gear=GEAR,
        parameters={"start.vehicle_speed": START_SPEED,
                    **{name: factor * nominal[name] for name, factor in CHANGED.items()}})
    master.connect(TORQUE, "plant.engine_torque").connect(GEAR, "plant.gear")
    master.record("plant.*")
    return master.run(stop=STOP)


def run(out: Path, build: Callable[[Path], Iterable[Path]],
        say: Callable[[str], None], progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """From FMUs to pictures: build what is missing, run, compare, plot.

    Args:
        out: Where results and pictures go.
        build: Builds all FMUs into a folder.
        say: Told what happens.

    Returns:
        The comparison, the files written and how long it took.
    """
    began = time.perf_counter()
    if not any((folder / "plant_fom.fmu").is_file() for folder in build_folders()):
        say(f"building the FMUs into {build_folders()[0]}")
        for path in build(build_folders()[0]):
            say(f"  {path.name}")
    scenario = Scenario.load("demo")
    say("running the plant FMU on the example measurement, which is generated, not measured")
    result = scenario.run(progress)
    comparisons = scenario.compare(result)
    result.to_csv(out / "result.csv")
    result.to_parquet(out / "result.parquet")
    rows = [comparison.as_row() for comparison in comparisons]
    write_text(out / "comparison.json", json.dumps(rows, indent=2) + "\n")
    plot_comparison(comparisons, out / "comparison.png", f"{scenario.title} (measurement generated)")
    plot_signals(result, out / "signals.png", title=scenario.title)
    return {"measurement": "generated", "comparison": rows, "seconds": time.perf_counter() - began,
            "files": [str(out / name) for name in ("result.csv", "result.json", "result.parquet",
                                                   "comparison.json", "comparison.png", "signals.png")]}


if __name__ == "__main__":
    generate()
