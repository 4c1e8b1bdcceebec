"""Writes what in the documentation follows from something else; none of it is edited by hand.

    python -m docs.generate                 the lists of variables, and the tables of results
    python -m docs.generate --run [NAME]    the same after running studies anew, all by default; the picture
                            --measurement PATH    with a recorded drive, for the study that takes one

Lists of states, inputs, outputs and parameters come from the declarations and the vehicle file, tables of
results from ``docs/results``, where ``--run`` leaves what the studies gave. A test compares.
"""

from __future__ import annotations

import argparse
import inspect
import json
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim import studies
from cosim.diagnosis import hidden
from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import EffectParameter
from cosim.diagnosis.hidden import OUTSIDE, PREFIX
from cosim.files import write_text
from cosim.report.study_figures import Curve, Panel, draw
from cosim.studies.manoeuvre import TipIn, drive
from cosim.studies.manoeuvre import parameters as parameters_of
from driveline import vehicles
from driveline.kernels import layout as k
from driveline.models import MODELS, SHIPPED_GEAR, SHIPPED_VARIANT, SHIPPED_VEHICLE
from driveline.plants.plant import Plant
from driveline.quantities import Variable, behind
from driveline.vehicles import Vehicle

FOLDER = Path(__file__).parent
README = FOLDER.parent / "README.md"
RESULTS = FOLDER / "results"
PLANT_PAGES = {
    "plants/plant_fom_variables.md": ("plant_fom",),
    "plants/plant_rom_variables.md": ("plant_rom_2dof", "plant_rom_3dof", "plant_rom_3dof_split"),
}
# The table in the README: study, row of it, where the paper prints it.
MAIN_TABLE = (
    ("fom-validation", "shuffle frequency, baseline", "table 2.1"),
    ("fom-validation", "shuffle frequency, modified", "table 2.4"),
    ("fom-validation", "lash crossing time, modified", "section 3.2"),
    ("torque-meter-filter", "phase at 5.88 Hz", "figure 2.7"),
    ("torque-meter-filter", "delay at 5.88 Hz (eq. 2.3)", "section 2.1.3.3"),
    ("model-reduction", "shuffle frequency, 2DOF", "table 2.5"),
    ("model-reduction", "shuffle frequency, 3DOF", "table 2.6"),
    ("observability", "rank of the observability matrix, model I, contact (table 3.1)", "table 3.1"),
    ("observability", "rank of the observability matrix, model I, backlash (table 3.1)", "table 3.1"),
    ("observability", "rank of the observability matrix, model II, contact (table 3.2)", "table 3.2"),
    ("observability", "rank of the observability matrix, model II, backlash (table 3.2)", "table 3.2"),
)
ON_THE_ROAD = "state-estimator-robustness"  # takes a recorded drive
# The estimators' table: study, quantity, sampling time, the thesis's estimator, where the paper prints it.
BETTER = "lash_observer"
ESTIMATOR_TABLE = (
    ("state-estimator", "lash traversal time, mean error wherever the frames fall", "10 ms", "dskse", "table 3.3",
     14.29),
    ("state-estimator", "lash traversal time, mean error wherever the frames fall", "1 ms", "dskse", "table 3.4",
     5.59),
    ("state-estimator-robustness", "mean error of the lash traversal time, steps and ramps wherever the frames fall",
     "10 ms", "dskse", "figure 3.20", 15.0),
    ("state-estimator-robustness", "largest error of the lash traversal time, steps and ramps wherever the frames fall",
     "10 ms", "dskse", "", None),
    ("state-estimator-robustness", "mean error of the lash traversal time, the whole set", "10 ms", "dskse", "", None),
    ("size-estimator", "lash size, error after the last tip-in, 2 alpha", "10 ms", "tkbse", "table 4.1", 0.81),
    ("size-estimator", "lash size, error after the last tip-in, 4 alpha", "10 ms", "tkbse", "table 4.1", 0.25),
    ("size-estimator", "lash size, error after the last tip-in, 6 alpha", "10 ms", "tkbse", "table 4.1", 0.23),
    ("size-estimator", "lash size, error after tip-ins that meet the frames elsewhere each time, 2 alpha", "10 ms",
     "tkbse", "table 4.1", 0.81),
    ("size-estimator", "lash size, error after tip-ins that meet the frames elsewhere each time, 4 alpha", "10 ms",
     "tkbse", "table 4.1", 0.25),
    ("size-estimator", "lash size, error after tip-ins that meet the frames elsewhere each time, 6 alpha", "10 ms",
     "tkbse", "table 4.1", 0.23),
    ("size-estimator-robustness", "mean error of the lash size, the whole set", "10 ms", "tkbse", "figure 4.24", 3.0),
    ("size-estimator-robustness", "largest error of the lash size, the whole set", "10 ms", "tkbse", "figure 4.24",
     8.0),
    ("size-estimator-robustness", "lash size, error, engine speed 10 ms, wheel speed 30 ms late", "10 ms", "tkbse",
     "figure 4.21", 4.0),
    ("size-estimator-robustness", "largest error of the lash size with jitter", "10 ms", "tkbse", "section 4.3.8", 3.5),
    ("size-estimator-robustness", "true lash size in the 90 % interval, the whole set", "10 ms", None, "", None),
    ("state-estimator-robustness", "lash traversal time in its 90 % interval, the whole set", "10 ms", None, "", None),
)


