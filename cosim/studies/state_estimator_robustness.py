"""Estimators of the lash position over torques, delays, jitter and sampling times, and on a road log.

Table 3.5, figures 3.8 to 3.20. Every run is at 10, 5 and 1 ms. The road log (``measurement``) is a recording with
engine torque, gear and speeds; it is not shipped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cosim.report.error_figures import Groups, draw_groups
from cosim.report.study_figures import Curve, Panel
from cosim.studies.estimation import (
    PERIODS,
    Drive,
    Reading,
    every,
    in_ms,
    listen,
    measure_position,
    position_estimators,
    run_plant,
    traversal_error,
)
from cosim.studies.estimator_findings import (
    COLORS,
    PLANT,
    RPM,
    box_panels,
    draw,
    errors_over,
    lash_panel,
    of_cases,
    summarise,
    through_fmus,
    torque_panel,
)
from cosim.studies.findings import THESIS, Findings
from cosim.studies.road_log import RoadLog, road_log
from cosim.studies.sweep import CACHE, Case, Sweep
from cosim.studies.torque_profiles import ramp, step
from driveline.sensors.can_signal import jitter_density, jitter_table

SOURCE = f"{THESIS}, table 3.5, figures 3.8 to 3.20"
STEPS = tuple(range(200, 701, 100))  # [N.m]
RAMPS = tuple(range(200, 1001, 100))  # [N.m/s]
DELAYS = {"engine speed 10 ms": {"engine_delay": 0.01}, "wheel speed 30 ms": {"wheel_delay": 0.03},
          "engine speed 10 ms and wheel speed 30 ms": {"engine_delay": 0.01, "wheel_delay": 0.03}}
JITTER_SETS = (1, 2, 3, 4)
SEEDS = (1, 2, 3)
PHASES = (0.0, 0.002, 0.004, 0.006, 0.008)  # begin of a tip-in after a frame [s]
VALIDATION = Drive()
PRINTED_MEAN = {0.01: 15.0, 0.005: 9.0, 0.001: 4.0}  # section 3.3.6, figure 3.20 [%]; at 1 ms it is the mode
PRINTED_LARGEST = {0.001: 23.0}  # the outlier; without it 8 %
# Sections 3.3.3 and 3.3.4 at 10 ms: delay of the start and of the end [ms].
PRINTED_DELAYS = {"engine speed 10 ms": (10.0, 10.0), "wheel speed 30 ms": (0.0, 0.0),
                  "engine speed 10 ms and wheel speed 30 ms": (None, 10.0)}
DENSITY = np.linspace(-5e-3, 5e-3, 201)


def run(out: Path, progress: Callable[[float], None], steps: Sequence[float] = STEPS,
        ramps: Sequence[float] = RAMPS, jitter_sets: Sequence[int] = JITTER_SETS,
        seeds: Sequence[int] = SEEDS, phases: Sequence[float] = PHASES, workers: int | None = None,
        cluster: str | None = None, measurement: Path | None = None) -> Findings:
    """Rows and pictures.

    Args:
        steps: Sizes of step [N.m].
        ramps: Rates of ramp [N.m/s].
        jitter_sets: Data sets of jitter, each with each; 1 is none.
        seeds: Of the jitter; each pair runs with each.
        phases: Begins of a tip-in after a frame [s]; steps and ramps run with each. The first counts for
            the figures, where frames and tip-in begin together as in the thesis.
        workers, cluster: See ``sweep.Sweep``.
        measurement: Road log: a folder with measurement.toml or a data file.
    """
    findings = Findings()
    log = RoadLog.read(measurement)  # what is wrong with it is said before all the runs
    readings = every(position_estimators())
    inputs = {f"step {size:g} N.m": Drive(step(size)) for size in steps}
    inputs |= {f"ramp {rate:g} N.m/s": Drive(ramp(rate)) for rate in ramps}
    delayed = {name: VALIDATION.with_bus(**how) for name, how in DELAYS.items()}
    jittered = {(pair, seed): VALIDATION.with_bus(engine_jitter=pair[0], wheel_jitter=pair[1], seed=seed)
                for pair in product(jitter_sets, jitter_sets) for seed in seeds if pair != (1, 1)}
    moved = {(name, phase): _later(drive, phase) for name, drive in inputs.items() for phase in phases[1:]}
    drives: dict[Any, Drive] = {"plain": VALIDATION, **inputs, **moved, **delayed, **jittered}
    cases = [Case(str(name), measure_position, {"drive": drive, "readings": readings})
             for name, drive in drives.items()]
    results = Sweep(out / CACHE, workers, cluster).run(cases, lambda share: progress(0.7 * share))
    found = {name: results[str(name)] for name in drives}
    _torques(findings, found, inputs, readings)
    _delays(findings, found, delayed, readings)
    pairs = _jitter(findings, found, jittered, readings)
    errors = of_cases(found, list(inputs), readings, traversal_error)
    anywhere = of_cases(found, [*inputs, *moved], readings, traversal_error)
    whole = of_cases(found, [name for name in found if name != "plain"], readings, traversal_error)
    _summary(findings, found, drives, readings, {"errors": errors, "anywhere": anywhere, "whole": whole})
    _table_3_5(findings, inputs, delayed, jittered)
    through_fmus(findings, delayed[list(delayed)[-1]], [r for r in readings if r.period == PERIODS[0]])
    progress(0.8)
    findings.figures += _figures(out, found, steps, ramps, delayed, readings, pairs, errors, jitter_sets)
    progress(0.9)
    road_log(findings, out, log)
    return findings


def _torques(findings: Findings, found: Mapping[Any, Any], inputs: Mapping[str, Drive],
             readings: Sequence[Reading]) -> None:
    """Figures 3.8 (b) and 3.9 (b) in numbers."""
    for name in inputs:
        start, end = found[name]["truth"]
        findings.add(f"lash traversal time, full-order plant, {name}", "ms", None, 1e3 * (end - start))
        for i, reading in enumerate(readings):
            error = traversal_error(found[name], i)
            said = found[name]["readings"][i]
            note = "no traversal was reported" if said is None else (
                f"starts {1e3 * (said[0] - start):+.1f} ms, ends {1e3 * (said[1] - end):+.1f} ms later than "
                f"in the plant; {'longer' if error > 0 else 'shorter'} than it was")
            findings.add(f"lash traversal time, error, {name}, {in_ms(reading.period)}, {reading.estimator}", "%",
                         None, abs(error), note)


def _shift(found: Mapping[Any, Any], name: Any, number: int) -> tuple[float, float] | None:
    """How much later [ms] start and end are reported than in the validation ramp without delay."""
    plain, late = found["plain"]["readings"][number], found[name]["readings"][number]
    if plain is None or late is None:
        return None
    return tuple(1e3 * (after - before) for before, after in zip(plain, late))


def _delays(findings: Findings, found: Mapping[Any, Any], delayed: Mapping[str, Drive],
            readings: Sequence[Reading]) -> None:
    """Sections 3.3.3 and 3.3.4."""
    for name in delayed:
        for i, reading in enumerate(readings):
            which = f"{name} late, {in_ms(reading.period)}, {reading.estimator}"
            printed = PRINTED_DELAYS[name] if reading.period == 0.01 else (None, None)
            shift = _shift(found, name, i)
            for k, what in enumerate(("start", "end")):
                findings.add(f"shift of the traversal's {what}, {which}", "ms", printed[k],
                             None if shift is None else shift[k],
                             "no traversal was reported" if shift is None else "")
            findings.add(f"lash traversal time, error, {which}", "%", None,
                         abs(traversal_error(found[name], i)))


def _printed_jitter(pair: tuple[int, int], period: float) -> float | None:
    """What section 3.3.5 says of the delay [ms]."""
    engine, wheel = pair
    if period == 0.01:
        return 0.0
    if engine == 3:
        return 1e3 * period
    return 5.0 if period == 0.005 and wheel == 4 else None


def _jitter(findings: Findings, found: Mapping[Any, Any], jittered: Mapping[Any, Drive],
            readings: Sequence[Reading]) -> dict[tuple[Reading, tuple[int, int]], float]:
    """Section 3.3.5; mean shift of the traversal's end [ms] by reading and pair of data sets."""
    pairs = list(dict.fromkeys(pair for pair, _ in jittered))
    shifts = {}
    for pair, (i, reading) in product(pairs, enumerate(readings)):
        ends = [shift[1] for name in jittered if name[0] == pair
                if (shift := _shift(found, name, i)) is not None]
        which = f"jitter sets engine {pair[0]}, wheel {pair[1]}, {in_ms(reading.period)}, {reading.estimator}"
        shifts[reading, pair] = float(np.mean(ends)) if ends else np.nan
        findings.add(f"shift of the traversal's end, {which}", "ms", _printed_jitter(pair, reading.period),
                     shifts[reading, pair] if ends else None,
                     f"mean of {len(ends)} draws of the jitter, {min(ends):+.1f} to {max(ends):+.1f} ms" if ends
                     else "no traversal was reported")
    return shifts


