"""What may be connected to what, checked before anything runs."""

from __future__ import annotations

import graphlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from cosim import units
from cosim.master.clock import PER_SECOND, Clock
from cosim.master.participants import Participant
from cosim.messages import did_you_mean
from cosim.signals import Constant, Signal
from driveline.quantities import InputError, Variable

_TRUTH = {"true": 1.0, "false": 0.0}


@dataclass(frozen=True)
class Connection:
    """One wire: ``target = factor * source + offset``, in their own units.

    Attributes:
        source: ``participant.output``, or the name of a signal.
        target: ``participant.input``.
    """

    source: str
    target: str
    factor: float
    offset: float


def find(name: str, participants: Mapping[str, Participant]) -> tuple[Participant, Variable]:
    """The participant and variable behind ``participant.variable``.

    Raises:
        InputError: There is no such participant or variable; close names are suggested.
    """
    owner, dot, variable = name.partition(".")
    if not dot:
        raise InputError(f"'{name}': a name like 'participant.variable' is needed")
    if owner not in participants:
        raise InputError(f"'{name}': there is no participant '{owner}'{did_you_mean(owner, participants)}")
    variables = participants[owner].variables
    if variable not in variables:
        raise InputError(f"'{name}': {owner} has no variable '{variable}'{did_you_mean(variable, variables)}")
    return participants[owner], variables[variable]


def find_input(name: str, participants: Mapping[str, Participant]) -> Variable:
    """The input behind ``participant.variable``, which a source may be connected to.

    Raises:
        InputError: It is no input, or a string.
    """
    owner, variable = find(name, participants)
    if variable.causality != "input":
        inputs = [v.name for v in owner.variables.values() if v.causality == "input"]
        raise InputError(f"'{name}' is of causality {variable.causality}: only an input can be connected to "
                         f"a source{did_you_mean(variable.name, inputs)}")
    if variable.kind == "string":
        raise InputError(f"'{name}' is a string: strings can be set, but not connected")
    return variable


def number(value: float | str, variable: Variable, what: str) -> float:
    """A value for a variable as a number in its unit; of a boolean also ``true`` and ``false``, bare or as text.

    Args:
        what: Named in the message of the error.

    Raises:
        InputError: Neither a number nor a quantity of the right kind.
    """
    if variable.kind == "boolean" and isinstance(value, bool | str) and str(value).lower() in _TRUTH:
        return _TRUTH[str(value).lower()]
    return units.in_unit(value, variable.unit, what)


def between(source: str, target: str,
            participants: Mapping[str, Participant]) -> tuple[Connection, list[str]]:
    """The connection of an output with an input, and what is to be said about it.

    Raises:
        InputError: Causality, type or unit do not fit.
    """
    goal = find_input(target, participants)
    owner, origin = find(source, participants)
    if origin.causality != "output":
        outputs = [v.name for v in owner.variables.values() if v.causality == "output"]
        raise InputError(f"'{source}' is of causality {origin.causality}: only an output can be a source of "
                         f"'{target}'{did_you_mean(origin.name, outputs)}")
    if origin.kind != goal.kind and (origin.kind, goal.kind) != ("integer", "real"):
        raise InputError(f"'{source}' is {origin.kind}, but '{target}' is {goal.kind}: "
                         "equal types are needed")
    factor, offset, said = convert(source, origin.unit, target, goal.unit)
    if goal.kind != "real" and (factor, offset) != (1.0, 0.0):
        raise InputError(f"'{source}' is in '{origin.unit}', but '{target}' in '{goal.unit}': "
                         f"a value of type {goal.kind} is not converted")
    return Connection(source, target, factor, offset), said


def convert(source: str, source_unit: str, target: str, target_unit: str) -> tuple[float, float, list[str]]:
    """Factor and offset from one unit to the other, and what is to be said aloud about them."""
    if not source_unit or not target_unit:
        silent = [name for name, unit in ((source, source_unit), (target, target_unit)) if not unit]
        if source_unit == target_unit == "":
            return 1.0, 0.0, [f"{source} -> {target}: neither declares a unit, nothing was checked"]
        return 1.0, 0.0, [f"{source} -> {target}: {silent[0]} declares no unit, taken as "
                          f"'{source_unit or target_unit}'"]
    try:
        factor, offset = units.conversion(source_unit, target_unit)
    except InputError as error:
        raise InputError(
            f"'{source}' is in '{source_unit}', but '{target}' in '{target_unit}': {error}") from error
    if (factor, offset) == (1.0, 0.0):
        return factor, offset, []
    added = f" + {offset:g}" if offset else ""
    return factor, offset, [f"{source} [{source_unit}] -> {target} [{target_unit}]: converted, "
                            f"times {factor:.9g}{added}"]


def check_values(signal: Signal, connection: Connection, goal: Variable, clock: Clock) -> None:
    """Refuse a signal that leaves the range of the input it drives, before anything runs.

    Raises:
        InputError: The message names signal, instant, input and range.
    """
    for times, _ in clock.blocks(100_000):
        seconds = (times[:1] if isinstance(signal, Constant) else times) / PER_SECOND
        values = signal.values(seconds) * connection.factor + connection.offset
        low, high = goal.range
        possible = np.isfinite(values) & (values >= low) & (values <= high)
        if goal.kind != "real":
            possible &= values == np.round(values)
        if not possible.all():
            first = int(np.argmin(possible))
            try:
                goal.check(float(values[first]))
            except InputError as error:
                owner = connection.target.partition(".")[0]
                raise InputError(f"signal '{connection.source.lstrip('=')}' at t = {seconds[first]:g} s: "
                                 f"{owner}.{error}") from error
        if isinstance(signal, Constant):
            return


def algebraic_loop(participants: Iterable[Participant], connections: Iterable[Connection]) -> list[str]:
    """The variables of one loop without a state or a step in it, in order; empty if there is none.

    Inside a participant an output follows the inputs it declares to depend on within a step.
    """
    graph: dict[str, set[str]] = {}
    for connection in connections:
        graph.setdefault(connection.target, set()).add(connection.source)
    for participant in participants:
        for variable in participant.variables.values():
            graph.setdefault(f"{participant.name}.{variable.name}", set()).update(
                f"{participant.name}.{name}" for name in variable.depends_on)
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []
