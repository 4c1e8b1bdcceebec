"""An FMI 2.0 co-simulation FMU as a participant, on FMPy's low-level slave.

Whatever does not change between steps (value references, buffers, function pointers) is made once;
a step costs one fmi2SetReal, one fmi2DoStep and one fmi2GetReal.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import hashlib
import logging
import os
import re
import shutil
import sys
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    addLoggerProxy,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    fmi2Fatal,
    fmi2OK,
    fmi2Pending,
    fmi2Warning,
)

import driveline
from cosim import units
from cosim.master.participants import SimulationError
from driveline.model import HOST_TELLS
from driveline.quantities import WHOLE, InputError, Variable

log = logging.getLogger("cosim")

_KINDS = {"Real": "real", "Integer": "integer", "Enumeration": "integer", "Boolean": "boolean",
          "String": "string"}
_LEVELS = {fmi2OK: logging.DEBUG, fmi2Warning: logging.WARNING, fmi2Pending: logging.INFO}  # of what an FMU logs
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")  # what units are defined by
_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
# What PythonFMU puts before the words of an exception: the names of its own functions.
_PREAMBLE = re.compile(r"Fatal py exception encountered: .*\n")

_extracted: dict[str, Path] = {}  # content -> folder, for the life of the process


def _remove(folder: str, owner: int) -> None:
    if os.getpid() == owner:  # not in a copy of it
        shutil.rmtree(folder, ignore_errors=True)


def extracted(path: Path) -> tuple[Path, str]:
    """The folder an FMU is extracted to, once per content and process, and its SHA-256.

    Extracting again for every run would cost most of the start-up, and extracting to a folder that
    goes away would break whatever an FMU imports or loads later.
    """
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if digest not in _extracted:
        folder = tempfile.mkdtemp(prefix="driveline-fmu-")
        # no TemporaryDirectory: a copy of this process (multiprocessing's fork) forgets what is to be done at its end,
        # from Python 3.13 on, and with that object the folder would go that this process still has in use
        atexit.register(_remove, folder, os.getpid())
        fmpy.extract(str(path), folder)
        _extracted[digest] = Path(folder)
        if changed := _built_from_other_source(_extracted[digest]):
            log.warning("%s was built from another source than this (%s is not the same): run `driveline build`", path,
                        changed)
    return _extracted[digest], digest


def _built_from_other_source(folder: Path) -> str | None:
    """A module of the payload that is another one here than in this FMU; None also for somebody else's FMU.

    What is only there, or only here, is imported by one that differs.
    """
    here = Path(driveline.__file__).parent
    for shipped in (folder / "resources").glob("driveline_*"):
        for module in sorted(shipped.rglob("*.py")):
            source = here / module.relative_to(shipped)
            if source.is_file() and source.read_bytes() != module.read_bytes():
                return f"driveline/{module.relative_to(shipped).as_posix()}"
    return None


def _is_pythonfmu(description: Any) -> bool:
    return "PythonFMU" in (description.generationTool or "")


def _pythonfmu_finds(folder: Path) -> bool:
    """Whether PythonFMU 0.7, which of the escapes in a URI knows that of the blank alone, gets its path.

    On Linux the library before it in FMUs of this project undoes the others.
    """
    undone = sys.platform == "linux" and (folder / "binaries" / "linux64" / "libpythonfmu-export.so").is_file()
    return "%20" not in str(folder) if undone else "%" not in folder.absolute().as_uri().replace("%20", " ")


class FmuParticipant:
    """One instance of an FMU.

    Attributes:
        folder: Where it is extracted: the same for the same content.
        only_once: Whether it says that a process can have but one instance of it.

    Args:
        name: Its name in the run.
        path: The ``.fmu`` file.

    Raises:
        InputError: No such file, not an FMI 2.0 co-simulation FMU, or none for this platform.
    """

    def __init__(self, name: str, path: str | Path) -> None:
        self.name, self.path = name, Path(path)
        self.folder, self._digest = self._extract()
        self.description = self._read_description()
        self.variable_step = bool(self.description.coSimulation.canHandleVariableCommunicationStepSize)
        self.only_once = bool(self.description.coSimulation.canBeInstantiatedOnlyOncePerProcess)
        self._references = {v.name: v.valueReference for v in self.description.modelVariables}
        try:
            self.variables, self.dependencies_declared = self._read_variables()
        except InputError:  # which is a ValueError too
            raise
        except ValueError as error:
            raise InputError(f"{self.name}: {self.path} is not an FMU: {error}, where a variable's start, min, max, "
                             "nominal or item is") from error
        self._slave: FMU2Slave | None = None
        self._fatal = False
        self._running = False  # initialized, and nothing has failed
        self._said: list[str] = []  # what it logged as an error, as yet untold: an exception may follow, which tells it

    @property
    def model_name(self) -> str:
        """The model's identifier (``plant_fom``): the key of its twin."""
        return str(self.description.coSimulation.modelIdentifier)

    def describe(self) -> dict[str, Any]:
        description = self.description
        return {"fmu": self.path.name, "guid": description.guid, "sha256": self._digest,
                "model": description.modelName, "version": description.version,
                "generation_tool": description.generationTool}

    def _extract(self) -> tuple[Path, str]:
        if not self.path.is_file():
            raise InputError(f"{self.name}: there is no FMU {self.path}")
        try:
            return extracted(self.path)
        except OSError:
            raise  # the disk, not the archive
        except Exception as error:  # no zip, a path in it that cannot be, encrypted, damaged: each of another kind
            raise InputError(f"{self.name}: {self.path} is not an FMU, or a damaged one: {error}") from error

    def _read_description(self) -> Any:
        try:
            description = fmpy.read_model_description(str(self.folder), validate=False)
        except Exception as error:  # FMPy raises plain exceptions for whatever it does not understand
            raise InputError(f"{self.name}: {self.path} is not an FMU: {error}") from error
        if description.fmiVersion != "2.0" or description.coSimulation is None:
            kind = "co-simulation" if description.coSimulation is not None else "model exchange only"
            raise InputError(f"{self.name}: {self.path} is FMI {description.fmiVersion}, {kind}: "
                             "an FMI 2.0 co-simulation FMU is needed")
        platforms = fmpy.supported_platforms(str(self.folder))
        if fmpy.platform not in platforms:
            built = ', '.join(platforms) or 'nothing'
            raise InputError(f"{self.name}: {self.path} has binaries for {built}: "
                             f"{fmpy.platform} is needed")
        if _is_pythonfmu(description) and (lacking := self._lacking()):
            raise InputError(f"{self.name}: {self.path} is not whole: {lacking}, without which PythonFMU ends the "
                             "process")
        return description

    def _lacking(self) -> str:
        """What of an FMU of PythonFMU is not there, in words; nothing where all is."""
        resources = self.folder / "resources"
        named = resources / "slavemodule.txt"
        if not named.is_file():
            return "it has no resources/slavemodule.txt"
        first, *_ = named.read_text(encoding="utf-8", errors="replace").splitlines() or [""]
        top = first.strip().partition(".")[0]
        there = bool(top) and any(path.name.partition(".")[0] == top for path in resources.iterdir())
        return "" if there else "the module that resources/slavemodule.txt names is not there"

    def _read_variables(self) -> tuple[dict[str, Variable], bool]:
        description = self.description
        for unit in description.unitDefinitions:
            if (base := unit.baseUnit) is not None:
                units.define(unit.name, {symbol: power for symbol in _BASE if (power := getattr(base, symbol))},
                             base.factor, base.offset)
        inputs = tuple(v.name for v in description.modelVariables if v.causality == "input")
        declared = {unknown.variable.name: unknown.dependencies for unknown in description.outputs}
        variables = {}
        for v in description.modelVariables:
            depends_on: tuple[str, ...] = ()
            if v.causality == "output":  # FMI: where nothing is declared, on everything
                known = declared.get(v.name)
                depends_on = inputs if known is None else tuple(
                    d.name for d in known if d.causality == "input")
            kind = _KINDS[v.type]
            # only reals can declare a unit in FMI 2.0; the others count
            unit = _declared(v, "unit") or ("" if kind == "real" else "1")
            start = v.start if kind == "string" else _number(v.start)
            items = [int(item.value) for item in v.declaredType.items] if v.type == "Enumeration" else []
            variables[v.name] = Variable(
                v.name, unit=unit, meaning=v.description or "", causality=v.causality or "local",
                variability=v.variability or "continuous", kind=kind, start=start,
                minimum=_number(_declared(v, "min"), min(items, default=None)),
                maximum=_number(_declared(v, "max"), max(items, default=None)),
                nominal=_number(_declared(v, "nominal"), None), depends_on=depends_on)
        return variables, all(dependencies is not None for dependencies in declared.values())

    def open(self, start: dict[str, float | str], inputs: Sequence[str], outputs: Sequence[str],
             input_buffer: np.ndarray, output_buffer: np.ndarray) -> None:
        self._fatal = self._running = False
        self._said.clear()
        if _is_pythonfmu(self.description) and not _pythonfmu_finds(self.folder):
            raise InputError(f"{self.name}: {self.path.name} lies in {self.folder}, where PythonFMU "
                             "does not find it and ends the process: set TMPDIR to a folder whose path has "
                             "only ASCII letters, digits, blanks and . _ - ~")
        try:
            _open[self.name] = self
            self._slave = FMU2Slave(
                guid=self.description.guid, unzipDirectory=str(self.folder), instanceName=self.name,
                modelIdentifier=self.description.coSimulation.modelIdentifier)
            with _told():
                self._slave.instantiate(callbacks=_callbacks, loggingOn=True)
        except Exception as error:  # FMPy raises plain exceptions for whatever fails here
            self._slave = None
            raise SimulationError(
                f"{self.name}: {self.path.name} cannot be instantiated: {self._words() or error}") from error
        dll, component = self._slave.dll, self._slave.component
        self._do_step, self._component = dll.fmi2DoStep, component
        self._set = [_Transfer(self, dll, "Set", kind, inputs, input_buffer) for kind in _TYPES]
        self._get = [_Transfer(self, dll, "Get", kind, outputs, output_buffer) for kind in _TYPES]
        self._set = [transfer for transfer in self._set if transfer.count]
        self._get = [transfer for transfer in self._get if transfer.count]
        for name, value in start.items():
            self._set_start(name, value)

    def _set_start(self, name: str, value: float | str) -> None:
        slave, reference = self._slave, [self._references[name]]
        setter, convert = {
            "real": (slave.setReal, float), "integer": (slave.setInteger, int),
            "boolean": (slave.setBoolean, bool), "string": (slave.setString, str),
        }[self.variables[name].kind]
        try:
            setter(reference, [convert(value)])
        except FMICallException as error:
            self._fatal = error.status == fmi2Fatal
            raise InputError(
                f"{self.name}: {name} = {value!r} is refused: {self._words() or error}") from error

    def initialize(self, start_time: float, stop_time: float) -> None:
        slave = self._slave
        try:
            slave.setupExperiment(startTime=start_time, stopTime=stop_time)
            slave.enterInitializationMode()
            for transfer in self._set:
                transfer.push()
            slave.exitInitializationMode()
            self._running = True
            self.read()
        except (FMICallException, SimulationError) as error:
            raise self._refused(error) from error
        self._tell()

    def _refused(self, error: Exception) -> InputError:
        # nothing has run yet, so what it does not like is what it was given
        self._running = False
        self._fatal = self._fatal or getattr(error, "status", None) == fmi2Fatal
        return InputError(f"{self.name} does not initialize: {self._words() or error}")

    def advance(self, time: float, step: float) -> None:
        for transfer in self._set:
            transfer.push()
        status = self._do_step(self._component, time, step, 1)
        if status > fmi2Warning:
            self.fail("fmi2DoStep", status, time)
        if self._said:
            self._tell()

    def read(self) -> None:
        for transfer in self._get:
            transfer.pull()

    def check(self, variable: Variable, value: float) -> None:
        """Raise SimulationError for a value that a variable cannot have."""
        try:
            variable.check(value)
        except InputError as error:
            raise SimulationError(f"{self.name} ({self.path.name}): {error}") from error

    def fail(self, function: str, status: int, time: float | None = None) -> None:
        """Raise SimulationError for a status worse than a warning."""
        self._fatal, self._running = status == fmi2Fatal, False
        when = "" if time is None else f" at t = {time:.9g} s"
        label = _STATUS[status] if 0 <= status < len(_STATUS) else str(status)
        words = self._words()
        raise SimulationError(f"{self.name} ({self.path.name}){when}: {function} reports {label}"
                              + (f": {words}" if words else ""))

    def close(self) -> None:
        slave, self._slave = self._slave, None
        running, self._running = self._running, False
        if slave is None or self._fatal:  # after fmi2Fatal the standard forbids every further call
            return
        if running:  # nor may what was never initialized, or has failed, be terminated
            try:
                slave.terminate()
            except FMICallException as error:
                self._fatal = error.status == fmi2Fatal
                log.warning("%s: %s", self.name, self._words() or error)
        if not self._fatal:
            slave.freeInstance()
        self._tell()

    def hear(self, status: int, message: str) -> None:
        """Called with whatever the FMU logs."""
        message = _PREAMBLE.sub("", message, count=1)
        if status in _LEVELS:
            log.log(_LEVELS[status], "%s: %s", self.name, message)
        else:
            self._said.append(message)

    def _tell(self) -> None:
        """Log the errors that the FMU told of, but went on."""
        for message in self._said:
            log.error("%s: %s", self.name, message)
        self._said.clear()

    def _words(self) -> str:
        """What the FMU last said about its trouble, on one line; what it said before is logged."""
        if not self._said:
            return ""
        last = " ".join(self._said.pop().split())
        self._tell()
        return last


