"""Estimators of the lash size in ten tip-ins, with the plant's lash 2, 4 and 6 alpha.

Table 4.1, figures 4.2 to 4.4. The estimators are not told the plant's lash. Tip-ins 5 s apart meet frames of
10 ms at the same place every time; so the study also moves all of them, and each against the one before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cosim.report.study_figures import Curve, Panel
from cosim.result import Result
from cosim.studies.estimation import (
    PERIODS,
    THESIS_TKBSE,
    Drive,
    Estimates,
    in_ms,
    listen,
    measure_size,
    run_plant,
    size_errors,
    size_estimators,
    size_readings,
)
from cosim.studies.estimator_findings import PLANT, RPM, color, draw, held, through_fmus
from cosim.studies.findings import THESIS, Findings
from cosim.studies.sweep import CACHE, Case, Sweep
from cosim.studies.torque_profiles import LONG, RATE, ramps

SOURCE = f"{THESIS}, table 4.1"
SPEED = 15.0  # at the start [m/s]
DRIVE = Drive(ramps(RATE), stop=LONG, vehicle_speed=SPEED)
LASHES = {1.0: "2 alpha", 2.0: "4 alpha", 3.0: "6 alpha"}  # factors on the plant's gaps
APART = 1e-3  # how much more than a whole number of frames lies between tip-ins that do not repeat one another [s]
PRINTED = {1.0: 0.81, 2.0: 0.25, 3.0: 0.23}  # table 4.1, at 10 ms [%]


def run(out: Path, progress: Callable[[float], None], drive: Drive = DRIVE, phases: int = 10,
        workers: int | None = None, cluster: str | None = None) -> Findings:
    """Rows and pictures; a shorter drive with fewer tip-ins makes the study smaller.

    Args:
        phases: Between two frames the tip-ins begin at so many instants, a millisecond apart.
        workers, cluster: See ``sweep.Sweep``.
    """
    findings = Findings()
    readings = size_readings()
    cases = [Case(f"{label}, {phase}", measure_size,
                  {"drive": _with_lash(_later(drive, 1e-3 * phase), factor), "readings": readings})
             for factor, label in LASHES.items() for phase in range(phases)]
    cases += [Case(f"{label}, spread", measure_size,
                   {"drive": _with_lash(replace(drive, torque=drive.torque.spread(APART)), factor),
                    "readings": readings}) for factor, label in LASHES.items()]
    found = Sweep(out / CACHE, workers, cluster).run(cases, lambda share: progress(0.6 * share))
    for factor, label in LASHES.items():
        for i, reading in enumerate(readings):
            printed = PRINTED[factor] if reading.period == PERIODS[0] else None
            which = f"{label}, {in_ms(reading.period)}, {reading.name}"
            rows(findings, which, found[f"{label}, 0"], i, printed)
            _phase_row(findings, which, [found[f"{label}, {phase}"] for phase in range(phases)], i, printed)
            _spread_row(findings, which, found[f"{label}, spread"], i, printed)
    progress(0.7)
    through_fmus(findings, drive, [r for r in readings if r.period == PERIODS[0]])
    progress(0.8)
    findings.figures += _figures(out, drive)
    return findings


def _later(drive: Drive, delay: float) -> Drive:
    return replace(drive, torque=drive.torque.later(delay))


def _phase_row(findings: Findings, which: str, cases: Sequence[Mapping], number: int, printed: float | None) -> None:
    """What of an error is luck: the same tip-ins where the frames fall elsewhere on them."""
    errors = np.array([size_errors(case, number)[-1] for case in cases])
    findings.add(f"lash size, mean error wherever the frames fall, {which}", "%", printed, np.abs(errors).mean(),
                 f"the tip-ins begin at {errors.size} instants, 1 ms apart; with sign {errors.mean():+.2f} %, from "
                 f"{errors.min():+.2f} to {errors.max():+.2f} %")


def _spread_row(findings: Findings, which: str, case: Mapping, number: int, printed: float | None) -> None:
    """What is left when no tip-in meets the frames where the one before did, as nobody's foot does."""
    errors = size_errors(case, number)
    findings.add(f"lash size, error after tip-ins that meet the frames elsewhere each time, {which}", "%", printed,
                 abs(errors[-1]), f"{in_ms(APART)} further each; by tip-in: "
                 + ", ".join(f"{error:+.1f}" for error in errors))


def _with_lash(drive: Drive, factor: float) -> Drive:
    return replace(drive, lash=factor)


