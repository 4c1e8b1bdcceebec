"""Loading the compiled kernels, and building them where the tools for that are installed.

An FMU ships the library in the package's folder ``lib`` and never compiles. In a development
environment the library is built once per content of the kernels and kept in the user's cache.
Where neither is possible the kernels run as plain Python: the same numbers, much slower.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import json
import logging
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from . import backend as declared
from .backend import F8, I8

log = logging.getLogger(__name__)

PACKAGE = Path(__file__).resolve().parents[1]
SHIPPED = PACKAGE / "lib"
TARGETS = {
    "linux-x86_64": {
        "triple": "x86_64-unknown-linux-gnu", "zig": "x86_64-linux-gnu.2.17",
        "flags": ["-fPIC"], "file": "kernels-linux-x86_64.so"},
    "windows-x86_64": {
        "triple": "x86_64-pc-windows-gnu", "zig": "x86_64-windows-gnu",
        "flags": ["-nostdlib", "-L.", "-lucrtbase"], "file": "kernels-windows-x86_64.dll"},
}
SEAL = b"sha256:"  # this and its digest end a library; system loaders ignore what follows the image
C_TYPES = {float: ctypes.c_double, int: ctypes.c_int64}
DTYPES = {F8: np.dtype(np.float64), I8: np.dtype(np.int64)}


class Unavailable(Exception):
    """There is no compiled library for this machine; the message says why."""


def this_machine() -> str:
    """The name this machine has in TARGETS, or would have."""
    machine = platform.machine().lower()
    return f"{platform.system().lower()}-{'x86_64' if machine == 'amd64' else machine}"


def build(targets: Iterable[str], out: Path | str) -> list[Path]:
    """Compile all entry points into one shared library a target; needs numba and ziglang.

    Args:
        targets: Keys of ``TARGETS``.
        out: Folder for the libraries; made where it is missing. Files there appear complete.

    Returns:
        The library files, in the order of ``targets``. The same kernels give the same bytes.

    Raises:
        Unavailable: The tools are missing, or the kernels cannot be compiled.
    """
    from . import compiler

    targets = {name: TARGETS[name] for name in targets}
    _need_tools()
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    log.info("compiling the kernels for %s", ", ".join(targets))
    environment = {k: v for k, v in compiling().items() if not k.startswith("NUMBA_")} | compiler.ENVIRONMENT
    root = PACKAGE.parent
    with tempfile.TemporaryDirectory(dir=out, prefix=".build-") as scratch:
        request = {"targets": targets, "out": scratch, "modules": declared.KERNEL_MODULES,
                   "path": [str(root), *(os.path.abspath(entry) for entry in sys.path)]}
        done = subprocess.run(
            [sys.executable, "-m", compiler.__name__], cwd=root, env=environment,
            input=json.dumps(request), capture_output=True, text=True)
        if done.returncode:
            raise Unavailable(f"the kernels do not compile: {done.stderr.strip()}")
        libraries = []
        for target in targets.values():
            made = Path(scratch, target["file"])
            content = made.read_bytes()
            made.write_bytes(content + SEAL + hashlib.sha256(content).digest())
            libraries.append(out / target["file"])
            try:
                os.replace(made, libraries[-1])
            except PermissionError:  # Windows, where another process was first and has it loaded
                if not _is_whole(libraries[-1]):
                    raise
    return libraries


def libraries() -> dict[str, Path]:
    """The library for every target: from the cache, what is not there built into it.

    All of them together take hardly longer than one; FMUs carry them all.

    Raises:
        Unavailable: They cannot be built.
    """
    _need_tools()
    folder = cache_folder() / "kernels" / _fingerprint()
    paths = {name: folder / target["file"] for name, target in TARGETS.items()}
    missing = [name for name, path in paths.items() if not _is_whole(path)]
    if missing:
        build(missing, folder)
    return paths


def library() -> Path:
    """The library for this machine: from the cache, or built into it.

    Raises:
        Unavailable: This machine is not among TARGETS, or the library cannot be built.
    """
    machine = this_machine()
    if machine not in TARGETS:
        raise Unavailable(f"the kernels are not compiled for {machine}, only for {', '.join(TARGETS)}")
    return libraries()[machine]


def compiling() -> dict[str, str]:
    """The environment in which ziglang compiles, with what it keeps in the cache."""
    return {"ZIG_GLOBAL_CACHE_DIR": str(cache_folder() / "zig"), **os.environ}


def _need_tools() -> None:
    for tool in ("numba", "ziglang"):
        if importlib.util.find_spec(tool) is None:
            raise Unavailable(f"{tool} is not installed")


def cache_folder() -> Path:
    """Where what was compiled is kept: ``DRIVELINE_CACHE``, or the user's cache."""
    if "DRIVELINE_CACHE" in os.environ:
        return Path(os.environ["DRIVELINE_CACHE"])
    import platformdirs

    return Path(platformdirs.user_cache_dir("driveline-cosim", appauthor=False))


