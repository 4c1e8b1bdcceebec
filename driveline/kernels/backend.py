"""Marks for the functions that run as plain Python and as machine code, with the same bits.

A *kernel* is an ordinary function that may be compiled. An *entry point* is a kernel that the
compiled library exports: annotated arguments, arrays before scalars, a status as its result.

What a kernel may contain, so that both ways give the same numbers:

- ``for``, ``while``, ``if``, float and int arithmetic, ``math``, ``abs``, ``min``, ``max``;
  calls of other kernels by their global name; module-level int and float constants; tuples as
  results. One variable keeps one type: start a float with ``0.0``, not ``0``.
- Arrays are one-dimensional and only read and written an item at a time, with an offset passed
  beside them (``state[at + 3]``). The plain run sees them as memory views, three times as fast as
  numpy there; compiled code does not know their length. So neither has ``len``, ``.size``, slices,
  iteration or arithmetic: counts are passed in.
- No allocation, no exceptions, no strings, no containers. The build refuses what needs Python.
- Squares are written ``x * x``: ``**`` and ``pow`` round differently in the two, and are refused;
  so are functions whose result Python computes in its own way (``math.hypot``, ``math.gamma``).
- Division by zero and the domain errors of ``math`` (a negative root, an overflowing ``exp``)
  raise in plain Python and give infinity or NaN compiled: keep away from both.
- I8 have 64 bits compiled and no end in Python: keep every intermediate inside
  +-2**63. A negative index is not allowed; an index too large is not noticed when compiled.
"""

from __future__ import annotations

import dis
import importlib
import inspect
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

# Annotations of an entry point's arrays; both are one-dimensional.
F8 = NDArray[np.float64]
I8 = NDArray[np.int64]

# Modules that hold entry points, or packages that import those that do; a leading dot counts from the
# package this file is shipped in.
KERNEL_MODULES: tuple[str, ...] = (".kernels.network", ".estimators")

ENTRY_POINTS: dict[str, Callable[..., int]] = {}

Function = TypeVar("Function", bound=Callable)


def kernel(function: Function) -> Function:
    """Mark a function that compiled code may call; it stays the plain Python function it is."""
    function.is_kernel = True
    return function


def entry_point(function: Function) -> Function:
    """Mark a kernel that the library exports under its own name.

    The function takes arrays (``F8``, ``I8``), then scalars (``float``, ``int``), and
    returns an int status whose meaning is its own.

    Raises:
        TypeError: An argument is not annotated that way, or the name is taken.
    """
    kinds, scalars = signature(function)
    if any(kind in (F8, I8) for kind in scalars):
        raise TypeError(f"{function.__name__}: the array arguments must come before the scalars")
    taken = ENTRY_POINTS.get(function.__name__)
    if taken is not None and taken.__module__ != function.__module__:
        raise TypeError(f"two entry points are called {function.__name__}")
    ENTRY_POINTS[function.__name__] = function
    return kernel(function)


def signature(function: Callable) -> tuple[list, list]:
    """The types of an entry point's leading arrays, and of the scalars that follow."""
    kinds = inspect.get_annotations(function, eval_str=True)
    result = kinds.pop("return", None)
    names = list(inspect.signature(function).parameters)
    for name in names:
        if kinds.get(name) not in (F8, I8, float, int):
            raise TypeError(
                f"{function.__name__}: argument {name} needs the annotation F8, I8, float or int")
    if result is not int:
        raise TypeError(f"{function.__name__}: an entry point returns int, its status")
    ordered = [kinds[name] for name in names]
    count = next((i for i, kind in enumerate(ordered) if kind in (float, int)), len(ordered))
    return ordered[:count], ordered[count:]


def import_entry_points() -> dict[str, Callable[..., int]]:
    """Import every kernel module, and give the entry points they declare, by name."""
    package = __package__.rpartition(".")[0]
    inside = tuple(f"{importlib.import_module(name, package).__name__}." for name in KERNEL_MODULES)
    return {name: f for name, f in sorted(ENTRY_POINTS.items()) if f"{f.__module__}.".startswith(inside)}


def reached_kernels(functions: list[Callable]) -> list[Callable]:
    """The given kernels and all kernels they call, in a fixed order.

    Raises:
        TypeError: A kernel calls a Python function that is not marked as one, or breaks a rule whose
            breach would compile, to other numbers.
    """
    found: list[Callable] = []
    waiting = list(functions)
    while waiting:
        function = waiting.pop(0)
        if function in found:
            continue
        found.append(function)
        broken = _broken_rule(function)
        if broken:
            raise TypeError(f"kernel {function.__name__} {broken}")
        for name in function.__code__.co_names:
            used = function.__globals__.get(name)
            if isinstance(used, np.ndarray):
                raise TypeError(f"kernel {function.__name__} uses the module-level array {name}: pass it in")
            if inspect.isfunction(used):
                if not getattr(used, "is_kernel", False):
                    raise TypeError(f"kernel {function.__name__} calls {name}, which is not a @kernel")
                waiting.append(used)
    return found


def _broken_rule(function: Callable) -> str:
    """What in a kernel would give other numbers compiled, and what to write instead; "" if nothing."""
    before = None
    for step in dis.get_instructions(function):
        if step.argrepr in ("**", "**=") or step.argval == "pow":
            return "raises to a power: multiply, or use exp and log"
        if step.argval == "len":
            return "asks for a length: pass the count in"
        if "SLICE" in step.opname or isinstance(step.argval, slice):
            return "slices an array: pass an offset beside it"
        if "SUBSCR" in step.opname or step.argrepr == "[]":
            if "CONST" in before.opname and isinstance(before.argval, int) and before.argval < 0:
                return "counts an index from the end: pass the count in"
        before = step
    return ""


def constants_of(function: Callable) -> dict[str, int | float | tuple]:
    """The module-level numbers a kernel refers to: the compiler freezes them into the code."""
    used = {name: function.__globals__.get(name) for name in sorted(set(function.__code__.co_names))}
    return {name: value for name, value in used.items() if isinstance(value, int | float | tuple)}
