"""Compiled and plain kernels give the same bits, wherever the library comes from, or say what is wrong."""

import gc
import importlib
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from driveline.kernels import backend, native

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

pytestmark = pytest.mark.skipif(native.this_machine() not in native.TARGETS,
                                reason=f"kernels are not compiled for {native.this_machine()}")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache of its own, so that the library is really built here."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def toy(cache: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The toy's entry points in place of the package's."""
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.setattr(backend, "KERNEL_MODULES", ("toy_kernels",))
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(native.cache_folder() / "zig"))  # the C library, built once
    monkeypatch.setenv("DRIVELINE_CACHE", str(cache))
    native._loaded.cache_clear()
    yield
    native._loaded.cache_clear()


def operands() -> tuple[np.ndarray, np.ndarray]:
    """Numbers of all sizes and signs, near and far from each other; none of them zero."""
    random = np.random.default_rng(1)
    sizes = 10.0 ** random.uniform(-8.0, 2.0, 4000)
    x = np.concatenate([random.normal(0.0, 1.0, 4000), random.normal(0.0, 30.0, 4000), -sizes, sizes])
    return x, random.permutation(x)


def operations(backend_name: str) -> np.ndarray:
    """All results of the toy's operations."""
    x, y = operands()
    result = np.zeros(x.size * importlib.import_module("toy_kernels").RESULTS)
    assert native.load("toy_operations", backend_name).bind(x, y, result)(x.size) == x.size
    return result.reshape(x.size, -1)


def run_toy(entry: native.Entry) -> tuple[int, bytes, bytes]:
    """Status, values and counts after a run of the toy."""
    values, counts = np.linspace(-3.0, 3.0, 50), np.zeros(50, dtype=np.int64)
    status = entry.bind(values, counts)(0.01, 200, 50)
    return status, values.tobytes(), counts.tobytes()


