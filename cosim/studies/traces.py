"""The four panels that most of the thesis's figures of chapter 2 have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.report.study_figures import Curve, Panel
from cosim.result import Result

RPM = 30.0 / np.pi


@dataclass(frozen=True)
class Trace:
    """One run in a figure.

    Attributes:
        label: What the legend says.
        color: A key of ``study_figures.COLORS``.
        result: Its signals.
        torque: Which of them is its crankshaft torque.
        wheel_ratio: Engine over wheel speed, where wheel speed is drawn.
    """

    label: str
    color: str
    result: Result
    torque: str = "crankshaft_torque"
    wheel_ratio: float = 1.0

    def curve(self, signal: str, factor: float = 1.0, what: str = "", style: str = "-",
              right: bool = False) -> Curve:
        """One of its signals; ``what`` goes before the label."""
        return Curve(self.result.time, factor * self.result[signal], what + self.label, self.color, style,
                     0.8 if self.color == "measured" else 1.3, right)


def against_measured(traces: Sequence[Trace], span: tuple[float, float],
                     acceleration: str = "seat_acceleration") -> list[Panel]:
    """Torque, engine and vehicle speed, propeller shaft torque, acceleration (figures 2.4 to 2.6, 2.13).

    Args:
        span: Stretch of time shown [s].
        acceleration: Signal of the last panel, of those traces that have it.
    """
    speeds = [t.curve("engine_speed", RPM, "engine, ") for t in traces]
    speeds += [t.curve("vehicle_speed", 3.6, "vehicle, ", "--", right=True) for t in traces]
    middle = Panel("(b) engine and vehicle speed", speeds, "engine [rpm]", right_label="vehicle [km/h]",
                   x_range=span)
    return _four(traces, span, middle, acceleration)


def in_engine_domain(traces: Sequence[Trace], span: tuple[float, float]) -> list[Panel]:
    """The same with the wheel speed times the ratios in place of the vehicle speed (2.9, 2.11, 2.15)."""
    speeds = [t.curve("engine_speed", RPM, "engine, ") for t in traces]
    speeds += [t.curve("wheel_speed", RPM * t.wheel_ratio, "wheel, ", "--") for t in traces]
    middle = Panel("(b) engine and wheel speed, both at the engine", speeds, "speed [rpm]", x_range=span)
    return _four(traces, span, middle, "vehicle_acceleration")


def _four(traces: Sequence[Trace], span: tuple[float, float], middle: Panel,
          acceleration: str) -> list[Panel]:
    return [
        Panel("(a) crankshaft torque", [t.curve(t.torque) for t in traces], "torque [N.m]", x_range=span),
        middle,
        Panel("(c) propeller shaft torque", [t.curve("propeller_shaft_torque") for t in traces],
              "torque [N.m]", x_range=span),
        Panel(f"(d) {acceleration.replace('_', ' ')}", [t.curve(acceleration) for t in traces],
              "acceleration [m/s²]", x_range=span),
    ]
