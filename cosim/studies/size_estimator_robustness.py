"""Estimators of the lash size over torque profiles, lash sizes, delays, jitter and sampling times.

Table 4.2, figures 4.5 to 4.24. Every run has ten tip-ins in 50 s and is at 10, 5 and 1 ms. An error is that of the
size which holds after the last tip-in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cosim.report.error_figures import Groups, draw_groups
from cosim.report.study_figures import Curve, Panel
from cosim.studies import size_estimator
from cosim.studies.estimation import (
    PERIODS,
    THESIS_TKBSE,
    Drive,
    Reading,
    in_ms,
    measure_size,
    names,
    run_plant,
    size_errors,
    size_estimators,
    size_readings,
)
from cosim.studies.estimator_findings import (
    RPM,
    box_panels,
    draw,
    errors_over,
    of_cases,
    summarise,
    through_fmus,
    torque_panel,
)
from cosim.studies.findings import THESIS, Findings
from cosim.studies.size_estimator import LASHES, SPEED
from cosim.studies.sweep import CACHE, Case, Sweep
from cosim.studies.torque_profiles import LONG, RATE, TorqueProfile, ramps, random, steps, varying

SOURCE = f"{THESIS}, table 4.2, figures 4.5 to 4.24"
PROFILES: dict[str, dict[str, TorqueProfile]] = {
    "steps": {f"Step {i} ({torque:g} N.m)": steps(torque) for i, torque in enumerate((60.0, 100.0, 150.0), 1)},
    "ramps": {f"Ramp {i} ({i * RATE:g} N.m/s)": ramps(i * RATE) for i in (1, 2, 3)},
    "varying": {f"Varying {i}": varying(i) for i in (1, 2)},
    "random": {"Random": random()},
}
VALIDATION = Drive(ramps(RATE), stop=LONG, vehicle_speed=SPEED)
ENGINE_DELAYS = (0.005, 0.01, 0.02)  # [s]
WHEEL_DELAYS = (0.01, 0.02, 0.03)
BOTH_DELAYS = (0.01, 0.03)
JITTER_SETS = (1, 2, 3, 4)
PRINTED_MEAN = {0.01: 3.0, 0.005: 2.0, 0.001: 1.5}  # section 4.3.9, figure 4.24 [%]
PRINTED_LARGEST = {0.01: 8.0}  # section 5.1
PRINTED_BOTH = 4.0  # section 4.3.7, at 10 ms
PRINTED_JITTER = 3.5  # section 5.1, largest at 10 ms
ERROR = "error [%]"
TOLD = (THESIS_TKBSE, "lash_observer")  # these also know the delays

Errors = Mapping[tuple[str, float], Sequence[float]]


def run(out: Path, progress: Callable[[float], None], profiles: Mapping[str, Mapping[str, TorqueProfile]] = PROFILES,
        lashes: Sequence[float] = tuple(LASHES), jitter_sets: Sequence[int] = JITTER_SETS,
        validation: Drive = VALIDATION, workers: int | None = None, cluster: str | None = None) -> Findings:
    """Rows and pictures.

    Args:
        profiles: Torques by kind and name.
        lashes: Factors on the plant's gaps.
        jitter_sets: Data sets of jitter, each with each; 1 is none.
        validation: What delays and jitter are tried with.
        workers, cluster: See ``sweep.Sweep``.
    """
    findings = Findings()
    readings = size_readings()
    drives: dict[Any, Drive] = {"plain": validation}
    drives |= {(name, lash): Drive(profile, stop=validation.stop, vehicle_speed=SPEED, lash=lash)
               for named in profiles.values() for name, profile in named.items() for lash in lashes}
    engine = {("engine", delay): validation.with_bus(engine_delay=delay) for delay in ENGINE_DELAYS}
    wheel = {("wheel", delay): validation.with_bus(wheel_delay=delay) for delay in WHEEL_DELAYS}
    both = {"both": validation.with_bus(engine_delay=BOTH_DELAYS[0], wheel_delay=BOTH_DELAYS[1])}
    jittered = {("jitter", *pair): validation.with_bus(engine_jitter=pair[0], wheel_jitter=pair[1])
                for pair in product(jitter_sets, jitter_sets) if pair != (1, 1)}
    drives |= engine | wheel | both | jittered
    late = {**engine, **wheel, **both}
    told = {name: [reading.told(drive.bus) for reading in readings if reading.name in TOLD]
            for name, drive in late.items()}
    cases = [Case(str(name), measure_size, {"drive": drive, "readings": readings})
             for name, drive in drives.items()]
    cases += [Case(f"told {name}", measure_size, {"drive": late[name], "readings": knowing})
              for name, knowing in told.items()]
    results = Sweep(out / CACHE, workers, cluster).run(cases, lambda share: progress(0.7 * share))
    found = {name: results[str(name)] for name in drives}
    _rows(findings, found, profiles, lashes, readings)
    _delay_and_jitter_rows(findings, found, [*late], list(jittered), readings)
    for name, knowing in told.items():
        _delay_rows(findings, _late_by(name), results[f"told {name}"], knowing, None)
    errors = of_cases(found, [name for name in found if name != "plain"], readings, final_error)
    _summary(findings, found, errors, readings, list(jittered))
    _table_4_2(findings, profiles, lashes, list(jittered))
    through_fmus(findings, both["both"], [r for r in readings if r.period == PERIODS[0]])
    progress(0.8)
    figures = _Figures(out, found, readings, validation)
    figures.profiles(profiles, lashes)
    figures.delays()
    figures.jitter(jitter_sets)
    figures.boxes(errors)
    findings.figures += figures.drawn
    return findings


def final_error(case: Mapping[str, Any], number: int) -> float:
    """Error of the size after the last tip-in [%], with sign."""
    return size_errors(case, number)[-1]


def _note(case: Mapping[str, Any], number: int) -> str:
    errors = size_errors(case, number)
    note = f"largest after any tip-in {np.abs(errors).max():.2f} %"
    said = case["readings"][number]
    if "low" in said:
        inside = sum(low <= case["truth"] <= high for low, high in zip(said["low"], said["high"]))
        note += f"; truth in its 90 % interval after {inside} of {len(errors)}"
    return note


def _rows(findings: Findings, found: Mapping[Any, Any], profiles: Mapping[str, Mapping[str, TorqueProfile]],
          lashes: Sequence[float], readings: Sequence[Reading]) -> None:
    """Figures 4.7, 4.10, 4.13 and 4.15 in numbers."""
    for named in profiles.values():
        for (name, profile), lash, (i, reading) in product(named.items(), lashes, enumerate(readings)):
            case = found[name, lash]
            which = f"{name}, {LASHES[lash]}, {in_ms(reading.period)}, {reading.name}"
            findings.add(f"lash size, error, {which}", "%", None, abs(final_error(case, i)), _note(case, i))
            if name == "Random":
                errors = size_errors(case, i)
                torques = [target for _, target, _ in profile.changes[::2]][:len(errors)]
                highest = int(np.argmax(torques))
                findings.add(f"lash size, error after the highest tip-in, {which}", "%", None,
                             abs(errors[highest]),
                             f"the thesis keeps the size found there; tip-in {highest + 1} of {len(torques)}, "
                             f"to {torques[highest]:g} N.m")


def _delay_and_jitter_rows(findings: Findings, found: Mapping[Any, Any], delayed: Sequence[Any],
                           jittered: Sequence[Any], readings: Sequence[Reading]) -> None:
    """Figures 4.17, 4.19, 4.21 and 4.23 in numbers; without either for comparison."""
    named = {"plain": "no delay, no jitter"}
    named |= {name: _late_by(name) for name in delayed}
    named |= {name: f"jitter sets engine {name[1]}, wheel {name[2]}" for name in jittered}
    for name, text in named.items():
        _delay_rows(findings, text, found[name], readings, PRINTED_BOTH if name == "both" else None)


def _delay_rows(findings: Findings, text: str, case: Mapping[str, Any], readings: Sequence[Reading],
                printed: float | None) -> None:
    for i, reading in enumerate(readings):
        findings.add(f"lash size, error, {text}, {in_ms(reading.period)}, {reading.name}", "%",
                     printed if reading.period == PERIODS[0] else None, abs(final_error(case, i)), _note(case, i))


def _late_by(name: Any) -> str:
    if name == "both":
        return f"engine speed {in_ms(BOTH_DELAYS[0])}, wheel speed {in_ms(BOTH_DELAYS[1])} late"
    return f"{name[0]} speed {in_ms(name[1])} late"


def _summary(findings: Findings, found: Mapping[Any, Any], errors: Errors, readings: Sequence[Reading],
             jittered: Sequence[Any]) -> None:
    def printed(statistic: str, estimator: str, period: float) -> float | None:
        return {"mean": PRINTED_MEAN, "largest": PRINTED_LARGEST}.get(statistic, {}).get(period)

    summarise(findings, "error of the lash size, the whole set", "%", errors, printed, "figure 4.24; about")
    for i, reading in enumerate(readings):
        which = f"{in_ms(reading.period)}, {reading.name}"
        if jittered:
            findings.add(f"largest error of the lash size with jitter, {which}", "%",
                         PRINTED_JITTER if reading.period == 0.01 else None,
                         max(abs(final_error(found[name], i)) for name in jittered), f"of {len(jittered)} runs")
        tip_ins = np.abs(np.concatenate([size_errors(case, i) for case in found.values()]))
        findings.add(f"mean error of the lash size after any tip-in, the whole set, {which}", "%", None,
                     tip_ins.mean(), f"of {tip_ins.size} tip-ins; largest {tip_ins.max():.1f} %, 95 % below "
                     f"{np.percentile(tip_ins, 95):.1f} %")
        said = [case["readings"][i] for case in found.values()]
        if all("low" in entry for entry in said):
            inside = np.concatenate([[low <= case["truth"] <= high for low, high in zip(entry["low"], entry["high"])]
                                     for case, entry in zip(found.values(), said)])
            findings.add(f"true lash size in the 90 % interval, the whole set, {which}", "%", None,
                         100.0 * inside.mean(), f"of {inside.size} tip-ins; 90 % is what the interval promises")


def _table_4_2(findings: Findings, profiles: Mapping[str, Mapping[str, TorqueProfile]], lashes: Sequence[float],
               jittered: Sequence[Any]) -> None:
    """What was assessed, as table 4.2 lists it, by the number of runs at every sampling time."""
    rows = {"varying torque step inputs": "steps", "varying torque ramp rates": "ramps",
            "varying duty cycle and pulse width": "varying", "variable torque input profile": "random"}
    counts = {what: len(profiles.get(kind, {})) * len(lashes) for what, kind in rows.items()}
    counts |= {"constant delay in engine speed": len(ENGINE_DELAYS),
               "constant delay in wheel speed": len(WHEEL_DELAYS), "constant delay in both": 1,
               "CAN jitter in engine speed": sum(name[2] == 1 for name in jittered),
               "CAN jitter in wheel speed": sum(name[1] == 1 for name in jittered),
               "CAN jitter in both": sum(min(name[1:]) > 1 for name in jittered)}
    for what, runs in counts.items():
        findings.add(f"table 4.2: runs with {what}", "1", None, runs, f"each at {len(PERIODS)} sampling times")


class _Figures:
    """The figures of section 4.3; ``drawn`` are their names."""

    def __init__(self, out: Path, found: Mapping[Any, Any], readings: Sequence[Reading], validation: Drive) -> None:
        self.out, self.found, self.readings, self.validation = out, found, readings, validation
        self.drawn: list[str] = []
        self.two = (0.0, min(validation.stop, 10.5))

    def profiles(self, profiles: Mapping[str, Mapping[str, TorqueProfile]], lashes: Sequence[float]) -> None:
        """Figures 4.5 to 4.15: torque, the run of its first profile, errors."""
        numbers = {"steps": (5, 6, 7), "ramps": (8, 9, 10), "varying": (11, 12, 13), "random": (None, 14, 15)}
        for kind, named in profiles.items():
            shown, simulated, errors = numbers[kind]
            drives = {name: Drive(profile, stop=self.validation.stop, vehicle_speed=SPEED)
                      for name, profile in named.items()}
            first = next(iter(drives))
            if shown is not None:
                span = self.two if kind != "varying" else (0.0, self.validation.stop)
                if kind == "varying":
                    drives |= {"constant": self.validation}
                self._draw(shown, f"torque profiles: {kind}", [
                    torque_panel({name: drive}, span, f"({letter}) {name}")
                    for letter, (name, drive) in zip("abcd", drives.items())], 1)
            self._simulation(simulated, first, drives[first], self.two if kind in ("steps", "ramps") else
                             (0.0, self.validation.stop))
            self._profile_errors(errors, kind, list(named), lashes)

    def _profile_errors(self, number: int, kind: str, profiles: Sequence[str], lashes: Sequence[float]) -> None:
        """A panel an estimator and lash; groups are profiles, series are sampling times."""
        panels = []
        for estimator, lash in product(names(self.readings), lashes):
            series = {in_ms(r.period): [abs(final_error(self.found[profile, lash], i)) for profile in profiles]
                      for i, r in enumerate(self.readings) if r.name == estimator}
            panels.append(Groups(f"{LASHES[lash]}, {estimator}", [profile.partition(" (")[0] for profile in profiles],
                                 series, ERROR))
        self._groups(number, f"error of the lash size, torque profiles: {kind}", panels, len(lashes))

    def delays(self) -> None:
        """Figures 4.16 to 4.21."""
        for speed, delays, (shown, errors), at in (
                ("engine", ENGINE_DELAYS, (16, 17), 0.01), ("wheel", WHEEL_DELAYS, (18, 19), 0.03)):
            self._late(shown, speed, at)
            data = of_cases(self.found, ["plain", *((speed, delay) for delay in delays)], self.readings, final_error)
            x = [0.0, *(1e3 * delay for delay in delays)]
            self._draw(errors, f"error of the size with a constant delay of the {speed} speed, 2 alpha", [
                errors_over("error of the lash size", x, f"delay of the {speed} speed [ms]", ERROR, data)], 1)
        late = self.validation.with_bus(engine_delay=BOTH_DELAYS[0], wheel_delay=BOTH_DELAYS[1])
        self._simulation(20, "engine speed 10 ms, wheel speed 30 ms late", late, (0.0, self.validation.stop))
        series = {estimator: [abs(final_error(self.found["both"], i)) for i, r in enumerate(self.readings)
                              if r.name == estimator] for estimator in names(self.readings)}
        self._groups(21, "error of the size with both delays, 2 alpha", [Groups(
            "engine speed 10 ms, wheel speed 30 ms late", [in_ms(p) for p in PERIODS], series, ERROR,
            "sampling time", [PRINTED_BOTH, None, None])], 1)

    def _late(self, number: int, speed: str, delay: float) -> None:
        """Both estimator inputs at 10 ms: with and without delay."""
        panels = []
        rows = slice(0, None, 10)
        for letter, title, (begin, end) in (("a", "one tip-in", (0.8, 3.0)), ("b", "closer", (1.2, 1.5))):
            curves = []
            for label, bus, style, shade in (("no delay", {}, "-", "measured"),
                                             (f"{in_ms(delay)} late", {f"{speed}_delay": delay}, "--", "first")):
                plant = run_plant(Drive(self.validation.torque, stop=3.0, vehicle_speed=SPEED).with_bus(**bus))
                inside = (plant.time[rows] >= begin) & (plant.time[rows] <= end)
                curves.append(Curve(plant.time[rows][inside], RPM * plant[f"{speed}_speed_measured"][rows][inside],
                                    label, shade, style, width=1.3))
            panels.append(Panel(f"({letter}) {title}", curves, "speed [rpm]", x_range=(begin, end)))
        self._draw(number, f"{speed} speed with and without delay, sampled at 10 ms", panels, 2)

    def jitter(self, sets: Sequence[int]) -> None:
        """Figures 4.22 and 4.23."""
        plant = run_plant(Drive(self.validation.torque, stop=2.0, vehicle_speed=SPEED).with_bus(
            engine_jitter=3, wheel_jitter=4))
        panels = []
        for letter, speed, number in (("a", "engine", 3), ("b", "wheel", 4)):
            span = (1.20, 1.28)
            inside = np.flatnonzero((plant.time >= span[0]) & (plant.time <= span[1]))
            rows = inside[inside % 10 == 0]
            arrived = RPM * plant[f"{speed}_speed_measured"]
            panels.append(Panel(f"({letter}) {speed} speed, data set {number}", [
                Curve(plant.time[inside], RPM * plant[f"{speed}_speed"][inside], "plant", "measured", width=1.5),
                Curve(plant.time[inside], arrived[inside], "1 ms, jittered", "first", width=0.9),
                Curve(plant.time[rows], arrived[rows], "sampled at 10 ms", "second", "o")],
                "speed [rpm]", x_range=span))
        self._draw(22, "how jitter is put into the speeds", panels, 2)
        panels = []
        for estimator, (i, reading) in product(names(self.readings), enumerate(self.readings)):
            if reading.name == estimator:
                series = {f"wheel set {wheel}": [abs(final_error(self.found[self._pair(engine, wheel)], i))
                                                 for engine in sets] for wheel in sets}
                panels.append(Groups(f"{in_ms(reading.period)}, {estimator}", [str(s) for s in sets], series, ERROR,
                                     "engine speed data set (1: no jitter)"))
        self._groups(23, "error of the size with jitter, 2 alpha", panels, len(PERIODS))

    @staticmethod
    def _pair(engine: int, wheel: int) -> Any:
        return "plain" if (engine, wheel) == (1, 1) else ("jitter", engine, wheel)

    def boxes(self, errors: Errors) -> None:
        """Figure 4.24."""
        self._groups(24, "error of the lash size over the whole set", [
            box_panels(errors, ERROR, [PRINTED_MEAN[p] for p in PERIODS])], 1)

    def _simulation(self, number: int, name: str, drive: Drive, span: tuple[float, float]) -> None:
        plant = run_plant(drive)
        who = size_estimators() if drive.bus == self.validation.bus else names(self.readings)
        heard = size_estimator.heard(plant, drive, who)
        self._draw(number, f"{name}, 2 alpha, 10 ms",
                   size_estimator.panels(plant, heard, drive, span, split=True), 2)

    def _draw(self, number: int, title: str, panels: Sequence[Panel], columns: int) -> None:
        self.drawn.append(draw(self.out / f"figure_4_{number}.png", f"Figure 4.{number}: {title}", panels, columns))

    def _groups(self, number: int, title: str, panels: Sequence[Groups], columns: int) -> None:
        self.drawn.append(draw_groups(self.out / f"figure_4_{number}.png", f"Figure 4.{number}: {title}", panels,
                                      columns))
