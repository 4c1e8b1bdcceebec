"""What an engineer reads off a recording: shuffle, dead time, lag, overshoot, drift, ratio, orders.

Each feature is a number of one channel of one run that can be read off measured and simulated signals
alike; ``None`` where a recording does not show it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import savgol_filter

from cosim.diagnosis.plants import Run

_RATE = 100.0  # Hz: features are slower
_SHUFFLE = np.arange(1.5, 14.0, 0.15)  # Hz
_DECAY = np.array([0.3, 0.8, 1.5, 2.5, 4.0, 6.0, 9.0])  # 1/s
_RINGING = ("propeller_shaft_torque", "engine_speed", "turbine_speed", "seat_acceleration")


@dataclass(frozen=True)
class Feature:
    """A kind of feature: its words, unit, and whether a difference is best told in per cent."""

    name: str
    unit: str
    relative: bool


FEATURES = {f.name: f for f in (
    Feature("shuffle frequency", "Hz", True), Feature("shuffle damping", "1", True),
    Feature("lag", "s", False), Feature("reversal dead time", "s", True), Feature("overshoot", "", True),
    Feature("amplitude", "1", True), Feature("level", "", False), Feature("drift", "", False),
    Feature("speed ratio", "1", True), Feature("firing order content", "", True),
    Feature("rotation order content", "", True), Feature("loop area", "", True))}


@dataclass(frozen=True)
class Reader:
    """Reads features off the stacked channels of one run, always at the same places.

    Args:
        run: The run.
        reference: Stacked channels that say where things happen: those of the nominal simulation.
    """

    run: Run
    reference: np.ndarray

    @cached_property
    def grid(self) -> np.ndarray:
        """Even clock [s] inside all channels."""
        start = max(float(clock[0]) for clock in self.run.clocks.values())
        stop = min(float(clock[-1]) for clock in self.run.clocks.values())
        return np.arange(start, stop, 1.0 / _RATE)

    @cached_property
    def torque(self) -> np.ndarray:
        """Requested engine torque on the grid [N.m]."""
        return np.interp(self.grid, self.run.time, self.run.inputs[:, 0])

    @cached_property
    def ringing(self) -> tuple[int, int] | None:
        """The stretch of the grid after the largest change of torque, until the next: shuffle alone."""
        change = np.abs(self.torque[10:] - self.torque[:-10])
        if not change.size or change.max() < 20.0:
            return None
        busy = np.flatnonzero(change > 0.15 * change.max()) + 5
        breaks = np.flatnonzero(np.diff(busy) > 5)
        ends = np.append(busy[breaks], busy[-1])
        nexts = np.append(busy[breaks + 1], self.grid.size)
        length = nexts - ends
        driving = self.torque[np.minimum(ends + 5, self.torque.size - 1)] > 0
        best = int(np.argmax(np.minimum(length, 150) + 0.1 * driving))
        begin = int(ends[best]) + 22  # air path and lash are through
        end = min(int(nexts[best]) - 2, begin + 160)
        return (begin, end) if end - begin >= 45 else None

    @cached_property
    def _bases(self) -> tuple[np.ndarray, np.ndarray] | None:
        if self.ringing is None:
            return None
        t = np.arange(self.ringing[1] - self.ringing[0]) / _RATE
        pairs, bases = [], []
        for f in _SHUFFLE:
            for d in _DECAY:
                envelope = np.exp(-d * t)
                columns = np.column_stack([np.ones_like(t), t, t**2, envelope * np.cos(2 * np.pi * f * t),
                                           envelope * np.sin(2 * np.pi * f * t)])
                bases.append(np.linalg.qr(columns)[0])
                pairs.append((f, d))
        return np.array(pairs), np.array(bases)

    def even(self, stacked: np.ndarray) -> dict[str, np.ndarray]:
        """Channels on the grid."""
        return {name: np.interp(self.grid, clock, stacked[self.run.slices[name]])
                for name, clock in self.run.clocks.items()}

    def read(self, stacked: np.ndarray) -> dict[tuple[str, str], float]:
        """Every feature that is there, by channel and name."""
        channels, reference = self.even(stacked), self.even(self.reference)
        found: dict[tuple[str, str], float | None] = {}
        for name, values in channels.items():
            base = reference[name]
            if name in _RINGING:
                found[(name, "shuffle frequency")], found[(name, "shuffle damping")] = self._shuffle(values)
            found[(name, "lag")] = _lag(values, base)
            found[(name, "amplitude")] = _amplitude(values, base)
            error = values - base
            found[(name, "level")] = float(np.mean(error)) + float(np.mean(base))
            slope = np.polyfit(self.grid - self.grid.mean(), values, 1)[0]
            if not name.endswith("acceleration"):
                found[(name, "drift")] = float(slope)
        if "propeller_shaft_torque" in channels:
            torque, base = channels["propeller_shaft_torque"], reference["propeller_shaft_torque"]
            found[("propeller_shaft_torque", "reversal dead time")] = self._dead_time(torque, base)
            found[("propeller_shaft_torque", "overshoot")] = self._overshoot(torque)
            if "engine_speed" in channels:
                found[("propeller_shaft_torque", "loop area")] = _loop(channels["engine_speed"], torque)
        for over, under in (("engine_speed", "wheel_speed"), ("wheel_speed", "vehicle_speed"),
                            ("engine_speed", "turbine_speed"), ("turbine_speed", "transmission_output_speed")):
            if over in channels and under in channels:
                found[(f"{over} over {under}", "speed ratio")] = float(
                    np.sum(channels[over]) / np.sum(channels[under]))
        found |= self._orders(stacked)
        return {key: value for key, value in found.items() if value is not None and np.isfinite(value)}

    def _shuffle(self, values: np.ndarray) -> tuple[float | None, float | None]:
        """Frequency [Hz] and damping ratio of a damped sinusoid over a parabola, by variable projection."""
        if self._bases is None:
            return None, None
        pairs, bases = self._bases
        y = values[slice(*self.ringing)]
        flat = y - np.polyval(np.polyfit(np.arange(y.size), y, 2), np.arange(y.size))
        energy = np.sum((bases.transpose(0, 2, 1) @ y) ** 2, axis=1)
        explained = (energy - (y @ y - flat @ flat)).reshape(_SHUFFLE.size, _DECAY.size)
        i, j = np.unravel_index(int(np.argmax(explained)), explained.shape)
        if explained[i, j] < 0.5 * float(flat @ flat):
            return None, None
        f = _vertex(_SHUFFLE, explained[:, j], i)
        d = float(np.exp(_vertex(np.log(_DECAY), explained[i], j)))
        return f, d / float(np.hypot(d, 2.0 * np.pi * f))

    def _dead_time(self, torque: np.ndarray, reference: np.ndarray) -> float | None:
        """How long the torque stays near zero in reversals [s], all together."""
        band = 0.04 * float(np.ptp(reference)) + 4.0
        if reference.min() > -band or reference.max() < band:
            return None
        smooth = np.interp(np.arange(0, torque.size, 0.2), np.arange(torque.size), torque)
        return float(np.sum(np.abs(smooth) < band)) / (5.0 * _RATE)

    def _overshoot(self, torque: np.ndarray) -> float | None:
        """Largest torque over what it settles at after the largest step [N.m]."""
        if self.ringing is None:
            return None
        begin, end = self.ringing
        settled = float(np.mean(torque[(begin + end) // 2:end]))
        around = torque[max(0, begin - 40):end]
        return float(np.max(around) if settled > 0 else -np.min(around)) - abs(settled)

    def _orders(self, stacked: np.ndarray) -> Mapping[tuple[str, str], float]:
        """Amplitude at the third order of the crank in fast channels, at the first of the wheel in its speed."""
        found: dict[tuple[str, str], float] = {}
        if "engine_speed" in self.run.clocks:
            speed = self.run.measured["engine_speed"]
            found |= self._order("propeller_shaft_torque", "firing order content", stacked, 3.0,
                                 self.run.clocks["engine_speed"], speed)
        for name in ("wheel_speed", "transmission_output_speed"):
            if name in self.run.clocks:
                found |= self._order(name, "rotation order content", stacked, 1.0, self.run.clocks[name],
                                     self.run.measured[name])
        return found

    def _order(self, channel: str, name: str, stacked: np.ndarray, order: float, clock: np.ndarray,
               speed: np.ndarray) -> dict[tuple[str, str], float]:
        if channel not in self.run.clocks:
            return {}
        t = self.run.clocks[channel]
        rate = 1.0 / float(np.median(np.diff(t)))
        if order * float(np.max(speed)) / (2.0 * np.pi) > 0.45 * rate:
            return {}
        angle = np.interp(t, clock, np.concatenate([[0.0], np.cumsum(
            0.5 * np.diff(clock) * (speed[1:] + speed[:-1]))]))
        values = stacked[self.run.slices[channel]]
        window = max(5, 2 * round(0.1 * rate) + 1)
        if values.size <= window:
            return {}
        fast = values - savgol_filter(values, window, 2)
        return {(channel, name): 2.0 * float(np.abs(np.mean(fast * np.exp(-1j * order * angle))))}


def _vertex(grid: np.ndarray, heights: np.ndarray, i: int) -> float:
    """Where the parabola through a maximum and its neighbours peaks."""
    if i in (0, grid.size - 1):
        return float(grid[i])
    a, b, c = np.polyfit(grid[i - 1:i + 2] - grid[i], heights[i - 1:i + 2], 2)
    return float(grid[i] + np.clip(-b / (2.0 * a), grid[i - 1] - grid[i], grid[i + 1] - grid[i]) if a < 0 else grid[i])


def _changes(values: np.ndarray) -> np.ndarray:
    """A signal without its slow part."""
    return np.gradient(savgol_filter(values, 7, 2))


def _lag(values: np.ndarray, base: np.ndarray) -> float | None:
    """How much later than the reference the signal is [s], from its changes; by least squares."""
    slope, error = _changes(base), _changes(values - base)
    rate = np.gradient(slope)
    design = np.column_stack([slope, rate])
    if not np.sum(rate**2) > 0.0:
        return None
    return -float(np.linalg.lstsq(design, error, rcond=None)[0][1]) / _RATE


def _amplitude(values: np.ndarray, base: np.ndarray) -> float | None:
    """Size of the signal's fast changes over those of the reference."""
    reference = float(np.std(_changes(base)))
    return float(np.std(_changes(values))) / reference if reference > 0.0 else None


def _loop(x: np.ndarray, y: np.ndarray) -> float:
    """Area of the hysteresis loop of two signals."""
    return float(np.abs(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x))))


def words(feature: str, channel: str, unit: str, measured: float, simulated: float,
          uncertainty: Callable[[float], str] | None = None) -> tuple[str, float, str]:
    """How a difference is told: the words, its size (simulated minus measured) and unit."""
    kind = FEATURES[feature]
    size = simulated - measured
    own = kind.unit or {"drift": f"{unit}/s", "loop area": f"{unit}.rad/s"}.get(feature, unit)
    if feature == "lag":
        return f"measured {abs(size) * 1e3:.0f} ms {'later' if size < 0 else 'earlier'} than simulated", size, own
    side = "high" if size > 0 else "low"
    if kind.relative and measured:
        return f"simulated {feature} {100 * abs(size / measured):.2g} % {side}", size, own
    return f"simulated {feature} {abs(size):.3g} {own} {side}", size, own
