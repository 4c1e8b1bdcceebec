"""A short run of every model, for whoever imports its FMU to compare with: NAME_reference.csv.

    python -m fmus.reference [NAME ...]

writes those of some models, all by default, each beside the slave it belongs to, from the model in process;
packaging puts it into the FMU's documentation. A tip-in in fifth gear from 12 m/s: the requested torque is
-30 N.m, from 0.2 s on it rises by 250 N.m/s. The first row holds the inputs and outputs at the start; then a
row every 10 ms holds the inputs of the step that ends there and the outputs at its end. The estimators get
the frames of the full-order plant in that run.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from driveline.estimators import ESTIMATORS
from driveline.model import Model
from driveline.models import MODELS, SHIPPED_GEAR, SHIPPED_VARIANT, SHIPPED_VEHICLE
from driveline.vehicles import load

from .packaging import FMUS, HERE

STEP, STEPS = 0.01, 120
START_SPEED = 12.0
COAST, RISE, RISE_START = -30.0, 250.0, 0.2
# What the estimators read of the plant.
FRAMES = {"engine_torque": "crankshaft_torque", "engine_speed": "engine_speed", "wheel_speed": "wheel_speed"}


def torque(step: int) -> float:
    """Requested torque [N.m] held over step number ``step``."""
    return COAST + RISE * max(0.0, step * STEP - RISE_START)


def started(name: str) -> Model:
    """A model as its FMU starts, at START_SPEED where it is a plant."""
    model = MODELS[name](MODELS[name].defaults_from(load(SHIPPED_VEHICLE, SHIPPED_VARIANT), SHIPPED_GEAR))
    if "start.vehicle_speed" in model.index:
        model["start.vehicle_speed"] = START_SPEED
    return model


def run(name: str) -> tuple[list[str], np.ndarray]:
    """Column names (time, inputs, outputs) and rows of the reference of one model."""
    model = started(name)
    plant = started("plant_fom") if name in ESTIMATORS else model
    plant["engine_torque"] = torque(0)
    plant.initialize()

    def feed() -> None:
        for target, source in FRAMES.items():
            if target in model.index and model is not plant:
                model[target] = plant[source]

    if model is not plant:
        feed()
        model.initialize()
    inputs = [v.name for v in model.variables if v.causality == "input"]
    outputs = [v.name for v in model.variables if v.causality == "output"]

    def row(time: float) -> list[float]:
        return [time, *(model[name] for name in inputs), *(model[name] for name in outputs)]

    rows = [row(0.0)]
    for step in range(STEPS):
        plant["engine_torque"] = torque(step)
        plant.step(step * STEP, STEP)
        if model is not plant:
            feed()
            model.step(step * STEP, STEP)
        rows.append(row((step + 1) * STEP))
    return ["time", *inputs, *outputs], np.array(rows)


def write(names: Iterable[str] = tuple(FMUS)) -> Iterator[Path]:
    """Write the reference of every FMU named beside its slave; gives each path."""
    for name in names:
        columns, rows = run(name)
        path = HERE / FMUS[name] / f"{name}_reference.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(rows.tolist())
        yield path


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the reference results of FMUs beside their slaves.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"some of {', '.join(FMUS)} (default: all)")
    wanted = parser.parse_args().names or [*FMUS]
    if unknown := sorted({*wanted} - {*FMUS}):
        parser.error(f"there is no {unknown[0]}: there are {', '.join(FMUS)}")
    for written in write(wanted):
        print(written.relative_to(HERE.parent))
