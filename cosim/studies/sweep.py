"""Many independent cases over the cores of this machine or a cluster, started again where they stopped.

A case is a function of a module, by reference, and its arguments; its result is what JSON can hold, so it is
the same number whether it comes from this process, another one, or yesterday's file. Results are kept in a
folder, one file a case, under a digest of function, arguments and all code and data they stand on.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import itertools
import json
import logging
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import driveline
from cosim.files import write_text
from cosim.workers import cores, pool
from driveline.quantities import InputError

log = logging.getLogger("cosim")

CACHE = "cases"  # folder beside a study's result


@dataclass(frozen=True)
class Case:
    """One call.

    Attributes:
        name: What it is called in the results; unique in a sweep.
        work: A function of a module; returns what JSON can hold.
        arguments: By name: numbers, text, lists and dataclasses of these.
    """

    name: str
    work: Callable[..., Any]
    arguments: Mapping[str, Any] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Digest of what decides the result."""
        said = json.dumps([self.work.__module__, self.work.__qualname__, _plain(self.arguments)], sort_keys=True)
        return hashlib.sha256((_code() + _source(self.work.__module__) + said).encode()).hexdigest()[:20]

    def run(self) -> str:
        """The result as JSON text."""
        return json.dumps(self.work(**self.arguments), allow_nan=False)


@dataclass(frozen=True)
class Sweep:
    """How to run cases.

    Attributes:
        folder: Where results are kept; None to keep none.
        workers: Processes; None for one a core.
        cluster: Address of a dask scheduler to run on instead, such as ``tcp://host:8786``.
    """

    folder: Path | None = None
    workers: int | None = None
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.workers < 1:
            raise InputError(f"workers is {self.workers}: at least 1 is needed")

    def run(self, cases: Sequence[Case], progress: Callable[[float], None] | None = None) -> dict[str, Any]:
        """The result of every case by its name, in the order of ``cases``, whoever ran them when.

        Args:
            progress: Called with the share that is done, 0 to 1.

        Raises:
            InputError: Two cases have one name, or there is no such cluster.
            RuntimeError: A case failed; the message names it. What was finished is kept.
        """
        if len({case.name for case in cases}) != len(cases):
            raise InputError("two cases have the same name")
        found = {case.name: text for case in cases if (text := self._kept(case)) is not None}
        if found:
            log.info("%d of %d cases were there already", len(found), len(cases))
        waiting = [case for case in cases if case.name not in found]
        said = progress or (lambda share: None)
        with self._executor(len(waiting)) as finished:
            for case, outcome in finished(waiting):
                try:
                    found[case.name] = outcome()
                except InputError as error:
                    raise InputError(f"case '{case.name}': {error}") from error
                except Exception as error:
                    raise RuntimeError(f"case '{case.name}': {type(error).__name__}: {error}") from error
                if self.folder is not None:
                    write_text(self._file(case), found[case.name] + "\n")
                said(len(found) / len(cases))
        return {case.name: json.loads(found[case.name]) for case in cases}

    def _file(self, case: Case) -> Path:
        return self.folder / f"{case.key}.json"

    def _kept(self, case: Case) -> str | None:
        """A result of an earlier run; None where there is none, or half of one."""
        if self.folder is None or not self._file(case).is_file():
            return None
        text = self._file(case).read_text(encoding="utf-8")
        try:
            json.loads(text)
        except ValueError:
            return None
        return text

    @contextlib.contextmanager
    def _executor(self, count: int) -> Iterator[Callable[[Sequence[Case]], Iterator[tuple[Case, Callable]]]]:
        """Something that runs cases and gives each with its outcome, as they end."""
        if self.cluster is not None and count:
            with _dask(self.cluster) as finished:
                yield finished
            return
        workers = min(self.workers or cores(), count)
        if workers <= 1:
            yield lambda cases: ((case, case.run) for case in cases)
            return
        _compile()  # once, before all of them want to
        several = pool(workers)
        try:
            yield functools.partial(_as_completed, several)
        finally:
            several.shutdown(wait=True, cancel_futures=True)


def _as_completed(several: ProcessPoolExecutor, cases: Sequence[Case]) -> Iterator[tuple[Case, Callable]]:
    futures: dict[Future, Case] = {several.submit(case.run): case for case in cases}
    for future in as_completed(futures):
        yield futures[future], future.result


@contextlib.contextmanager
def _dask(address: str) -> Iterator[Callable[[Sequence[Case]], Iterator[tuple[Case, Callable]]]]:
    try:
        from distributed import Client
        from distributed import as_completed as completed
    except ImportError as error:
        raise InputError("--cluster needs dask: pip install 'driveline-cosim[cluster]'") from error
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"--cluster {address}: there is no dask scheduler ({error})") from error

    def finished(cases: Sequence[Case]) -> Iterator[tuple[Case, Callable]]:
        # as many as there are threads, and the next as one ends: the scheduler would deal all of them out at once,
        # and a worker that is done early was seen to idle beside another's queue
        waiting, running, ended = iter(cases), {}, completed()

        def feed() -> None:
            for case in itertools.islice(waiting, max(sum(client.nthreads().values()) - len(running), 0)):
                future = client.submit(case.run, key=f"{case.key}-{case.name}")
                running[future] = case
                ended.add(future)

        feed()
        for future in ended:
            case = running.pop(future)
            feed()
            yield case, future.result

    with client:
        yield finished


def _compile() -> None:
    from driveline.kernels import native

    with contextlib.suppress(native.Unavailable):
        native.library()


@functools.cache
def _code() -> str:
    """Digest of the payload, its data, and the interpreter's and numpy's versions."""
    digest = hashlib.sha256(f"{sys.version_info[:2]} {np.__version__}".encode())
    root = Path(driveline.__file__).parent
    for path in sorted(root.rglob("*")):
        if path.suffix in (".py", ".toml", ".csv"):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


@functools.cache
def _source(module: str) -> str:
    """Digest of the function's module and of all it uses of this project and of its own package."""
    names = _used(module, ("cosim.", module.partition(".")[0] + "."), set())
    return hashlib.sha256(b"".join(Path(sys.modules[name].__file__).read_bytes() for name in sorted(names))).hexdigest()


def _used(module: str, packages: tuple[str, ...], seen: set[str]) -> set[str]:
    seen.add(module)
    for value in vars(sys.modules[module]).values():
        name = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", None)
        if isinstance(name, str) and name.startswith(packages) and name not in seen:
            _used(name, packages, seen)
    return seen


def _plain(value: Any) -> Any:
    """As JSON can hold it, with the type's name so that equal numbers of different things differ."""
    if dataclasses.is_dataclass(value):
        named = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"type": type(value).__qualname__, **named}
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return [_plain(entry) for entry in value.tolist()]
    return value
