"""From what a plant does to what a measurement shows: sensors, filters and clocks, without the plant.

A plant gives its outputs on an even clock (1 ms). A channel shows one of them at its own instants, and
errs in ways of its own; all of them are parameters ``observe.CHANNEL.NAME`` in the same flat mapping as
the plant's, so that a sensor may be the cause as well as a shaft:

    gain, offset             shown = gain * true + offset
    filter_period            low-pass filter of the torque meter, its edge beyond the vehicle file's [s]
    delay                    the value shown is that of ``delay`` ago [s]
    eccentricity, _phase     a speed swings by this share once a revolution, and where in it it begins [rad]
    clock_drift, _offset     the stamp of true time t is (1 + drift) t + offset

They need no new run of the plant. Whatever is missing is absent: gain 1, all else 0. The vehicle file's own
torque meter (``torque_meter.*``) and the delays of its CAN speeds (``wheel_speed_sensor.delay``) count as
known and are applied with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.signal import sosfilt

from cosim.diagnosis.effect import SLOPE
from driveline.quantities import InputError, from_values
from driveline.sensors.torque_meter import TorqueMeter, filter_sections, steady_state

PREFIX = "observe."
# Errors a channel can have, and what they are without.
NEUTRAL = {"gain": 1.0, "offset": 0.0, "filter_period": 0.0, "delay": 0.0, "eccentricity": 0.0,
           "eccentricity_phase": 0.0, "clock_drift": 0.0, "clock_offset": 0.0}
CHANNELS = ("engine_speed", "turbine_speed", "transmission_output_speed", "wheel_speed", "vehicle_speed",
            "propeller_shaft_torque", "seat_acceleration", "differential_acceleration")
BENCH_CHANNELS = ("motor_speed", "motor_position", "inline_torque", "position")
# No error anywhere, of inputs and sensors; what a plant's own parameters do not hold.
DEFAULTS = {SLOPE: 0.0} | {
    f"{PREFIX}{channel}.{name}": value for channel in CHANNELS + BENCH_CHANNELS for name, value in NEUTRAL.items()}
METERED = "propeller_shaft_torque"
# Below this period [s] of its edge the filter cannot be made at 1 kHz; from there to 0 it fades out.
SHORTEST_PERIOD = 1.0 / 300.0
LONGEST_PERIOD = 1.0


@dataclass(frozen=True)
class Errors:
    """How one channel errs; see the module."""

    gain: float = 1.0
    offset: float = 0.0
    filter_period: float = 0.0
    delay: float = 0.0
    eccentricity: float = 0.0
    eccentricity_phase: float = 0.0
    clock_drift: float = 0.0
    clock_offset: float = 0.0

    @classmethod
    def of(cls, channel: str, values: Mapping[str, float]) -> Errors:
        """Those of a channel: the file's own sensor and what ``observe.CHANNEL`` adds to it.

        Raises:
            InputError: There is no such error.
        """
        named = _by_channel(tuple(values)).get(channel, {})
        errors = cls(**{error: float(values[name]) for error, name in named.items()})
        if channel == METERED:
            period = errors.filter_period
            if values.get("torque_meter.enabled", 0.0):
                period += 1.0 / values["torque_meter.stopband_frequency"]
            return replace(errors, filter_period=max(period, 0.0),
                           gain=errors.gain * values.get("torque_meter.gain", 1.0),
                           offset=errors.offset + values.get("torque_meter.offset", 0.0))
        return replace(errors, delay=errors.delay + values.get(f"{channel}_sensor.delay", 0.0))

    def instants(self, stamps: np.ndarray) -> np.ndarray:
        """When was true [s] what the logger wrote at ``stamps``."""
        return (np.asarray(stamps, dtype=np.float64) - self.clock_offset) / (1.0 + self.clock_drift) - self.delay

    def stamps(self, instants: np.ndarray) -> np.ndarray:
        """At what time of the logger [s] it wrote what was true at ``instants``."""
        return (1.0 + self.clock_drift) * (instants + self.delay) + self.clock_offset


@lru_cache(maxsize=8)
def _by_channel(names: tuple[str, ...]) -> dict[str, dict[str, str]]:
    """Of each channel, the errors among the names of values, and what they are called there."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        if name.startswith(PREFIX):
            channel, _, error = name.removeprefix(PREFIX).partition(".")
            if error not in NEUTRAL:
                raise InputError(f"{name}: a channel has {', '.join(NEUTRAL)}")
            found.setdefault(channel, {})[error] = name
    return found


def observe(raw: Mapping[str, np.ndarray], time: np.ndarray, values: Mapping[str, float], channel: str,
            stamps: np.ndarray) -> np.ndarray:
    """What a channel shows.

    Args:
        raw: Outputs of the plant by canonical name, each of shape (n,), in SI.
        time: Their even clock [s], shape (n,).
        values: All values; only ``observe.CHANNEL.*`` and the file's own sensor matter.
        channel: Canonical name of one of the outputs.
        stamps: Instants as the logger wrote them [s], any shape; before and after the run its ends hold.

    Returns:
        Shape of ``stamps``, in SI, unrounded: a resolution is noise to whoever compares.
    """
    errors = Errors.of(channel, values)
    shown = np.asarray(raw[channel], dtype=np.float64)
    if errors.eccentricity:
        angle = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (shown[1:] + shown[:-1]))])
        shown = shown * (1.0 + errors.eccentricity * np.cos(angle + errors.eccentricity_phase))
    shown = errors.gain * shown + errors.offset
    if errors.filter_period:
        shown = filtered(shown, float(time[1] - time[0]), errors.filter_period, values)
    return np.interp(errors.instants(stamps), time, shown)


def filtered(signal: np.ndarray, step: float, period: float, values: Mapping[str, float]) -> np.ndarray:
    """A signal behind the torque meter's low-pass filter, its bands scaled so that they end at 1/period.

    It starts as if the first value had been there for ever. Without a torque meter in ``values`` the bands
    are those of thesis table 2.2.

    Args:
        step: Distance of the samples [s]; 1 ms is the meter's own.
        period: Of the edge of the stop band [s].
    """
    if period <= 0.0:
        return signal
    if period > LONGEST_PERIOD:
        raise InputError(f"filter_period is {period:g} s: at most {LONGEST_PERIOD:g} s is possible")
    known = tuple((name, values[name]) for name in sorted(values) if name.startswith("torque_meter."))
    sections = _sections(known, step, max(period, SHORTEST_PERIOD))
    taps = np.column_stack([sections[:, :3], np.ones(len(sections)), sections[:, 3:]])
    start = steady_state(sections, signal[0]).reshape(-1, 2)
    smooth, _ = sosfilt(taps, signal, zi=start)
    if period < SHORTEST_PERIOD:
        share = period / SHORTEST_PERIOD
        return (1.0 - share) * signal + share * smooth
    return smooth


@lru_cache(maxsize=256)
def _sections(known: tuple[tuple[str, float], ...], step: float, period: float) -> np.ndarray:
    meter = from_values(TorqueMeter, dict(known), "torque_meter.")
    edge = 1.0 / period
    scale = edge / meter.stopband_frequency
    return filter_sections(replace(meter, sampling_frequency=1.0 / step, stopband_frequency=edge,
                                   passband_frequency=scale * meter.passband_frequency))
