"""The command ``driveline``.

Standard output carries the result, standard error whatever is said on the way. Exit code 0: done; 2: the
input or usage is wrong; 1: it failed for another reason; 130: Ctrl-C; 143: terminated, 129: by a terminal that closed.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import logging
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cosim import ending
from cosim.diagnosis.judge.finding import (
    balances,
    driven,
    either,
    errs,
    goes_with_words,
    in_doubt,
    joint_probability,
    lacking,
    missing,
    wrong_sensor,
)
from driveline.quantities import InputError, behind

log = logging.getLogger("cosim")
LISTS = ("fmus", "scenarios", "studies", "vehicles", "effects")
_RESULT = ("result.csv", "result.json", "result.parquet")  # what a run writes
_PARTIAL = ("result_partial.csv", "result_partial.json", "result_partial.parquet")  # one that did not reach its stop
_SHOWN = ("signals.png", "comparison.json", "comparison.png")  # what is shown of a result
_DIAGNOSED = ("finding.json", "report.html", "extended.toml", "*_extended.fmu")  # what a diagnosis writes
_OK, _FAILED, _WRONG_INPUT, _INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        The exit code.
    """
    options = _parser().parse_args(arguments)
    logging.basicConfig(format="%(message)s", stream=sys.stderr, force=True, level=logging.WARNING)
    for own in ("cosim", "driveline"):  # libraries say only what is wrong
        logging.getLogger(own).setLevel(logging.WARNING if options.quiet else logging.INFO)
    try:
        with ending.in_order(), _standard_output(options.json) as write:
            answer, text = options.command(options)
            write(json.dumps(answer, indent=2, default=str) if options.json else text)
        return _OK
    except InputError as error:
        return _say(error, _WRONG_INPUT)
    except KeyboardInterrupt as error:
        return _say(str(error) or "interrupted", getattr(error, "code", _INTERRUPTED))
    except BrokenPipeError:  # whoever reads our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _FAILED
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:  # found by whatever looks for it first
            return _say(f"{error.filename}: {error.strerror}", _WRONG_INPUT)
        if options.debug:
            raise
        return _say(f"{error}" if isinstance(error, RuntimeError | OSError) else
                    f"{type(error).__name__}: {error} (--debug shows where)", _FAILED)


