"""Rows and panels that the estimators' studies share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.report.error_figures import Groups
from cosim.report.study_figures import Curve, Panel
from cosim.report.study_figures import draw as draw_panels
from cosim.result import Result
from cosim.studies.estimation import (
    Drive,
    Estimates,
    Reading,
    in_ms,
    is_built,
    largest_difference,
    listen,
    run_plant,
    through_master,
)
from cosim.studies.findings import Findings

RPM = 30.0 / np.pi
COLORS = ("first", "second", "third", "fourth")
PLANT = "full-order plant"


def color(number: int) -> str:
    """Of the estimator with this number."""
    return COLORS[number % len(COLORS)]


def through_fmus(findings: Findings, drive: Drive, readings: Sequence[Reading]) -> None:
    """Rows: the central case once more through FMUs and master, against the run in process."""
    built = [reading for reading in readings if is_built(reading.estimator)]
    theirs = (through_master(drive, built) or {}) if built else {}
    plant = run_plant(drive) if theirs else None
    for reading in readings:
        name = f"FMUs and master against in-process run, {in_ms(reading.period)}, {reading.name}"
        if reading not in theirs:
            findings.add(name, "1", None, None, "not all FMUs are built: `driveline build`")
        else:
            ours = listen(plant, reading, drive.gear, drive.step)
            findings.add(name, "1", None, largest_difference(ours, theirs[reading]),
                         "largest difference over all frames and outputs")


def summarise(findings: Findings, what: str, unit: str, errors: Mapping[tuple[str, float], Sequence[float]],
              printed: Callable[[str, str, float], float | None], note: str = "") -> None:
    """Rows: mean, median and largest magnitude, by estimator and sampling time.

    Args:
        printed: The printed number of a statistic (``mean``, ``median``, ``largest``) for an estimator
            and sampling time.
    """
    for (estimator, period), values in errors.items():
        size = np.abs(values)
        for statistic, value in (("mean", size.mean()), ("median", np.median(size)), ("largest", size.max())):
            findings.add(f"{statistic} {what}, {in_ms(period)}, {estimator}", unit,
                         printed(statistic, estimator, period), value,
                         f"of {size.size} runs" + (f"; {note}" if note else ""))


def box_panels(errors: Mapping[tuple[str, float], Sequence[float]], y_label: str,
               marks: Sequence[float]) -> Groups:
    """Magnitudes of errors as boxes: sampling times side by side, estimators beside one another.

    Outliers so far away that they would flatten the boxes are named at the edge instead.
    """
    tops = [np.percentile(np.abs(values), 90) for values in errors.values()]
    top = 1.5 * max(*tops, *marks)
    largest = max(np.abs(values).max() for values in errors.values())
    y_range = (-0.03 * top, top) if largest > 2.0 * top else None
    periods = list(dict.fromkeys(period for _, period in errors))
    estimators = list(dict.fromkeys(estimator for estimator, _ in errors))
    return Groups("boxes: quartiles; line: median; diamond: mean", [in_ms(period) for period in periods],
                  {estimator: [np.abs(errors[estimator, period]) for period in periods]
                   for estimator in estimators}, y_label, "sampling time", marks, y_range)


def errors_over(title: str, x: Sequence[float], x_label: str, y_label: str,
                errors: Mapping[tuple[str, float], Sequence[float]],
                y_range: tuple[float, float] | None = None) -> Panel:
    """Magnitudes of errors over what was varied: a colour a sampling time, a line style an estimator."""
    periods = list(dict.fromkeys(period for _, period in errors))
    estimators = list(dict.fromkeys(estimator for estimator, _ in errors))
    styles = ("o-", "s--", "^:", "v-.")
    curves = [Curve(np.asarray(x, dtype=float), np.abs(values), f"{in_ms(period)}, {estimator}",
                    COLORS[periods.index(period) % len(COLORS)], styles[estimators.index(estimator) % len(styles)])
              for (estimator, period), values in errors.items()]
    return Panel(title, curves, y_label, x_label, y_range=y_range)


def torque_panel(drives: Mapping[str, Drive], span: tuple[float, float], title: str = "(a) crankshaft torque",
                 ) -> Panel:
    """Torques over time, one curve a drive."""
    time = np.arange(span[0], span[1], 1e-3)
    curves = [Curve(time, drive.torque.values(time), label, color(i))
              for i, (label, drive) in enumerate(drives.items())]
    return Panel(title, curves, "torque [N.m]", x_range=span)


def draw(path: Path, title: str, panels: Sequence[Panel], columns: int = 2) -> str:
    """As ``study_figures.draw``, with every axis scaled to what is shown of its curves."""
    return draw_panels(path, title, [_cut(panel) for panel in panels], columns)


def _cut(panel: Panel) -> Panel:
    """Curves without what lies outside the range, but for one point on either side."""
    if panel.x_range is None:
        return panel
    curves = []
    for curve in panel.curves:
        first, last = np.searchsorted(curve.x, panel.x_range)
        shown = slice(max(int(first) - 1, 0), int(last) + 1)
        curves.append(replace(curve, x=curve.x[shown], y=curve.y[shown]))
    return replace(panel, curves=curves)


def lash_panel(title: str, plant: Result, estimates: Mapping[str, Estimates], span: tuple[float, float],
               degrees: tuple[float, float] | None = None) -> Panel:
    """Lash position of plant and estimators; these hold what they said last."""
    curves = [Curve(plant.time, np.degrees(plant["lash_position"]), PLANT, "measured", width=1.5)]
    curves += [held(found, "lash_position", label, color(i), np.degrees(1.0))
               for i, (label, found) in enumerate(estimates.items())]
    return Panel(title, curves, "lash position [deg]", x_range=span, y_range=degrees)


def held(found: Estimates, output: str, label: str, shade: str, factor: float = 1.0, style: str = "-") -> Curve:
    """An output as a staircase."""
    period = found.time[1] - found.time[0]
    x = np.repeat(np.append(found.time, found.time[-1] + period), 2)[1:-1]
    return Curve(x, factor * np.repeat(found[output], 2), label, shade, style, 1.0)


def of_cases(found: Mapping[str, Any], names: Sequence[str], readings: Sequence[Reading],
             error: Callable[[Mapping[str, Any], int], float]) -> dict[tuple[str, float], list[float]]:
    """Errors of every reading over some cases, by estimator and sampling time."""
    return {(reading.name, reading.period): [error(found[name], i) for name in names]
            for i, reading in enumerate(readings)}
