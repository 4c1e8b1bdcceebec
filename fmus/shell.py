"""The FMI 2.0 slave around a model: what PythonFMU's native layer calls, and nothing else.

Value reference = position of the variable in ``model.variables`` = index into ``model.values``,
so that getting and setting touch one array and look nothing up.

PythonFMU 0.7's native layer shapes this file in three ways. It answers every exception with
fmi2Fatal and gives back references that it still uses (``_fail`` lends them again, so that the host
may free or reset the instance afterwards). It drops every message while debug logging is off, so
errors also go to standard error, unless the host says that it shows them. And it keeps the resources
folder in ``sys.path`` for ever.
"""

from __future__ import annotations

import ctypes
import json
import os
import struct
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from pythonfmu.enums import Fmi2Status
from pythonfmu.fmi2slave import Fmi2Slave

from driveline.model import HOST_TELLS
from driveline.quantities import InputError, Variable

MODEL_FILE = "model.json"
_BEFORE, _RUNNING, _INITIALIZING = range(3)  # phases, as snapshots have them
_HEAD = struct.Struct("<Bd")  # of a snapshot


class SlaveError(Exception):
    """What the host is told; the native layer shows the ``repr``, which is therefore the message."""

    def __repr__(self) -> str:
        return str(self)


class ModelSlave(Fmi2Slave):
    """Holds one model and passes the FMI calls on to it.

    A subclass names the models it can hold, all of ``driveline.models``: FMUs of one build share the modules of the
    first that was loaded, whose folder may be gone when another one is. Which model, and its start values, stand in the
    FMU's ``resources/model.json``: ``{"model": "plant_fom", "start_values": {"vehicle.mass": 2500.0}}``.

    Attributes:
        models: Model classes by name; each is constructed with a dict of start values.
        model: The model; ``model.values[value_reference]`` is the value of a variable.
    """

    models: Mapping[str, Any] = {}

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        resources = kwargs["resources"]
        # everything is imported by now; what stays in the path could shadow modules of the host
        while resources in sys.path:
            sys.path.remove(resources)
        described = json.loads(Path(resources, MODEL_FILE).read_text(encoding="utf-8"))
        self.model = self.models[described["model"]](described["start_values"])
        self.start_time = 0.0
        self._host_tells = HOST_TELLS in os.environ
        self._outputs = self._settable("output")
        before = self._settable("parameter", "input")
        self._free_by_phase = {_BEFORE: before, _INITIALIZING: before, _RUNNING: self._settable("input")}
        self._enter(_BEFORE)

    def _settable(self, *causalities: str) -> dict[str, frozenset[int]]:
        """Value references of these causalities, by kind."""
        return {
            kind: frozenset(
                i for i, v in enumerate(self.model.variables)
                if v.kind == kind and v.causality in causalities)
            for kind in ("real", "integer", "boolean")
        }

    def _enter(self, phase: int) -> None:
        """Note the phase, and which variables may be set in it without further ado."""
        self._phase = phase
        self._stale = phase == _INITIALIZING  # whether outputs that are asked for are to be computed first
        self._free = self._free_by_phase[phase]

    def _fail(self, error: Exception) -> NoReturn:
        """Tell the host, which logs the exception, and standard error where it may log nothing."""
        # what the model says is meant to be read; anything else is a fault of its own, whose kind matters
        meant = isinstance(error, ValueError) or type(error) is ArithmeticError
        message = str(error) if meant else repr(error)
        if not self._host_tells:
            print(f"{self.instance_name}: {message}", file=sys.stderr)
        # The native layer now releases class, instance and log queue, yet keeps and uses the pointers.
        for lent in (type(self), self, self.log_queue):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(lent))
        raise SlaveError(message) from error

    def _forward_log(self) -> None:
        """Pass on the model's messages; never from the constructor.

        The native layer empties the queue after every call but the instantiation. What waits in it
        when the instance is freed goes to a logger that is gone by then: the process would die.
        """
        for message in self.model.log:
            self.log(message, Fmi2Status.warning)
        self.model.log.clear()

    # ---- life ----

    def setup_experiment(self, start_time: float, *_: Any) -> None:
        self.start_time = start_time

    def enter_initialization_mode(self) -> None:
        self._enter(_INITIALIZING)
        self._forward_log()

    def _compute(self, kind: str, vrs: list[int]) -> None:
        """Outputs that are asked for in initialization mode, as they follow from what was set so far.

        Where that cannot be, they stay as they are: more may be set, and at its end the host is told.
        """
        if self._outputs[kind].isdisjoint(vrs):
            return
        try:
            self.model.initialize(self.start_time)
        except Exception:
            return
        self._stale = False

    def exit_initialization_mode(self) -> None:
        try:
            self.model.initialize(self.start_time)
        except Exception as error:
            self._fail(error)
        self._enter(_RUNNING)
        self._forward_log()

    def do_step(self, current_time: float, step_size: float) -> bool:
        try:
            self.model.step(current_time, step_size)
        except Exception as error:
            self._fail(error)
        if self.model.log:
            self._forward_log()
        return True

    # ---- values ----

    def get_real(self, vrs: list[int]) -> list[float]:
        if self._stale:
            self._compute("real", vrs)
        try:
            return [*map(self.model.values.item, vrs)]
        except Exception as error:
            self._fail(error)

    def get_integer(self, vrs: list[int]) -> list[int]:
        if self._stale:
            self._compute("integer", vrs)
        try:
            return [int(value) for value in map(self.model.values.item, vrs)]
        except Exception as error:
            self._fail(error)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        if self._stale:
            self._compute("boolean", vrs)
        try:
            return [value != 0.0 for value in map(self.model.values.item, vrs)]
        except Exception as error:
            self._fail(error)

    def get_string(self, vrs: list[int]) -> list[str]:
        """None: no model has strings, and PythonFMU's own would raise where nobody lends what it gives away."""
        try:
            for vr in vrs:
                self._variable(vr, "string")
        except Exception as error:
            self._fail(error)
        return []

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self.get_string(vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        self._set("real", vrs, values)

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self._set("integer", vrs, values)

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self._set("boolean", vrs, values)

    def _set(self, kind: str, vrs: list[int], values: list) -> None:
        """Write values; impossible ones are refused where the model checks: before it uses them."""
        if not self._free[kind].issuperset(vrs):
            self._set_with_care(kind, vrs, values)
            return
        self._stale = self._phase == _INITIALIZING
        held = self.model.values
        for vr, value in zip(vrs, values, strict=True):
            held[vr] = value

    def _variable(self, vr: int, kind: str) -> Variable:
        """The variable of a value reference, which is to be of this kind."""
        if not 0 <= vr < len(self.model.variables):
            raise ValueError(f"there is no variable with value reference {vr}")
        variable = self.model.variables[vr]
        if variable.kind != kind:
            raise ValueError(f"{variable.name} is {variable.kind}, not {kind}")
        return variable

    def _set_with_care(self, kind: str, vrs: list[int], values: list) -> None:
        """Refuse what may not be set now, change tunable parameters in a run."""
        try:
            for vr, value in zip(vrs, values, strict=True):
                variable = self._variable(vr, kind)
                if variable.causality == "output":
                    raise ValueError(f"{variable.name} is an output: it cannot be set")
                if variable.causality == "parameter" and self._phase == _RUNNING:
                    if variable.variability != "tunable":
                        raise ValueError(f"{variable.name} is a fixed parameter: it can only be set before "
                                         "the end of the initialization")
                    variable.check(float(value))
            for vr, value in zip(vrs, values, strict=True):
                self.model.values[vr] = value
            if self._phase == _RUNNING:
                self.model.retune()
        except Exception as error:
            self._fail(error)

    # ---- snapshots: phase and start time, which the end of the initialization needs, then the model to the bit ----

    def _get_fmu_state(self) -> bytes:
        try:
            return _HEAD.pack(self._phase, self.start_time) + self.model.save()
        except Exception as error:
            self._fail(error)

    def _set_fmu_state(self, state: bytes) -> None:
        try:
            self.model.restore(state[_HEAD.size:])
            phase, start_time = _HEAD.unpack_from(state)
            if phase not in self._free_by_phase:
                raise InputError(f"these bytes are not a saved state of {self.model.name}")
        except Exception as error:
            self._fail(error)
        self.start_time = start_time
        self._enter(phase)

    @staticmethod
    def _fmu_state_to_bytes(state: bytes) -> bytes:
        return state

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> bytes:
        return state
