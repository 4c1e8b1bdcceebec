"""From a measurement to a finding: the pipeline, and the files it writes."""

from __future__ import annotations

import json
import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cosim.diagnosis import extend, proposal
from cosim.diagnosis.identify import Fit, Identification, Search, inseparable, probabilities
from cosim.diagnosis.plants import FullOrderCar, Run
from cosim.diagnosis.predict import Predictor, coordinates
from cosim.diagnosis.residuals import Wrong, wrong
from cosim.files import write_text
from cosim.measured import Measurement, load
from driveline.quantities import InputError

log = logging.getLogger("cosim")
LIKELY = 0.05  # causes less probable are not listed
SURE = 0.8  # a cause more probable than this needs no further recording


@dataclass
class Diagnosis:
    """Everything a finding and its report are made of.

    Attributes:
        finding: As the contract has it.
        measurement, car, runs, reserved: What was looked at; ``reserved`` runs were not, until the gain.
        identification: The search's result.
        wrong: What the vehicle file gets wrong.
        traces: For pictures: run, channel to (clock, measured, before, after).
        notices: What limits the diagnosis, in words.
    """

    finding: dict[str, Any]
    measurement: Measurement
    car: FullOrderCar
    runs: list[Run]
    reserved: list[Run]
    identification: Identification
    wrong: list[Wrong]
    traces: dict[tuple[str, str], tuple[np.ndarray, ...]] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)
    seconds: float = 0.0


def diagnose(path: Path, out: Path | None = None, *, workers: int | None = None,
             say: Callable[[str], None] = log.info,
             build: Callable[[Path, Path], Path] | None = None) -> Diagnosis:
    """Diagnose a measurement.

    Args:
        path: A measurement folder or data file.
        out: Where ``finding.json``, ``report.html``, the extended vehicle and FMU go; None: no files.
        workers: Processes; default: as many as there are processors.
        say: Told what happens.
        build: Makes the extended FMU: ``(folder, vehicle file) -> path``; None: no FMU.

    Raises:
        InputError: The measurement cannot be understood, or lacks what any diagnosis needs.
    """
    began = time.perf_counter()
    measurement = load(path)
    if measurement.vehicle is None:
        raise InputError(f"{path}: which vehicle? measurement.toml needs vehicle = \"...\"")
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs, reserved = _reserve(car.runs(measurement))
    notices = _notices(runs, reserved)
    for notice in notices:
        say(notice)
    workers = workers or len(os.sched_getaffinity(0))
    with Predictor(car, runs, coordinates(car, runs), workers) as predictor:
        search = Search(predictor, say)
        found = search.run()
        say("reading features")
        listed = wrong(predictor, found)
        finding = _finding(predictor, found, listed)
        diagnosis = Diagnosis(finding, measurement, car, runs, reserved, found, listed, notices=notices)
        _traces(diagnosis, found)
        if finding["verdict"] == "ambiguous":
            say("looking for the manoeuvre that would tell the causes apart")
            _propose(diagnosis, predictor, found)
        if found.best.effects:
            _extend(diagnosis, predictor, found, out, build, say)
    diagnosis.seconds = time.perf_counter() - began
    if out is not None:
        from cosim.report.diagnosis_html import render

        finding["notices"], finding["run_seconds"] = notices, diagnosis.seconds
        write_text(out / "report.html", render(diagnosis))
        write_text(out / "finding.json", json.dumps(finding, indent=2) + "\n")
    return diagnosis


def _reserve(runs: list[Run]) -> tuple[list[Run], list[Run]]:
    """One run for the gain where there are three or more: a repeat if there is one, or else the last."""
    if len(runs) < 3:
        return runs, []
    kinds = [(run.kind, run.gear) for run in runs]
    repeats = [i for i, kind in enumerate(kinds) if kind in kinds[:i]]
    chosen = repeats[-1] if repeats else len(runs) - 1
    return [run for i, run in enumerate(runs) if i != chosen], [runs[chosen]]


def _notices(runs: list[Run], reserved: list[Run]) -> list[str]:
    """What the recordings cannot show."""
    notices = []
    present = {name for run in runs for name in run.clocks}
    blind = {
        "propeller_shaft_torque": "without the propeller shaft torque, causes before and behind it can hardly be "
                                  "told apart, and nothing of the torque meter",
        "engine_speed": "without the engine speed nothing is known of the converter clutch and of that sensor",
        "wheel_speed": "without a wheel speed tyre slip and rolling radius cannot be told from gear and speed",
        "vehicle_speed": "without a vehicle speed tyre slip and rolling radius cannot be told"}
    notices += [text for name, text in blind.items() if name not in present]
    if not reserved:
        notices.append("fewer than three recordings: none is left over to measure the gain on")
    if len(runs) == 1:
        notices.append("one recording: nothing can be predicted that was not fitted, so every cause is less sure")
    return notices


def _finding(predictor: Predictor, found: Identification, listed: list[Wrong]) -> dict[str, Any]:
    best = found.best
    shares = probabilities(found)
    rivals = inseparable(found)
    causes = []
    for effect in sorted(best.effects, key=lambda e: -shares[e]):
        causes.append({"effect": effect, "probability": shares[effect],
                       "parameters": _parameters(predictor, best, effect)})
    for effect, share in sorted(shares.items(), key=lambda item: -item[1]):
        if effect not in best.effects and share > LIKELY:
            fit = next(f for f in found.alternatives if effect in f.effects)
            causes.append({"effect": effect, "probability": share,
                           "parameters": _parameters(predictor, fit, effect)})
    if not best.effects:
        verdict = "unknown" if listed else "none"
    elif any(set(f.effects) - set(best.effects) for f, _ in rivals):
        verdict = "ambiguous"
    else:
        verdict = "cause"
    return {
        "verdict": verdict,
        "wrong": [w.as_json() for w in listed],
        "causes": causes,
        "ambiguous_with": [{"effects": sorted(set(fit.effects) - set(best.effects)) or list(fit.effects),
                            "separation_sigma": distance} for fit, distance in rivals
                           if set(fit.effects) - set(best.effects)],
        "next_manoeuvre": None, "unknown": None, "extension": None, "gain": None}


def _parameters(predictor: Predictor, fit: Fit, effect: str) -> dict[str, dict[str, Any]]:
    result = {}
    for i in predictor.index(effect):
        p = predictor.coordinates[i].parameter
        deviation = float(np.sqrt(fit.posterior.covariance[i, i]))
        value, low, high = (p.size(float(fit.point[i]) + 1.645 * d * deviation) for d in (0.0, -1.0, 1.0))
        nominal, value, unit = p.physical(value, predictor.car.values)
        low, high = (p.physical(x, predictor.car.values)[1] for x in (low, high))
        result[p.name] = {"nominal": nominal, "value": value, "low90": low, "high90": high, "unit": unit}
    return result


def _traces(diagnosis: Diagnosis, found: Identification) -> None:
    for run, before, after in zip(diagnosis.runs, found.nominal, found.best.predicted):
        for name, place in run.slices.items():
            diagnosis.traces[(run.name, name)] = (run.clocks[name], run.measured[name], before[place], after[place])


def _values(predictor: Predictor, fit: Fit) -> dict[str, float]:
    """Values with the supposed effects in them, and nothing else changed."""
    point = np.array([x if c.effect in fit.effects and c.parameter is not None else 0.0
                      for c, x in zip(predictor.coordinates, fit.point)])
    return predictor.values(point, 0)[0]


def _propose(diagnosis: Diagnosis, predictor: Predictor, found: Identification) -> None:
    rivals = [f for f, _ in inseparable(found) if set(f.effects) - set(found.best.effects)]
    other = rivals[0]
    best = proposal.propose(diagnosis.car, found.noise, _values(predictor, found.best), _values(predictor, other),
                            diagnosis.runs[0])
    if best is not None:
        diagnosis.finding["next_manoeuvre"] = {
            "kind": best.kind, "gear": best.gear, "separation_sigma": best.separation_sigma,
            "why": proposal.words(best, found.best.effects, other.effects)}


def _extend(diagnosis: Diagnosis, predictor: Predictor, found: Identification, out: Path | None,
            build: Callable[[Path, Path], Path] | None, say: Callable[[str], None]) -> None:
    """The extended vehicle and FMU, and the gain on the reserved runs."""
    car, values = diagnosis.car, _values(predictor, found.best)
    changes = extend.changed_values(car.values, values)
    fmu = None
    if out is not None:
        why = (f"diagnosis of {diagnosis.measurement.name}: "
               + ", ".join(e.replace("_", " ") for e in found.best.effects))
        extend.write_vehicle(car.source, changes, car.units, why, out / extend.EXTENDED)
        if build is not None:
            say("building the extended FMU")
            fmu = build(out, out / extend.EXTENDED)
        diagnosis.finding["extension"] = {"vehicle": extend.EXTENDED, "fmu": fmu.name if fmu else None}
    if not diagnosis.reserved:
        return
    say("measuring the gain on " + ", ".join(run.name for run in diagnosis.reserved))

    def simulate(extended: bool, run: Run) -> dict[str, np.ndarray]:
        now = values if extended else car.values
        if fmu is None:
            return car.raw(now, run)
        nominal = {} if extended else {name: car.values[name] for name in changes}
        return extend.co_simulate(fmu, nominal, extend.with_inputs(run, now), run.start_speed)

    rows = extend.gain(diagnosis.reserved, simulate, (car.values, values), found.noise.floors())
    for run in diagnosis.reserved:
        for name, clock in run.clocks.items():
            before, after = (car.instruments(car.raw(v, run), v, run)[run.slices[name]] for v in (car.values, values))
            diagnosis.traces[(run.name, name)] = (clock, run.measured[name], before, after)
    after, floor = (np.array([getattr(row, key) for row in rows]) for key in ("nrmse_after", "noise_floor"))
    diagnosis.finding["gain"] = {
        "held_out": [{"manoeuvre": row.run, "signal": row.signal, "nrmse_before": row.nrmse_before,
                      "nrmse_after": row.nrmse_after, "noise_floor": row.noise_floor} for row in rows],
        "fraction_of_noise_floor": float(np.median(after / floor))}
