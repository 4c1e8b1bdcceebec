"""The torque meter's low-pass filter: order, phase, delay and attenuation.

Table 2.2, figure 2.7 and eq. 2.3. Designed here by ``driveline.sensors.torque_meter``, by SciPy once more,
and read off the running filter a third time.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy import signal

from cosim.report.study_figures import Curve, Panel, draw
from cosim.studies.findings import THESIS, Findings
from cosim.studies.manoeuvre import shuffle
from driveline.sensors.torque_meter import (
    TorqueMeter,
    filter_order,
    filter_sample,
    filter_sections,
    frequency_response,
    steady_state,
)

SOURCE = f"{THESIS}, table 2.2, figure 2.7, eq. 2.3"
SHUFFLE = 5.88  # [Hz], where the thesis reads the phase


def scipy_response(meter: TorqueMeter, frequencies: np.ndarray) -> tuple[int, np.ndarray]:
    """Order and complex gain of SciPy's filter for the same bands; the stop band's edge kept exact."""
    order, _ = signal.cheb2ord(meter.passband_frequency, meter.stopband_frequency, meter.passband_ripple,
                               meter.stopband_attenuation, fs=meter.sampling_frequency)
    sections = signal.cheby2(order, meter.stopband_attenuation, meter.stopband_frequency, output="sos",
                             fs=meter.sampling_frequency)
    z = np.exp(-2j * np.pi * frequencies / meter.sampling_frequency)[:, None]
    numerator = sections[:, 0] + z * (sections[:, 1] + z * sections[:, 2])
    denominator = sections[:, 3] + z * (sections[:, 4] + z * sections[:, 5])
    return int(order), np.prod(numerator / denominator, axis=1)


def filtered(meter: TorqueMeter, values: np.ndarray) -> np.ndarray:
    """Samples through the filter as the plant runs it, from rest at the first value."""
    sections = filter_sections(meter)
    state, coefficients = steady_state(sections, float(values[0])), sections.ravel()
    return np.array([filter_sample(state, 0, coefficients, 0, len(sections), value) for value in values])


def running_delay(meter: TorqueMeter, frequency: float, seconds: float = 3.0) -> float:
    """Delay [s] of a steady sine through the running filter, from a fit to the last half of it."""
    time = np.arange(round(seconds * meter.sampling_frequency)) / meter.sampling_frequency
    sine = np.sin(2.0 * np.pi * frequency * time)
    fits = [shuffle(time, values, seconds / 2.0, seconds) for values in (sine, filtered(meter, sine))]
    angle = (fits[0].phase - fits[1].phase) % (2.0 * np.pi)
    return float(angle / (2.0 * np.pi * frequency))


def run(out: Path, progress: Callable[[float], None], seconds: float = 3.0) -> Findings:
    """Rows and figure 2.7; ``seconds`` is the length of the sine run through the filter."""
    meter = TorqueMeter()
    findings = Findings()
    probe = np.array([SHUFFLE, meter.passband_frequency, meter.stopband_frequency])
    gain = frequency_response(filter_sections(meter), probe, meter.sampling_frequency)
    order, theirs = scipy_response(meter, probe)
    attenuation = -20.0 * np.log10(np.abs(gain))
    phase = float(np.angle(gain[0]))  # half a turn is not reached below 10 Hz: nothing to unwrap
    delay = -phase / (2.0 * np.pi * SHUFFLE)
    findings.add("filter order", "1", None, filter_order(meter),
                 f"lowest that keeps to table 2.2; SciPy: {order}")
    findings.add("phase at 5.88 Hz", "rad", -1.28, phase,
                 f"SciPy: {np.angle(theirs[0]):.4f}; the thesis reads its value off figure 2.7")
    findings.add("delay at 5.88 Hz (eq. 2.3)", "ms", 34.67, 1e3 * delay,
                 "the printed phase gives 34.65 ms; the printed delay is that of 1.281 rad")
    progress(0.3)
    findings.add("delay of a 5.88 Hz sine through the running filter", "ms", 34.67,
                 1e3 * running_delay(meter, SHUFFLE, seconds), "sample by sample, as the plant runs it")
    findings.add("attenuation at 5.88 Hz", "dB", None, attenuation[0])
    findings.add("attenuation at 27 Hz", "dB", 1.0, attenuation[1], "table 2.2: at most 1 dB")
    findings.add("attenuation at 30 Hz", "dB", 80.0, attenuation[2], "table 2.2: at least 80 dB")
    frequencies = np.linspace(0.05, 60.0, 1200)
    response = frequency_response(filter_sections(meter), frequencies, meter.sampling_frequency)
    _, theirs = scipy_response(meter, frequencies)
    findings.add("largest difference of the gain from SciPy's, 0 to 60 Hz", "1", None,
                 np.abs(response - theirs).max(), "two designs, by different formulas")
    findings.figures.append(_figure(out, meter, frequencies, response, theirs, phase))
    return findings


def _figure(out: Path, meter: TorqueMeter, frequencies: np.ndarray, response: np.ndarray, theirs: np.ndarray,
            phase: float) -> str:
    ours, scipy_s = (20.0 * np.log10(np.maximum(np.abs(g), 1e-7)) for g in (response, theirs))
    inside = frequencies <= meter.stopband_frequency  # behind, every zero turns the phase by half a turn
    angle = np.unwrap(np.angle(response[inside]))
    panels = [
        Panel("magnitude (left) and phase (right)",
              [Curve(frequencies, ours, "magnitude", "first", width=1.6),
               Curve(frequencies, scipy_s, "magnitude, SciPy", "second", ":", 1.4),
               Curve(frequencies[inside], angle, "phase", "third", "--", 1.4, right=True),
               Curve(np.array([SHUFFLE]), np.array([phase]), f"{phase:.3f} rad at 5.88 Hz", "third", "o",
                     right=True)],
              "magnitude [dB]", "frequency [Hz]", "phase [rad]", y_range=(-120.0, 5.0), x_range=(0.0, 60.0),
              marks={meter.passband_frequency: "", meter.stopband_frequency: "27 Hz, 30 Hz"}),
        Panel("delay by eq. 2.3",
              [Curve(frequencies[inside], -1e3 * angle / (2.0 * np.pi * frequencies[inside]),
                     "-phase / (2 pi f)", "third", "--", 1.4),
               Curve(np.array([SHUFFLE]), np.array([34.67]), "printed: 34.67 ms at 5.88 Hz", "measured",
                     "x")],
              "delay [ms]", "frequency [Hz]", x_range=(0.0, 30.0)),
    ]
    title = "Figure 2.7: frequency response of the torque meter's low-pass filter"
    return draw(out / "figure_2_7.png", title, panels, columns=1)
