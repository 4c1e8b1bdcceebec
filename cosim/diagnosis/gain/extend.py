"""The extended vehicle file and plant FMU, and what they gain on recordings that were never used."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.diagnosis.judge.finding import Gain
from cosim.diagnosis.plants import STEP, Run
from cosim.diagnosis.plants.observation import observe
from cosim.diagnosis.show.features import WITH_RINGING, Key, Reader, unit_of
from cosim.files import write_text
from cosim.master import Master
from cosim.signals import Table
from driveline import vehicles
from driveline.vehicles import Vehicle

log = logging.getLogger("cosim")
EXTENDED = "extended.toml"
_CONTROL = re.compile(r"[\x00-\x1f\x7f]+")
_SECTION = re.compile(r"^\s*\[([^\]]+)\]\s*(#.*)?$")


def changed_values(nominal: Mapping[str, float], extended: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the plant that differ; errors of sensors and inputs are no part of a vehicle."""
    return {name: value for name, value in extended.items()
            if not name.startswith(("observe.", "input.")) and value != nominal.get(name)}


def write_vehicle(source: Vehicle, changes: Mapping[str, float], unit_of: Mapping[str, str], why: str,
                  path: Path) -> Path:
    """A vehicle file with all values of ``source``, those of ``changes`` in SI replaced or added.

    Args:
        source: The vehicle, its variant applied.
        changes: Structured name to SI value.
        unit_of: SI unit of every parameter.
        why: Source of the changed values.
        path: Where it goes.
    """
    tables: dict[str, dict[str, list[tuple[float, str]]]] = {}
    values = dict(source.values) | dict(changes)
    for name, value in values.items():
        section, _, key = name.partition(".")
        bare, _, _ = key.partition("[")
        origin = why if name in changes else source.sources[name]
        tables.setdefault(section, {}).setdefault(bare, []).append((value, origin))
    lines = [f"# {_CONTROL.sub(' ', f'{source.name} ({source.variant}), extended: {why}')}. All values in SI.", ""]
    for section, entries in tables.items():
        lines.append(f"[{section}]")
        for key, rows in entries.items():
            unit = _spelled(unit_of.get(f"{section}.{key}", unit_of.get(f"{section}.{key}[1]", "1")))
            origin = next((o for _, o in rows if o == why), rows[0][1])
            table = f"{section}.{key}[1]" in values
            number = f"values = [{', '.join(repr(v) for v, _ in rows)}]" if table else f"value = {rows[0][0]!r}"
            lines.append(f'{key} = {{ {number}, unit = "{unit}", source = {_quoted(origin)} }}')
        lines.append("")
    write_text(path, "\n".join(lines))
    vehicles.load(path)  # whoever reads it next shall have no surprise
    return path


def _quoted(text: str) -> str:
    """As TOML has it: the escapes of JSON, and one more."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _spelled(unit: str) -> str:
    return unit or "1"


def co_simulate(fmu: Path, parameters: Mapping[str, float], run: Run,
                start_speed: float) -> dict[str, np.ndarray]:
    """Outputs of a plant FMU in one run, through the master; on ``run.time``.

    Args:
        fmu: Path of the FMU.
        parameters: What is not as it was built.
        run: Its inputs are held over each step.
        start_speed: Of the vehicle [m/s].
    """
    from driveline.plants.full_order import FullOrderPlant

    names = [variable.name for variable in FullOrderPlant.inputs]
    master = Master(step=STEP)
    master.add("plant", fmu, parameters={**parameters, "start.vehicle_speed": start_speed})
    start = round(run.start, 9)  # the master counts nanoseconds, and clocks of loggers anything
    # what a step begins with holds from before it begins, whatever the last bit of either time is
    time = start + STEP * (np.arange(len(run.inputs)) - 0.5)
    for i, name in enumerate(names):
        column = run.inputs[:, i]
        if np.ptp(column) > 0.0:
            discrete = name == "gear"
            master.connect(Table(times=time, data=column, unit="1" if discrete else _unit(name),
                                 interpolation="hold"), f"plant.{name}")
        else:
            master.connect(int(column[0]) if name == "gear" else float(column[0]), f"plant.{name}")
    master.record("plant.*")
    result = master.run(start=start, stop=round(start + STEP * len(run.inputs), 9))
    return {name.removeprefix("plant."): np.interp(run.time, result.time, result[name]) for name in result.names}


def _unit(name: str) -> str:
    from driveline.plants.full_order import FullOrderPlant

    return next(v.unit for v in FullOrderPlant.inputs if v.name == name)


def gain(runs: Iterable[Run], simulate: Callable[[bool, Run], Mapping[str, np.ndarray]],
         values: Callable[[bool, Run], Mapping[str, float]], floors: Mapping[str, float]) -> list[Gain]:
    """Errors before and after on recordings that were not used.

    Args:
        simulate: ``(extended, run) -> outputs on run.time``.
        values: ``(extended, run) -> values``; what matters are the instruments.
        floors: Noise floor of each channel.
    """
    rows = []
    for run in runs:
        known = [(simulate(extended, run), values(extended, run)) for extended in (False, True)]
        for name, clock in run.clocks.items():
            shown = (observe(raw, run.time, instruments, name, clock) for raw, instruments in known)
            rows.append(Gain.of(run.name, name, clock, run.measured[name], *shown, floors[name]))
    return rows


def read_off(run: Run, before: np.ndarray, after: np.ndarray, wanted: Iterable[Key],
             firing_order: float = Reader.firing_order) -> list[dict[str, Any]]:
    """What an engineer reads off a recording that was not used, and off the plant before and after.

    An error in time does not say whether shuffle is the right one a moment late, or another one.

    Args:
        run: The recording.
        before, after: Its stacked channels, simulated.
        wanted: Signals and features. Those that the recording or a simulation does not show are left out; how the
            driveline rings is read off every channel that shows it.
        firing_order: Firings of the engine per revolution of its crankshaft.

    Returns:
        Rows for ``gain`` of a finding, SI.
    """
    reader = Reader(run, before, firing_order)
    shown, was, now = (reader.read(stacked) for stacked in (run.stacked, before, after))
    keys = dict.fromkeys([*wanted, *(key for key in shown if key[1] in WITH_RINGING)])
    return [{"manoeuvre": run.name, "signal": key[0], "feature": key[1], "unit": unit_of(*key),
             "measured": shown[key], "before": was[key], "after": now[key]}
            for key in keys if key in shown and key in was and key in now]


def with_inputs(run: Run, values: Mapping[str, float]) -> Run:
    """The run with its inputs as they really were, as far as ``values`` know."""
    from driveline.plants.full_order import FullOrderPlant

    columns = {variable.name: i for i, variable in enumerate(FullOrderPlant.inputs)}
    return replace(run, inputs=run.driven_by(values, columns))
