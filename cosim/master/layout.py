"""Where every value lies: the bus that participants exchange values on, and what is recorded from it."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.master.connections import Connection
from cosim.master.participants import Participant
from cosim.master.stepping import Seat
from cosim.messages import did_you_mean
from cosim.signals import Constant, Signal
from driveline.quantities import InputError, Variable


@dataclass
class Member:
    """A participant with its step [ns] and the parameters set."""

    participant: Participant
    step: int
    parameters: dict[str, float | str]


@dataclass(frozen=True)
class Layout:
    """The outcome.

    Attributes:
        bus: All values, at their start values. Varying signals come first, then of each participant the
            outputs and the inputs that are exchanged at every step (reals side by side, so that an FMU
            reads and writes them in place), then everything that stays as it is.
        slots: Name to place on the bus.
        seats: The participants in their places.
        varying: The signals of the first slots.
    """

    bus: np.ndarray
    slots: dict[str, int]
    seats: list[Seat]
    varying: list[Signal]


def scalars(members: Mapping[str, Member]) -> dict[str, Variable]:
    """All variables that a number can stand for, by ``participant.variable``."""
    return {f"{name}.{variable.name}": variable for name, member in members.items()
            for variable in member.participant.variables.values() if variable.kind != "string"}


def choose(patterns: Sequence[str], members: Mapping[str, Member],
           signals: Mapping[str, Signal]) -> list[str]:
    """The names to record, in the order asked for, each once; by default all outputs and named signals.

    Raises:
        InputError: A pattern matches nothing.
    """
    variables = scalars(members)
    named = [name for name in signals if not name.startswith("=")]
    if not patterns:
        return [*named, *(name for name, variable in variables.items() if variable.causality == "output")]
    everything = {*named, *variables}
    shown = [*named, *(name for name, variable in variables.items()
                       if variable.causality in ("input", "output"))]
    chosen: dict[str, None] = {}
    for pattern in patterns:
        if pattern in everything:  # parameters and internal variables only by their full name
            chosen[pattern] = None
            continue
        matches = fnmatch.filter(shown, pattern.replace("[", "[[]"))
        if not matches:
            raise InputError(f"nothing to record is called '{pattern}'{did_you_mean(pattern, everything)}")
        chosen.update(dict.fromkeys(matches))
    return list(chosen)


def lay_out(members: Mapping[str, Member], signals: Mapping[str, Signal],
            by_target: Mapping[str, Connection], recorded: Sequence[str]) -> Layout:
    """Give every value that is exchanged or recorded its slot.

    Args:
        by_target: Connections by the input they lead to.
        recorded: Names to record.
    """
    variables = scalars(members)
    varying = {name: signal for name, signal in signals.items() if not isinstance(signal, Constant)}
    constants = _constants(members, signals, by_target, variables)
    exchanged = {connection.source for connection in by_target.values()} | set(recorded)
    slots = {name: slot for slot, name in enumerate(varying)}

    def place(names: list[str]) -> tuple[list[str], slice]:
        names.sort(key=lambda name: variables[name].kind != "real")
        first = len(slots)
        slots.update({name: first + i for i, name in enumerate(names)})
        return [name.partition(".")[2] for name in names], slice(first, len(slots))

    seats: list[Seat] = []
    for name, member in members.items():
        own = [full for full in variables if full.startswith(f"{name}.") and full not in constants]
        outputs, output_slots = place([full for full in own if full not in by_target and full in exchanged])
        inputs, input_slots = place([full for full in own if full in by_target])
        wired = [by_target[f"{name}.{entry}"] for entry in inputs]
        fixed = {full.partition(".")[2]: constants[full] for full in by_target
                 if full in constants and full.startswith(f"{name}.")}
        earlier = {seat.participant.name for seat in seats}
        seats.append(Seat(
            member.participant, member.step, {**member.parameters, **fixed}, inputs, outputs, input_slots,
            output_slots, sources=np.zeros(len(wired), dtype=np.intp),
            factor=np.array([c.factor for c in wired]), offset=np.array([c.offset for c in wired]),
            early=np.array([c.source.partition(".")[0] in earlier for c in wired], dtype=bool),
            feeds=any(c.source.startswith(f"{name}.") for c in by_target.values())))
    slots.update({name: len(slots) + i for i, name in enumerate(constants)})
    for seat in seats:  # now that everybody has a place
        targets = (f"{seat.participant.name}.{entry}" for entry in seat.inputs)
        seat.sources[:] = [slots[by_target[target].source] for target in targets]

    bus = np.zeros(len(slots))
    for name, slot in slots.items():
        if name in constants:
            bus[slot] = constants[name]
        elif name in variables:  # what others see of an output until it is initialized
            bus[slot] = variables[name].start
    return Layout(bus, slots, seats, list(varying.values()))


def _constants(members: Mapping[str, Member], signals: Mapping[str, Signal],
               by_target: Mapping[str, Connection], variables: Mapping[str, Variable]) -> dict[str, float]:
    """What never changes in a run: constant signals, inputs they drive, unconnected inputs, parameters."""
    constants = {name: signal.value for name, signal in signals.items() if isinstance(signal, Constant)}
    for target, connection in by_target.items():
        if connection.source in constants:
            constants[target] = constants[connection.source] * connection.factor + connection.offset
    for full, variable in variables.items():
        if variable.causality in ("input", "parameter") and full not in by_target:
            owner = members[full.partition(".")[0]]
            constants[full] = float(owner.parameters.get(variable.name, variable.start))
    return constants
