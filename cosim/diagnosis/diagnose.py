"""From a measurement to a finding: the pipeline, and the files it writes."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from cosim.diagnosis.benches.bench import diagnose_bench
from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.fit.fitting import Fit, as_found
from cosim.diagnosis.fit.noise import WANDER, Noise
from cosim.diagnosis.fit.predict import ZERO, Coordinate, Predictor, coordinates, zero_of
from cosim.diagnosis.gain import extend
from cosim.diagnosis.gain.profit import profit
from cosim.diagnosis.gain.swings import as_driven
from cosim.diagnosis.judge import proposal
from cosim.diagnosis.judge.confirm import FEWEST, Jury, words
from cosim.diagnosis.judge.finding import believed, doubts, gained
from cosim.diagnosis.judge.localise import Disturbance, Supposed, each_its_own, goes_with, tied
from cosim.diagnosis.judge.road import on_its_road
from cosim.diagnosis.judge.sensors import WrongSensor, odd_one, wrong_sensors
from cosim.diagnosis.judge.shafts import bent_shafts
from cosim.diagnosis.judge.verdict import (
    beside,
    beside_unknown,
    finding_of,
    is_strange,
    left_over,
    probabilities,
    rivals_of,
)
from cosim.diagnosis.plants import FullOrderCar, InstrumentedPlant, RigidPlant, Run, plant_for, plausible
from cosim.diagnosis.plants.led import PLACES
from cosim.diagnosis.plants.observation import CHANNELS
from cosim.diagnosis.search.identification import APART, Identification
from cosim.diagnosis.search.identify import Search
from cosim.diagnosis.show.residuals import wrong
from cosim.files import write_text
from cosim.measured import Channel, Manoeuvre, Measurement, load
from cosim.workers import cores

log = logging.getLogger("cosim")
_TOLD = 1.0  # N.m.s: impulse that may be lost where frames are, from which on that is said
_NOT_LEVEL = 2.0  # times what accelerometers show at rest, from which on that is said
_WANDERS = 5.0  # times its wander: by less the engine's torque changes where nobody drives with it
_COMPARED = 4  # rivals that a proposed manoeuvre has to tell from the best
_DRAWS = 30  # healthy cars
_FAR_MORE = 2.0  # times what a torque explains that is missing in a healthy car (a judgement)
_FIRING_ORDER = "torque_ripple.order"


@dataclass
class Diagnosis:
    """Everything a finding and its report are made of.

    Attributes:
        finding: As the contract has it.
        measurement, car, runs, reserved: What was looked at; ``reserved`` runs were not, until the gain.
        further: Stretches of a long drive that judge what was found.
        wrong: What the vehicle file gets wrong, as in the finding.
        traces: For pictures: run, channel to (clock, measured, before, after).
        suspects: Every effect with its probability, as that of causes is meant.
        disturbance: The torque that is missing, at some instants, and what it may go with; empty for none.
        taken_out: Values of the vehicle file that the car was diagnosed without (``_without_swings``).
        notices: What limits the diagnosis, in words.
        seconds: It took.
        identification: The search's result; None for a bench.
    """

    finding: dict[str, Any]
    measurement: Measurement
    car: InstrumentedPlant
    runs: list[Run]
    reserved: list[Run]
    further: list[Run] = field(default_factory=list)
    wrong: list[dict[str, Any]] = field(default_factory=list)
    traces: dict[tuple[str, str], tuple[np.ndarray, ...]] = field(default_factory=dict)
    suspects: list[dict[str, Any]] = field(default_factory=list)
    disturbance: dict[str, np.ndarray] = field(default_factory=dict)
    taken_out: dict[str, float] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)
    seconds: float = 0.0
    identification: Identification | None = None


@threadpool_limits.wrap(limits=1)  # small matrices, and a process a core: more threads only wait for one another
def diagnose(path: Path, out: Path | None = None, *, vehicle: str | None = None, variant: str | None = None,
             workers: int | None = None, say: Callable[[str], None] = log.info,
             build: Callable[[Path, Path], Path] | None = None) -> Diagnosis:
    """Diagnose a measurement.

    Args:
        path: A measurement folder or data file.
        vehicle, variant: By name or file, where they are not those that the measurement says; a data file says none.
        out: Where ``finding.json``, ``report.html``, the extended vehicle and FMU go; None: no files.
        workers: Processes; default: as many as there are processors.
        say: Told what happens.
        build: Makes the extended FMU: ``(folder, vehicle file) -> path``; None: no FMU.

    Raises:
        InputError: The measurement cannot be understood, or lacks what any diagnosis needs.
    """
    began = time.perf_counter()
    measurement = load(path)
    if vehicle is not None:
        measurement = replace(measurement, vehicle=vehicle, variant=variant)
    car = plant_for(measurement)
    stretches, further, left_out = car.stretches(measurement)
    if isinstance(car, FullOrderCar):
        plausible.check(car, measurement, [*stretches, *further])
    runs, reserved = _reserve(stretches)
    taken_out = _without_swings(car)
    notices = [*(f"the vehicle file has {name} = {had:g}, but no recording's phase of it: it is taken out, and all "
                 "that is found of it is said" for name, had in taken_out.items()),
               *left_out, *_notices(measurement, car, runs, reserved)]
    for notice in notices:
        say(notice)
    repaired = [notice for manoeuvre in measurement.manoeuvres for notice in manoeuvre.notices]  # said as it was read
    diagnosis = Diagnosis({}, measurement, car, runs, reserved, further, taken_out=taken_out,
                          notices=[*dict.fromkeys(repaired), *notices])
    if isinstance(car, RigidPlant):
        _bench(diagnosis, car, out, say)
    else:
        _driveline(diagnosis, car, out, workers or cores(), say, build)
    for cause in diagnosis.finding["causes"]:
        for p in CATALOGUE[cause["effect"]].parameters:
            if p.name in cause["parameters"] and p.targets[0] in taken_out:
                cause["parameters"][p.name]["nominal"] = taken_out[p.targets[0]]
    diagnosis.notices += doubts(diagnosis.finding)
    diagnosis.wrong = diagnosis.finding["wrong"]
    diagnosis.seconds = time.perf_counter() - began
    diagnosis.finding["notices"], diagnosis.finding["run_seconds"] = diagnosis.notices, diagnosis.seconds
    if out is not None:
        from cosim.report.diagnosis.page import render

        write_text(out / "report.html", render(diagnosis))
        write_text(out / "finding.json", json.dumps(diagnosis.finding, indent=2) + "\n")
    return diagnosis


def _without_swings(car: InstrumentedPlant) -> dict[str, float]:
    """Takes out of a car what swings with an angle; what there was.

    A file has no phase for it that is that of a recording: as it is it would only be wrong once more.
    """
    had = {target: size for effect in CATALOGUE.values() for p in effect.parameters if p.name in effect.swings
           for target in p.targets if (size := car.values.get(target, 0.0))}
    car.values |= dict.fromkeys(had, 0.0)
    return had


def _reserve(runs: list[Run]) -> tuple[list[Run], list[Run]]:
    """One run for the gain where there are three or more: one that is repeated, or else that with the steadiest torque.

    Never the last, which may have been driven because a diagnosis asked for it. What is lively says most of causes.
    """
    if len(runs) < 3:
        return runs, []
    kinds = [run.manoeuvre for run in runs]
    repeated = [i for i, kind in enumerate(kinds) if kind and kind in kinds[i + 1:]]
    chosen = repeated[-1] if repeated else int(np.argmin([np.std(run.inputs[:, 0]) for run in runs[:-1]]))
    return [run for i, run in enumerate(runs) if i != chosen], [runs[chosen]]


def _drives(recordings: int) -> dict[int, int]:
    """How often a manoeuvre may be driven beside other recordings, and how many of it are fitted then (``_reserve``).

    Driven once beside two it would take the place of one of these, which is kept back then.
    """
    return {2 if recordings == 2 else 1: 1, 3: 2, 4: 3}


def _notices(measurement: Measurement, car: InstrumentedPlant, runs: list[Run], reserved: list[Run]) -> list[str]:
    """What the recordings cannot show, and how they are read."""
    notices = []
    present = {name for run in runs for name in run.clocks}
    blind = {
        "propeller_shaft_torque": "without the propeller shaft torque, causes before and behind it can hardly be "
                                  "told apart, and nothing of the torque meter",
        "engine_speed": "without the engine speed nothing is known of the converter clutch and of that sensor",
        "wheel_speed": "without a wheel speed tyre slip and rolling radius cannot be told from gear and speed",
        "vehicle_speed": "without a vehicle speed tyre slip and rolling radius cannot be told"}
    if isinstance(car, FullOrderCar):
        notices += [text for name, text in blind.items() if name not in present]
        notices += _excitation(car, runs)
        notices += [f"{manoeuvre.name}: {', '.join(held)} held between samples; only those that were measured count"
                    for manoeuvre in measurement.manoeuvres
                    if (held := [name for name, channel in car.updated(manoeuvre).channels.items()
                                 if channel is not manoeuvre[name]])]
        notices += [f"{manoeuvre.name}: {name} reads the same number again and again for {_lasts(of):.2g} s, from "
                    f"{of.time[0]:.3g} to {of.time[-1]:.3g} s: its sensor hangs or is at its limit, and it is left out "
                    "there" for manoeuvre in map(Manoeuvre.from_zero, measurement.manoeuvres)
                    for name, of in car.hanging(manoeuvre).items()]
    notices += [f"{manoeuvre.name}: times count from {manoeuvre.zero:.15g} s of its file"
                for manoeuvre in measurement.manoeuvres if manoeuvre.zero and isinstance(car, FullOrderCar)]
    for run in runs:
        lost = [gap for gap in run.gaps if gap.impulse > _TOLD]
        if lost:
            notices.append(f"{run.name}: frames of the torque are lost for up to "
                           f"{1e3 * max(gap.end - gap.begin for gap in lost):.0f} ms where it changes; what it was "
                           "there is estimated")
    if not reserved:
        notices.append("fewer than three recordings: none is left over to measure the gain on")
    if len(runs) == 1:
        notices.append("one recording: nothing can be predicted that was not fitted, so every cause is less sure")
    return notices


def _excitation(car: FullOrderCar, runs: Sequence[Run]) -> list[str]:
    """What recordings cannot show in none of which the driver does anything."""
    swing = max(run.swing for run in runs)
    if swing > _WANDERS * WANDER:
        return []
    does = f"changes by no more than {swing:.2g} N.m in any recording" if swing > 0.0 else (
        "does not change in any recording (if the car was driven otherwise, its signal hangs)")
    return [f"{car.driver} {does}: unless it rings from before, nothing excites the driveline, so of lash, stiffness, "
            "damping, inertias and delays hardly anything can be told"]


def _zeros(declared: Sequence[Coordinate], fit: Fit) -> list[str]:
    """Which accelerometers show more at rest than those do that are nearly level, in words."""
    places = {c.name: i for i, c in enumerate(declared)}
    found = {name: float(np.mean([point[places[zero_of(name)]] for point in fit.points]))
             for name in CHANNELS if zero_of(name) in places}
    return [f"{name} shows some {size:.2g} m/s2 at rest, as of a sensor that is not level or was not set to zero: that "
            "is taken off" for name, size in found.items() if abs(size) > _NOT_LEVEL * ZERO]


def _lasts(hanging: Channel) -> float:
    """How long samples that repeat others last together [s]."""
    return float(hanging.time.size * np.median(np.diff(hanging.time)))


# -- benches ---------------------------------------------------------------------------------------


def _bench(diagnosis: Diagnosis, car: RigidPlant, out: Path | None, say: Callable[[str], None]) -> None:
    """A bench whose motion was measured says by itself which torque it needs."""
    found = diagnose_bench(car, diagnosis.runs, diagnosis.reserved, say)
    diagnosis.finding = {"extension": None, **found.finding}
    diagnosis.traces, diagnosis.notices = found.traces, [*diagnosis.notices, *found.notices]
    diagnosis.suspects = [{"effect": name, "probability": share} for name, share in found.probabilities.items()]
    if out is not None and diagnosis.finding["causes"] and believed(diagnosis.finding):
        _write_vehicle(diagnosis, found.values, out)


# -- a driveline on the road -----------------------------------------------------------------------


def _driveline(diagnosis: Diagnosis, car: FullOrderCar, out: Path | None, workers: int,
               say: Callable[[str], None], build: Callable[[Path, Path], Path] | None) -> None:
    runs, declared = diagnosis.runs, coordinates(car, diagnosis.runs)
    with Predictor(car, runs, declared, workers) as predictor:
        search = Search(predictor, say)
        found = search.run()
        # what only recordings show that were not fitted has no noise that it could be judged by
        diagnosis.reserved, diagnosis.further = (
            [known for run in others if (known := run.only(found.noise.floors)).clocks]
            for others in (diagnosis.reserved, diagnosis.further))
        further, confirmed, told = diagnosis.further, set(), []
        if len(further) >= FEWEST and found.best.causes:
            say(f"judging what was found on {len(further)} further stretches")
            jury = Jury(predictor, further, found.noise.floors)
            found, verdicts = jury.judged(found, partial(search.part, found.best))
            told += words(verdicts, len(further))
            confirmed = {verdict.effect for verdict in verdicts if verdict.confirmed}
        diagnosis.identification = found
        for notice in [*told, *_zeros(declared, found.best)]:
            say(notice)
            diagnosis.notices.append(notice)
        say("whether something is missing beside what was found")
        left, curve = left_over(search.fitter, found), None
        if not is_strange(left):
            say("whether the axle shafts are bent")
            curve = bent_shafts(search.fitter, found, search.file)
            left = beside(left, curve)
        shares = probabilities(declared, found, CATALOGUE, left)
        diagnosis.finding = finding_of(predictor, found, left, shares, confirmed)
        if diagnosis.finding["verdict"] == "unknown":
            say("looking for the torque that is missing")
            supposed = _missing(predictor, found, bool(confirmed))
            listed = supposed.listed()
            if curve is not None:
                listed = [curve.disturbance, *(d for d in listed if d.place != curve.disturbance.place)]
            _localise(diagnosis, listed, odd_one(wrong_sensors(supposed), listed))
        if diagnosis.finding["ambiguous_with"]:
            say("looking for the manoeuvre that would tell " + (
                "the causes apart" if found.best.causes else "whether anything is wrong"))
            _propose(diagnosis, search, found)
    diagnosis.suspects = _suspects(shares, diagnosis.finding["verdict"] == "unknown", confirmed)
    say("what a healthy car would have shown")
    floors, points = found.noise.floors, [as_found(predictor, found.best, point) for point in found.best.points]
    roads = [on_its_road(car, car.values, run, floors) for run in runs]
    with Predictor(car, roads, coordinates(car, roads), workers) as freely:
        nominal, healthy = _healthy(freely, found.noise)
        found_wrong = wrong(runs, nominal, healthy, car.values[_FIRING_ORDER], freely.each)
    diagnosis.finding["wrong"] = [w.as_json() for w in found_wrong]
    after = nominal
    if found.best.causes:
        roads = [on_its_road(car, predictor.values(point, r)[0], runs[r], floors) for r, point in enumerate(points)]
        after = Predictor(car, roads, declared).all_runs(points) or nominal
    for run, before, then in zip(runs, nominal, after):
        for name, place in run.slices.items():
            diagnosis.traces[(run.name, name)] = (run.clocks[name], run.measured[name], before[place], then[place])
    if found.best.causes and believed(diagnosis.finding):
        _extend(diagnosis, predictor, found, out, build, say)


def _healthy(freely: Predictor, noise: Noise) -> tuple[list[np.ndarray], list[list[np.ndarray]]]:
    """What the vehicle file says, start speeds fitted, and what cars would show that are like it."""
    random = np.random.default_rng(1)
    count = len(freely.coordinates)
    points = []
    starts = [next(i for i, c in enumerate(freely.coordinates) if c.name == "start_speed" and c.run == r)
              for r in range(len(freely.runs))]
    base = freely.all_runs([np.zeros(count) for _ in freely.runs])
    moved = freely.jacobian([np.zeros(count) for _ in freely.runs], base, {r: [i] for r, i in enumerate(starts)})
    for r, run in enumerate(freely.runs):
        point = np.zeros(count)
        # the speeds of the first second: later ones have other reasons to differ
        early = np.concatenate([(clock < run.start + 1.0) & name.endswith("speed")
                                for name, clock in run.clocks.items()])
        slope, error = (x[early] / noise.least[r][early] for x in (moved[r][:, 0], run.stacked - base[r]))
        point[starts[r]] = float(slope @ error) / (float(slope @ slope) + 1.0)
        points.append(point)
    nominal = freely.all_runs(points)
    tolerances = np.array([0.0 if c.name == "start_speed" else 0.5 * c.tolerance if c.nuisance else c.tolerance
                           for c in freely.coordinates])
    cars = tolerances * random.standard_normal((_DRAWS, count))
    jobs = [(point + car, r, k) for r, point in enumerate(points) for k, car in enumerate(cars)]
    shown = freely.many(jobs)
    return nominal, [[y + run.stack(noise.floors) * random.standard_normal(y.size)
                      for y in shown[r * _DRAWS:(r + 1) * _DRAWS] if y is not None]
                     for r, run in enumerate(freely.runs)]


def _values(predictor: Predictor, fit: Fit, told: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Values with the supposed causes in them, and nothing else changed.

    What swings is as large as it is told, of all runs, and at the file's phase: it has another in every run.
    """
    values = predictor.values(as_found(predictor, fit, fit.shared), 0)[0]
    parameters = {cause["effect"]: cause["parameters"] for cause in told}
    for c in predictor.coordinates:
        if c.phase and c.cause in fit.causes:
            values[c.parameter.targets[0]] = parameters[c.effect][c.parameter.name]["value"]
            values[c.phase] = predictor.car.values.get(c.phase, 0.0)
    return values


