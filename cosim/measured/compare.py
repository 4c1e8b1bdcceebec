"""Simulated against measured, each channel on its own irregular clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim import units
from cosim.measured.measurement import Manoeuvre
from cosim.result import Result
from driveline.quantities import InputError


@dataclass(frozen=True)
class Comparison:
    """How far one simulated signal is from a measured one; error = simulated - measured, in ``unit``.

    Attributes:
        signal: Name in the result.
        channel: Name of the measured channel.
        unit: SI unit of both.
        samples: Number of measured samples inside the run.
        mean_error, rms_error: Over those samples.
        max_error: Of the largest size, with its sign, at ``max_error_time`` [s].
        nrmse: ``rms_error`` over the range (largest minus smallest) of the measured values.
        nrmse_deviation: ``rms_error`` over their standard deviation: 1 is what a constant achieves.
        time, measured, simulated: The samples compared.
    """

    signal: str
    channel: str
    unit: str
    samples: int
    mean_error: float
    rms_error: float
    max_error: float
    max_error_time: float
    nrmse: float | None
    nrmse_deviation: float | None
    time: np.ndarray = dataclasses.field(repr=False)
    measured: np.ndarray = dataclasses.field(repr=False)
    simulated: np.ndarray = dataclasses.field(repr=False)

    def as_row(self) -> dict[str, float | str | int | None]:
        """The numbers, for a table or JSON."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.repr}


def compare(result: Result, manoeuvre: Manoeuvre, pairs: Mapping[str, str]) -> list[Comparison]:
    """Compare simulated signals with measured channels.

    The simulated signal is interpolated to the instants of the measured samples; nothing else is
    resampled.

    Args:
        pairs: Name in the result to name of the channel.

    Raises:
        InputError: No such signal or channel, units that do not fit, or no common time.
    """
    return [_compare(result, manoeuvre, signal, channel) for signal, channel in pairs.items()]


def _compare(result: Result, manoeuvre: Manoeuvre, signal: str, channel_name: str) -> Comparison:
    values, channel = result[signal], manoeuvre[channel_name]
    try:
        factor, offset = units.conversion(result.units[signal] or channel.unit, channel.unit)
    except InputError as error:
        raise InputError(f"'{signal}' is compared with '{channel_name}', but {error}") from error
    if result.time.size < 2:
        raise InputError(f"'{signal}' has {result.time.size} samples: there is nothing to compare")
    inside = (channel.time >= result.time[0]) & (channel.time <= result.time[-1])
    if not inside.any():
        span = f"{channel.time[0]:g} to {channel.time[-1]:g} s"
        raise InputError(f"'{channel_name}' was measured from {span}, the run is from {result.time[0]:g} to "
                         f"{result.time[-1]:g} s: there is no common time")
    time, measured = channel.time[inside], channel.values[inside]
    simulated = np.interp(time, result.time, values) * factor + offset
    error = simulated - measured
    rms = float(np.sqrt(np.mean(error**2)))
    worst = int(np.argmax(np.abs(error)))
    extent, deviation = float(np.ptp(measured)), float(np.std(measured))
    return Comparison(
        signal, channel_name, channel.unit, int(time.size), float(error.mean()), rms, float(error[worst]),
        float(time[worst]), rms / extent if extent else None, rms / deviation if deviation else None,
        time, measured, simulated)
