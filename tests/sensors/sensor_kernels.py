"""Entry points that run the sensors' kernels over whole signals."""

from __future__ import annotations

from driveline.kernels.backend import F8, entry_point
from driveline.sensors.can_signal import can_signal_tick, standard_normal, uniform
from driveline.sensors.torque_meter import filter_sample


@entry_point
def filter_signal(state: F8, coefficients: F8, signal: F8, result: F8, at: int, place: int, sections: int,
                  count: int) -> int:
    for i in range(count):
        result[i] = filter_sample(state, at, coefficients, place, sections, signal[i])
    return 0


@entry_point
def channel_signal(state: F8, constants: F8, signal: F8, result: F8, at: int, parameters: int, table: int,
                   first: int, count: int) -> int:
    for i in range(count):
        result[i] = can_signal_tick(state, at, constants, parameters, table, first + i, signal[i])
    return 0


@entry_point
def random_numbers(result: F8, seed: int, normal: int, count: int) -> int:
    for i in range(count):
        if normal:
            result[i] = standard_normal(seed, i)
        else:
            result[i] = uniform(seed, i)
    return 0