def _suspects(shares: Mapping[str, float], unknown: bool, confirmed: Collection[str]) -> list[dict[str, Any]]:
    """Every effect with its probability, beside something unknown as much lower as that of causes is."""
    suspects = [{"effect": name, "probability": share} for name, share in shares.items()]
    if unknown:
        beside_unknown(suspects, confirmed)
    return suspects


def _missing(predictor: Predictor, found: Identification, confirmed: bool) -> Supposed:
    """Torques that may be missing beside what is sure: what is not sure may only imitate one.

    But where causes explain far more than any torque does beside a healthy car, derivatives there know nothing of what
    is missing. Beside shafts in two stages, which are nearest to ones that harden, 62 units of it are within the
    shafts; beside a healthy car, 787 behind, 293 are at the engine and 211 within the shafts.
    """
    supposed = Supposed(predictor, found.best if confirmed else found.healthy, found.noise)
    if not confirmed and found.best.score - found.healthy.score > _FAR_MORE * supposed.listed()[0].gain:
        return Supposed(predictor, found.best, found.noise)
    return supposed


def _localise(diagnosis: Diagnosis, listed: list[Disturbance], sensor: WrongSensor | None) -> None:
    """Where a torque is missing, and what that goes with; and which sensor explains more than that."""
    first = listed[0]
    variable, shape, _ = goes_with(first.table, first.follows, first.shape)
    diagnosis.finding["unknown"] = {
        "balance": PLACES[first.place].balance, "place": first.place,
        "balances": list(dict.fromkeys(PLACES[d.place].balance for d in tied(listed))),
        "driving_variable": variable, "shape": shape, "each_its_own": each_its_own(first.follows),
        "size": first.size, "unit": PLACES[first.place].unit,
        "log_evidence": {d.place: d.gain for d in listed}, "sensor": sensor and sensor.as_json()}
    diagnosis.disturbance = first.table


