"""How the estimators of a control unit profit from the extended vehicle: what is left for them to be surprised by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from cosim.diagnosis.plants import STEP, Run
from driveline.estimators import ESTIMATORS
from driveline.quantities import InputError
from driveline.vehicles import Vehicle

ASKED = ("dskse", "tkbse")
_FRAME = 0.01  # s
# What is compared: output, in words, unit, and how a run's values become one number.
_QUANTITIES = (("unexplained_torque", "torque its innovations stand for, rms", "N.m"),
               ("lash_size", "lash found, total at the propeller shaft", "rad"))


def profit(source: Vehicle, changes: Mapping[str, float], runs: Sequence[Run]) -> list[dict[str, Any]]:
    """What the thesis's estimators make of recordings, their driveline from the vehicle as it was and extended.

    Args:
        source: The vehicle as its file has it.
        changes: Its values that are other ones in the extended vehicle.
        runs: Recordings that were not used to find them; those without engine or wheel speed are passed over.

    Returns:
        Rows ``estimator, quantity, before, after, unit``; a lash that no tip-in showed is left out, and an estimator
        that had nothing to do: that of the lash waits for a tip-in.
    """
    rows = []
    extended = replace(source, values={**source.values, **changes})
    for name in ASKED:
        found: list[dict[str, list[float]]] = []
        for vehicle in (source, extended):
            heard: dict[str, list[float]] = {}
            for run in runs:
                if {"engine_speed", "wheel_speed"} <= set(run.clocks):
                    for quantity, value in _heard(name, vehicle, run).items():
                        heard.setdefault(quantity, []).append(value)
            found.append(heard)
        before, after = found
        rows += [{"estimator": name.upper(), "quantity": words, "before": float(np.mean(before[quantity])),
                  "after": float(np.mean(after[quantity])), "unit": unit}
                 for quantity, words, unit in _QUANTITIES if quantity in before and quantity in after]
    return rows


def delivered(vehicle: Vehicle, run: Run) -> np.ndarray:
    """The torque that the crankshaft got in a run by what was asked for, at ``run.time`` [N.m].

    That is what a control unit tells its estimators; what is asked for comes earlier, by what the air path takes.
    """
    delay, lag, gain, offset, taken = (vehicle.values.get(f"engine.{name}", default) for name, default in (
        ("air_delay", 0.0), ("air_lag", 0.0), ("torque_gain", 1.0), ("torque_offset", 0.0), ("accessory_torque", 0.0)))
    # an input holds over the step that ends at its instant
    asked = np.interp(run.time - 0.5 * STEP - delay, run.time - 0.5 * STEP, run.inputs[:, 0])
    keep = float(np.exp(-STEP / lag)) if lag > 0.0 else 0.0
    arrived, _ = lfilter([1.0 - keep], [1.0, -keep], asked, zi=[keep * asked[0]])
    return gain * arrived + offset - taken


def _heard(name: str, vehicle: Vehicle, run: Run) -> dict[str, float]:
    """What an estimator says of one recording."""
    begin = max(float(run.clocks[c][0]) for c in ("engine_speed", "wheel_speed"))
    times = np.arange(begin, run.time[-1], _FRAME)
    told = {"engine_torque": np.interp(times, run.time, delivered(vehicle, run))} | {
        channel: np.interp(times, run.clocks[channel], run.measured[channel])
        for channel in ("engine_speed", "wheel_speed")}
    kind = ESTIMATORS[name]
    try:
        values = kind.defaults_from(vehicle, run.gear)
        model = kind(values)
        first = {key: float(course[0]) for key, course in told.items()}  # it wakes up in the drive, not before it
        for key, value in (values | {"sampling.period": _FRAME} | first).items():
            model[key] = value
        model.initialize()
    except InputError:  # a vehicle that no file could hold, or no estimator can be made for: without lash, say
        return {}
    frames = np.tile([model[variable.name] for variable in model.inputs], (times.size, 1))
    for place, variable in enumerate(model.inputs):
        if variable.name in told:
            frames[:, place] = told[variable.name]
    table = {v.name: column for v, column in zip(model.output_variables, model.simulate(frames[1:]).T)}
    settled = table["unexplained_torque"][round(1.0 / _FRAME):]
    heard = {"unexplained_torque": float(np.sqrt(np.mean(settled**2)))} if settled.any() else {}
    if table.get("lash_size", np.zeros(1))[-1] > 0.0:
        heard["lash_size"] = float(table["lash_size"][-1])
    return heard