def _say(message: object, code: int) -> int:
    print(f"driveline: {message}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--json", action="store_true", help="print the result as JSON, and nothing else")
    common.add_argument("--quiet", action="store_true", help="no progress, only the result and what is wrong")
    common.add_argument("--debug", action="store_true", help="show where an unexpected error comes from")
    parser = argparse.ArgumentParser(
        prog="driveline", description="Driveline plants and estimators as FMUs, simulated together.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, function: Callable[[argparse.Namespace], tuple[Any, str]],
                help: str, out: str | None = None) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=help, description=help, parents=[common])
        sub.set_defaults(command=function)
        if out is not None:
            sub.add_argument("--out", type=Path, default=None, metavar="DIR",
                             help=f"where the files go (default: {out})")
        return sub

    command("build", _build, "build every FMU", "build/fmus")
    list_ = command("list", _list, "what there is")
    list_.add_argument("what", nargs="?", choices=LISTS)
    run = command("run", _run, "run a scenario", "out/NAME")
    run.add_argument("scenario", metavar="SCENARIO",
                     help="a TOML file, or a name that `driveline list scenarios` gives")
    run.add_argument("--set", action="append", default=[], metavar="FMU.PARAMETER=VALUE",
                     help="change a parameter, or hold an input; the value may carry a unit")
    run.add_argument("--measurement", type=Path, metavar="PATH",
                     help="a folder with measurement.toml, or a data file, in place of the scenario's")
    run.add_argument("--twins", action="store_true", help="run the models in process instead of their FMUs")
    study = command("study", _study, "one table or figure of the paper", "out/NAME")
    study.add_argument("name", metavar="NAME")
    study.add_argument("--workers", type=int, metavar="N",
                       help="processes for a study of many runs (default: one a core)")
    study.add_argument("--cluster", metavar="ADDRESS", help="dask scheduler to run them on instead")
    study.add_argument("--measurement", type=Path, metavar="PATH", help="a recording, for a study that takes one")
    diagnose = command("diagnose", _diagnose, "what a measurement says is wrong with the model, and why",
                       "out/diagnosis")
    diagnose.add_argument("measurement", type=Path, metavar="MEASUREMENT",
                          help="a folder with measurement.toml, or one data file with canonical names and units")
    diagnose.add_argument("--vehicle", help="by name or file, where the measurement names none or another")
    diagnose.add_argument("--variant", help="of that vehicle (default: none)")
    diagnose.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    diagnose.add_argument("--no-fmu", action="store_true",
                          help="the extended vehicle file alone, without its FMU")
    hide = command("hide", _hide, "a measurement with effects hidden in it", "out/hidden")
    hide.add_argument("effects", nargs="*", metavar="EFFECT[=SIZE]",
                      help="a name that `driveline list effects` gives, outside:NAME for one that no catalogue knows, "
                           "thesis_cocktail for all of thesis table 2.3; the size is a factor, an SI number or a "
                           "value with its unit, drawn where it is missing; no effect: nothing is hidden")
    hide.add_argument("--seed", type=int, required=True, metavar="N", help="of all that is drawn")
    hide.add_argument("--vehicle", default="pickup_10r80",
                      help="the nominal vehicle, by name or file (default: %(default)s)")
    hide.add_argument("--variant", help="of the vehicle (default: modified for the shipped pickup)")
    hide.add_argument("--structure", choices=("same", "other"),
                      help="of the hidden plant (default: other for a third of all seeds)")
    hide.add_argument("--drift", choices=("nuisance", "all", "none"), default="nuisance",
                      help="which other parameters are off by 3 to 5 percent (default: those no effect names)")
    hide.add_argument("--manoeuvres", action="extend", metavar="KIND:GEAR,...",
                      type=lambda listed: listed.split(","),
                      help="the recordings, tip_in:5:back with the road driven the other way; may be repeated "
                           "(default: six usual ones)")
    hide.add_argument("--truth", type=Path, metavar="FILE",
                      help="where what is hidden is written, outside DIR (default: DIR.truth.json)")
    command("demo", _demo, "the main job in about a minute, on what the package ships", "out/demo")
    return parser


def _build(options: argparse.Namespace) -> tuple[Any, str]:
    out = _writable(options.out or Path("build/fmus"))
    built = []
    for path in _build_fmus(out):
        log.info("built %s", path)
        built.append(str(path))
    return {"fmus": built}, "\n".join(built)


def _build_fmus(out: Path) -> Iterable[Path]:
    from fmus.packaging import build  # here alone: whoever only runs FMUs needs nothing that builds them

    return build(out)


def _list(options: argparse.Namespace) -> tuple[Any, str]:
    wanted = [options.what] if options.what else list(LISTS)
    found = {what: globals()[f"_list_{what}"]() for what in wanted}
    lines = []
    for what, entries in found.items():
        lines += [f"{what}:"] if len(found) > 1 else []
        width = max((len(name) for name in entries), default=0)
        lines += [f"  {name:{width}}  {about}".rstrip() for name, about in entries.items()]
    return found if options.what is None else found[options.what], "\n".join(lines)


def _list_fmus() -> dict[str, str]:
    from cosim.master.parameters import build_folders

    return {path.stem: str(path) for folder in reversed(build_folders())
            for path in sorted(folder.glob("*.fmu"))}


def _list_scenarios() -> dict[str, str]:
    from cosim.master.scenario import SHIPPED
    from cosim.toml import TomlFile

    return {path.stem: TomlFile.read(path).table.get("title", "") for path in sorted(SHIPPED.glob("*.toml"))}


def _list_studies() -> dict[str, str]:
    from cosim import studies

    return {name: studies.summary(name) for name in studies.STUDIES}


def _list_vehicles() -> dict[str, str]:
    from driveline import vehicles

    return {name: "variants: " + ", ".join(vehicles.variants(name)) for name in vehicles.names()}


def _list_effects() -> dict[str, str]:
    from cosim.diagnosis.catalogue import CATALOGUE

    return {name: effect.summary for name, effect in CATALOGUE.items()}