def _propose(diagnosis: Diagnosis, search: Search, found: Identification) -> None:
    """What to drive next; where nothing is wrong, to see whether the likeliest of what is not excluded is there."""
    if not found.best.causes:
        found = replace(found, best=rivals_of(found)[0][0])
    rivals = [fit for fit, _ in rivals_of(found)[:_COMPARED]]
    if found.apart(found.healthy) < APART:
        rivals.append(found.healthy)
    best = proposal.propose(search.fitter, found, rivals, _drives(len(diagnosis.runs) + len(diagnosis.reserved)))
    if best is not None:
        diagnosis.finding["next_manoeuvre"] = {
            "kind": best.kind, "gear": best.gear, "back": best.back, "times": best.times,
            "separation_sigma": best.separation_sigma, "chance": best.chance,
            "why": proposal.words(best, found.best)}


def _write_vehicle(diagnosis: Diagnosis, values: dict[str, float], out: Path) -> None:
    """The extended vehicle file, and which causes are in it: what is wrong with a sensor or an input is no value of a
    vehicle."""
    car, changes = diagnosis.car, _changes(diagnosis, values)
    nothing = "what swings was not found" if changes else "no value of the vehicle is another one"
    inside = [effect for effect in diagnosis.finding["together"] if _is_in(effect, changes)]
    why = f"diagnosis of {diagnosis.measurement.name}: " + (
        ", ".join(effect.replace("_", " ") for effect in inside) or nothing)
    extend.write_vehicle(car.source, changes, car.units, why, out / extend.EXTENDED)
    diagnosis.finding["extension"] = {"vehicle": extend.EXTENDED, "fmu": None, "effects": inside}


