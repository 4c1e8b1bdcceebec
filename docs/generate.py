"""Writes the pages that list what plants consist of: states, inputs, outputs, parameters with source.

    python -m docs.generate

Everything is read from the declarations and from the vehicle file, so a page is never edited by hand;
a test compares the pages with what this module writes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from driveline import vehicles
from driveline.kernels import network as k
from driveline.models import MODELS
from driveline.plants.plant import Plant
from driveline.quantities import Variable
from driveline.vehicles import Vehicle

FOLDER = Path(__file__).parent / "plants"
VEHICLE, VARIANT, GEAR = "pickup_10r80", "modified", 5
PAGES = {
    "plant_fom_variables.md": ("plant_fom",),
    "plant_rom_variables.md": ("plant_rom_2dof", "plant_rom_3dof", "plant_rom_3dof_split"),
}
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
    defaults = MODELS[name].defaults_from(vehicle, GEAR)
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
        yield (f"Computed from the full-order vehicle by `driveline/plants/reduced.py`, for gear {GEAR}; "
               "`start` and `solver` have defaults of their own.")
        yield ""
        headers, rows = headers[:-1], [row[:-1] for row in rows]
    yield from table(headers, rows)


def page(names: Sequence[str]) -> str:
    """A page of lists."""
    vehicle = vehicles.load(VEHICLE, VARIANT)
    lines = [f"# What {' and '.join(names) if len(names) < 3 else 'the reduced plants'} consist"
             f"{'s' if len(names) == 1 else ''} of", "",
             "Written by `python -m docs.generate` from the declarations in `driveline/` and from "
             f"`driveline/vehicles/{VEHICLE}.toml`, variant `{VARIANT}`. Units are SI; tables over gears "
             "begin with reverse and neutral.", ""]
    for name in names:
        lines += variables(name, vehicle)
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write the pages."""
    for file, names in PAGES.items():
        (FOLDER / file).write_text(page(names), encoding="utf-8")
        print(FOLDER / file)


if __name__ == "__main__":
    main()
