"""The boundary every plant and estimator shows: variables, initialise, step, save, restore.

An FMU's shell and the master's in-process twin both hold a Model and nothing else, which is why
they give the same numbers.
"""

from __future__ import annotations

import struct

import numpy as np

from .quantities import InputError, Variable

HOST_TELLS = "DRIVELINE_HOST_TELLS"  # set in the environment: the host shows what FMUs log, so errors are told once

# [s], 48 days, before and after 0. Beyond it the doubles lie so far apart that two ways to compute one instant may
# differ by more than what clocks of the kernels take as equal (TIME_TOLERANCE), and a sensor would miss its tick.
LATEST = 2.0**22


def check_time(time: float, what: str) -> None:
    """Raise InputError for an instant that is too far from 0 to be counted."""
    if not abs(time) <= LATEST:  # also NaN
        raise InputError(f"{what} is {time:.10g} s: a time of at most {LATEST:.0f} s is needed, beyond which a number "
                         "is no longer exact enough for the ticks of sensors: count from a later zero")


class Model:
    """A block that advances in time.

    Subclasses set the class attributes, build ``self.variables`` before calling
    ``super().__init__()`` and implement ``_initialize`` and ``_step``. Everything that changes
    during a run lives in two float arrays, ``values`` and ``state``: that is what makes
    ``save``/``restore`` complete to the bit.

    Attributes:
        name: Identifier of the model, also the FMU's (``plant_fom``).
        description: One line.
        default_step: Communication step [s] for the FMU's default experiment.
        variables: All scalars of the boundary; position = index into ``values``.
        values: float64, one entry a variable (integers and booleans too).
        state: float64, complete internal state; set by ``initialize``.
        log: Messages for the host since it last emptied the list (fallbacks, warnings).
    """

    name = ""
    description = ""
    default_step = 1e-3
    variables: tuple[Variable, ...] = ()

    def __init__(self) -> None:
        self.index = {variable.name: i for i, variable in enumerate(self.variables)}
        self.values = np.array([variable.start for variable in self.variables], dtype=np.float64)
        self.state = np.zeros(0)
        self.log: list[str] = []
        self._positions = {
            causality: np.array(
                [i for i, v in enumerate(self.variables) if v.causality == causality], dtype=np.intp)
            for causality in ("parameter", "input", "output")
        }
        self._whole = np.array([v.kind != "real" for v in self.variables], dtype=bool)
        self._lower, self._upper = np.array([v.range for v in self.variables]).reshape(-1, 2).T.copy()

    def _check(self, causality: str) -> None:
        """Raise InputError for the first value of this causality that is not possible."""
        positions = self._positions[causality]
        values = self.values[positions]
        if ((values >= self._lower[positions]) & (values <= self._upper[positions])
                & np.isfinite(values) & (~self._whole[positions] | (values == np.floor(values)))).all():
            return
        for i in positions:
            self.variables[i].check(float(self.values[i]))

    def initialize(self, start_time: float = 0.0) -> None:
        """Check the parameters and inputs, assemble the model, set state and outputs.

        Raises:
            InputError: A parameter or input is missing, not finite or out of range, or it starts too late.
        """
        check_time(start_time, "the start")
        self._check("parameter")
        self._check("input")
        self._prepare()
        self._initialize(float(start_time))

    def step(self, time: float, dt: float) -> None:
        """Advance from ``time`` to ``time + dt`` [s] with the inputs held; refresh the outputs.

        Raises:
            InputError: The step is not a positive length or comes too late, or an input is not finite or out of
                range.
            ArithmeticError: The state left the finite numbers; the message names the signal.
        """
        if self.state.size == 0:
            raise InputError(f"{self.name} was not initialised: call initialize first")
        check_time(time, "the time")
        if not 0.0 < dt < float("inf"):
            raise InputError(f"the communication step is {dt:g} s: a positive length is needed")
        self._check("input")
        self._step(float(time), float(dt))

    def _prepare(self) -> None:
        """Assemble what the parameters determine; give ``state`` its size."""
        raise NotImplementedError

    def _initialize(self, start_time: float) -> None:
        """Fill ``state`` and the outputs for the start time."""
        raise NotImplementedError

    def _step(self, time: float, dt: float) -> None:
        raise NotImplementedError

    def retune(self) -> None:
        """Called when a tunable parameter was changed during a run; subclasses reassemble."""

    def save(self) -> bytes:
        """Everything that changes during a run, as bytes: the values, then the state."""
        return struct.pack("<q", self.values.size) + self.values.tobytes() + self.state.tobytes()

    def restore(self, saved: bytes) -> None:
        """Put back what ``save`` gave, to the bit, also in another process.

        Raises:
            InputError: The bytes were not saved by this model.
        """
        count = struct.unpack_from("<q", saved)[0] if len(saved) >= 8 else -1
        if count != self.values.size or (len(saved) - 8) % 8:
            raise InputError(f"these bytes are not a saved state of {self.name}")
        numbers = np.frombuffer(saved, dtype="<f8", offset=8)
        before, state = self.values.copy(), self.state
        parameters = self._positions["parameter"]
        same = np.array_equal(before[parameters], numbers[parameters])
        self.values[:] = numbers[:count]
        if numbers.size == count:
            self.state = np.zeros(0)  # saved before it was initialised
            return
        if not same or state.size == 0:
            self._check("parameter")
            self._prepare()
        if self.state.size != numbers.size - count:
            self.values[:] = before
            if state.size:
                self._prepare()
                self.state[:] = state
            raise InputError(f"these bytes are not a saved state of {self.name}")
        self.state[:] = numbers[count:]

    def __getitem__(self, name: str) -> float:
        return float(self.values[self.index[name]])

    def __setitem__(self, name: str, value: float) -> None:
        """Set a variable; a fixed parameter counts from the next ``initialize`` on.

        Raises:
            InputError: It is not possible.
        """
        variable = self.variables[self.index[name]]
        variable.check(float(value))
        self.values[self.index[name]] = value