def in_another_process(code: str, *paths: Path) -> str:
    """What a fresh interpreter, that finds modules in ``paths`` first, prints for ``code``."""
    start = f"import sys; sys.path[:0] = {[str(path) for path in paths]}\n"
    done = subprocess.run([sys.executable, "-P", "-c", start + textwrap.dedent(code)],
                          capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_every_operation_gives_the_same_bits_compiled_and_plain():
    compiled, plain = operations("native"), operations("python")
    different = np.flatnonzero((compiled.view(np.int64) != plain.view(np.int64)).any(axis=0))
    assert different.size == 0


def test_a_run_gives_the_same_bits_compiled_and_plain():
    compiled, plain = native.load("toy_run", "native"), native.load("toy_run", "python")
    assert (compiled.backend, plain.backend) == ("native", "python")
    assert run_toy(compiled) == run_toy(plain)


@pytest.mark.parametrize("backend_name", ["native", "python"])
def test_the_status_comes_back(backend_name: str):
    values, counts = np.array([9.99]), np.zeros(1, dtype=np.int64)
    run = native.load("toy_run", backend_name).bind(values, counts)
    assert run(0.0, 1, 1) == 0
    assert run(-1.0, 1, 1) == 1
    assert native.load("toy_last", backend_name).bind()(-4.0) == -40


@pytest.mark.parametrize("backend_name", ["native", "python"])
def test_what_is_bound_stays_alive_and_is_changed_in_place(backend_name: str):
    holder = np.zeros((3, 1000))
    values, counts = holder[1], np.zeros(1000, dtype=np.int64)
    run = native.load("toy_run", backend_name).bind(values, counts)
    del values, counts
    gc.collect()
    run(0.1, 1, 1000)
    assert (holder[1, 500:] == 0.1).all()
    assert (holder[[0, 2]] == 0.0).all()


@pytest.mark.parametrize(
    "values",
    [np.zeros(4, dtype=np.float32), np.zeros((2, 2)), np.zeros(8)[::2], np.zeros(4, dtype=np.int64),
     np.frombuffer(bytes(32)), [0.0] * 4],
    ids=["float32", "2d", "strided", "int64", "readonly", "list"])
@pytest.mark.parametrize("backend_name", ["native", "python"])
def test_arrays_that_do_not_fit_are_refused(backend_name: str, values):
    with pytest.raises(TypeError, match="toy_run: array 0 must be .* float64"):
        native.load("toy_run", backend_name).bind(values, np.zeros(4, dtype=np.int64))
    with pytest.raises(TypeError, match="works on 2 arrays, 1 were given"):
        native.load("toy_run", backend_name).bind(np.zeros(4))


def test_an_unknown_entry_point_is_named():
    with pytest.raises(KeyError, match="toy_walk.*toy_run"):
        native.load("toy_walk")


def test_a_c_program_without_python_gets_the_same_bits(tmp_path: Path):
    if sys.platform != "linux":
        pytest.skip("the C program loads the library by dlopen")
    (tmp_path / "host.c").write_text(textwrap.dedent("""
        #include <dlfcn.h>
        #include <stdint.h>
        #include <stdio.h>
        int main(int count, char **names) {
          void *library = dlopen(names[1], RTLD_NOW);
          if (!library) { puts(dlerror()); return 1; }
          int64_t (*run)(void *const *, double, int64_t, int64_t) = dlsym(library, "toy_run");
          double values[50]; int64_t counts[50] = {0};
          for (int i = 0; i < 50; i++) values[i] = 0.125 * i - 3.0;
          void *arrays[] = {values, counts};
          int64_t status = run(arrays, 0.01, 200, 50);
          printf("%lld\\n", (long long)status);
          for (int i = 0; i < 50; i++) printf("%a %lld\\n", values[i], (long long)counts[i]);
          return 0; }
    """))
    target = native.TARGETS["linux-x86_64"]["zig"]
    subprocess.run([sys.executable, "-m", "ziglang", "cc", "-O1", "-target", target, "host.c", "-o", "host",
                    "-ldl"], cwd=tmp_path, check=True)
    printed = subprocess.run([tmp_path / "host", native.library()], env={}, capture_output=True, text=True)
    status, *rows = printed.stdout.splitlines()
    assert printed.returncode == 0, printed.stdout

    values, counts = 0.125 * np.arange(50) - 3.0, np.zeros(50, dtype=np.int64)
    assert native.load("toy_run", "python").bind(values, counts)(0.01, 200, 50) == int(status)
    assert [float.fromhex(row.split()[0]) for row in rows] == values.tolist()
    assert [int(row.split()[1]) for row in rows] == counts.tolist()


def payload(folder: Path, libraries: list[Path]) -> Path:
    """The package as an FMU carries it: with the libraries in its folder ``lib``."""
    shutil.copytree(ROOT / "driveline", folder / "driveline", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "driveline" / "lib").mkdir()
    for library in libraries:
        shutil.copy(library, folder / "driveline" / "lib")
    shutil.copy(HERE / "toy_kernels.py", folder)
    return folder


RUN_IN_PAYLOAD = """
    import hashlib, logging, sys
    for tool in ("numba", "llvmlite", "ziglang", "platformdirs"):
        sys.modules[tool] = None  # as if it were not installed
    logging.disable()
    import numpy as np
    from driveline.kernels import backend, native
    backend.KERNEL_MODULES = ("toy_kernels",)
    values, counts = np.linspace(-3.0, 3.0, 50), np.zeros(50, dtype=np.int64)
    status = native.load("toy_run").bind(values, counts)(0.01, 200, 50)
    numbers = hashlib.sha256(values.tobytes() + counts.tobytes()).hexdigest()
    print(native.describe(), status, numbers, sep=chr(10))
"""


def test_a_payload_runs_compiled_without_any_compiler(tmp_path: Path):
    shipped = in_another_process(RUN_IN_PAYLOAD, payload(tmp_path / "a b", [native.library()])).splitlines()
    plain = in_another_process(RUN_IN_PAYLOAD, payload(tmp_path / "plain", [])).splitlines()
    assert shipped[0] == ("the kernels run compiled, from "
                          f"{tmp_path / 'a b' / 'driveline' / 'lib' / native.library().name}")
    assert plain[0] == ("the kernels run as plain Python, which is slow: "
                        f"no compiled kernels for {native.this_machine()} are shipped")
    assert shipped[1:] == plain[1:]


def sealed(content: bytes) -> bytes:
    """A library file of this content, with the right digest."""
    return content + native.SEAL + native.hashlib.sha256(content).digest()


@pytest.mark.parametrize(("change", "message"), [
    (lambda whole: whole[:2000], "is damaged"),
    (lambda whole: whole[:2000] + b"x" + whole[2001:], "is damaged"),
    (lambda whole: b"", "is damaged"),
    (lambda whole: sealed(b"MZ" + bytes(4000)), native.TARGETS["linux-x86_64"]["file"]),
    (lambda whole: whole.replace(b"toy_run\0", b"toy_ran\0"), "has no toy_run"),
], ids=["cut off", "changed", "empty", "other machine", "other sources"])
def test_a_shipped_library_that_does_not_fit_is_named_and_replaced_by_plain_python(
        change, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        caplog: pytest.LogCaptureFixture):
    content = native.library().read_bytes()
    expected = run_toy(native.load("toy_run", "python"))
    changed = change(content)
    if b"toy_ran" in changed:
        changed = sealed(changed[:-len(native.SEAL) - 32])
    assert changed != content
    (tmp_path / native.library().name).write_bytes(changed)
    monkeypatch.setattr(native, "SHIPPED", tmp_path)
    native._loaded.cache_clear()

    entry = native.load("toy_run")
    assert entry.backend == "python"
    assert run_toy(entry) == expected
    assert message in native.describe()
    assert native.describe() in caplog.text
    with pytest.raises(native.Unavailable, match="plain Python"):
        native.load("toy_run", "native")


def test_a_damaged_library_in_the_cache_is_built_again_and_a_whole_one_is_not():
    path = native.library()
    built = path.stat().st_mtime_ns
    assert native.library().stat().st_mtime_ns == built
    content = path.read_bytes()
    path.write_bytes(content[:-1])
    assert native.library() == path
    assert path.read_bytes() == content


def test_a_changed_constant_or_function_has_another_library(monkeypatch: pytest.MonkeyPatch):
    toy_kernels = importlib.import_module("toy_kernels")
    before = native._fingerprint()
    assert native._fingerprint() == before
    monkeypatch.setattr(toy_kernels, "PIECES", (0.25, 4))
    constant = native._fingerprint()

    @backend.kernel
    def halve(values, at):
        return at

    monkeypatch.setattr(toy_kernels, "halve", halve)
    assert len({before, constant, native._fingerprint()}) == 3


def test_the_same_kernels_give_the_same_bytes_for_both_systems(tmp_path: Path):
    first = native.build(native.TARGETS, tmp_path / "first")
    second = native.build(native.TARGETS, tmp_path / "second")
    assert [path.name for path in first] == [target["file"] for target in native.TARGETS.values()]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert [path.read_bytes()[:2] for path in first] == [b"\x7fE", b"MZ"]
    assert native.library().read_bytes() in [path.read_bytes() for path in first]
    assert sorted((tmp_path / "first").iterdir()) == sorted(first)


def test_two_processes_may_build_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("DRIVELINE_CACHE", str(tmp_path))
    code = (f"import sys; sys.path[:0] = {[str(ROOT), str(HERE)]}\n"
            "from driveline.kernels import backend, native\n"
            "backend.KERNEL_MODULES = ('toy_kernels',)\n"
            "print(native.load('toy_last', 'native').bind()(0.5), native.library())")
    running = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
               for _ in range(2)]
    printed = {process.communicate()[0].strip() for process in running}
    assert printed == {f"5 {native.library()}"}
    assert sorted(native.library().parent.iterdir()) == sorted(native.libraries().values())


