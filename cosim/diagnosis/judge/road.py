"""The slope of a road that nobody recorded: the one on which a car, left to itself, goes most nearly as it did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cosim.diagnosis.fit.predict import SLOPES
from cosim.diagnosis.plants import FullOrderCar, Run
from driveline.quantities import InputError

_STEP = 1e-3  # rad: of differences
_TURNS, _ENOUGH = 6, 1e-5  # of Gauss-Newton; rad: a smaller step ends it


def on_its_road(car: FullOrderCar, values: Mapping[str, float], run: Run, floors: Mapping[str, float]) -> Run:
    """A run left to itself, on the slope that suits a car best; where it is known, or no slope can be driven, as it is.

    Two cars are compared on a road of their own each: how steep it was depends on what the car is taken for.

    Args:
        values: Of the car.
        floors: Noise of each channel.
    """
    run = run.free
    if not run.unknown_road:
        return run
    scale, slope = run.stack(floors), 0.0

    def on(slope: float) -> Run:
        inputs = run.inputs.copy()
        inputs[:, car.columns["road_grade"]] += slope
        return replace(run, inputs=inputs, graded=True)

    def missed(slope: float) -> np.ndarray:
        return (run.stacked - car.predict(values, on(slope))) / scale

    for _ in range(_TURNS):
        try:
            left = missed(slope)
            by_slope = (left - missed(slope + _STEP)) / _STEP
        except (ArithmeticError, InputError):
            return run
        step = (by_slope @ left - slope / SLOPES**2) / (by_slope @ by_slope + 1.0 / SLOPES**2)
        slope += step
        if abs(step) < _ENOUGH:
            break
    return on(slope)
