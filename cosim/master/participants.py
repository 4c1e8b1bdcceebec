"""Who takes part in a run: the small interface the master sees, and the in-process twin behind it.

``FmuParticipant`` (``fmu.py``) shows the same interface, so either can stand where the other stood.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from driveline.model import Model
from driveline.quantities import InputError, Variable

log = logging.getLogger("cosim")


class SimulationError(RuntimeError):
    """A participant failed during the run; the message names it, the time and its own words.

    Attributes:
        result: What was recorded until then, or None.
    """

    result: Any = None


class Participant(Protocol):
    """What the master needs of anything it steps.

    The order of calls is ``open``, ``initialize``, any ``advance`` and ``read``, ``close``.

    Attributes:
        name: Its name in this run.
        variables: Everything it shows, by name; unit ``""`` where it does not say, ``depends_on`` of an
            output holding all inputs where it does not say.
        variable_step: Whether it can make a last step that is shorter than the others.
        dependencies_declared: Whether the dependencies of its outputs are declared, not assumed.
    """

    name: str
    variables: dict[str, Variable]
    variable_step: bool
    dependencies_declared: bool

    def describe(self) -> dict[str, Any]:
        """Where it comes from: for the provenance of results."""

    def open(self, start: dict[str, float | str], inputs: Sequence[str], outputs: Sequence[str],
             input_buffer: np.ndarray, output_buffer: np.ndarray) -> None:
        """Make the instance and set start values (parameters, and inputs that stay as they are).

        The participant reads its connected inputs from ``input_buffer`` and writes its outputs to
        ``output_buffer`` (float64, in the order of the names), which the caller owns.
        """

    def initialize(self, start_time: float, stop_time: float) -> None:
        """Initialize with the inputs in the buffer and write the outputs."""

    def advance(self, time: float, step: float) -> None:
        """From ``time`` to ``time + step`` [s] with the inputs in the buffer."""

    def read(self) -> None:
        """Write the outputs to the buffer."""

    def close(self) -> None:
        """Free everything; also after a failure."""


class ModelParticipant:
    """The in-process twin: a Model of the payload, without an FMU around it.

    Attributes:
        model: The Model, which holds the state: an instance serves one participant.
    """

    variable_step = True
    dependencies_declared = True

    def __init__(self, name: str, model: Model) -> None:
        self.name = name
        self.variables = {variable.name: variable for variable in model.variables}
        self.model = model
        self._fresh = model.values.copy()

    def describe(self) -> dict[str, Any]:
        return {"twin": self.model.name, "step_function": type(self.model).__module__}

    def open(self, start: dict[str, float | str], inputs: Sequence[str], outputs: Sequence[str],
             input_buffer: np.ndarray, output_buffer: np.ndarray) -> None:
        model = self.model
        model.values[:] = self._fresh
        for name, value in start.items():
            model[name] = float(value)
        self._inputs = np.array([model.index[name] for name in inputs], dtype=np.intp)
        self._outputs = np.array([model.index[name] for name in outputs], dtype=np.intp)
        self._input_buffer, self._output_buffer = input_buffer, output_buffer

    def initialize(self, start_time: float, stop_time: float) -> None:
        self.model.values[self._inputs] = self._input_buffer
        try:
            self.model.initialize(start_time)
        except (ValueError, ArithmeticError) as error:  # nothing has run yet, so it is what it was given
            raise InputError(f"{self.name}: {error}") from error
        self._forward_log()
        self.read()

    def advance(self, time: float, step: float) -> None:
        self.model.values[self._inputs] = self._input_buffer
        try:
            self.model.step(time, step)
        except (ValueError, ArithmeticError) as error:
            raise SimulationError(f"{self.name} at t = {time:.9g} s: {error}") from error
        if self.model.log:
            self._forward_log()

    def read(self) -> None:
        self.model.values.take(self._outputs, out=self._output_buffer, mode="clip")

    def close(self) -> None:
        self._forward_log()

    def _forward_log(self) -> None:
        for message in self.model.log:
            log.warning("%s: %s", self.name, message)
        self.model.log.clear()
