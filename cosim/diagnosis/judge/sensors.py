"""Whether one sensor that errs explains what is left, in a way that no effect of the catalogue does.

A torque that is missing moves all that turns; an error of a sensor is in its own channel, and in what is led along it.
So errors of every channel are supposed as torques are at every place (``torques``), beside all that healthy cars may
differ by, and the evidence says which it is. Supposed is a delay, a factor, or anything that lasts; of the torque that
drives the simulation a delay: any other error of it is a torque that is missing at the engine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.diagnosis.fit.predict import Predictor
from cosim.diagnosis.judge.finding import DELAY, FACTOR
from cosim.diagnosis.judge.localise import Disturbance, Supposed, clearer
from cosim.diagnosis.judge.torques import HEIGHTS, LASTING, Torque, posterior
from cosim.diagnosis.plants import Run
from cosim.diagnosis.plants.hats import hats
from cosim.diagnosis.plants.led import ANCHORS, PLACES
from cosim.measured import CANONICAL

_DELAYS = tuple(sign * float(delay) for delay in np.geomspace(0.01, 0.3, 9) for sign in (1.0, -1.0))  # s
_FEWEST = 3  # channels: of two that contradict each other either may be wrong
_CONSTANT = len(_DELAYS) + 1  # errors that are supposed beside hats: these, and a factor
_LASTING = tuple(map(float, np.geomspace(0.3, 1000.0, 12)))  # sizes of an error that lasts, over the channel's noise
# Where what leads the simulation along a channel acts: a torque of which is missing there what the channel errs by.
_LED = {name: next(place for place, of in PLACES.items() if dict(of.nodes) == {anchor.node: 1.0})
        for name, anchor in ANCHORS.items()}


@dataclass(frozen=True)
class WrongSensor:
    """One channel that errs.

    Attributes:
        channel: Which.
        gain: Log evidence over that of no error.
        kind: ``DELAY``, ``FACTOR`` or ``LASTING``.
        size: It is so late [s], or shows so many times what is there; of an error that lasts its root mean square [SI
            unit of the channel].
    """

    channel: str
    gain: float
    kind: str
    size: float

    def as_json(self) -> dict[str, Any]:
        """As ``finding.json`` has it."""
        unit = {DELAY: "s", FACTOR: "1"}.get(self.kind, CANONICAL[self.channel].unit)
        return {"channel": self.channel, "kind": self.kind, "size": self.size, "unit": unit,
                "log_evidence": self.gain}


def wrong_sensors(supposed: Supposed) -> list[WrongSensor]:
    """Every channel, with the likeliest error of it; the most evident first.

    Args:
        supposed: All torques that may be missing, at every place.

    Returns:
        These, and the torque that drives the simulation.
    """
    channels = dict.fromkeys(name for run in supposed.runs for name in run.clocks)
    found = [_likeliest(supposed, channel) for channel in channels]
    return sorted([*found, _late_driver(supposed)], key=lambda sensor: -sensor.gain)


def odd_one(sensors: Sequence[WrongSensor], torques: Sequence[Disturbance]) -> WrongSensor | None:
    """The sensor that explains clearly more than any torque that is missing, and than any other sensor; or None."""
    if len(sensors) <= _FEWEST:  # what drives the simulation is one more
        return None
    first, *others = sensors
    rivals = [other.gain for other in (*others, *torques)]
    return first if all(clearer(first.gain, gain) for gain in rivals) else None


def _likeliest(supposed: Supposed, channel: str) -> WrongSensor:
    """The likeliest error of a channel. Errors count as what the best torque leaves, which makes it no likelier."""
    slopes = [_slopes(supposed, channel, r) for r in range(len(supposed.runs))]
    told = Torque(supposed.healthy, slopes, np.eye, False).information(supposed.left)
    floor = supposed.noise.floors[channel]
    tried = [_constant(channel, told, k, DELAY, delay) for k, delay in enumerate(_DELAYS, -_CONSTANT)]
    tried.append(_constant(channel, told, -1, FACTOR, 1.0))
    tried += [_that_lasts(channel, told, floor * size) for size in _LASTING]
    return _best(tried)


def _late_driver(supposed: Supposed) -> WrongSensor:
    """The likeliest delay of what drives the simulation, which moves all channels."""
    predictor, fit = supposed.predictor, supposed.fit
    car = predictor.car

    def later(run: Run, delay: float) -> Run:
        inputs, column = run.inputs.copy(), car.columns[car.driver]
        inputs[:, column] = np.interp(run.time + delay, run.time, inputs[:, column])
        return replace(run, inputs=inputs)

    # what the plant refuses explains nothing
    shown = [Predictor(car, [later(run, delay) for run in supposed.runs], predictor.coordinates).all_runs(fit.points)
             or fit.predicted for delay in _DELAYS]
    slopes = [np.column_stack([moved[r] - fit.predicted[r] for moved in shown]) / scale[:, None]
              for r, scale in enumerate(supposed.scales)]
    told = Torque(supposed.healthy, slopes, np.eye, False).information(supposed.left)
    return _best([_constant(car.driver, told, k, DELAY, delay) for k, delay in enumerate(_DELAYS, -len(_DELAYS))])


def _best(tried: Sequence[WrongSensor]) -> WrongSensor:
    """The likeliest of some errors of one channel, less what the choice among them is worth."""
    best = max(tried, key=lambda sensor: sensor.gain)
    return replace(best, gain=best.gain - math.log(len(tried)))


def _constant(channel: str, told: Sequence[tuple[np.ndarray, np.ndarray]], k: int, kind: str,
              unit: float) -> WrongSensor:
    """An error of the k-th kind that is constant, the same in all runs.

    Args:
        channel: Which.
        told: Of each run, what it says of the heights of all that is supposed.
        k: Of these, from the last.
        kind, unit: Of the error.
    """
    alone = [(matrix[np.ix_([k], [k])], vector[[k]]) for matrix, vector in told]
    mean, _, gain = posterior(alone, np.eye(1))
    return WrongSensor(channel, gain, kind, unit * float(mean[0]) + (kind == FACTOR))


def _that_lasts(channel: str, told: Sequence[tuple[np.ndarray, np.ndarray]], size: float) -> WrongSensor:
    """An error of some size that lasts, in each run another; arguments as ``_constant``."""
    heights, gains = [], []
    for matrix, vector in told:
        count = vector.size - _CONSTANT
        root = size * np.linalg.cholesky(HEIGHTS[LASTING][0](count))
        mean, _, gain = posterior([(matrix[:count, :count], vector[:count])], root)
        heights.append(mean)
        gains.append(gain)
    return WrongSensor(channel, sum(gains), LASTING, float(np.sqrt(np.mean(np.square(np.concatenate(heights))))))


def _slopes(supposed: Supposed, channel: str, r: int) -> np.ndarray:
    """What errors of a channel do to a run, in units of the noise: hats that are one high, each delay, and as much more
    as there is of it."""
    run, scale, predicted = supposed.runs[r], supposed.scales[r], supposed.fit.predicted[r]
    peaks = hats(run)
    shown = np.zeros((predicted.size, peaks.size + _CONSTANT))
    if channel not in run.clocks:
        return shown
    place, clock = run.slices[channel], run.clocks[channel]
    own, alone = predicted[place], replace(run, clocks={channel: clock})
    values, nuisance = supposed.predictor.values(supposed.fit.points[r], r)
    raw, name = supposed.predictor.car.raw(values, run, nuisance), f"observe.{channel}.delay"
    late = [supposed.predictor.car.instruments(raw, values | {name: values.get(name, 0.0) + delay}, alone) - own
            for delay in _DELAYS]
    rows = [np.interp(clock, peaks, hat) for hat in np.eye(peaks.size)]
    shown[place] = np.column_stack([*rows, *late, own])
    if channel in run.anchors:
        # what is led along it is pushed by what it errs by, and would not be
        errors = np.column_stack([np.interp(peaks, clock, error) for error in shown[place].T])
        led = supposed.torques[_LED[channel], LASTING].slopes[r] * scale[:, None]
        shown -= ANCHORS[channel].gain * led @ errors
    return shown / scale[:, None]