def _is_in(effect: str, changes: Mapping[str, float]) -> bool:
    """Whether an effect of the catalogue is in values that are other ones than in the vehicle file."""
    parameters = (*CATALOGUE[effect].parameters, *CATALOGUE[effect].elsewhere)
    bare = {target.partition("[")[0] for p in parameters for target in p.targets}  # of a table without its places
    return not bare.isdisjoint(name.partition("[")[0] for name in changes)


def _changes(diagnosis: Diagnosis, values: dict[str, float]) -> dict[str, float]:
    """Which of these values of the plant are other ones than in the vehicle file."""
    return extend.changed_values(diagnosis.car.values | diagnosis.taken_out, values)


def _extend(diagnosis: Diagnosis, predictor: Predictor, found: Identification, out: Path | None,
            build: Callable[[Path, Path], Path] | None, say: Callable[[str], None]) -> None:
    """The extended vehicle and FMU, and the gain on the reserved runs, driven freely.

    Where no value of the vehicle is another one the gain is that of what its sensors and inputs are known to err by.
    """
    car, values = diagnosis.car, _values(predictor, found.best, diagnosis.finding["causes"])
    changes, fmu = _changes(diagnosis, values), None
    if out is not None:
        _write_vehicle(diagnosis, values, out)
        if build is not None:
            say("building the extended FMU")
            fmu = build(out, out / extend.EXTENDED)
            diagnosis.finding["extension"]["fmu"] = fmu.name
    if not diagnosis.reserved:
        return
    say("measuring the gain on " + ", ".join(run.name for run in diagnosis.reserved))
    floors, phases = found.noise.floors, [name for effect in found.best.effects for name in CATALOGUE[effect].nuisances]
    driven = {(extended, run.name): as_driven(car, cause, run, floors, unknown)
              for extended, cause, unknown in ((False, car.values, ()), (True, values, phases))
              for run in diagnosis.reserved}

    def known(extended: bool, run: Run) -> dict[str, float]:
        return driven[extended, run.name][0]

    def simulate(extended: bool, run: Run) -> dict[str, np.ndarray]:
        values, run = driven[extended, run.name]
        if fmu is None:
            return car.raw(values, run)
        other = {name: values[name] for name in (phases if extended else changes) if name in car.units}
        return extend.co_simulate(fmu, other, extend.with_inputs(run, values), run.start_speed)

    rows = extend.gain(diagnosis.reserved, simulate, known, floors)
    wanted, features = [(entry["signal"], entry["feature"]) for entry in diagnosis.finding["wrong"]], []
    for run in diagnosis.reserved:
        before, after = (car.predict(*driven[extended, run.name]) for extended in (False, True))
        features += extend.read_off(run, before, after, wanted, car.values[_FIRING_ORDER])
        for name, clock in run.clocks.items():
            place = run.slices[name]
            diagnosis.traces[(run.name, name)] = (clock, run.measured[name], before[place], after[place])
    diagnosis.finding["gain"] = {**gained(rows), "features": features,
                                 "estimators": profit(car.source, changes, diagnosis.reserved) if changes else []}
