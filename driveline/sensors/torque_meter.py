"""The propeller-shaft torque meter: gain, offset and the supplier's low-pass filter.

Source: thesis section 2.1.3.3, table 2.2: Chebyshev type II, 1000 Hz, pass band to 27 Hz with at
most 1 dB, stop band from 30 Hz with at least 80 dB. That needs order 23; the stop band begins at
30 Hz exactly, and the phase at 5.88 Hz is -1.289 rad (the thesis reads -1.28 off figure 2.7).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernels.backend import kernel
from ..quantities import InputError, quantity

SECTION_COEFFICIENTS = 5  # b0, b1, b2, a1, a2 of a section; a0 = 1
SECTION_STATES = 2
HIGHEST_ORDER = 200  # beyond it only a slip puts the bands so close together, and an array of millions would be made


@dataclass(frozen=True)
class TorqueMeter:
    """A torque meter: ``gain * torque + offset``, then the low-pass filter where it is enabled."""

    enabled: bool = quantity("1", "whether the low-pass filter is in the path", start=True,
                             minimum=0, maximum=1, kind="boolean")
    gain: float = quantity("1", "indicated over true torque", start=1.0)
    offset: float = quantity("N.m", "indicated torque at zero torque", start=0.0)
    sampling_frequency: float = quantity("Hz", "rate at which the meter filters", start=1000.0,
                                         minimum=1.0, maximum=1e5)
    passband_frequency: float = quantity("Hz", "end of the pass band", start=27.0, minimum=1e-3)
    stopband_frequency: float = quantity("Hz", "start of the stop band", start=30.0, minimum=1e-3)
    passband_ripple: float = quantity("dB", "largest attenuation in the pass band", start=1.0,
                                      minimum=1e-3)
    stopband_attenuation: float = quantity("dB", "smallest attenuation in the stop band", start=80.0,
                                           minimum=1.0, maximum=200.0)


def filter_order(meter: TorqueMeter) -> int:
    """Lowest order of a Chebyshev filter that keeps to the meter's bands.

    Raises:
        InputError: The frequencies are not pass band < stop band < half the sampling frequency, or too close together.
    """
    if not 0.0 < meter.passband_frequency < meter.stopband_frequency < 0.5 * meter.sampling_frequency:
        raise InputError(
            f"torque meter: passband_frequency {meter.passband_frequency:g} Hz, stopband_frequency "
            f"{meter.stopband_frequency:g} Hz and half the sampling_frequency "
            f"{0.5 * meter.sampling_frequency:g} Hz must be positive and rise in this order")
    if not 0.0 < meter.passband_ripple < meter.stopband_attenuation:
        raise InputError("torque meter: passband_ripple must be positive and below stopband_attenuation")
    edge = _warped(meter.stopband_frequency, meter) / _warped(meter.passband_frequency, meter)
    contrast = math.sqrt((10.0 ** (0.1 * meter.stopband_attenuation) - 1.0)
                         / (10.0 ** (0.1 * meter.passband_ripple) - 1.0))
    order, edge_order = math.acosh(contrast), math.acosh(edge)
    if order > HIGHEST_ORDER * edge_order:
        raise InputError(f"torque meter: from passband_frequency {meter.passband_frequency:.10g} Hz to "
                         f"stopband_frequency {meter.stopband_frequency:.10g} Hz a filter of more than order "
                         f"{HIGHEST_ORDER} is needed: set them further apart, or stopband_attenuation lower")
    return math.ceil(order / edge_order)


def filter_sections(meter: TorqueMeter) -> NDArray[np.float64]:
    """The filter as second-order sections (Chebyshev type II, bilinear transform).

    Every section has unit gain at rest, and the weakly damped ones come last: so no section
    amplifies or extinguishes what a later one undoes. An odd order has one section with
    ``b2 = a2 = 0``.

    Returns:
        Sections x (b0, b1, b2, a1, a2).

    Raises:
        InputError: See ``filter_order``.
    """
    order = filter_order(meter)
    warped = _warped(meter.stopband_frequency, meter)
    spread = math.asinh(math.sqrt(10.0 ** (0.1 * meter.stopband_attenuation) - 1.0)) / order
    sections = []
    for k in range(order // 2, 0, -1):
        angle = math.pi * (2 * k - 1) / (2 * order)
        pole = warped / complex(-math.sinh(spread) * math.sin(angle), math.cosh(spread) * math.cos(angle))
        pole = (1.0 + pole) / (1.0 - pole)
        zero = warped / math.cos(angle)  # on the imaginary axis, hence on the unit circle
        b1 = -2.0 * (1.0 - zero * zero) / (1.0 + zero * zero)
        gain = abs(1.0 - pole) ** 2 / (4.0 * zero * zero / (1.0 + zero * zero))
        sections.append((gain, gain * b1, gain, -2.0 * pole.real, abs(pole) ** 2))
    if order % 2:
        pole = -warped / math.sinh(spread)
        pole = (1.0 + pole) / (1.0 - pole)
        sections.insert(0, (0.5 * (1.0 - pole), 0.5 * (1.0 - pole), 0.0, -pole, 0.0))
    return np.array(sections)


def _warped(frequency: float, meter: TorqueMeter) -> float:
    """The analogue frequency that the bilinear transform maps to ``frequency`` [Hz]."""
    return math.tan(math.pi * frequency / meter.sampling_frequency)


def frequency_response(
    sections: NDArray[np.float64], frequencies: NDArray[np.float64], sampling_frequency: float
) -> NDArray[np.complex128]:
    """Complex gain of the cascade at ``frequencies`` [Hz]."""
    z = np.exp(-2j * np.pi * np.asarray(frequencies, dtype=float) / sampling_frequency)[..., np.newaxis]
    b0, b1, b2, a1, a2 = np.asarray(sections).T
    return np.prod((b0 + z * (b1 + z * b2)) / (1.0 + z * (a1 + z * a2)), axis=-1)


def steady_state(sections: NDArray[np.float64], value: float) -> NDArray[np.float64]:
    """State of the cascade after ``value`` has been its input for ever; two numbers a section."""
    b0, _, b2, _, a2 = np.asarray(sections).T
    return value * np.column_stack((1.0 - b0, b2 - a2)).ravel()


@kernel
def filter_sample(state, at, coefficients, place, sections, value):
    """Run one sample through the cascade (direct form II transposed); returns the filtered value.

    ``state[at:]`` holds two numbers a section, ``coefficients[place:]`` b0, b1, b2, a1, a2 a section.
    """
    for i in range(sections):
        s = at + 2 * i
        c = place + 5 * i
        y = coefficients[c] * value + state[s]
        state[s] = coefficients[c + 1] * value - coefficients[c + 3] * y + state[s + 1]
        state[s + 1] = coefficients[c + 2] * value - coefficients[c + 4] * y
        value = y
    return value
