"""Crankshaft torques that drive the estimators' studies: tip-ins and tip-outs of chapters 3 and 4.

The thesis shows its profiles in figures without numbers on the axes. Known are the steps of figure 4.5
(-20 to 60, 100 and 150 N.m), the steps and ramp rates of figures 3.8 and 3.9, ten tip-ins in 50 s, and that
steps have the first-order shape of the engine. The rest is chosen here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from cosim.signals import FirstOrder, Ramp, Signal

LOW, HIGH, RATE = -30.0, 200.0, 250.0  # of the validation ramp [N.m, N.m, N.m/s], as `manoeuvre.TipIn`
BEGIN = 1.0  # first tip-in [s]
ENGINE_LAG = 0.1  # [s], first-order lag of the engine; engine.air_lag of the vehicle file
TIP_INS, PERIOD, WIDTH = 10, 5.0, 2.5  # how many in one run, how far apart, how long [s]
LONG = PERIOD * TIP_INS  # length of a run for the size estimators [s]
SEED = 20190325  # of the random profile: arbitrary

Change = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class TorqueProfile(Signal):
    """A torque that is told again and again where to go.

    Attributes:
        low: At the start [N.m].
        changes: When [s], where to [N.m], and how fast [N.m/s], in order of time.
        lag: Time constant [s] of a first-order approach; 0 for ramps at the changes' own rates.
    """

    kind: ClassVar[str] = "torque_profile"
    low: float
    changes: tuple[Change, ...]
    lag: float = 0.0

    def values(self, time: np.ndarray) -> np.ndarray:
        time = np.asarray(time, dtype=np.float64)
        torque = np.full(time.shape, float(self.low))
        begin = self.low
        ends = [change[0] for change in self.changes[1:]] + [np.inf]
        for (start, target, rate), end in zip(self.changes, ends):
            after = time >= start
            torque[after] = self._towards(begin, target, rate, time[after] - start)
            begin = float(self._towards(begin, target, rate, np.float64(end - start)))
        return torque

    def _towards(self, begin: float, target: float, rate: float, elapsed: np.ndarray) -> np.ndarray:
        if self.lag:
            return target + (begin - target) * np.exp(-elapsed / self.lag)
        return begin + np.clip(target - begin, -rate * elapsed, rate * elapsed)

    def later(self, delay: float) -> TorqueProfile:
        """The same, ``delay`` [s] later."""
        return replace(self, changes=tuple((round(at + delay, 6), target, rate) for at, target, rate in self.changes))

    def spread(self, delay: float) -> TorqueProfile:
        """The same, each tip-in with its way back ``delay`` [s] more behind the one before."""
        changes, before, late = [], self.low, -delay
        for at, target, rate in self.changes:
            late += delay * (target > before)
            changes.append((round(at + max(late, 0.0), 6), target, rate))
            before = target
        return replace(self, changes=tuple(changes))

    @property
    def tip_ins(self) -> tuple[float, ...]:
        """When the torque is told to rise [s]."""
        before = (self.low, *(change[1] for change in self.changes[:-1]))
        return tuple(change[0] for change, torque in zip(self.changes, before) if change[1] > torque)


def step(torque: float, low: float = LOW) -> FirstOrder:
    """One step (figure 3.8)."""
    return FirstOrder(before=low, after=torque, time=BEGIN, time_constant=ENGINE_LAG)


def ramp(rate: float, torque: float = HIGH, low: float = LOW, begin: float = BEGIN) -> Ramp:
    """One ramp (figures 3.3 and 3.9)."""
    return Ramp(before=low, after=torque, time=begin, duration=(torque - low) / rate)


def steps(torque: float, low: float = -20.0) -> TorqueProfile:
    """Ten steps and the way back (figure 4.5)."""
    return _pulses(low, [(PERIOD, WIDTH, torque, np.inf)] * TIP_INS, ENGINE_LAG)


def ramps(rate: float, torque: float = HIGH, low: float = LOW, count: int = TIP_INS) -> TorqueProfile:
    """Ten ramps and the way back (figures 4.3 and 4.8)."""
    return _pulses(low, [(PERIOD, WIDTH, torque, rate)] * count)


def varying(number: int) -> TorqueProfile:
    """Ramps whose duty cycle (1) or also pulse width and distance (2) change (figure 4.11)."""
    if number == 1:
        shape = [(PERIOD, 1.25 + 0.25 * i, HIGH, RATE) for i in range(TIP_INS)]
    else:
        periods = (3.5, 6.5, 4.0, 6.0, 5.0, 3.8, 6.2, 4.5, 5.5, 5.0)
        widths = (1.3, 3.6, 2.2, 2.0, 3.1, 1.5, 4.0, 1.8, 3.3, 1.6)
        shape = [(period, width, HIGH, 1.6 * RATE) for period, width in zip(periods, widths)]
    return _pulses(LOW, shape)


def random(seed: int = SEED) -> TorqueProfile:
    """Ramps whose rate, height, width and distance are drawn (figure 4.14)."""
    draw = np.random.default_rng(seed)
    periods = draw.uniform(3.5, 6.5, TIP_INS)
    periods *= LONG / periods.sum()
    shape = [(period, share * period, torque, rate) for period, share, torque, rate in zip(
        periods.round(3).tolist(), draw.uniform(0.35, 0.65, TIP_INS).round(3).tolist(),
        draw.uniform(60.0, 200.0, TIP_INS).round(1).tolist(),
        draw.uniform(100.0, 600.0, TIP_INS).round(1).tolist())]
    return _pulses(LOW, shape)


def _pulses(low: float, shape: list[tuple[float, float, float, float]], lag: float = 0.0) -> TorqueProfile:
    """From distance to the next [s], width [s], torque [N.m] and rate [N.m/s] of each tip-in."""
    changes: list[Change] = []
    start = BEGIN
    for period, width, torque, rate in shape:
        changes += [(round(start, 3), torque, rate), (round(start + width, 3), low, rate)]
        start += period
    return TorqueProfile(low=low, changes=tuple(changes), lag=lag)