def _run(options: argparse.Namespace) -> tuple[Any, str]:
    from cosim.master import Interrupted, Scenario, SimulationError

    overrides = {}
    for entry in options.set:
        name, equals, value = entry.partition("=")
        if not equals or not name or not value:
            raise InputError(
                f"--set {entry}: FMU.PARAMETER=VALUE is needed, for example plant.vehicle.mass=2500")
        overrides[name] = value
    scenario = Scenario.load(options.scenario, overrides, options.measurement, options.twins)
    out = options.out or Path("out") / scenario.name
    with _not_left_empty(out):
        began = time.perf_counter()
        try:
            with _progress(scenario.title, scenario.start, scenario.stop) as progress:
                result = scenario.run(progress)
        except (Interrupted, SimulationError) as error:
            if error.result is None or error.result.time.size == 0:
                raise
            _save(error.result, out, _PARTIAL)  # beside the whole result of an earlier run, which is not less for it
            where = f"{error}; what was recorded until then is in {out / _PARTIAL[0]}"
            ended = isinstance(error, Interrupted)
            raise (ending.Ended(error.number, where) if ended else SimulationError(where)) from error
        seconds = time.perf_counter() - began
        _save(result, out, _RESULT)
        for old in (*_PARTIAL, *_SHOWN):  # would be taken for something of this run
            (out / old).unlink(missing_ok=True)
        return _report(scenario, result, out, seconds)


def _save(result: Any, out: Path, names: tuple[str, str, str]) -> None:
    """Write a result under the names of its CSV, JSON and Parquet files."""
    csv, _, parquet = names
    result.to_csv(out / csv)
    result.to_parquet(out / parquet)


def _report(scenario: Any, result: Any, out: Path, seconds: float) -> tuple[Any, str]:
    """Compare and draw beside the result; the answer and its text."""
    from cosim.files import write_text
    from cosim.report import plot_comparison, plot_signals

    comparisons = scenario.compare(result)
    rows = [comparison.as_row() for comparison in comparisons]
    plot_signals(result, out / "signals.png", title=scenario.title)
    if comparisons:
        write_text(out / "comparison.json", json.dumps(rows, indent=2) + "\n")
        plot_comparison(comparisons, out / "comparison.png", scenario.title)
    names = [name for name in (*_RESULT, *_SHOWN) if (out / name).exists()]
    simulated = float(result.time[-1] - result.time[0])
    answer = {"scenario": scenario.name, "complete": result.complete, "simulated_seconds": simulated,
              "run_seconds": seconds, "notices": result.provenance["notices"], "comparison": rows,
              "files": [str(out / name) for name in names]}
    text = [f"{scenario.title}: {simulated:g} s simulated in {seconds:.2f} s", *_comparison_table(rows),
            *(str(out / name) for name in names)]
    return answer, "\n".join(text)


def _comparison_table(rows: Sequence[dict[str, Any]]) -> list[str]:
    if not rows:
        return []
    lines = [f"{'simulated - measured':38} {'unit':6} {'samples':>8} {'mean':>10} {'rms':>10} {'max':>10} "
             f"{'rms/range':>9}"]
    for row in rows:
        relative = "" if row["nrmse"] is None else f"{100 * row['nrmse']:.2f} %"
        lines.append(f"{row['signal']:38} {row['unit']:6} {row['samples']:8d} {row['mean_error']:10.4g} "
                     f"{row['rms_error']:10.4g} {row['max_error']:10.4g} {relative:>9}")
    return lines


def _study(options: argparse.Namespace) -> tuple[Any, str]:
    from cosim import studies

    if options.name not in studies.STUDIES:
        studies.summary(options.name)  # says which there are, before a folder is made
    out = options.out or Path("out") / options.name
    given = {key: value for key in ("workers", "cluster", "measurement")
             if (value := getattr(options, key)) is not None}
    with _not_left_empty(out), _progress(options.name, 0.0, 1.0) as progress:
        answer = studies.run(options.name, out, progress, **given)
    name, unit = (max(map(len, (key, *(row[key] for row in answer["rows"])))) for key in ("quantity", "unit"))
    lines = [f"{answer['study']}: {answer['source']}",
             f"{'quantity':{name}} {'unit':{unit}} {'paper':>10} {'here':>10} {'deviation':>10}  note"]
    for row in answer["rows"]:
        paper, here = ("-" if row[key] is None else f"{row[key]:.5g}" for key in ("paper", "here"))
        deviation = "" if row["deviation_percent"] is None else f"{row['deviation_percent']:+.2f} %"
        lines.append(f"{row['quantity']:{name}} {row['unit']:{unit}} {paper:>10} {here:>10} {deviation:>10}  "
                     f"{row['note']}".rstrip())
    return answer, "\n".join([*lines, *(str(out / file) for file in (f"{options.name}.json", *answer["figures"]))])


