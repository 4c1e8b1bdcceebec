"""Estimators of the lash position in the validation ramp, against the full-order plant.

Tables 3.3 and 3.4, figures 3.3 to 3.7: errors of the speeds and of the traversal time at 10 ms and 1 ms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from cosim.report.study_figures import Curve, Panel
from cosim.result import Result
from cosim.studies.estimation import (
    SOURCES,
    Drive,
    Estimates,
    Reading,
    estimated_traversal,
    every,
    in_ms,
    listen,
    measure_position,
    position_estimators,
    run_plant,
    traversal_error,
    traversal_interval,
    true_traversal,
    vehicle,
)
from cosim.studies.estimator_findings import (
    PLANT,
    RPM,
    color,
    draw,
    held,
    lash_panel,
    through_fmus,
)
from cosim.studies.findings import THESIS, Findings
from cosim.studies.manoeuvre import Crossing
from driveline.elements.driveline_parts import in_gear

SOURCE = f"{THESIS}, tables 3.3, 3.4"
DRIVE = Drive()
# Tables 3.3 and 3.4, by sampling time: errors of engine speed, wheel speed and traversal time [%].
PRINTED = {0.01: (2.5e-8, 1e-5, 14.29), 0.001: (5e-9, 5e-6, 5.59)}
SPEEDS = ("engine_speed", "wheel_speed")


def run(out: Path, progress: Callable[[float], None], drive: Drive = DRIVE, phases: int = 10) -> Findings:
    """Rows and pictures.

    Args:
        drive: A shorter one makes the study smaller.
        phases: Between two frames the ramp begins at so many instants, a millisecond apart.
    """
    findings = Findings()
    readings = every(position_estimators())
    plant = run_plant(drive)
    truth = true_traversal(plant, drive)
    progress(0.2)
    found = {reading: listen(plant, reading, drive.gear, drive.step) for reading in readings}
    findings.add("lash traversal time, full-order plant", "ms", 130.0, 1e3 * truth.duration,
                 "section 3.2; lumped, from leaving the first flank to contact on all")
    for reading, estimates in found.items():
        _rows(findings, reading, estimates, plant, truth, drive)
    progress(0.4)
    _phase_rows(findings, readings, drive, phases)
    progress(0.5)
    through_fmus(findings, drive, [r for r in readings if r.period in PRINTED])
    progress(0.6)
    findings.figures += _figures(out, plant, found, truth, drive)
    return findings


def _rows(findings: Findings, reading: Reading, estimates: Estimates, plant: Result, truth: Crossing,
          drive: Drive) -> None:
    which = f"{in_ms(reading.period)}, {reading.estimator}"
    printed = PRINTED.get(reading.period, (None, None, None))
    rows = np.searchsorted(plant.time, estimates.time - 1e-9)
    for speed, paper in zip(SPEEDS, printed):
        if f"{speed}_estimate" in estimates:
            measured = plant[SOURCES[speed]][rows]
            error = 100.0 * np.abs(estimates[f"{speed}_estimate"] / measured - 1.0).max()
            findings.add(f"{speed.replace('_', ' ')} estimate, largest error, {which}", "%", paper, error,
                         "against the frame it was corrected with")
    crossing = estimated_traversal(estimates, drive.tip_ins[0])
    if crossing is None:
        findings.add(f"lash traversal time, error, {which}", "%", printed[2], None, "no traversal was reported")
        return
    error = 100.0 * (crossing.duration / truth.duration - 1.0)
    findings.add(f"lash traversal time, error, {which}", "%", printed[2], abs(error),
                 f"{1e3 * crossing.duration:.1f} ms, {'longer' if error > 0 else 'shorter'} than it was")
    findings.add(f"lash traversal starts later than in the plant by, {which}", "ms",
                 10.0 if reading.period == 0.01 else None, 1e3 * (crossing.start - truth.start),
                 "section 3.2: one time step at 10 ms" if reading.period == 0.01 else "")
    findings.add(f"lash traversal ends later than in the plant by, {which}", "ms", None,
                 1e3 * (crossing.end - truth.end),
                 "section 3.2: close to the end in the plant" if reading.period == 0.01 else "")
    _live_rows(findings, which, estimates, plant, truth)
    if "trusted" in estimates:
        findings.add(f"share of frames in which it trusts itself, {which}", "%", None,
                     100.0 * float(estimates["trusted"].mean()))
    if interval := traversal_interval(estimates, drive.tip_ins[0]):
        low, high = interval
        findings.add(f"lash traversal time lies in its 90 % interval (0 no, 1 yes), {which}", "1", None,
                     float(low <= truth.duration <= high), f"{1e3 * low:.1f} to {1e3 * high:.1f} ms")


def _live_rows(findings: Findings, which: str, estimates: Estimates, plant: Result, truth: Crossing) -> None:
    """What a controller would have of it while the lash is crossed: position then, and when it learns of contact."""
    inside = (plant.time >= truth.start) & (plant.time <= truth.end)
    held_rows = np.maximum(np.searchsorted(estimates.time, plant.time[inside] + 1e-9, side="right") - 1, 0)
    error = estimates["lash_position"][held_rows] - plant["lash_position"][inside]
    findings.add(f"lash position while it is crossed, rms error, {which}", "deg", None,
                 np.degrees(np.sqrt(np.mean(error**2))), "as it is said at the time, held between frames")
    told = estimates.time[(estimates.time >= truth.start) & (estimates["contact"] > 0.5)]
    findings.add(f"contact on the drive flank is told later than it was by, {which}", "ms", None,
                 1e3 * (told[0] - truth.end) if told.size else None, "" if told.size else "never told")


def _phase_rows(findings: Findings, readings: list[Reading], drive: Drive, phases: int) -> None:
    """What of an error is luck: the same ramp where the frames fall elsewhere on it."""
    cases = [measure_position(replace(drive, torque=replace(drive.torque, time=drive.torque.time + 1e-3 * i)),
                              readings) for i in range(phases)]
    for number, reading in enumerate(readings):
        errors = np.abs([traversal_error(case, number) for case in cases])
        which = f"{in_ms(reading.period)}, {reading.estimator}"
        findings.add(f"lash traversal time, mean error wherever the frames fall, {which}", "%", None, errors.mean(),
                     f"the ramp begins at {phases} instants, 1 ms apart; largest {errors.max():.1f} %")


def _figures(out: Path, plant: Result, found: Mapping[Reading, Estimates], truth: Crossing,
             drive: Drive) -> list[str]:
    begin = drive.tip_ins[0]
    span = (begin - 0.2, min(drive.stop, begin + 2.0))
    # the start: the plant leaves slowly, then grows with the square of time
    start = (truth.start - 0.02, truth.start + 0.07)
    slow, fast = ({r.estimator: e for r, e in found.items() if r.period == period} for period in (0.01, 0.001))
    size = np.degrees(drive.lash_size())
    bottom = (-0.57 * size, -0.2 * size)
    thesis = next(iter(slow.values()))
    figures = [draw(out / "figure_3_3.png", "Figure 3.3: states as DSKSE estimates them, 10 ms",
                    _states(plant, thesis, span, drive))]
    figures.append(draw(out / "figure_3_4.png", "Figure 3.4: estimators and full-order plant, 10 ms",
                        _validation(plant, slow, span)))
    figures.append(draw(out / "figure_3_5.png", "Figure 3.5: start of the traversal, 10 ms", [
        lash_panel("position in the lash, near the coast flank", plant, slow, start, bottom)], columns=1))
    figures.append(draw(out / "figure_3_6.png", "Figure 3.6: estimators and full-order plant, 1 ms",
                        _validation(plant, fast, span)))
    figures.append(draw(out / "figure_3_7.png", "Figure 3.7: start of the traversal at both sampling times", [
        lash_panel("(a) 10 ms", plant, slow, start, bottom), lash_panel("(b) 1 ms", plant, fast, start, bottom)]))
    return figures


def _states(plant: Result, estimates: Estimates, span: tuple[float, float], drive: Drive) -> list[Panel]:
    """The four panels of figure 3.3; wheel speed in the engine domain."""
    values = vehicle().values
    ratio = values[in_gear("ratio", drive.gear)] * values["final_drive.ratio"]
    return [
        Panel("(a) crankshaft torque", [Curve(plant.time, plant["crankshaft_torque"])], "torque [N.m]",
              x_range=span),
        Panel("(b) twist angles", [
            held(estimates, "shaft_twist", "engine side, with the lash", "first", np.degrees(1.0)),
            held(estimates, "wheel_shaft_twist", "wheel side", "second", np.degrees(1.0))],
            "twist [deg]", x_range=span),
        Panel("(c) speeds, both at the engine", [
            held(estimates, "engine_speed_estimate", "engine", "first", RPM),
            held(estimates, "wheel_speed_estimate", "wheel", "second", RPM * ratio)], "speed [rpm]", x_range=span),
        Panel("(d) position in the lash", [
            held(estimates, "lash_position", "estimated", "first", np.degrees(1.0))],
            "lash position [deg]", x_range=span),
    ]


def _validation(plant: Result, found: Mapping[str, Estimates], span: tuple[float, float]) -> list[Panel]:
    """The four panels of figures 3.4 and 3.6."""
    panels = [Panel("(a) crankshaft torque", [Curve(plant.time, plant["crankshaft_torque"])], "torque [N.m]",
                    x_range=span)]
    for letter, speed in zip("bc", SPEEDS):
        curves = [Curve(plant.time, RPM * plant[speed], PLANT, "measured", width=1.5)]
        curves += [held(estimates, f"{speed}_estimate", name, color(i), RPM, "--")
                   for i, (name, estimates) in enumerate(found.items()) if f"{speed}_estimate" in estimates]
        panels.append(Panel(f"({letter}) {speed.replace('_', ' ')}", curves, "speed [rpm]", x_range=span))
    return [*panels, lash_panel("(d) position in the lash", plant, found, span)]
