"""Benches whose masses move as one: instead of simulating them freely, their torques are asked for.

A bench without a load to lean on integrates every error of its torque into its speed; after seconds a free
simulation says nothing any more. The other way round nothing is integrated: the motion that was measured goes
into the equations of motion, and out come the torques that make it (inverse dynamics). Below its first
resonance a bench moves as one, and the torque at any section is what the masses behind it need:

    torque = sum of inertia * (measured acceleration - acceleration of the coasting plant at that speed)

The accelerations of the coasting plant are those of the assembled plant itself: no law is written twice, and
every effect that changes a value changes the torque.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from cosim.diagnosis.plants.band import Band
from cosim.diagnosis.plants.base import SHORTEST, InstrumentedPlant, compared
from cosim.diagnosis.plants.observation import Errors, observe
from cosim.diagnosis.plants.run import STEP, Run
from cosim.measured import Channel, Manoeuvre, Measurement
from driveline.kernels import layout as k
from driveline.quantities import InputError

LONGEST = 10.0  # s: stretches into which a recording is cut
_LEAST = 3.0  # times what the band's filter spoils at either end: how long a stretch has to be
_SMOOTH = 100.0  # Hz: a position is smoothed up to here before it is differentiated
_MISSED = 2.5  # of nine in ten intervals between samples: a longer one is a gap
_GRID = 129  # speeds at which friction is asked for, either way


@dataclass(frozen=True)
class Motion:
    """What was measured of a run's motion, on its even clock.

    Attributes:
        time: Instants [s], every ``STEP``.
        speed: Speed of all nodes [rad/s or m/s].
        acceleration: Its derivative.
        position: Integral of the speed, as it was measured.
    """

    time: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    position: np.ndarray


class RigidPlant(InstrumentedPlant):
    """A bench whose nodes stand in a line from the drive outward and move as one.

    Attributes:
        motions: Channels the motion may be taken from, best first; a position is differentiated.
        sections: The channels of torque or force, and the first node behind each; the drive's own first.
    """

    motions: ClassVar[tuple[str, ...]]
    sections: ClassVar[Mapping[str, str]]

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Smallest and largest possible value of every parameter of the plant."""
        return {v.name: v.range for v in self._plant.variables if v.causality == "parameter"}

    def runs(self, measurement: Measurement, longest: float | None = None) -> list[Run]:
        """The manoeuvres of a measurement, cut where frames are lost, and into stretches.

        Args:
            longest: A stretch's length at most [s]; by default ``LONGEST``, or more where samples are so far apart that
                too little of its halves would be left once they are filtered.

        Raises:
            InputError: The torque or force of the drive or all motion is missing, or a manoeuvre is too short.
        """
        interval = max(self._interval(manoeuvre) for manoeuvre in measurement.manoeuvres)
        shortest = max(SHORTEST, _LEAST * Band.sampled(interval).spoiled)
        longest = max(LONGEST, 2.0 * shortest) if longest is None else longest
        return [run for manoeuvre in measurement.manoeuvres
                for run in self._cut(manoeuvre, shortest, longest, interval)]

    def _interval(self, manoeuvre: Manoeuvre) -> float:
        """Between the samples of what is compared [s]: the motion's, which also the drive's torque is compared at.

        Raises:
            InputError: The torque or force of the drive or all motion is missing, or all of it is too short.
        """
        self._driven(manoeuvre)
        motion = next((name for name in self.motions if name in manoeuvre), None)
        if motion is None:
            raise InputError(f"manoeuvre '{manoeuvre.name}' shows no motion: one of {', '.join(self.motions)} "
                             "is needed")
        self._span(manoeuvre)
        others = [name for name in self.sections if name != self.driver and name in manoeuvre]
        return interval_of(manoeuvre[name].time for name in (motion, *others))

    def _cut(self, manoeuvre: Manoeuvre, shortest: float, longest: float, interval: float) -> list[Run]:
        spans = []
        for start, stop in self._whole(manoeuvre, shortest, interval):
            bounds = np.linspace(start, stop, max(1, int(np.ceil((stop - start) / longest))) + 1)
            spans += list(zip(bounds, bounds[1:]))
        return [self._run(manoeuvre, manoeuvre.name if len(spans) == 1 else f"{manoeuvre.name}_{i}", a, b)
                for i, (a, b) in enumerate(spans, start=1)]

    def _whole(self, manoeuvre: Manoeuvre, shortest: float, interval: float) -> list[tuple[float, float]]:
        """Spans [s] of at least ``shortest`` in which no channel lost frames.

        A motion that is differentiated twice through a gap is that of another bench.

        Raises:
            InputError: None is long enough.
        """
        present = [manoeuvre[name] for name in (self.driver, *self.channels) if name in manoeuvre]
        lost = sorted(gap for channel in present for gap in _lost(channel))
        start, stop = self._span(manoeuvre)
        spans = []
        for begin, end in [*lost, (stop, stop)]:
            spans.append((start, min(begin, stop)))
            start = max(start, end)
        kept = [(start, stop) for start, stop in spans if stop - start >= shortest]
        if not kept:
            whole = max(0.0, *(stop - start for start, stop in spans))
            raise InputError(f"manoeuvre '{manoeuvre.name}': {shortest:.3g} s without lost frames are needed where "
                             f"samples are {1e3 * interval:.3g} ms apart; there are no more than {whole:.3g} s")
        return kept

    def _run(self, manoeuvre: Manoeuvre, name: str, start: float, stop: float) -> Run:
        inputs = self._inputs(manoeuvre, start, stop)
        present = [channel for channel in self.channels if channel in manoeuvre]
        clocks, measured = compared(manoeuvre, present, start, start + STEP * (len(inputs) - 1), fastest=np.inf)
        run = Run(name, manoeuvre.kind, manoeuvre.gear or 0, start, inputs, 0.0, clocks, measured)
        return replace(run, start_speed=float(self.motion(run, self.values).speed[0]))

    def motion_of(self, run: Run) -> str:
        """The channel that a run's motion is taken from."""
        return next(name for name in self.motions if name in run.clocks)

    def motion(self, run: Run, values: Mapping[str, float]) -> Motion:
        """The motion as it was, from the best channel that shows it, that sensor's errors undone."""
        time = run.start + STEP * np.arange(len(run.inputs))
        name = self.motion_of(run)
        errors = Errors.of(name, values)
        # straight lines between samples that are unevenly apart bend most where those are far apart: after two
        # differentiations that is noise of several per cent
        clock = run.clocks[name]
        shown = CubicSpline(clock, run.measured[name])(np.clip(time + errors.delay, clock[0], clock[-1]))
        shown = (shown - errors.offset) / errors.gain
        if name.endswith("position"):
            position = sosfiltfilt(butter(4, _SMOOTH, fs=1.0 / STEP, output="sos"), shown)
            speed = np.gradient(position, STEP)
        else:
            speed = shown
            position = np.concatenate([[0.0], np.cumsum(0.5 * STEP * (speed[1:] + speed[:-1]))])
        return Motion(time, speed, np.gradient(speed, STEP), position)

    def torques(self, values: Mapping[str, float], run: Run, motion: Motion | None = None,
                every: bool = False) -> dict[str, np.ndarray]:
        """What the channels of torque or force should read for the run to have moved as it did.

        Args:
            values: Parameters of plant and sensors.
            run: Only its motion is used.
            motion: That motion, if it is at hand, or another one.
            every: Whether also channels that were not recorded are asked for.

        Returns:
            Each channel on the even clock of ``motion``: the drive's as estimated, the others as sensors show.
        """
        motion = self.motion(run, values) if motion is None else motion
        plant = self._plant
        for name in self._parameters:
            plant.values[plant.index[name]] = values[name]
        plant[self.driver] = 0.0
        plant.initialize()
        inertia, still = plant.inertias[:, None], np.zeros(1)
        behind = inertia * (motion.acceleration - _of_speed(plant.coasting, motion.speed))
        plant[self.driver] = 1.0
        driven = plant.coasting(still)
        plant[self.driver] = 0.0
        unit = float((inertia * (driven - plant.coasting(still))).sum())  # torque for one unit of the estimate
        found = {}
        for channel, node in self.sections.items():
            needed = behind[plant.network.nodes[node]:].sum(axis=0)
            if channel == self.driver:  # an estimate that is early by the delay
                delay = plant.network.constants[k.DELAY]
                found[channel] = np.interp(motion.time + delay, motion.time, needed / unit)
            elif every or channel in run.clocks:
                found[channel] = observe({channel: needed}, motion.time, values, channel, motion.time)
        return found

    def shown(self, run: Run) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """What those channels did read: clock [s] and values; the drive's on the clock of the motion."""
        frames = run.clocks[self.motion_of(run)]
        time = run.start + STEP * np.arange(len(run.inputs))
        drive = np.interp(frames, time, run.inputs[:, self.columns[self.driver]])
        return {channel: (frames, drive) if channel == self.driver else (run.clocks[channel], run.measured[channel])
                for channel in self.sections if channel == self.driver or channel in run.clocks}

    def instruments(self, raw: Mapping[str, np.ndarray], values: Mapping[str, float], run: Run) -> np.ndarray:
        """As for any plant; a position is measured from where it was at the start of the run."""
        zero = {name: raw[name] + run.measured[name][0] if name.endswith("position") else raw[name]
                for name in run.clocks}
        return super().instruments(zero, values, run)


def interval_of(clocks: Iterable[np.ndarray]) -> float:
    """What nine in ten intervals between samples [s] do not exceed."""
    return float(np.quantile(np.concatenate([np.diff(clock) for clock in clocks]), 0.9))


def _lost(channel: Channel) -> list[tuple[float, float]]:
    """Spans [s] without samples, longer than its logger's irregular intervals and than what is smoothed."""
    apart = np.diff(channel.time)
    wide = np.flatnonzero(apart > max(_MISSED * float(np.quantile(apart, 0.9)), 1.0 / _SMOOTH))
    return [(float(channel.time[i]), float(channel.time[i + 1])) for i in wide]


def _of_speed(law: Callable[[np.ndarray], np.ndarray], speed: np.ndarray) -> np.ndarray:
    """Columns of a law of the speed alone that may jump where the speed changes its sign; fine between."""
    grid = np.linspace(0.0, max(float(np.abs(speed).max()), 1e-9), _GRID)
    forward, backward = law(grid), law(np.minimum(-grid, -1e-12))
    return np.stack([np.where(speed < 0.0, np.interp(-speed, grid, back), np.interp(speed, grid, ahead))
                     for ahead, back in zip(forward, backward)])