def _diagnose(options: argparse.Namespace) -> tuple[Any, str]:
    from cosim.diagnosis.diagnose import diagnose

    if options.workers is not None and options.workers < 1:
        raise InputError(f"--workers {options.workers}: at least 1 is needed")
    if options.variant is not None and options.vehicle is None:
        raise InputError(f"--variant {options.variant}: --vehicle is needed with it")
    out = options.out or Path("out/diagnosis")
    with _all_or_nothing(out, _DIAGNOSED) as folder, _telling("diagnose") as say:
        found = diagnose(options.measurement, folder, vehicle=options.vehicle, variant=options.variant,
                         workers=options.workers, say=say,
                         build=None if options.no_fmu else _build_extended)
    files = [str(path) for pattern in _DIAGNOSED for path in sorted(out.glob(pattern))]
    return found.finding, "\n".join([*_summary(found.finding), *files])


def _build_extended(out: Path, vehicle: Path) -> Path:
    from fmus.packaging import build  # as in _build_fmus

    return next(iter(build(out, ["plant_fom"], vehicle=str(vehicle), variant=None, suffix="_extended")))


def _summary(finding: dict[str, Any]) -> list[str]:
    """A finding in a few lines."""
    lines = [f"verdict: {finding['verdict']}"]
    lines += [f"  wrong: {entry['signal']}: {entry['what']} ({entry['where']}; p = {entry['p_value']:.1g})"
              for entry in finding["wrong"][:5]]
    if len(together := finding["together"]) > 1:
        lines.append(f"  {100 * joint_probability(finding, together):3.0f} % these together: {', '.join(together)}")
    for cause in finding["causes"]:
        numbers = ", ".join(f"{name} {_number(p['value'])} [{_number(p['low90'])}, {_number(p['high90'])}]"
                            f"{behind(p['unit'])} (file: {_number(p['nominal'])})"
                            for name, p in cause["parameters"].items())
        lines.append(f"  {100 * cause['probability']:3.0f} % {cause['effect']}: {numbers}")
    if unknown := finding["unknown"]:
        what, unit = missing(unknown)
        if sensor := wrong_sensor(unknown):
            lines.append(f"  unknown: {sensor['channel']} contradicts all else, {errs(sensor)}")
        else:
            lines.append(f"  unknown: a {what} at the {either(balances(unknown))} of {unknown['size']:.3g} {unit}; "
                         f"it goes with {goes_with_words(unknown)}")
    open_to = "is not excluded:" if in_doubt(finding) else "cannot be told from"
    for rival in finding["ambiguous_with"]:
        which = " alone" if lacking(finding, rival["effects"]) else (
            f" in place of {', '.join(rival['in_place_of'])}" if len(together) > 1 and rival.get("in_place_of") else "")
        lines.append(f"  {open_to} {', '.join(rival['effects'])}{which} ({rival['separation_sigma']:.1f} sigma)")
    measure = "measure"
    if proposed := finding["next_manoeuvre"]:
        lines.append(f"  drive next: {driven(proposed)}: {proposed['why']}")
        measure = "or measure"
    lines += [f"  {measure} {row['effect']}: {row['how']}" for row in finding.get("directly", ())]
    if gain := finding["gain"]:
        lines += [f"  {row['signal']}: error {100 * row['nrmse_before']:.2f} % before, "
                  f"{100 * row['nrmse_after']:.2f} % after, of the range" for row in gain["held_out"]]
        were_wrong = {(entry["signal"], entry.get("feature")) for entry in finding["wrong"][:5]}
        lines += [f"  {row['signal']}: {row['feature']} {_number(row['measured'])} measured, "
                  f"{_number(row['before'])} before, {_number(row['after'])} after"
                  + f" [{row['unit']}]" * (row["unit"] != "1")
                  for row in gain.get("features", ()) if (row["signal"], row["feature"]) in were_wrong]
    return lines


def _number(value: float) -> str:
    """Four digits, without an exponent where five or six places do: 10750."""
    return f"{float(f'{value:.4g}'):g}"