def rows(findings: Findings, which: str, case: Mapping, number: int, printed: float | None = None,
         largest: float | None = None) -> None:
    """Error after the last tip-in, the largest after any, and how often its interval was right."""
    errors = size_errors(case, number)
    said = case["readings"][number]
    findings.add(f"lash size, error after the last tip-in, {which}", "%", printed, abs(errors[-1]),
                 f"{np.degrees(said['size'][-1]):.3f} deg, true {np.degrees(case['truth']):.3f} deg")
    findings.add(f"lash size, largest error after any tip-in, {which}", "%", largest, np.abs(errors).max(),
                 "by tip-in: " + ", ".join(f"{error:+.1f}" for error in errors))
    if "low" in said:
        inside = [low <= case["truth"] <= high for low, high in zip(said["low"], said["high"])]
        width = 100.0 * (np.array(said["high"]) - np.array(said["low"])) / case["truth"]
        findings.add(f"true lash size in the 90 % interval, {which}", "%", None, 100.0 * np.mean(inside),
                     f"of {len(inside)} tip-ins; its width falls from {width[0]:.1f} to {width[-1]:.1f} % of it")


def _figures(out: Path, drive: Drive) -> list[str]:
    plant = run_plant(drive)
    found = heard(plant, drive, size_estimators())
    two = (0.0, min(drive.stop, (drive.tip_ins[2] if len(drive.tip_ins) > 2 else drive.stop)))
    whole = (0.0, drive.stop)
    figures = [draw(out / "figure_4_2.png", "Figure 4.2: two tip-ins, triggers and estimates, 10 ms",
                    panels(plant, found, drive, two, triggers=True))]
    figures.append(draw(out / "figure_4_3.png", "Figure 4.3: all tip-ins, size as it settles, 10 ms",
                        panels(plant, found, drive, whole, split=True)))
    figures.append(draw(out / "figure_4_4.png", "Figure 4.4: all tip-ins, size with constraint, 10 ms",
                        panels(plant, found, drive, whole, split=True, settled=True)))
    return figures


def heard(plant: Result, drive: Drive, who: Sequence[str]) -> dict[str, Estimates]:
    """What size readings say at 10 ms, by name."""
    return {reading.name: listen(plant, reading, drive.gear, drive.step)
            for reading in size_readings() if reading.period == PERIODS[0] and reading.name in who}


def panels(plant: Result, found: Mapping[str, Estimates], drive: Drive, span: tuple[float, float],
           triggers: bool = False, split: bool = False, settled: bool = False) -> list[Panel]:
    """Torque; triggers and speeds, or both speeds; and the size, true and estimated.

    Args:
        triggers: Show when the thesis's estimator listens, and both speeds in one panel.
        split: A panel a speed.
        settled: Show what holds after each tip-in only, not how it gets there.
    """
    result = [Panel("(a) crankshaft torque", [Curve(plant.time, plant["crankshaft_torque"])], "torque [N.m]",
                    x_range=span)]
    thesis = next(iter(found.values()))
    if triggers and "triggered" in thesis:
        torque = plant["crankshaft_torque"]
        rising = np.gradient(torque, plant.time) > 6.0
        result.append(Panel("(b) triggers", [
            Curve(plant.time, (torque > 0.0).astype(float), "torque positive", "measured"),
            Curve(plant.time, 0.9 * rising, "torque rising", "second", "--"),
            held(thesis, "triggered", "both: estimator listens", "first", 0.8)], "off, on", x_range=span))
    letters = iter("bcd" if len(result) == 1 else "cd")
    for speed in ("engine_speed", "wheel_speed") if split else ("engine_speed",):
        curves = [Curve(plant.time, RPM * plant[speed], PLANT, "measured", width=1.5)]
        curves += [held(e, f"{speed}_estimate", name, color(i), RPM) for i, (name, e) in enumerate(found.items())
                   if f"{speed}_estimate" in e and name != THESIS_TKBSE]
        there = RPM * plant[speed][(plant.time >= span[0]) & (plant.time <= span[1])]
        margin = 0.1 * np.ptp(there)  # before the first trigger an estimator may say 0
        result.append(Panel(f"({next(letters)}) {speed.replace('_', ' ')}", curves, "speed [rpm]", x_range=span,
                            y_range=(there.min() - margin, there.max() + margin)))
    true = np.degrees(drive.lash_size())
    curves = [Curve(np.array(span), np.full(2, true), "true", "measured", width=1.5)]
    for i, (name, estimates) in enumerate(found.items()):
        both = not settled and "lash_size_unconstrained" in estimates and name != THESIS_TKBSE
        if both:
            curves.append(held(estimates, "lash_size_unconstrained", f"{name}, without constraint", color(i),
                               np.degrees(1.0), "--"))
        label = f"{name}, with constraint" if both else name
        curves.append(held(estimates, "lash_size", label, color(i), np.degrees(1.0)))
    result.append(Panel(f"({next(letters)}) lash size", curves, "size [deg]", x_range=span,
                        y_range=(-0.4 * true, 2.0 * true)))
    return result
