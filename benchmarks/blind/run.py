"""The diagnosis on blind cases, spread by dask, started again where it stopped."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import json
import logging
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

import cosim
import driveline
from benchmarks.blind.cases import BlindCase, top_gear
from benchmarks.blind.reading import CATALOGUED, NOTHING, found_sizes, named, right_first
from benchmarks.blind.visibility import beside, evident, missed, visibility
from cosim.diagnosis.catalogue import CATALOGUE, apply_all
from cosim.diagnosis.gain.swings import as_driven
from cosim.diagnosis.hidden import Hidden, hide
from cosim.diagnosis.hidden.recordings import BACK, KINDS, usual
from cosim.diagnosis.plants import FullOrderCar
from cosim.files import write_text
from cosim.measured import load
from cosim.studies.sweep import Case, Sweep
from driveline.plants.full_order import FullOrderPlant
from driveline.plants.linear import shuffle_mode
from driveline.quantities import InputError

log = logging.getLogger("cosim")

Progress = Callable[[float, dict[str, Any]], None]

DIAGNOSE = "cosim.diagnosis.diagnose:diagnose"
LINES = "cases.jsonl"
VERDICTS = ("cause", "ambiguous", "unknown", "none")
# Of the environment of dask's workers, and what they do better without: given any threshold of its own, the C library
# maps every matrix of a diagnosis anew, 12 million pages in 20 minutes.
_ENVIRONMENT, _TRIMMED = "distributed.nanny.pre-spawn-environ", "MALLOC_TRIM_THRESHOLD_"
_AT = {"gear": 5, "start.vehicle_speed": 12.0, "engine_torque": 120.0}  # where the shuffle frequency is taken


# -- many cases -----------------------------------------------------------------------------------

def run(cases: Sequence[BlindCase], out: Path, *, workers: int = 1, cluster: str | None = None,
        method: str = DIAGNOSE, progress: Progress | None = None) -> list[dict[str, Any]]:
    """The results of all cases, in their order, whoever ran them when.

    Every result is a file in ``out/cases`` as soon as it is there, under a digest of the case and of all code
    it stands on: what another version of the code found is done again. ``out/cases.jsonl`` has all of them, a
    line each.

    Args:
        workers: Processes of a local dask cluster; 1 for none but this.
        cluster: Address of a dask scheduler to run on instead; its workers need this repository.
        method: ``module:function`` that takes a folder, as ``cosim.diagnosis.diagnose.diagnose`` does.
        progress: Called with the share that is done and each result, also of those that were there already.

    Raises:
        InputError: There is no such cluster, or workers have another version of the code.
    """
    code = fingerprint()
    jobs = [Case(case.name, examined, {"case": case, "method": method, "code": code}) for case in cases]
    return spread(jobs, out, LINES, workers, cluster, progress)


def spread(jobs: Sequence[Case], out: Path, lines: str, workers: int, cluster: str | None,
           progress: Progress | None = None) -> list[dict[str, Any]]:
    """Run jobs of a sweep whose results are dictionaries, and keep them as lines beside."""
    waiting, done = {job.name: out / "cases" / f"{job.key}.json" for job in jobs}, 0
    kept = [text for path in waiting.values() if (text := _text(path))]
    before = _lines(out / lines)
    if lost := len(before) - len(set(before) & set(kept)):
        log.warning("%s: %d results of another version of the code, or of other cases, are left out", out / lines, lost)
    write_text(out / lines, "")

    def tell(share: float) -> None:
        nonlocal done
        for name, path in list(waiting.items()):
            if text := _text(path):
                del waiting[name]
                done += 1
                with (out / lines).open("a", encoding="utf-8") as file:
                    file.write(text + "\n")
                if progress is not None:
                    progress(done / len(jobs), json.loads(text))

    tell(0.0)
    with address_of(workers, cluster, len(waiting)) as address:
        found = Sweep(out / "cases", 1, address).run(jobs, tell)
    write_text(out / lines, "".join(json.dumps(found[job.name]) + "\n" for job in jobs))  # in their order
    return [found[job.name] for job in jobs]


def read(path: Path) -> list[dict[str, Any]]:
    """The results in a file of lines.

    Raises:
        InputError: There is none.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; run the cases first")
    return [json.loads(line) for line in _lines(path)]