def _hide(options: argparse.Namespace) -> tuple[Any, str]:
    from cosim.diagnosis.hidden import hide

    if options.seed < 0:
        raise InputError(f"--seed {options.seed}: 0 or more is needed")
    out = options.out or Path("out/hidden")
    named = out if out.name not in ("", "..") else out.resolve()  # the folder we are in has no name as it is written
    truth = options.truth or named.parent / f"{named.name}.truth.json"
    if truth.is_dir():
        raise InputError(f"--truth {truth}: it is a folder: a file is needed")
    began = time.perf_counter()
    try:
        with (_not_left_empty(out), _not_left_empty(truth.parent, "--truth"),
              _progress("hide", 0.0, 1.0) as progress):
            hide(options.effects, options.seed, out, vehicle=options.vehicle, variant=options.variant,
                 structure=options.structure, drift=options.drift, manoeuvres=options.manoeuvres, truth=truth,
                 progress=progress)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:  # which may be that of the vehicle
            raise
        raise InputError(f"--out {out}: {error}: a folder that can be written to is needed") from error
    answer = {"measurement": str(out), "truth": str(truth), "run_seconds": time.perf_counter() - began}
    return answer, f"{out}\n{truth}"


def _demo(options: argparse.Namespace) -> tuple[Any, str]:
    from cosim import demo

    out = _writable(options.out or Path("out/demo"))
    answer = demo.run(out, _build_fmus, log.info)
    text = [f"demo: done in {answer['seconds']:.1f} s; the measurement is generated, with a heavier vehicle "
            "and softer axle shafts than the model has", *_comparison_table(answer["comparison"])]
    return answer, "\n".join([*text, *answer["files"]])


def _writable(folder: Path, option: str = "--out") -> Path:
    """The folder, made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{option} {folder}: {error.strerror}: a folder that can be written to is needed") from error
    if not os.access(folder, os.W_OK):
        raise InputError(f"{option} {folder}: it cannot be written to")
    return folder


@contextlib.contextmanager
def _not_left_empty(out: Path, option: str = "--out") -> Iterator[None]:
    """The folder is made if need be, and those that were made go again when nothing was written to them."""
    made = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        _writable(out, option)
        yield
    finally:
        with contextlib.suppress(OSError):  # not empty
            for folder in made:
                folder.rmdir()


@contextlib.contextmanager
def _all_or_nothing(out: Path, patterns: Sequence[str]) -> Iterator[Path]:
    """A folder to write to, of which all goes to ``out`` when all went well, and nothing otherwise; files there
    that match the patterns and were not written again are of an earlier run, and go."""
    near = next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists())
    if not near.is_dir() or not os.access(near, os.W_OK):
        raise InputError(f"--out {out}: {near} is no folder that can be written to")
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=near) as name:
        folder = Path(name)
        yield folder
        _writable(out)
        written = {path.name for path in folder.iterdir()}
        for old in {path for pattern in patterns for path in out.glob(pattern)}:
            if old.name not in written:
                old.unlink()
        for path in folder.iterdir():
            path.replace(out / path.name)


@contextlib.contextmanager
def _telling(title: str) -> Iterator[Callable[[str], None]]:
    """How to say what is being done: lines on standard error, one that changes where that is a terminal."""
    if not sys.stderr.isatty():
        yield log.info
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with Progress(SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}"), transient=True,
                  console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=None)
        yield lambda words: bar.update(task, description=f"{title}: {words}")


@contextlib.contextmanager
def _standard_output(only_json: bool) -> Iterator[Callable[[str], None]]:
    """How to write the result; with JSON whatever else is printed (by an FMU, say) goes to standard error."""
    def write(text: str) -> None:
        if text:
            os.write(stdout, (text + "\n").encode()) if only_json else print(text)

    if not only_json:
        yield write
        return
    sys.stdout.flush()
    stdout = os.dup(1)
    os.dup2(2, 1)
    try:
        yield write
    finally:
        sys.stdout.flush()
        os.dup2(stdout, 1)
        os.close(stdout)


@contextlib.contextmanager
def _progress(title: str, start: float, stop: float) -> Iterator[Callable[[float], None] | None]:
    """A progress bar on standard error where that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=stop - start)
        yield lambda now: bar.update(task, completed=now - start)


if __name__ == "__main__":
    sys.exit(main())