def between(name: str) -> re.Pattern[str]:
    """What stands between the marks of a table in the README."""
    return re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->\n)", re.DOTALL)


_NUMBERED = re.compile(r"\[\d+\]$")


def table(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lines of a Markdown table."""
    yield "| " + " | ".join(headers) + " |"
    yield "|" + "---|" * len(headers)
    for row in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
    yield ""


def number(value: float) -> str:
    """A number as short as it can be read."""
    return f"{value:.6g}"


def limits(variable: Variable) -> str:
    """The range that makes sense."""
    low = "" if variable.minimum is None else f"from {number(variable.minimum)}"
    high = "" if variable.maximum is None else f"to {number(variable.maximum)}"
    return f"{low} {high}".strip()


def states(plant: Plant) -> Iterator[str]:
    """The list of everything that is saved, and what each is for."""
    network = plant.network
    yield from table(("", "state", "unit", "what it is"), (
        (str(i), f"`{entry.name}`", entry.unit, entry.meaning) for i, entry in enumerate(network.entries, 1)))
    filtered = 2 * len(network.sections) - int(np.sum(network.sections[:, 4] == 0.0))
    switching = network.plan[network.plan[k.SWITCH_TABLE]:][:network.plan[k.SWITCHES]]
    named = [f"`{name}`" for name, branch in network.branches.items() if branch in switching]
    besides = [f"the modes of {', '.join(named)}: the flank a lash touches, whether dry friction sticks or "
               "which way it slips"]
    if filtered:
        besides.append(f"{filtered} of the torque meter's filter, and the value it holds")
    for channel in network.channels:
        besides.append(f"the CAN channel of `{channel.source}`: the value held, the next frame, the frames "
                       "on their way")
    if plant.name == "plant_fom":
        besides.append("the clock: the engaged gear, and the torque requests on their way through the air "
                       "path's delay; a count of the mode changes")
    else:
        besides.append("a count of the mode changes")
    yield "Besides these, discrete:"
    yield ""
    yield from (f"- {what}" + (";" if what is not besides[-1] else ".") for what in besides)
    yield ""


def parameters(variables: Iterable[Variable], vehicle: Vehicle) -> Iterator[tuple[str, ...]]:
    """Rows of the parameters; a table of numbers is one row."""
    tables: dict[str, list[Variable]] = {}
    for variable in variables:
        tables.setdefault(_NUMBERED.sub("", variable.name), []).append(variable)
    for name, members in tables.items():
        first = members[0]
        shown = name if len(members) == 1 else f"{name}[1..{len(members)}]"
        value = ", ".join(number(v.start) for v in members)
        tunable = "; tunable" if first.variability == "tunable" else ""
        source = vehicle.sources.get(first.name, "")
        yield f"`{shown}`", first.unit, value, limits(first), first.meaning + tunable, source


def variables(name: str, vehicle: Vehicle) -> Iterator[str]:
    """One plant's lists."""
    defaults = MODELS[name].defaults_from(vehicle, SHIPPED_GEAR)
    plant = MODELS[name](defaults)
    plant.initialize()
    yield f"## {name}"
    yield ""
    yield plant.description + "."
    yield ""
    yield f"### {name}: {len(plant.network.entries)} continuous states"
    yield ""
    yield from states(plant)
    for causality in ("input", "output"):
        yield f"### {name}: {causality}s"
        yield ""
        found = [v for v in plant.variables if v.causality == causality]
        if causality == "input":
            yield from table(("input", "unit", "start", "range", "meaning"),
                             ((f"`{v.name}`", v.unit, number(v.start), limits(v), v.meaning) for v in found))
        else:
            yield from table(("output", "unit", "meaning"),
                             ((f"`{v.name}`", v.unit, v.meaning) for v in found))
    yield f"### {name}: parameters"
    yield ""
    found = [v for v in plant.variables if v.causality == "parameter"]
    rows = list(parameters(found, vehicle))
    headers = ("parameter", "unit", "value", "range", "meaning", "source")
    if not vehicle.values.items() <= defaults.items():  # computed, not read
        yield (f"Computed from the full-order vehicle by `driveline/plants/reduced.py`, for gear {SHIPPED_GEAR}; "
               "`start` and `solver` have defaults of their own.")
        yield ""
        headers, rows = headers[:-1], [row[:-1] for row in rows]
    yield from table(headers, rows)


def page(names: Sequence[str]) -> str:
    """A page of lists."""
    vehicle = vehicles.load(SHIPPED_VEHICLE, SHIPPED_VARIANT)
    lines = [f"# What {' and '.join(names) if len(names) < 3 else 'the reduced plants'} consist"
             f"{'s' if len(names) == 1 else ''} of", "",
             "Written by `python -m docs.generate` from the declarations in `driveline/` and from "
             f"`driveline/vehicles/{SHIPPED_VEHICLE}.toml`, variant `{SHIPPED_VARIANT}`. Units are SI; tables "
             "over gears begin with reverse and neutral.", ""]
    for name in names:
        lines += variables(name, vehicle)
    return "\n".join(lines).rstrip() + "\n"


# -- effects -------------------------------------------------------------------------------------------


def size_range(parameter: EffectParameter) -> str:
    """What sizes are plausible."""
    low, high = map(number, parameter.limits)
    if parameter.scale == "log":
        return f"times {low} to {high}"
    return f"{low} to {high}{behind(parameter.unit)}"


def effect_page() -> str:
    """The catalogue of effects."""
    lines = ["# Effects a diagnosis can name", "",
             "Written by `python -m docs.generate` from `cosim/diagnosis/effects`, where each has a file.", "",
             "An effect is physics that the vehicle file or the plant may not have right, with the one to three "
             "numbers that would put it right. The size of a number is a factor on what the vehicle file says "
             "(1: as the file says), or is added to it in SI (0: as the file says); outside the plausible range "
             "it is not a cause. `driveline hide EFFECT=SIZE` hides one; besides a bare size it takes `+15 %`, "
             "`30 ms`, `+334 kg`, or `PARAMETER:SIZE,PARAMETER:SIZE`. Parameters of values that no car has are those "
             "of [benches](plants/plant_bench.md).", ""]
    rows = []
    for name, effect in CATALOGUE.items():
        for i, p in enumerate((*effect.parameters, *effect.elsewhere)):
            targets = ", ".join(f"`{target}`" for target in p.targets)
            rows.append((f"[`{name}`](#{name})" if i == 0 else "", effect.acts_on if i == 0 else "", f"`{p.name}`",
                         p.meaning, size_range(p), targets))
    lines += table(("effect", "acts on", "parameter", "meaning", "plausible", "values it changes"), rows)
    for name, effect in CATALOGUE.items():
        lines += [f"## {name}", "", f"{effect.summary}. {effect.physics}", "",
                  f"Measured directly: {effect.directly}.", ""]
    lines += ["## Effects outside the catalogue", "",
              f"For `driveline hide {PREFIX}NAME`: physics that no diagnosis can name, to see whether it admits "
              "that, and finds the balance and what the missing torque goes with.", ""]
    lines += table(("effect", "what it is", "balance", "goes with", "unit of its size"),
                   ((f"`{PREFIX}{name}`", about.meaning, about.balance, " or ".join(about.driving_variables),
                     about.unit) for name, about in OUTSIDE.items()))
    title, _, text = inspect.cleandoc(hidden.__doc__).partition("\n")
    lines += ["## How such a measurement is made", "", title, text]
    return "\n".join(lines).rstrip() + "\n"


# -- results -------------------------------------------------------------------------------------------


def results() -> dict[str, dict[str, Any]]:
    """What the studies gave when they were last run, by name, in their order."""
    return {name: json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
            for name in studies.STUDIES if (RESULTS / f"{name}.json").is_file()}


def figures(row: dict[str, Any]) -> tuple[str, str, str]:
    """Paper, here and deviation as they are shown."""
    paper, here = ("" if row[key] is None else f"{row[key]:.4g}" for key in ("paper", "here"))
    deviation = row["deviation_percent"]
    return paper, here, "" if deviation is None else f"{deviation:+.2f} %"


def main_table() -> str:
    """The table of the README."""
    found = results()
    rows = []
    for study, quantity, place in MAIN_TABLE:
        (row,) = (row for row in found[study]["rows"] if row["quantity"] == quantity)
        name = re.sub(r" \(.*?\)$", "", quantity)
        rows.append((f"{name}{'' if row['unit'] == '1' else ' [' + row['unit'] + ']'}", place, *figures(row),
                     f"`{study}`"))
    return "\n".join(table(("quantity", "printed in", "paper", "here", "deviation", "study"), rows))


def estimator_table() -> str:
    """The estimators in the README: what the paper prints, its estimator here, the better one here."""
    found = results()

    def here(study: str, quantity: str, sampling: str, estimator: str | None) -> str:
        rows = {row["quantity"]: row["here"] for row in found[study]["rows"]}
        return "" if estimator is None else f"{rows[f'{quantity}, {sampling}, {estimator}']:.3g}"

    rows = [(f"{quantity}, {sampling} [%]", place, "" if paper is None else f"{paper:g}",
             here(study, quantity, sampling, estimator), here(study, quantity, sampling, BETTER), f"`{study}`")
            for study, quantity, sampling, estimator, place, paper in ESTIMATOR_TABLE]
    return "\n".join(table(("quantity", "printed in", "paper", "DSKSE / TKBSE here", "lash observer here", "study"),
                           rows))


def result_page() -> str:
    """All rows of all studies."""
    lines = ["# What the studies give", "",
             "Written by `python -m docs.generate --run`. Each study is run by `driveline study NAME`, which "
             "also draws its figures.", ""]
    for name, result in results().items():
        lines += [f"## {name}", "", studies.summary(name), "", f"Source: {result['source']}.", ""]
        lines += table(("quantity", "unit", "paper", "here", "deviation", "note"),
                       ((row["quantity"], row["unit"], *figures(row), row["note"]) for row in result["rows"]))
    return "\n".join(lines).rstrip() + "\n"


def with_tables(readme: str) -> str:
    """The README with its tables as the results have them, and the number of effects."""
    for name, made in (("main table", main_table), ("estimator table", estimator_table)):
        content = made()
        readme = between(name).sub(lambda match, content=content: f"{match[1]}{content}{match[2]}", readme)
    return re.sub(r"\[\d+ effects\]", f"[{len(CATALOGUE)} effects]", readme)


def run_studies(names: Iterable[str], measurement: Path | None = None) -> None:
    """Run studies and keep their rows."""
    for name in names:
        given = {} if measurement is None or name != ON_THE_ROAD else {"measurement": measurement}
        with tempfile.TemporaryDirectory() as folder:
            result = studies.run(name, Path(folder), **given)
        write_text(RESULTS / f"{name}.json", json.dumps(result, indent=1) + "\n")
        print(RESULTS / f"{name}.json")


def draw_tip_in(path: Path) -> None:
    """The picture of the README: the validation tip-in, full-order plant beside the 3DOF one."""
    vehicle, tip_in = vehicles.load(SHIPPED_VEHICLE, SHIPPED_VARIANT), TipIn()
    full = drive("plant_fom", parameters_of("plant_fom", vehicle), tip_in)
    reduced = drive("plant_rom_3dof", parameters_of("plant_rom_3dof", vehicle),
                    tip_in.less(vehicle.values["engine.accessory_torque"]))
    gap = np.degrees(full["lash_position"].max())

    def panel(title: str, curves: Sequence[Curve], label: str, **more: Any) -> Panel:
        return Panel(title, curves, label, x_range=(0.9, 2.4), **{"x_label": "", **more})

    def both(signal: str, factor: float, *labels: str) -> list[Curve]:
        return [Curve(full.time, factor * full[signal], labels[0], "measured", width=1.5),
                Curve(reduced.time, factor * reduced[signal], labels[1], "first")]

    torques = both("propeller_shaft_torque", 1.0, "full-order plant", "3DOF plant")
    torques.append(Curve(full.time, full["propeller_shaft_torque_measured"],
                         "full-order plant, through its torque meter", "second"))
    draw(path, "Tip-in in 5th gear: the driveline crosses its lash, then shuffles", [
        panel("propeller shaft torque", torques, "torque [N.m]"),
        panel("engine speed", both("engine_speed", 30.0 / np.pi, "", ""), "speed [rpm]",
              y_range=(1360.0, 1500.0)),
        panel("position in the lash, at the propeller shaft", both("lash_position", 180.0 / np.pi, "", ""),
              "angle [deg]", x_label="time [s]", y_range=(-1.35 * gap, 1.35 * gap),
              levels={gap: "driving flank", -gap: "coasting flank"}),
    ], columns=1)


# -- all of it -----------------------------------------------------------------------------------------


def pages() -> dict[Path, str]:
    """Every file that is written here, with what belongs into it."""
    written = {FOLDER / file: page(names) for file, names in PLANT_PAGES.items()}
    written[FOLDER / "effects.md"] = effect_page()
    written[FOLDER / "results.md"] = result_page()
    written[README] = with_tables(README.read_text(encoding="utf-8"))
    return written


def main() -> None:
    """Write everything."""
    parser = argparse.ArgumentParser(description="Write the generated parts of the documentation.")
    parser.add_argument("--run", nargs="*", choices=[*studies.STUDIES], metavar="NAME",
                        help="first run these studies, all where none is named, and draw the picture")
    parser.add_argument("--measurement", type=Path, metavar="PATH", help=f"a recorded drive for {ON_THE_ROAD}")
    options = parser.parse_args()
    run = options.run
    if run is not None:
        run_studies(run or studies.STUDIES, options.measurement)
        draw_tip_in(FOLDER / "images" / "tip_in.png")
    for path, text in pages().items():
        write_text(path, text)
        print(path)


if __name__ == "__main__":
    main()
