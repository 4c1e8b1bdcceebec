"""What an engineer reads off a recording: shuffle, dead time, lag, overshoot, drift, loop area, orders, ratios.

Each feature is one number of one channel of one run, read off measured and simulated signals in the same
way and at the same places; it is absent where a recording does not show it. Where samples are lost nobody knows what
a channel did: it is read beside such a gap, or not at all.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import correlate1d, maximum_filter1d
from scipy.signal import savgol_coeffs, savgol_filter

from cosim.diagnosis.plants import Run
from cosim.diagnosis.plants.gaps import known
from cosim.measured import CANONICAL
from driveline.quantities import behind

Key = tuple[str, str]  # signal, feature

_RATE = 200.0  # Hz: features are slower
_SMOOTH = 0.09  # s: over which a change is taken
_DERIVATIVE = savgol_coeffs(2 * round(0.5 * _SMOOTH * _RATE) + 1, 2, deriv=1, delta=1.0 / _RATE, use="dot")
_SHUFFLE = np.arange(1.5, 14.0, 0.15)  # Hz
_DECAY = np.geomspace(0.3, 16.0, 13)  # 1/s
_EDGE = round(0.05 * _RATE)  # samples of the grid at its ends, of which no change can be taken
_LAGS = np.arange(-32, 33)  # samples of the grid
_FEWEST = round(0.5 * _RATE)  # samples of the grid outside gaps that anything is read off
_BEFORE = 0.2  # s before shuffle is alone, in which an overshoot may be
_STEEP = 10.0  # times: more is no factor of a torque meter, either way
_SWINGS = 0.1  # share of the largest torque: by less, and a factor of it is that of noise and of what else swings
_RINGING = ("propeller_shaft_torque", "inline_torque", "engine_speed", "turbine_speed", "motor_speed",
            "seat_acceleration")
_TORQUES = ("propeller_shaft_torque", "inline_torque")
_RATIOS = (("engine_speed", "turbine_speed"), ("turbine_speed", "transmission_output_speed"),
           ("transmission_output_speed", "wheel_speed"), ("wheel_speed", "vehicle_speed"))
_SPEEDS = ("vehicle_speed", "wheel_speed", "transmission_output_speed", "turbine_speed", "engine_speed",
           "motor_speed")
_ROTATING = ("wheel_speed", "transmission_output_speed", "motor_speed")


@dataclass(frozen=True)
class Feature:
    """A kind of feature.

    Attributes:
        name: As a finding bears it.
        unit: SI; ``~`` stands for the channel's own.
        relative: Whether a difference is best told in per cent.
        log: Whether it is a size that scatters in proportion to itself.
        one_sided: Whether only more of it is wrong: it measures a difference already.
        tolerance: Relative difference between two honest models of one and the same car (distributed or
            lumped shafts, other tyre and friction laws); what is closer than that is not wrong.
    """

    name: str
    unit: str
    relative: bool = False
    log: bool = False
    one_sided: bool = False
    tolerance: float = 0.0


FEATURES = {f.name: f for f in (
    Feature("shuffle frequency", "Hz", relative=True, log=True),
    Feature("lag", "s"),
    Feature("lag behind the others", "s"),
    Feature("reversal dead time", "s", relative=True),
    Feature("speed ratio", "1", relative=True, tolerance=1e-3),
    Feature("firing order content", "~", one_sided=True),
    Feature("rotation order content", "~", one_sided=True),
    Feature("amplitude", "1", relative=True),
    Feature("shuffle damping", "1", relative=True, log=True),
    Feature("overshoot", "~", relative=True),
    Feature("gain", "1", relative=True),
    Feature("zero offset", "~"),
    Feature("level", "~"),
    Feature("drift", "~/s", relative=True),
    Feature("loop area", "N2.m2", relative=True, log=True),
    Feature("waveform", "~", log=True, one_sided=True))}

WITH_RINGING = ("shuffle frequency", "shuffle damping", "overshoot")  # read where the driveline rings by itself
# read off a recording as a whole
WITHOUT_PLACE = ("speed ratio", "gain", "zero offset", "level", "drift", "loop area", "firing order content",
                 "rotation order content")


def unit_of(signal: str, feature: str) -> str:
    """SI unit of a feature of a signal."""
    own = CANONICAL[signal].unit if signal in CANONICAL else "1"
    return FEATURES[feature].unit.replace("~", own)


@dataclass(frozen=True)
class Reader:
    """Reads features off the stacked channels of one run, always at the same places.

    Args:
        run: The run.
        reference: Stacked channels that lags, amplitudes and waveforms are compared with: the nominal
            simulation.
        firing_order: Firings of the engine per revolution of its crankshaft.
    """

    run: Run
    reference: np.ndarray
    firing_order: float = 3.0

    @cached_property
    def grid(self) -> np.ndarray:
        """Even clock [s] inside all channels."""
        start = max(float(clock[0]) for clock in self.run.clocks.values())
        stop = min(float(clock[-1]) for clock in self.run.clocks.values())
        return np.arange(start, stop, 1.0 / _RATE)

    @cached_property
    def drive(self) -> np.ndarray:
        """What drives the plant, its first input, on the grid."""
        return np.interp(self.grid, self.run.time, self.run.inputs[:, 0])

    @cached_property
    def _gaps(self) -> dict[str, np.ndarray]:
        """Of every channel, where on the grid it is a straight line through lost samples."""
        # a gap that is no longer than over what a change is taken hides little
        return {name: ~known(clock, self.grid, _SMOOTH) & (self.grid > clock[0])
                for name, clock in self.run.clocks.items()}

    @cached_property
    def _clear(self) -> dict[str, np.ndarray]:
        """Of every channel, where on the grid nothing that is compared with it there is within a gap."""
        reach = 2 * (_EDGE - _LAGS[0]) + 1
        return {name: ~maximum_filter1d(gap, reach) for name, gap in self._gaps.items()}

    @cached_property
    def ringing(self) -> tuple[int, int] | None:
        """The stretch of the grid after the quickest change of the drive, until the next: shuffle alone."""
        ten = round(0.1 * _RATE)
        change = np.abs(self.drive[ten:] - self.drive[:-ten])
        if not change.size or change.max() <= 0.3 * np.ptp(self.drive) or change.max() <= 0.1 * np.abs(
                self.drive).max():
            return None
        busy = np.flatnonzero(change > 0.15 * change.max()) + ten // 2
        breaks = np.flatnonzero(np.diff(busy) > ten // 2)
        ends = np.append(busy[breaks], busy[-1])
        nexts = np.append(busy[breaks + 1], self.grid.size)
        length = nexts - ends
        driving = self.drive[np.minimum(ends + ten // 2, self.drive.size - 1)] > 0
        best = int(np.argmax(np.minimum(length, 1.5 * _RATE) + 0.1 * driving))
        begin = int(ends[best]) + round(0.22 * _RATE)  # air path and lash are through
        end = min(int(nexts[best]) - 2, begin + round(1.6 * _RATE))
        return (begin, end) if end - begin >= 0.45 * _RATE else None

    def span(self, feature: str) -> tuple[float, float]:
        """Where a feature is read: begin and end [s] on the recording's clock."""
        if feature in WITH_RINGING and self.ringing:
            return float(self.grid[self.ringing[0]]), float(self.grid[self.ringing[1] - 1])
        return float(self.grid[0]), float(self.grid[-1])

    @cached_property
    def _bases(self) -> np.ndarray | None:
        """Orthonormal damped oscillations over a parabola, five rows each (frequencies * decays * 5, samples)."""
        if self.ringing is None:
            return None
        t = np.arange(self.ringing[1] - self.ringing[0]) / _RATE
        return np.concatenate([np.linalg.qr(np.column_stack([
            np.ones_like(t), t, t**2, np.exp(-d * t) * np.cos(2.0 * np.pi * f * t),
            np.exp(-d * t) * np.sin(2.0 * np.pi * f * t)]))[0].T for f, d in itertools.product(_SHUFFLE, _DECAY)])

    @cached_property
    def _shifted(self) -> dict[str, np.ndarray]:
        """Changes of every channel of the reference, shifted by every lag (lags, samples); of none too short."""
        found = {}
        for name, values in self.even(self.reference).items():
            changes, inner = _changes(values), self._inner(name)
            if np.sum(inner) < _FEWEST:
                continue
            rows = np.array([np.roll(changes, lag)[inner] for lag in _LAGS])
            found[name] = rows - rows.mean(axis=1, keepdims=True)
        return found

    def _inner(self, name: str) -> np.ndarray:
        """Where on the grid a channel can be compared with the reference at any lag."""
        inner = self._clear[name].copy()
        inner[:-_LAGS[0]] = inner[self.grid.size - _LAGS[-1]:] = False
        return inner

    def even(self, stacked: np.ndarray) -> dict[str, np.ndarray]:
        """Channels on the grid."""
        return {name: np.interp(self.grid, clock, stacked[self.run.slices[name]])
                for name, clock in self.run.clocks.items()}

    def read(self, stacked: np.ndarray) -> dict[Key, float]:
        """Every feature that is there, by signal and name, in SI."""
        channels, reference = self.even(stacked), self.even(self.reference)
        found: dict[Key, float | None] = {}
        for name, values in channels.items():
            clear = self._clear[name]
            if np.sum(clear) < _FEWEST:
                continue
            if name in _RINGING and not self._lost(name, 0.0):
                found[(name, "shuffle frequency")], found[(name, "shuffle damping")] = self._shuffle(values)
            lag = None
            if name in self._shifted:
                lag, found[(name, "amplitude")], _ = self._shift(name, values)
            found[(name, "lag")] = lag
            if name in _TORQUES:
                found[(name, "gain")], found[(name, "zero offset")] = self._line(
                    reference[name], values, lag or 0.0, clear)
            elif not name.endswith("speed"):  # where a speed starts is fitted, so that its level says nothing
                found[(name, "level")] = float(np.mean(values[clear]))
            error, time = (values - reference[name])[clear], self.grid[clear]
            error -= error.mean() + _slope(time, error) * (time - time.mean())
            found[(name, "waveform")] = float(np.sqrt(np.mean(error**2))) or None
        for name in _TORQUES:
            if name in channels:
                found[(name, "reversal dead time")] = self._dead_time(channels[name], reference[name], self._gaps[name])
                found[(name, "overshoot")] = None if self._lost(name, _BEFORE) else self._overshoot(channels[name])
                if self._returns and not self._gaps[name].any():
                    found[(name, "loop area")] = loop_area(self.drive, channels[name])
        # what moves all of them in time, a torque that wanders, does not move one against the others
        lags = {name: lag for name in channels
                if name in _RINGING and (lag := found.get((name, "lag"))) is not None}
        for name in channels:
            others = [lag for other, lag in lags.items() if other != name]
            if len(others) > 1 and (lag := found.get((name, "lag"))) is not None:
                found[(name, "lag behind the others")] = lag - float(np.median(others))
        gains = next((name for name in _SPEEDS if name in channels), None)
        if gains is not None and np.sum(clear := self._clear[gains]) >= _FEWEST:
            # that of all others is this one times a ratio
            found[(gains, "drift")] = _slope(self.grid[clear], channels[gains][clear])
        for over, under in _RATIOS:
            if over in channels and under in channels and np.sum(
                    clear := self._clear[over] & self._clear[under]) >= _FEWEST:
                found[(f"{over} over {under}", "speed ratio")] = _ratio(channels[over], channels[under], clear)
        found |= self._orders(stacked)
        return {key: value for key, value in found.items() if value is not None and np.isfinite(value)}

    def shifted_share(self, name: str, stacked: np.ndarray) -> tuple[float, float]:
        """Misfit of a channel's changes against the reference, and what is left of it after the best shift
        and scale (mean squares)."""
        values = self.even(stacked)[name]
        rows = self._shifted[name]
        changes = self._centred(name, values)
        return float(np.mean((changes - rows[-_LAGS[0]]) ** 2)), self._shift(name, values)[2]

    def _centred(self, name: str, values: np.ndarray) -> np.ndarray:
        changes = _changes(values)[self._inner(name)]
        return changes - changes.mean()

    def _lost(self, name: str, before: float) -> bool:
        """Whether samples of a channel are lost where shuffle is read, or until so long before [s]."""
        if self.ringing is None:
            return False
        begin, end = self.ringing
        return bool(self._gaps[name][max(0, begin - round(before * _RATE)):end].any())

    def _shift(self, name: str, values: np.ndarray) -> tuple[float | None, float | None, float]:
        """How much later [s] and larger than the reference the channel's changes are; what is left.

        Neither where they would have to be moved further than is looked at, or are more nearly the reference's turned
        round, which half a period of shuffle later looks alike: then something else makes them differ.
        """
        rows, changes = self._shifted[name], self._centred(name, values)
        power = np.sum(rows**2, axis=1)
        if not np.all(power > 0.0):
            return None, None, float(np.mean(changes**2))
        product = rows @ changes
        explained = np.sign(product) * product**2 / power
        best = int(np.argmax(explained))
        lag = _vertex(_LAGS / _RATE, explained, best)
        left = (float(changes @ changes) - float(np.interp(lag, _LAGS / _RATE, explained))) / changes.size
        scale = float(np.interp(lag, _LAGS / _RATE, product / power))
        if best in (0, _LAGS.size - 1) or -np.min(explained) > explained[best]:
            return None, None, left
        return lag, scale if scale > 0.0 else None, left

    def _line(self, x: np.ndarray, y: np.ndarray, lag: float,
              clear: np.ndarray) -> tuple[float | None, float | None]:
        """Factor and offset from x to y, which is as much later [s]; that it is some more or less does not change them.

        Neither where x hardly changes, at all or beside y, or y beside x: at a torque of 0 the line would be far from
        both.
        """
        if np.ptp(x) < _SWINGS * np.abs(x).max():
            return None, None
        late = np.interp(self.grid - lag, self.grid, x)
        inner = _EDGE + int(np.ceil(abs(lag) * _RATE))  # samples at the ends that another would be needed for
        design = np.column_stack([late, np.ones(late.size), _changes(late)])[inner:-inner][clear[inner:-inner]]
        factor, offset, _ = np.linalg.lstsq(design, y[inner:-inner][clear[inner:-inner]], rcond=None)[0]
        return (float(factor), float(offset)) if 1.0 / _STEEP < abs(factor) < _STEEP else (None, None)

    def _shuffle(self, values: np.ndarray) -> tuple[float | None, float | None]:
        """Frequency [Hz] and damping ratio of a damped oscillation over a parabola, by variable projection."""
        if self._bases is None:
            return None, None
        y = values[slice(*self.ringing)] - np.mean(values[slice(*self.ringing)])
        parts = (self._bases @ y).reshape(-1, 5) ** 2  # of the parabola, of the oscillation
        explained = (parts[:, 3] + parts[:, 4]).reshape(_SHUFFLE.size, _DECAY.size)
        i, j = np.unravel_index(int(np.argmax(explained)), explained.shape)
        if explained[i, j] < 0.5 * (float(y @ y) - np.sum(parts[0, :3])) or i in (0, _SHUFFLE.size - 1):
            return None, None
        frequency = _vertex(_SHUFFLE, explained[:, j], i)
        decay = float(np.exp(_vertex(np.log(_DECAY), explained[i], j)))
        return frequency, decay / float(np.hypot(decay, 2.0 * np.pi * frequency))

    def _dead_time(self, torque: np.ndarray, reference: np.ndarray, gap: np.ndarray) -> float | None:
        """How long the torque stays near zero in reversals [s], all together; None where samples are lost in one."""
        band = 0.05 * float(np.ptp(reference))
        if reference.min() > -band or reference.max() < band:
            return None
        if gap.any() and any((np.abs(lost) < band).any() or np.ptp(np.sign(lost)) for lost in _pieces(torque, gap)):
            return None
        fine = np.interp(np.arange(0.0, torque.size - 1, 0.1), np.arange(torque.size), torque)
        return float(np.sum(np.abs(fine) < band)) / (10.0 * _RATE)

    def _overshoot(self, torque: np.ndarray) -> float | None:
        """Largest torque over what it settles at, after the quickest change."""
        if self.ringing is None:
            return None
        begin, end = self.ringing
        settled = float(np.mean(torque[(begin + end) // 2:end]))
        around = torque[max(0, begin - round(_BEFORE * _RATE)):end]
        return float(np.max(around) if settled > 0.0 else -np.min(around)) - abs(settled)

    @cached_property
    def _returns(self) -> bool:
        """Whether the drive comes back, so that what hangs on it runs through a loop."""
        high = self.drive > 0.5 * (self.drive.max() + self.drive.min())
        return int(np.sum(high[1:] != high[:-1])) >= 2 and np.ptp(self.drive) > 0.3 * np.abs(self.drive).max()

    def _orders(self, stacked: np.ndarray) -> Mapping[Key, float]:
        """Amplitudes at the firing order in torque and engine speed, at the first of each shaft in its speed."""
        wanted = [(name, "rotation order content", name, 1.0) for name in _ROTATING]
        wanted += [(name, "firing order content", "engine_speed", self.firing_order)
                   for name in ("propeller_shaft_torque", "engine_speed")]
        found: dict[Key, float] = {}
        for name, feature, speed, order in wanted:
            if name in self.run.clocks and speed in self.run.clocks and not (
                    self._gaps[name].any() or self._gaps[speed].any()):
                content = order_content(self.run.clocks[name], stacked[self.run.slices[name]],
                                        self.run.clocks[speed], self.run.measured[speed], order)
                if content is not None:
                    found[(name, feature)] = content
        return found


def order_content(time: np.ndarray, values: np.ndarray, clock: np.ndarray, speed: np.ndarray,
                  order: float) -> float | None:
    """Amplitude of a signal at an order of a shaft; None where it cannot be told from what is slow.

    Sampling slower than the order only folds it: at the instants of the samples the shaft's angle is known.

    Args:
        time, values: The signal on its clock [s].
        clock, speed: Speed of the shaft [rad/s] on its own.
        order: Oscillations per revolution.
    """
    rate = 1.0 / float(np.median(np.diff(time)))
    frequencies = order * np.abs(speed) / (2.0 * np.pi)
    shown = float(np.mean(np.abs(frequencies - rate * np.round(frequencies / rate))))  # folded
    if shown < 0.5:
        return None
    window = max(5, 2 * round(0.7 * rate / shown) + 1)
    if values.size <= 2 * window:
        return None
    angle = np.interp(time, clock, np.concatenate([[0.0], np.cumsum(
        0.5 * np.diff(clock) * (speed[1:] + speed[:-1]))]))
    # the slow part goes; the carrier loses the same by it, so that the amplitude keeps its size
    carrier = np.exp(1j * order * angle)
    waves = np.array([values, carrier.real, carrier.imag])
    fast, real, imaginary = (waves - savgol_filter(waves, window, 2, mode="nearest"))[:, window // 2:-(window // 2)]
    quick = real + 1j * imaginary
    power = float(np.vdot(quick, quick).real)
    return 2.0 * float(np.abs(np.vdot(quick, fast))) / power if power > 0.2 * quick.size else None


def loop_area(x: np.ndarray, y: np.ndarray) -> float:
    """Area that a path encloses, a loop run through twice counted twice; the open end is closed straight."""
    return float(np.abs(np.sum(0.5 * (y + np.roll(y, -1)) * (np.roll(x, -1) - x))))


def _ratio(over: np.ndarray, under: np.ndarray, clear: np.ndarray) -> float:
    """Ratio of two speeds; that one is late while the vehicle gains speed does not change it."""
    inner = clear.copy()
    inner[:_EDGE] = inner[-_EDGE:] = False
    design = np.column_stack([under, _changes(under)])[inner]
    return float(np.linalg.lstsq(design, over[inner], rcond=None)[0][0])


def _pieces(values: np.ndarray, within: np.ndarray) -> list[np.ndarray]:
    """What values are in each stretch that is ``within``, with the one before and the one after it."""
    edges = np.flatnonzero(np.diff(within.astype(int), prepend=0, append=0))
    return [values[max(begin - 1, 0):end + 1] for begin, end in edges.reshape(-1, 2)]


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    centred = x - x.mean()
    return float(centred @ y / (centred @ centred))


def _changes(values: np.ndarray) -> np.ndarray:
    """Rate of change [1/s] of a signal on the grid, not at its edges."""
    return correlate1d(values, _DERIVATIVE, mode="nearest")


def _vertex(grid: np.ndarray, heights: np.ndarray, i: int) -> float:
    """Where the parabola through a maximum and its neighbours peaks."""
    if i in (0, grid.size - 1):
        return float(grid[i])
    a, b, _ = np.polyfit(grid[i - 1:i + 2] - grid[i], heights[i - 1:i + 2], 2)
    return float(grid[i] - b / (2.0 * a)) if a < 0.0 else float(grid[i])


def words(signal: str, feature: str, measured: float, simulated: float) -> str:
    """How an engineer tells a difference."""
    kind, unit = FEATURES[feature], unit_of(signal, feature)
    unit = behind(unit)
    size = simulated - measured
    if feature == "lag":
        return f"measured {abs(size) * 1e3:.0f} ms {'later' if size < 0.0 else 'earlier'} than simulated"
    if feature == "lag behind the others":
        return f"measured {abs(size) * 1e3:.1f} ms {'later' if size < 0.0 else 'earlier'} than the other channels"
    if feature == "waveform":
        times = f"{measured / simulated:.1f} times what tolerance and noise explain"
        return f"waveform off by {measured:.3g}{unit} rms, {times}"
    if kind.one_sided:
        return f"{feature} of {measured:.3g}{unit} that the simulation does not have"
    if feature == "drift" and measured * simulated > 0.0:
        what, how = "gained" if measured > 0.0 else "lost", "fast" if abs(simulated) > abs(measured) else "slowly"
        return f"speed {what} {100.0 * abs(size / measured):.2g} % too {how}"
    side = "high" if size > 0.0 else "low"
    if kind.relative and abs(size) < measured:
        return f"{feature} {100.0 * abs(size / measured):.2g} % {side}"
    if kind.relative and simulated > measured > 0.0:
        return f"{feature} {simulated / measured:.2g} times as large as measured"
    return f"{feature} {abs(size):.3g}{unit} {side}"
