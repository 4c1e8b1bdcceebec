"""The co-simulation master: participants, connections, a step length, and a run."""

from __future__ import annotations

import logging
import numbers
import platform
from collections.abc import Callable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from cosim import units
from cosim.master import clock as clocks
from cosim.master import connections as wires
from cosim.master import layout as layouts
from cosim.master.fmu import FmuParticipant
from cosim.master.parameters import find_fmu, twin_of, vehicle_parameters, why_strange
from cosim.master.participants import ModelParticipant, Participant, SimulationError
from cosim.master.stepping import Loop, NotFinite
from cosim.messages import did_you_mean
from cosim.result import Result, check_signal_name
from cosim.signals import Constant, Signal
from driveline.model import Model
from driveline.quantities import InputError, Variable, behind

log = logging.getLogger("cosim")

ORDERS = ("jacobi", "gauss-seidel")


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, or another signal that Python handles, ended a run.

    Attributes:
        result: What was recorded until then; ``complete`` is False.
        number: Of the signal.
    """

    def __init__(self, result: Result, number: int) -> None:
        reached = result.time[-1] if result.time.size else result.provenance["start"]
        super().__init__(f"interrupted at t = {reached:g} s")
        self.result, self.number = result, number


class Master:
    """Connects participants and steps them together.

    ::

        result = (Master(step=1e-3)
                  .add("plant", "plant_fom", parameters={"start_speed": "50 km/h"})
                  .connect(Ramp(before=-20, after=250, time=1, duration=0.1), "plant.engine_torque")
                  .run(stop=4.0))
        result["plant.engine_speed"]

    Args:
        step: Communication step [s] of everybody who is not given another; text such as ``"2 ms"`` is converted, as of
            all times here.
        order: ``jacobi`` or ``gauss-seidel`` (then the order of ``add`` is the order of steps).
    """

    def __init__(self, step: float | str = 1e-3, order: str = "jacobi") -> None:
        if order not in ORDERS:
            raise InputError(f"order is '{order}'{did_you_mean(order, ORDERS)}")
        self._step = clocks.step_length(step, "step")
        self._gauss_seidel = order == "gauss-seidel"
        self._members: dict[str, layouts.Member] = {}
        self._signals: dict[str, Signal] = {}
        self._wires: dict[str, str] = {}  # target -> source: one source for each input
        self._record: list[str] = []
        self._record_step: int | None = None
        self._title: dict[str, Any] = {}
        self.notices: list[str] = []

    def add(self, name: str, what: str | Path | Model | Participant, *, step: float | str | None = None,
            parameters: Mapping[str, float | str] | None = None, vehicle: str | Path | None = None,
            variant: str | None = None, gear: int = 5, twin: bool = False) -> Master:
        """Add a participant.

        Args:
            name: Its name in this run, without a dot.
            what: Path of an FMU, name of a built one, a Model, or anything with the interface of a
                participant.
            step: Its own communication step [s].
            parameters: Values by name; text such as ``"1.1 deg"`` is converted.
            vehicle, variant, gear: Vehicle file the parameters are computed from first.
            twin: Take the model called ``what`` in process instead of its FMU.

        Raises:
            InputError: Anything of this cannot be.
        """
        if not name or "." in name or name in self._members or name in self._signals:
            raise InputError(f"participant '{name}': a name without a dot that is not taken is needed")
        if isinstance(what, Model):
            participant: Participant = ModelParticipant(name, what)
        elif twin:
            participant = ModelParticipant(name, twin_of(str(what)))
        elif isinstance(what, str | Path):
            participant = FmuParticipant(name, find_fmu(what))
        else:
            participant = what
        if participant.name != name:
            raise InputError(f"participant '{name}' was made as '{participant.name}': one name for both is needed")
        for other, member in self._members.items():
            if _owner_of_state(member.participant) is _owner_of_state(participant):
                cause = "an instance of its own is needed, as the two would share one state"
                if isinstance(participant, FmuParticipant) and participant.only_once:
                    cause = f"{participant.path.name} allows one instance a process"
                raise InputError(f"participant '{name}' is '{other}' already: {cause}")
        values: dict[str, float | str] = {}
        if vehicle is not None:
            model = getattr(participant, "model_name", None) or str(getattr(what, "name", what))
            values.update(vehicle_parameters(model, vehicle, variant, gear))
            if strange := values.keys() - participant.variables.keys():
                raise InputError(f"{name}: {why_strange(model, min(strange))}")
        period = self._step if step is None else clocks.step_length(step, f"step of {name}")
        self._members[name] = layouts.Member(participant, period, values)
        try:
            for parameter, value in (parameters or {}).items():
                self.set(f"{name}.{parameter}", value)
        except InputError:
            del self._members[name]  # so that it can be added again, put right
            raise
        return self

    def variable(self, name: str) -> Variable:
        """What is known of ``participant.variable``."""
        return wires.find(name, self._participants)[1]

    def set(self, name: str, value: float | str) -> Master:
        """Set a parameter ``participant.parameter``; text is converted to its unit.

        An input that is a string can be set too, as nothing can be connected to it.

        Raises:
            InputError: There is no such parameter, or the value is not possible.
        """
        participant, variable = wires.find(name, self._participants)
        if variable.causality != "parameter" and (variable.causality, variable.kind) != ("input", "string"):
            parameters = [v.name for v in participant.variables.values() if v.causality == "parameter"]
            raise InputError(f"'{name}' is of causality {variable.causality}: a parameter is needed"
                             f"{did_you_mean(variable.name, parameters)}")
        if variable.kind != "string":
            value = wires.number(value, variable, f"'{name}'")
            try:
                variable.check(value)
            except InputError as error:
                raise InputError(f"{participant.name}: {error}") from error
        self._members[participant.name].parameters[variable.name] = value
        return self

    def signal(self, name: str, signal: Signal) -> Master:
        """Name a signal, so that it can be connected to several inputs and recorded.

        Raises:
            InputError: The name has a dot, is taken, or is ``time``.
        """
        check_signal_name(name)
        if not name or "." in name or name in self._signals or name in self._members:
            raise InputError(f"signal '{name}': a name without a dot that is not taken is needed")
        self._signals[name] = signal
        return self

    def connect(self, source: str | float | Signal, target: str) -> Master:
        """Connect an output, a signal or a constant (in the unit of the input) to an input.

        Raises:
            InputError: The names, causality, type or unit do not fit, or the input has a source.
        """
        variable = wires.find_input(target, self._participants)
        if target in self._wires:
            raise InputError(f"'{target}' is connected to '{self._wires[target]}' already: "
                             f"one source for each input, not also '{source}'")
        if isinstance(source, numbers.Real):  # numpy's too
            source = Constant(value=float(source))
        if isinstance(source, Signal):
            name = "=" + target  # a name of its own, which nobody else gives
            self._signals[name], source = source, name
        elif source not in self._signals:
            if "." not in source:
                raise InputError(f"there is no signal '{source}'"
                                 f"{did_you_mean(source, [s for s in self._signals if s[0] != '='])}")
            wires.between(source, target, self._participants)
        if source in self._signals and self._signals[source].unit:
            wires.convert(source, self._signals[source].unit, target, variable.unit)
        self._wires[target] = source
        return self

    def record(self, *patterns: str, step: float | str | None = None) -> Master:
        """Record these variables and signals (``*`` and ``?`` match), every ``step`` [s].

        Without it all outputs and named signals are recorded at the shortest step.

        Raises:
            InputError: A pattern is no text, or the step is not possible.
        """
        for pattern in patterns:
            if not isinstance(pattern, str):
                raise InputError(f"what to record is {pattern!r}: a name like 'participant.variable' is needed")
        self._record += patterns
        if step is not None:
            self._record_step = clocks.step_length(step, "step of the record")
        return self

    def recorded(self) -> dict[str, str]:
        """The names that a run records, in their order, with their units.

        Raises:
            InputError: There is nothing of a name that was asked for.
        """
        return {name: self._unit(name) for name in layouts.choose(self._record, self._members, self._signals)}

    def describe(self, **entries: Any) -> Master:
        """Add entries to the provenance of the result."""
        self._title.update(entries)
        return self

    def run(self, stop: float | str, start: float | str = 0.0,
            progress: Callable[[float], None] | None = None) -> Result:
        """Check everything, then step from ``start`` to ``stop`` [s].

        Args:
            progress: Called now and then with the instant reached [s].

        Raises:
            InputError: Something is wrong with what was put together; nothing has run.
            SimulationError: A participant failed; ``error.result`` holds what was recorded until then.
            Interrupted: Ctrl-C; ``interrupt.result`` likewise.
        """
        start, stop = units.in_unit(start, "s", "start"), units.in_unit(stop, "s", "stop")
        loop, shown = self._prepare(start, stop)
        names = list(shown)

        def result(complete: bool) -> Result:
            count = loop.recording.count
            return Result(loop.recording.times(),
                          {name: loop.recording.rows[:count, i].copy() for i, name in enumerate(names)},
                          shown, self._provenance(start, stop), complete)

        try:
            loop.initialize()
            ended_by = loop.run(progress)
        except NotFinite as error:
            failure = SimulationError(f"{names[error.column]} is not finite at t = {error.time:.9g} s")
            failure.result = result(complete=False)
            raise failure from error
        except SimulationError as error:
            error.result = result(complete=False)
            raise
        finally:
            loop.close()
        if ended_by is not None:
            raise Interrupted(result(complete=False), ended_by)
        return result(complete=True)

    @property
    def _participants(self) -> dict[str, Participant]:
        return {name: member.participant for name, member in self._members.items()}

    def _prepare(self, start: float, stop: float) -> tuple[Loop, dict[str, str]]:
        """Check everything and lay out the bus; the loop, and the units of what it records by name."""
        if not self._members:
            raise InputError("there is nobody to step: add a participant")
        self.notices = []
        record_period = self._record_step or min(member.step for member in self._members.values())
        clock = clocks.Clock(clocks.nanoseconds(start, "start"), clocks.nanoseconds(stop, "stop"),
                             [*(member.step for member in self._members.values()), record_period])
        for name, member in self._members.items():
            if (clock.stop - clock.start) % member.step and not member.participant.variable_step:
                raise InputError(f"{name} cannot vary its step of {member.step / clocks.PER_SECOND:g} s, and "
                                 f"the run of {stop - start:g} s is not a multiple of it")
        connections = self._resolve()
        recorded = self.recorded()
        by_target = {connection.target: connection for connection in connections}
        layout = layouts.lay_out(self._members, self._signals, by_target, list(recorded))
        loop = Loop(layout.seats, layout.bus, layout.varying, clock,
                    np.array([layout.slots[name] for name in recorded], dtype=np.intp), record_period,
                    self._gauss_seidel)
        # last: of a run too long to be recorded this would take for ever
        for connection in connections:
            if connection.source in self._signals:
                wires.check_values(self._signals[connection.source], connection,
                                   wires.find_input(connection.target, self._participants), clock)
        return loop, recorded

    def _resolve(self) -> list[wires.Connection]:
        """All connections with their conversion; says aloud what somebody should know."""
        participants = self._participants
        resolved = []
        for target, source in self._wires.items():
            if source in self._signals:
                variable = wires.find_input(target, participants)
                unit = self._signals[source].unit or variable.unit
                factor, offset, said = wires.convert(source.lstrip("="), unit, target, variable.unit)
                connection = wires.Connection(source, target, factor, offset)
            else:
                connection, said = wires.between(source, target, participants)
            for notice in said:
                self._say(notice)
            resolved.append(connection)
        for name, member in self._members.items():
            for variable in member.participant.variables.values():
                if variable.causality == "input" and f"{name}.{variable.name}" not in self._wires:
                    start = member.parameters.get(variable.name, variable.start)
                    shown = repr(start or "") if variable.kind == "string" else f"{start:g}{behind(variable.unit)}"
                    self._say(f"{name}.{variable.name} is not connected: it stays at its start value, {shown}")
        if loop := wires.algebraic_loop(participants.values(), resolved):
            known = all(p.dependencies_declared for p in participants.values())
            self._say(("algebraic loop " if known else "possible algebraic loop (dependencies not declared) ")
                      + " -> ".join(loop) + ": it is not iterated, one value in it is a step old")
        return resolved

    def _unit(self, name: str) -> str:
        if "." in name:
            return self.variable(name).unit
        if unit := self._signals[name].unit:
            return unit
        targets = [target for target, source in self._wires.items() if source == name]
        return self.variable(targets[0]).unit if targets else ""

    def _say(self, notice: str) -> None:
        self.notices.append(notice)
        log.info("%s", notice)

    def _provenance(self, start: float, stop: float) -> dict[str, Any]:
        members = {}
        for name, member in self._members.items():
            members[name] = {**member.participant.describe(), "step": member.step / clocks.PER_SECOND,
                             "parameters": dict(member.parameters)}
        return {
            **self._title, "start": start, "stop": stop,
            "order": ORDERS[self._gauss_seidel], "participants": members,
            "connections": dict(self._wires),
            "signals": {name: signal.describe() for name, signal in self._signals.items()},
            "notices": list(self.notices), "versions": _versions(),
        }


def _owner_of_state(participant: Participant) -> Model | Participant | Path:
    if isinstance(participant, FmuParticipant) and participant.only_once:
        return participant.folder  # which all instances have in common
    return participant.model if isinstance(participant, ModelParticipant) else participant


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version(), "platform": platform.platform(terse=True)}
    for package in ("driveline-cosim", "fmpy", "numpy"):
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "source"
    return versions