@contextlib.contextmanager
def _told() -> Iterator[None]:
    """FMUs of this project that are made inside are told that what they log is shown."""
    os.environ[HOST_TELLS] = "1"
    try:
        yield
    finally:
        os.environ.pop(HOST_TELLS, None)


_open: weakref.WeakValueDictionary[str, FmuParticipant] = weakref.WeakValueDictionary()


def _pass_on(_environment: int, instance: bytes, status: int, _category: bytes, message: bytes) -> None:
    """FMPy's proxy formats messages natively, but holds one logger a process: find its owner by name."""
    if (participant := _open.get((instance or b"").decode())) is not None:
        participant.hear(status, (message or b"").decode("utf-8", "replace").strip())


_callbacks = fmi2CallbackFunctions()
_callbacks.logger = fmi2CallbackLoggerTYPE(_pass_on)
_callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
_callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(fmpy.free)
addLoggerProxy(ctypes.byref(_callbacks))

_TYPES = {"real": (ctypes.c_double, "Real"), "integer": (ctypes.c_int, "Integer"),
          "boolean": (ctypes.c_int, "Boolean")}


class _Transfer:
    """All variables of one kind that cross the boundary in one direction, moved by one call.

    Reals go straight from and to the master's buffer where they lie side by side in it; integers and
    booleans pass through a buffer of their own and are sent only when they changed.
    """

    def __init__(self, owner: FmuParticipant, dll: ctypes.CDLL, direction: str, kind: str,
                 names: Sequence[str], buffer: np.ndarray) -> None:
        positions = [i for i, name in enumerate(names) if owner.variables[name].kind == kind]
        self.count = len(positions)
        if not self.count:
            return
        self._owner = owner
        self._name = f"fmi2{direction}{_TYPES[kind][1]}"
        self._function = getattr(dll, self._name)
        self._component = owner._slave.component
        self._references = (ctypes.c_uint * self.count)(*(owner._references[names[i]] for i in positions))
        self._shared = buffer[positions[0]:positions[-1] + 1]
        direct = kind == "real" and self.count == self._shared.size
        if direct:
            self._values, self._local = (ctypes.c_double * self.count).from_buffer(self._shared), None
        else:
            self._values = (_TYPES[kind][0] * self.count)()
            self._local = np.ctypeslib.as_array(self._values)
            self._shared = buffer
        self._positions = np.array(positions, dtype=np.intp)
        self._whole = [owner.variables[names[i]] for i in positions] if kind == "integer" else []
        self._sent = b""

    def push(self) -> None:
        """Buffer to FMU."""
        if self._local is not None:
            values = self._shared[self._positions]
            if (now := values.tobytes()) == self._sent:
                return
            for variable, value in zip(self._whole, values.tolist()):
                if not WHOLE[0] <= value <= WHOLE[1]:  # it would arrive as another number
                    self._owner.check(variable, value)
            self._local[:] = values
            self._sent = now
        status = self._function(self._component, self._references, self.count, self._values)
        if status > fmi2Warning:
            self._owner.fail(self._name, status)

    def pull(self) -> None:
        """FMU to buffer."""
        status = self._function(self._component, self._references, self.count, self._values)
        if status > fmi2Warning:
            self._owner.fail(self._name, status)
        if self._local is not None:
            self._shared[self._positions] = self._local


def _declared(variable: Any, attribute: str) -> str | None:
    """What the model description says of a variable, or of its type where it says nothing itself."""
    own = getattr(variable, attribute)
    return own if own is not None else getattr(variable.declaredType, attribute, None)


def _number(text: str | None, missing: float | None = 0.0) -> float | None:
    """A number as the model description writes it."""
    if text is None:
        return missing
    return float({"true": 1, "false": 0}.get(str(text).lower(), text))