def _fingerprint() -> str:
    """Digest of all that decides the library's content: code, constants, compiler, recipe."""
    from importlib.metadata import version  # slow to import, and a payload never asks

    digest = hashlib.sha256()
    for tool in ("numba", "llvmlite", "ziglang"):
        digest.update(f"{tool} {version(tool)} ".encode())
    digest.update(Path(__file__).with_name("compiler.py").read_bytes())
    entries = declared.import_entry_points()
    for name, function in entries.items():
        digest.update(f"{name} {declared.signature(function)}".encode())
    for function in declared.reached_kernels(list(entries.values())):
        code = function.__code__
        digest.update(code.co_code)
        digest.update(repr((code.co_names, code.co_varnames, code.co_consts, function.__defaults__,
                            declared.constants_of(function))).encode())
    return digest.hexdigest()[:16]


def _is_whole(path: Path) -> bool:
    """Whether the file is there and ends with the digest of the rest; loading half a file can crash."""
    if not path.is_file():
        return False
    content = path.read_bytes()
    end = len(content) - len(SEAL) - 32
    return content[end:] == SEAL + hashlib.sha256(content[:max(end, 0)]).digest()


class Entry:
    """One entry point, ready to be bound to its arrays.

    Attributes:
        name: Its name.
        backend: ``native`` or ``python``.
    """

    def __init__(self, name: str, compiled: ctypes.CDLL | None) -> None:
        self.name = name
        self.backend = "python" if compiled is None else "native"
        self._function = declared.ENTRY_POINTS[name]
        self._arrays, self._scalars = declared.signature(self._function)
        if compiled is not None:
            self._function = getattr(compiled, name)
            self._function.restype = ctypes.c_int64
            self._function.argtypes = [ctypes.c_void_p, *(C_TYPES[kind] for kind in self._scalars)]

    def bind(self, *arrays: np.ndarray) -> Callable[..., int]:
        """Fix the arrays; what comes back takes the scalars only and works on the arrays in place.

        Raises:
            TypeError: An array has another type than declared, is not one-dimensional and
                contiguous, or cannot be written.
        """
        if len(arrays) != len(self._arrays):
            raise TypeError(f"{self.name} works on {len(self._arrays)} arrays, {len(arrays)} were given")
        for i, (array, kind) in enumerate(zip(arrays, self._arrays, strict=True)):
            if not (isinstance(array, np.ndarray) and array.dtype == DTYPES[kind] and array.ndim == 1
                    and array.flags.c_contiguous and array.flags.aligned and array.flags.writeable):
                raise TypeError(f"{self.name}: array {i} must be one-dimensional, contiguous, writeable "
                                f"{DTYPES[kind]}")
        if self.backend == "python":
            return functools.partial(self._function, *(memoryview(array) for array in arrays))
        table = np.array([array.ctypes.data for array in arrays], dtype=np.uintp)
        bound = functools.partial(self._function, table.ctypes.data)
        bound.keep_alive = (table, arrays)
        return bound


@functools.cache
def _loaded() -> tuple[ctypes.CDLL | None, str]:
    """The compiled library of this process, and what to say about it."""
    names = declared.import_entry_points()
    try:
        path = _shipped() if SHIPPED.is_dir() else library()
        if not _is_whole(path):
            raise Unavailable(f"{path} is damaged")
        compiled = ctypes.CDLL(str(path))
        for name in names:
            if not hasattr(compiled, name):
                raise Unavailable(f"{path} has no {name}: it was built from other sources")
    except (Unavailable, OSError) as reason:
        told = f"the kernels run as plain Python, which is slow: {reason}"
        log.warning("%s", told)
        return None, told
    return compiled, f"the kernels run compiled, from {path}"


def _shipped() -> Path:
    """The library that was shipped for this machine; a payload never compiles."""
    target = TARGETS.get(this_machine())
    if target is None or not (SHIPPED / target["file"]).is_file():
        raise Unavailable(f"no compiled kernels for {this_machine()} are shipped")
    return SHIPPED / target["file"]


def describe(backend: str = "auto") -> str:
    """One sentence on what the kernels run as, and why; for the host's log."""
    return "the kernels run as plain Python, as asked" if backend == "python" else _loaded()[1]


def load(name: str, backend: str = "auto") -> Entry:
    """An entry point by name.

    Args:
        name: The entry point's name.
        backend: ``native`` (compiled), ``python``, or ``auto``: compiled where that is possible.

    Raises:
        KeyError: There is no such entry point.
        Unavailable: ``native`` was asked for and is not possible; the message says why.
    """
    if name not in declared.import_entry_points():
        raise KeyError(f"no entry point is called {name}; there are {', '.join(declared.ENTRY_POINTS)}")
    if backend not in ("auto", "native", "python"):
        raise ValueError(f"backend {backend!r} is not known: it is auto, native or python")
    if backend == "python":
        return Entry(name, None)
    compiled, told = _loaded()
    if compiled is None and backend == "native":
        raise Unavailable(told)
    return Entry(name, compiled)