def _lines(path: Path) -> list[str]:
    """Whole lines; the last may be half of one."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    return text[:text.rfind("\n") + 1].splitlines()


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8").strip() if path.is_file() else ""


@contextlib.contextmanager
def address_of(workers: int, cluster: str | None, count: int) -> Iterator[str | None]:
    """The address of the scheduler to run on; None for this process.

    Args:
        workers: Processes of a cluster that is started here and ends with this, as ``run``.
        cluster: Of another one.
        count: Jobs; there are no more workers than that.

    Raises:
        InputError: Less than one worker, or there is no dask.
    """
    if workers < 1:
        raise InputError(f"workers is {workers}: at least 1 is needed")
    if cluster is not None or workers == 1 or count == 0:
        yield cluster
        return
    try:
        from dask import config
        from distributed import LocalCluster
    except ImportError as error:
        raise InputError("more than one worker needs dask: pip install -e '.[blind]'") from error
    environment = {name: value for name, value in config.get(_ENVIRONMENT).items() if name != _TRIMMED}
    with (config.set({_ENVIRONMENT: environment}),
          LocalCluster(min(workers, count), threads_per_worker=1, dashboard_address=":0",
                       silence_logs=logging.ERROR) as local):
        yield local.scheduler_address


@functools.cache
def fingerprint() -> str:
    """Digest of what a diagnosis stands on: the payload, reading measurements, hiding and diagnosing."""
    digest = hashlib.sha256()
    for package, folder in ((driveline, "."), (cosim, "diagnosis"), (cosim, "measured")):
        root = Path(package.__file__).parent
        for path in sorted((root / folder).rglob("*")):
            if path.suffix in (".py", ".toml", ".csv"):
                digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


# -- one case -------------------------------------------------------------------------------------

def examined(case: BlindCase, method: str = DIAGNOSE, code: str | None = None, shows: bool = True) -> dict[str, Any]:
    """Hide, diagnose, and put the truth beside the finding; what goes wrong is part of the result.

    Args:
        case: What is hidden.
        method: ``module:function``.
        code: ``fingerprint`` of who asks; another one here is refused.
        shows: Whether it is also asked how much shows of an effect outside the catalogue, or of what was not found:
            either takes two more fits.
    """
    if code is not None and code != fingerprint():
        raise InputError("the code of a worker is not that of who started the run (edited meanwhile, or another "
                         "version on the cluster): start again, what is done with this code is kept")
    result = {**asdict(case), "code": fingerprint(), "truth": None, "finding": None, "error": None,
              "seconds": None, "gain": None, "shuffle": None, "visibility": None, "missed": None, "beside": None,
              "again": None}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "measurement"
        try:
            hidden = hide_case(case, case.manoeuvres, path)
            result["truth"] = truth(hidden)
            diagnosis, result["finding"], result["seconds"] = _diagnosed(path, method)
            result["gain"] = _ideal(diagnosis, hidden)
            if case.category == "cocktail":
                result["shuffle"] = shuffle(diagnosis.car, hidden, result["finding"])
            if shows and case.category == "outside" and diagnosis.identification is not None:
                result["visibility"] = _visibility(diagnosis, case, Path(folder) / "without")
            if shows:
                result |= _unfound(case, hidden, diagnosis, result["finding"])
        except Exception as error:
            result["error"] = f"{type(error).__name__}: {error}\n{traceback.format_exc(limit=-4)}"
            return result
    if result["finding"]["ambiguous_with"] and case.category in (*CATALOGUED, *NOTHING):
        result["again"] = _again(case, result["finding"].get("next_manoeuvre"), method, shows)
    return result


def hide_case(case: BlindCase, manoeuvres: Sequence[str] | None, path: Path) -> Hidden:
    """A case's measurement, with its manoeuvres or others, for whoever diagnoses it."""
    return hide(case.effects, case.seed, path, vehicle=case.vehicle, structure=case.structure, manoeuvres=manoeuvres)


def _diagnosed(path: Path, method: str) -> tuple[Any, dict[str, Any], float]:
    """The diagnosis, its finding as JSON has it, and how long it took [s]."""
    module, _, function = method.partition(":")
    began = time.perf_counter()
    diagnosis = getattr(importlib.import_module(module), function)(path, out=None, workers=1)
    seconds = time.perf_counter() - began
    finding = json.loads(json.dumps(diagnosis.finding, allow_nan=False))
    if finding.get("verdict") not in VERDICTS or not {"causes", "ambiguous_with"} <= set(finding):
        raise ValueError(f"no finding: verdict is {finding.get('verdict')!r}, keys are {', '.join(finding)}")
    return diagnosis, finding, seconds


