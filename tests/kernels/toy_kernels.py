"""Entry points with one of everything a kernel may contain."""

from __future__ import annotations

import math

from driveline.kernels.backend import F8, I8, entry_point, kernel

RESULTS = 30
MASK = 0xFFFFFFFF
PIECES = (0.25, 3)


@kernel
def sine_and_bell(x):
    return math.sin(x), math.exp(-x * x)


@kernel
def halve(values, at):
    steps = 0
    while at > 0:
        at //= 2
        values[at] = values[at] / (1.0 + abs(values[at]))
        steps += 1
    return steps


@entry_point
def toy_operations(x: F8, y: F8, result: F8, count: int) -> int:
    """RESULTS results of each of ``count`` pairs of ``x`` and ``y``; the status is their number."""
    for i in range(count):
        a = x[i]
        b = y[i]
        sine, bell = sine_and_bell(a)
        m = int(a * 1000.0)
        n = int(b * 77.0)
        if n == 0:
            n = -3
        at = RESULTS * i
        result[at] = sine
        result[at + 1] = bell
        result[at + 2] = math.cos(a)
        result[at + 3] = math.tan(a)
        result[at + 4] = math.tanh(a)
        result[at + 5] = math.atan2(a, b)
        result[at + 6] = math.log(abs(a) + 1e-9)
        result[at + 7] = math.sqrt(abs(a))
        result[at + 8] = a % b
        result[at + 9] = a // b
        result[at + 10] = min(a, b)
        result[at + 11] = max(a, b)
        result[at + 12] = math.floor(a)
        result[at + 13] = math.ceil(a)
        result[at + 14] = round(a)
        result[at + 15] = int(a)
        result[at + 16] = a * (b > 0.0)
        result[at + 17] = a / b
        result[at + 18] = a * b + a
        result[at + 19] = math.copysign(a, b)
        result[at + 20] = math.expm1(a)
        result[at + 21] = math.log1p(abs(a))
        result[at + 22] = math.asin(a / (1.0 + abs(a)))
        result[at + 23] = sine * math.cos(a)
        result[at + 24] = m // n
        result[at + 25] = m % n
        result[at + 26] = m / n
        result[at + 27] = (m * 2654435769 & MASK) >> 7
        result[at + 28] = (m ^ n) & 0xFFFF
        result[at + 29] = PIECES[0] * a + PIECES[1]
    return count


@entry_point
def toy_run(values: F8, counts: I8, step: float, times: int, size: int) -> int:
    """Advance ``values`` in place; the status says whether a value left -10 to 10."""
    for _ in range(times):
        for i in range(size):
            values[i] += step * math.cos(values[i])
            counts[i] += halve(values, i)
            if abs(values[i]) > 10.0:
                return 1
    return 0


@entry_point
def toy_last(step: float) -> int:
    """An entry point without arrays."""
    return int(10.0 * step)
