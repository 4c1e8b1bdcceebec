"""Run blind cases and print what came of them.

    python -m benchmarks.blind --cases 30 --workers 2                        # all categories
    python -m benchmarks.blind --categories single:60 null:100 --no-baselines
    python -m benchmarks.blind --manoeuvres tip_in:5 --no-baselines          # quick: one recording each
    python -m benchmarks.blind --vehicle any --manoeuvres any --no-baselines # each case a vehicle and drive of its own
    python -m benchmarks.blind --cluster tcp://host:8786 --cases 300         # a dask scheduler's address
    python -m benchmarks.blind --print --out out/blind                       # what is there, nothing is run

A run that was stopped goes on where it was; a longer one adds to a shorter one.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.blind import baselines
from benchmarks.blind import run as blind
from benchmarks.blind.cases import ANY, CATEGORIES, cases, wanted
from benchmarks.blind.failures import confusions, line
from benchmarks.blind.figures import HEADS, rate, reliability
from benchmarks.blind.reading import NOTHING, forecasts, is_right
from benchmarks.blind.score import score
from cosim.diagnosis.hidden import VEHICLE
from cosim.files import write_text
from cosim.workers import cores
from driveline.quantities import InputError


def main(arguments: Sequence[str] | None = None) -> int:
    options = _options(arguments)
    handler = logging.StreamHandler(sys.stderr)
    handler.setLevel(logging.WARNING)  # dask's own loggers tell more than that
    logging.basicConfig(format="%(message)s", handlers=[handler])
    try:
        counts = wanted(options.categories, options.cases)
        if options.print:
            results = [r for r in blind.read(options.out / blind.LINES) if r["category"] in counts]
            compared = ([r for r in blind.read(options.out / baselines.LINES) if r["category"] in counts]
                        if (options.out / baselines.LINES).is_file() else [])
        else:
            manoeuvres = options.manoeuvres and tuple(options.manoeuvres.split(","))
            chosen = cases(counts, options.seed, manoeuvres, options.vehicle)
            with _progress("diagnosis", options.quiet) as told:
                results = blind.run(chosen, options.out, workers=options.workers, cluster=options.cluster,
                                    progress=told)
            compared = []
            if options.baselines:
                with _progress("baselines", True) as told:
                    compared = baselines.run(chosen, options.out, options.workers, options.cluster, told)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    text, told = report(results, compared)
    write_text(options.out / "blind.json", json.dumps(told, indent=2, allow_nan=False) + "\n")
    write_text(options.out / "blind.md", text)
    print(text)
    return 0


def report(results: Sequence[dict[str, Any]], compared: Sequence[dict[str, Any]]) -> tuple[str, dict[str, Any]]:
    """The text that is printed, and everything for programs."""
    rows = score(results)
    versions = {r["code"] for r in results}
    parts = [f"{len(results)} cases: " + ", ".join(
        f"{n} {name}" for name in CATEGORIES if (n := sum(r["category"] == name for r in results)))]
    if versions - {blind.fingerprint()}:
        parts.append("These results are of another version of the code than the present one.")
    parts += ["", *markdown(HEADS, [row.cells() for row in rows])]
    nothing = sum(r["category"] in NOTHING for r in results)
    if nothing:
        parts += ["", _supported(nothing)]
    table = reliability(forecasts(r for r in results if r["category"] not in ("pair", "cocktail")))
    if table:
        parts += ["", "Probabilities, without pairs and cocktails:", "", *markdown(
            ("said", "mean said", "was so", "n"),
            [[f"{r['low']:.1f} to {r['high']:.1f}", f"{r['said']:.2f}", f"{r['was']:.2f}", str(r["n"])]
             for r in table])]
    against = baselines.rows(results, compared)
    if against:
        parts += ["", "The same cases by simpler methods:", "", *markdown(baselines.HEADS, against)]
    wrong = [line(r) for r in results if not is_right(r)]
    confused = confusions(results)
    if confused:
        parts += ["", "Taken for another (hidden -> found):", "", *(f"- {n} x {k}" for k, n in confused.items())]
    if wrong:
        parts += ["", f"{len(wrong)} cases that are not right:", "", *(f"- {text}" for text in wrong)]
    told = {"code": sorted(versions), "rows": [asdict(row) for row in rows], "reliability": table,
            "baselines": [dict(zip(baselines.HEADS, row)) for row in against], "confusions": confused,
            "not_right": wrong, "results": list(results), "baseline_results": list(compared)}
    return "\n".join(parts) + "\n", told


def _supported(count: int) -> str:
    """What so many cases with nothing in them can show at most."""
    best = rate("", "", [False] * count)
    return (f"Even without a single false alarm {count} cases with nothing hidden show no more than a rate below "
            f"{100.0 * best.high:.2g} % (95 %); 1 % takes 381 of them.")


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table."""
    return [f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows)]


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=30, help="in each category (30)")
    parser.add_argument("--categories", nargs="+", default=[], metavar="NAME[:N]",
                        help=f"of {', '.join(CATEGORIES)}; all of them by default")
    parser.add_argument("--workers", type=int, default=cores(), help="processes here; one a core")
    parser.add_argument("--cluster", help="address of a dask scheduler to run on instead")
    parser.add_argument("--out", type=Path, default=Path("out/blind"), help="folder of the results (out/blind)")
    parser.add_argument("--seed", type=int, default=0, help="another one gives other cases")
    parser.add_argument("--manoeuvres", metavar="KIND:GEAR,...",
                        help="recordings of each case, as driveline hide takes them; the usual ones by default, "
                             f"'{ANY}' draws one to three for each case")
    parser.add_argument("--vehicle", default=VEHICLE, help=f"of each case; {VEHICLE} by default, '{ANY}' draws one")
    parser.add_argument("--baselines", action=argparse.BooleanOptionalAction, default=True,
                        help="also simpler methods on the same cases")
    parser.add_argument("--print", action="store_true", help="only score what is in --out")
    parser.add_argument("--quiet", action="store_true", help="no line for every case on the way")
    return parser.parse_args(arguments)


@contextmanager
def _progress(title: str, quiet: bool) -> Iterator[Any]:
    """A bar on standard error, and a line for every case."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)

        def told(share: float, result: dict[str, Any]) -> None:
            bar.update(task, completed=share)
            if not quiet:
                console.print(("      " if is_right(result) else "wrong ") + line(result))

        yield told


if __name__ == "__main__":
    sys.exit(main())