def _later(drive: Drive, seconds: float) -> Drive:
    """The same with a tip-in that begins later."""
    return replace(drive, torque=replace(drive.torque, time=drive.torque.time + seconds))


def _summary(findings: Findings, found: Mapping[Any, Any], drives: Mapping[Any, Drive],
             readings: Sequence[Reading], sets: Mapping[str, Mapping[tuple[str, float], Sequence[float]]]) -> None:
    def printed(statistic: str, estimator: str, period: float) -> float | None:
        return {"mean": PRINTED_MEAN, "largest": PRINTED_LARGEST}.get(statistic, {}).get(period)

    error = "error of the lash traversal time"
    summarise(findings, f"{error}, steps and ramps", "%", sets["errors"], printed,
              "figure 3.20; section 3.3.6: about, at 1 ms the mode")
    summarise(findings, f"{error}, steps and ramps wherever the frames fall", "%", sets["anywhere"],
              lambda *which: None, "each begins at several instants between two frames")
    summarise(findings, f"{error}, the whole set", "%", sets["whole"], lambda *which: None,
              "steps and ramps wherever the frames fall, delays, jitter")
    for i, reading in enumerate(readings):
        missed = sum(found[name]["readings"][i] is None for name in drives)
        findings.add(f"traversals not reported, {in_ms(reading.period)}, {reading.estimator}", "1", None, missed,
                     f"of {len(drives)} runs; each counts as an error of 100 %")
        _interval_row(findings, [found[name] for name in drives], i, reading)