def declare(source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``source`` the module of entry points."""
    name = f"refused_{tmp_path.name}"
    text = ("import math\nimport numpy as np\n"
            "from driveline.kernels.backend import F8, I8, entry_point, kernel\n")
    (tmp_path / f"{name}.py").write_text(text + textwrap.dedent(source))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(backend, "KERNEL_MODULES", (name,))
    monkeypatch.setattr(backend, "ENTRY_POINTS", {})


@pytest.mark.parametrize(("body", "message"), [
    ("return int(np.zeros(3).sum())", "a kernel allocates"),
    ("if x[0] > 1.0: raise ValueError\n    return 0", "a kernel can raise"),
    ("return int(math.hypot(x[0], x[1]))", "a kernel calls hypot"),
    ("return helper(x)", "Unknown attribute 'size_'"),
], ids=["allocates", "raises", "own way", "unknown"])
def test_what_cannot_be_compiled_is_told_in_one_message(
        body: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    declare(f"""
@kernel
def helper(x):
    return x.size_

@entry_point
def refused(x: F8) -> int:
    {body}
""", tmp_path, monkeypatch)
    with pytest.raises(native.Unavailable, match=f"(?s)do not compile: .*{message}"):
        native.build([native.this_machine()], tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_linker_that_fails_is_told_in_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "no_folder").write_text("")
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "no_folder"))
    with pytest.raises(native.Unavailable, match="do not compile: (?s:.*)CalledProcessError: .*zig") as raised:
        native.build([native.this_machine()], tmp_path / "out")
    assert "Traceback" not in str(raised.value)
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(("body", "message"), [
    ("return int(x[0] ** 2)", "refused raises to a power"),
    ("return int(math.pow(x[0], 2.0))", "refused raises to a power"),
    ("return len(x)", "refused asks for a length"),
    ("return int(x[1:][0])", "refused slices an array"),
    ("x[:2] = x[2:4]\n    return 0", "refused slices an array"),
    ("return int(x[-1])", "refused counts an index from the end"),
    ("x[-1] = 0.0\n    return 0", "refused counts an index from the end"),
    ("return unmarked(x)", "refused calls unmarked, which is not a @kernel"),
    ("return int(TABLE[0])", "refused uses the module-level array TABLE"),
])
def test_what_would_give_other_numbers_is_refused(
        body: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    declare(f"""
TABLE = np.zeros(3)

def unmarked(x):
    return 0

@entry_point
def refused(x: F8) -> int:
    {body}
""", tmp_path, monkeypatch)
    with pytest.raises(TypeError, match=message):
        native.library()


@pytest.mark.parametrize(("arguments", "message"), [
    ("x, y: float) -> int", "argument x needs the annotation"),
    ("x: list) -> int", "argument x needs the annotation"),
    ("x: F8) -> float", "returns int"),
    ("y: float, x: F8) -> int", "arrays must come before|array arguments must come before"),
])
def test_an_entry_point_declared_wrongly_is_refused(
        arguments: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    declare(f"@entry_point\ndef refused({arguments}:\n    return 0\n", tmp_path, monkeypatch)
    with pytest.raises(TypeError, match=message):
        backend.import_entry_points()