def _visibility(diagnosis: Any, case: BlindCase, path: Path) -> dict[str, float] | None:
    """How much of what is hidden shows, by the same case without it; None where a car cannot be simulated then."""
    hide_case(replace(case, effects=()), case.manoeuvres, path)
    without = diagnosis.car.runs(load(path))
    try:
        return visibility(diagnosis, without)
    except ArithmeticError:
        return None


def truth(hidden: Hidden) -> dict[str, Any]:
    """What a finding is judged by."""
    told = hidden.as_json()
    return {key: told[key] for key in ("effects", "outside", "changed", "structure")}


def _unfound(case: BlindCase, hidden: Hidden, diagnosis: Any, finding: Mapping[str, Any]) -> dict[str, float | None]:
    """What the search ``missed``, and of two how much shows ``beside`` the other, where what is hidden is not first."""
    asked = {"truth": truth(hidden), "finding": finding}
    if case.category not in CATALOGUED or diagnosis.identification is None or right_first(asked):
        return {}
    true = evident(diagnosis, hidden.effects)
    told = {"missed": missed(diagnosis, true)}
    return told if case.category == "single" else {**told, "beside": beside(diagnosis, hidden.effects, true)}


def _again(case: BlindCase, proposed: Mapping[str, Any] | None, method: str, shows: bool = False) -> dict[str, Any]:
    """The same truth once more, with what was proposed beside the other manoeuvres; ``shows`` as in ``examined``."""
    if proposed is None:
        return {"manoeuvre": None, "finding": None, "error": "no manoeuvre was proposed"}
    entry = f"{proposed['kind']}:{proposed['gear']}" + f":{BACK}" * bool(proposed.get("back"))
    entries = [entry] * proposed.get("times", 1)
    driven = ",".join(entries)
    if proposed["kind"] not in KINDS:
        return {"manoeuvre": driven, "finding": None, "error": f"{proposed['kind']} is none of {', '.join(KINDS)}"}
    before = case.manoeuvres or usual(top_gear(case.vehicle))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "measurement"
        try:
            hidden = hide_case(case, [*before, *entries], path)
            diagnosis, finding, _ = _diagnosed(path, method)
            told = _unfound(case, hidden, diagnosis, finding) if shows else {}
            return {"manoeuvre": driven, "finding": finding, "error": None, **told}
        except Exception as error:
            return {"manoeuvre": driven, "finding": None, "error": f"{type(error).__name__}: {error}"}


# -- what the true model would do -----------------------------------------------------------------

def _true(car: FullOrderCar, hidden: Hidden) -> dict[str, float]:
    """The diagnosis's own model with the true effects in it."""
    return {**car.values, **{name: true for name, (_, true) in hidden.changed.items() if car.knows(name)}}


def _ideal(diagnosis: Any, hidden: Hidden) -> dict[str, list[float]] | None:
    """NRMSE of each signal of the reserved recordings, of the file's and of the true model, each as a finding's is."""
    if not diagnosis.reserved or not hidden.effects or diagnosis.identification is None:
        return None
    car, floors, found = diagnosis.car, diagnosis.identification.noise.floors, {}
    phases = [name for effect in hidden.effects for name in CATALOGUE[effect].nuisances]
    for run in diagnosis.reserved:
        shown = [car.predict(*as_driven(car, values, run, floors, unknown))
                 for values, unknown in ((car.values, ()), (_true(car, hidden), phases))]
        for name, place in run.slices.items():
            reach = float(np.ptp(run.measured[name]))
            found.setdefault(name, []).append([float(np.sqrt(np.mean((run.measured[name] - y[place])**2))) / reach
                                               for y in shown])
    return {name: np.mean(rows, axis=0).tolist() for name, rows in found.items()}


def shuffle(car: FullOrderCar, hidden: Hidden, finding: Mapping[str, Any]) -> list[float]:
    """Shuffle frequency [Hz] in fifth gear under load: of the file, as found, and the true one."""
    sizes = {name: found_sizes(finding)[name][0] for name in CATALOGUE if name in named(finding)}
    return [_frequency(values) for values in (car.values, apply_all(sizes, car.values), _true(car, hidden))]


def _frequency(values: Mapping[str, float]) -> float:
    # instruments are none of the plant's, and sub-steps of a diagnosis too long for what is stiffer than the file's
    plant = FullOrderPlant({name: x for name, x in values.items()
                            if not name.startswith(("observe.", "input.", "solver."))})
    for name, value in _AT.items():
        plant[name] = value
    plant.initialize()
    return float(shuffle_mode(plant).frequency)