def _interval_row(findings: Findings, cases: Sequence[Mapping[str, Any]], number: int, reading: Reading) -> None:
    said = [(case["intervals"][number], case["truth"][1] - case["truth"][0]) for case in cases]
    inside = [low <= true <= high for interval, true in said if interval for low, high in [interval]]
    if inside:
        findings.add(f"lash traversal time in its 90 % interval, the whole set, {in_ms(reading.period)}, "
                     f"{reading.estimator}", "%", None, 100.0 * np.mean(inside),
                     f"of {len(inside)} runs; 90 % is what the interval promises")


def _table_3_5(findings: Findings, inputs: Mapping[str, Drive], delayed: Mapping[str, Drive],
               jittered: Mapping[Any, Drive]) -> None:
    """What was assessed, as table 3.5 lists it, by the number of runs at every sampling time."""
    def count(test: Callable[[Drive], bool], drives: Mapping[Any, Drive]) -> int:
        return sum(test(drive) for drive in drives.values())

    rows = {
        "varying torque step inputs": sum(name.startswith("step") for name in inputs),
        "varying torque ramp rates": sum(name.startswith("ramp") for name in inputs),
        "constant delay in engine speed": count(lambda d: not d.bus.wheel_delay, delayed),
        "constant delay in wheel speed": count(lambda d: not d.bus.engine_delay, delayed),
        "constant delay in both": count(lambda d: d.bus.engine_delay > 0 < d.bus.wheel_delay, delayed),
        "CAN jitter in engine speed": count(lambda d: d.bus.wheel_jitter == 1, jittered),
        "CAN jitter in wheel speed": count(lambda d: d.bus.engine_jitter == 1, jittered),
        "CAN jitter in both": count(lambda d: min(d.bus.engine_jitter, d.bus.wheel_jitter) > 1, jittered),
    }
    for what, runs in rows.items():
        findings.add(f"table 3.5: runs with {what}", "1", None, runs, f"each at {len(PERIODS)} sampling times")


# -- figures ----------------------------------------------------------------------------------------


def _figures(out: Path, found: Mapping[Any, Any], steps: Sequence[float], ramps: Sequence[float],
             delayed: Mapping[str, Drive], readings: Sequence[Reading],
             pairs: Mapping[tuple[Reading, tuple[int, int]], float],
             errors: Mapping[tuple[str, float], Sequence[float]], jitter_sets: Sequence[int]) -> list[str]:
    figures = []
    for number, what, unit, values, make in ((8, "step", "N.m", steps, step), (9, "ramp", "N.m/s", ramps, ramp)):
        names = [f"{what} {value:g} {unit}" for value in values]
        shown = {f"{value:g} {unit}": Drive(make(value)) for value in values[::max(1, len(values) // 3)][:4]}
        figures.append(draw(out / f"figure_3_{number}.png",
                            f"Figure 3.{number}: error of the traversal time over torque {what}s", [
            torque_panel(shown, (0.8, 2.2)),
            errors_over("(b) error of the lash traversal time", values, f"torque {what} [{unit}]", "error [%]",
                        of_cases(found, names, readings, traversal_error))]))
    figures += _delay_figures(out, delayed)
    figures += _jitter_figures(out, pairs, jitter_sets)
    figures.append(draw_groups(
        out / "figure_3_20.png", "Figure 3.20: error of the lash traversal time over all steps and ramps",
        [box_panels(errors, "error [%]", [PRINTED_MEAN[p] for p in PERIODS])], columns=1))
    return figures


def _delay_figures(out: Path, delayed: Mapping[str, Drive]) -> list[str]:
    """Figures 3.10 to 3.14, at 10 ms: speeds with and without delay, estimates likewise."""
    figures = []
    plain = run_plant(VALIDATION)
    span, near = (1.0, 2.0), (1.1, 1.4)
    for (name, drive), numbers in zip(delayed.items(), (("3_10", "3_11"), ("3_12", "3_13"), ("3_14",))):
        late = run_plant(drive)
        traces, lash = {}, []
        for estimator in position_estimators():
            traces[f"{estimator}, no delay"] = listen(plain, Reading(estimator), drive.gear)
            traces[f"{estimator}, delay"] = listen(late, Reading(estimator), drive.gear)
        for letter, speed in zip("bc", ("engine_speed", "wheel_speed")):
            lash.append(Panel(f"({letter}) {speed.replace('_', ' ')}", [
                Curve(plain.time, RPM * plain[f"{speed}_measured"], "as it is", "measured", width=1.5),
                Curve(late.time, RPM * late[f"{speed}_measured"], "as it arrives", "first", "--")],
                "speed [rpm]", x_range=(1.15, 1.45)))
        title = f"Figure {numbers[0].replace('_', '.')}: {name} late"
        torque = torque_panel({"": drive}, span)
        figures.append(draw(out / f"figure_{numbers[0]}.png", title, [
            torque, *lash, lash_panel("(d) position in the lash", plain, traces, span)]))
        for number in numbers[1:]:
            figures.append(draw(out / f"figure_{number}.png", f"Figure {number.replace('_', '.')}: {name} late, "
                                "the traversal", [
                lash_panel("position in the lash", plain, traces, near)], columns=1))
    return figures


def _jitter_figures(out: Path, pairs: Mapping[tuple[Reading, tuple[int, int]], float],
                    jitter_sets: Sequence[int]) -> list[str]:
    """Figures 3.15 to 3.19."""
    figures = [draw(out / f"figure_3_{number}.png", f"Figure 3.{number}: jitter of the {source} speed (shapes "
                    "reconstructed: the measured sets are not published)", _densities(source))
               for number, source in ((15, "engine"), (16, "wheel"))]
    figures.append(draw(out / "figure_3_17.png", "Figure 3.17: how jitter is put into the speeds",
                        _layers(Drive().with_bus(engine_jitter=3)), columns=1))
    half = -(-len(jitter_sets) // 2)
    for number, wheels in ((18, jitter_sets[:half]), (19, jitter_sets[half:])):
        panels = []
        for wheel, estimator in product(wheels, position_estimators()):
            series = {in_ms(period): [pairs.get((Reading(estimator, period), (engine, wheel)), 0.0)
                                      for engine in jitter_sets] for period in PERIODS}
            panels.append(Groups(f"wheel set {wheel}, {estimator}", [str(s) for s in jitter_sets], series,
                                 "later by [ms]", "engine speed data set (1: no jitter)"))
        if panels:
            figures.append(draw_groups(out / f"figure_3_{number}.png", f"Figure 3.{number}: shift of the "
                                       "traversal's end with jitter (bars of zero height: none)", panels))
    return figures


def _densities(source: str) -> list[Panel]:
    """Each data set: its density and what is drawn from it; and all densities."""
    panels, ms = [], 1e3 * DENSITY
    draws = np.random.default_rng(1).uniform(size=2000)
    for letter, number in zip("abc", (2, 3, 4)):
        table = 1e3 * jitter_table(source, number, 1.0)
        drawn = np.interp(draws, np.linspace(0.0, 1.0, table.size), table)
        share, edges = np.histogram(drawn, bins=20, range=(-5.0, 5.0), density=True)
        panels.append(Panel(f"({letter}) data set {number}", [
            Curve(np.repeat(edges, 2)[1:-1], np.repeat(share, 2), "generated", "first"),
            Curve(ms, 1e-3 * jitter_density(source, number, DENSITY), "kernel density", "measured", width=1.5)],
            "density [1/ms]", "delay (+), advance (-) [ms]"))
    panels.append(Panel("(d) all", [
        Curve(ms, 1e-3 * jitter_density(source, number, DENSITY), f"data set {number}", shade)
        for number, shade in zip((2, 3, 4), COLORS)], "density [1/ms]", "delay (+), advance (-) [ms]"))
    return panels


def _layers(drive: Drive) -> list[Panel]:
    """One speed on its way: as it is, jittered on the bus, sampled by the estimator."""
    plant = run_plant(drive)
    rows = np.arange(10, plant.time.size, 10)
    span = (1.24, 1.32)
    inside = (plant.time >= span[0]) & (plant.time <= span[1])
    speed = RPM * plant["engine_speed"][inside]
    return [Panel("engine speed, data set 3", [
        Curve(plant.time, RPM * plant["engine_speed"], PLANT, "measured", width=1.5),
        Curve(plant.time, RPM * plant["engine_speed_measured"], "sampled at 1 ms and jittered", "first",
              width=0.9),
        Curve(plant.time[rows], RPM * plant["engine_speed_measured"][rows], "sampled again at 10 ms", "second",
              "o")],
        "speed [rpm]", x_range=span, y_range=(speed.min() - 3.0, speed.max() + 3.0))]
