"""The FMU in a host that has no Python: it brings one, or says why it cannot."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import fmpy
import pytest

from driveline.kernels import native
from fmus import loader

LIBRARY = next((path for place in (sysconfig.get_config_var("LIBDIR"), Path(sys.base_prefix, "lib"))
                if place and (path := Path(place, sysconfig.get_config_var("INSTSONAME") or "none")).is_file()), None)
STEP, STEPS, TORQUE = 0.001, 25, 150.0

pytestmark = pytest.mark.skipif(native.this_machine() != "linux-x86_64", reason="of the FMUs' library for Linux")
needs_library = pytest.mark.skipif(LIBRARY is None, reason="this Python has no shared library to bring")


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    """The host, compiled."""
    made = tmp_path_factory.mktemp("host") / "host"
    subprocess.run([sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-linux-gnu.2.17", "-Wall", "-Wextra",
                    "-Werror", Path(__file__).with_name("host.c"), "-o", made, "-ldl", "-lpthread"],
                   check=True, env=native.compiling())
    return made


@pytest.fixture(scope="session")
def places(fmus, tmp_path_factory):
    """The plant, extracted twice, once where a URI has to write some letters in another way."""
    folders = [tmp_path_factory.mktemp("there"), tmp_path_factory.mktemp("100% +ä (1) [2]")]
    for folder in folders:
        fmpy.extract(str(fmus["plant_fom"]), str(folder))
    return folders


def hosted(program, places, outputs=("engine_speed",), **environment):
    """What a host that is no Python prints, and how it ended; ``environment`` beside nothing but the home."""
    described = fmpy.read_model_description(str(places[0]))
    reference = {variable.name: str(variable.valueReference) for variable in described.modelVariables}
    words = [str(STEP), str(STEPS), reference["engine_torque"], str(TORQUE),
             ",".join(reference[name] for name in outputs)]
    for place in places:
        words += [place / "binaries/linux64/plant_fom.so", described.guid, (place / "resources").as_uri()]
    home = {name: os.environ[name] for name in ("HOME", "PATH") if name in os.environ}
    return subprocess.run([program, *words], capture_output=True, text=True, env={**home, **environment}, timeout=120)


@needs_library
def test_a_host_without_python_gets_the_same_bits(program, places, fmus, load):
    outputs = ["engine_speed", "propeller_shaft_torque", "lash_position"]
    here = load(fmus["plant_fom"])
    here.initialize(engine_torque=TORQUE)
    expected = []
    for step in range(STEPS):
        here.doStep(step * STEP, STEP)
        expected.append([here[name] for name in outputs])
    told = hosted(program, places[:1], outputs, FMU_PYTHON=sys.executable, PYTHONPATH="/what/it/was")
    assert told.returncode == 0, told.stdout + told.stderr
    version, *rows, interrupt, path = told.stdout.splitlines()
    assert version == "version 2.0"
    assert [[float.fromhex(word) for word in row.split()] for row in rows] == expected
    assert (interrupt, path) == ("interrupt as it was", "path /what/it/was")


@needs_library
def test_several_fmus_run_in_threads_of_their_own(program, places):
    one, two = (hosted(program, places[:count], FMU_PYTHON=sys.executable) for count in (1, 2))
    assert one.returncode == two.returncode == 0, two.stdout + two.stderr
    rows = one.stdout.splitlines()[1:-2]
    assert len(rows) == STEPS
    assert two.stdout.splitlines()[2:-2] == rows + rows


@needs_library
def test_python3_on_the_path_is_taken_where_none_is_named(program, places, tmp_path):
    (tmp_path / "python3").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (tmp_path / "python3").chmod(0o755)
    told = hosted(program, places[:1], PATH=f"{tmp_path}:/bin:/usr/bin")
    assert told.returncode == 0, told.stdout + told.stderr


@needs_library
def test_a_path_that_pythonfmu_takes_for_another_is_refused(program, fmus, tmp_path):
    fmpy.extract(str(fmus["plant_fom"]), str(tmp_path / "a%20b"))
    told = hosted(program, [tmp_path / "a%20b"], FMU_PYTHON=sys.executable)
    assert told.returncode == 1 and "a path with %20 in it" in told.stdout


def answering(folder, *lines):
    """A program that answers every question with these lines."""
    program = folder / "python3"
    program.write_text("#!/bin/sh\n" + "".join(f"echo '{line}'\n" for line in lines))
    program.chmod(0o755)
    return str(program)


@pytest.mark.parametrize(("lines", "words"), [
    (None, "there is no program '{python}': put a python3 with numpy on PATH, or name one in FMU_PYTHON"),
    (["what?"], "there is no program '{python}'"),
    (["/nowhere/libpython3.so", "/nowhere", "/nowhere"], "'{python}' has no shared library to bring"),
    pytest.param([LIBRARY, sys.base_prefix, "{blocked}"], "the Python that runs here has none: install it",
                 marks=needs_library)])
def test_without_a_python_the_instance_is_refused_and_the_log_says_why(program, places, tmp_path, lines, words):
    blocked = tmp_path / "modules"
    (blocked / "numpy").mkdir(parents=True)
    (blocked / "numpy" / "__init__.py").write_text("raise ImportError('not here')\n")
    python = str(tmp_path / "gone")
    if lines is not None:
        python = answering(tmp_path, *(str(line).format(blocked=blocked) for line in lines))
    told = hosted(program, places[:1], FMU_PYTHON=python)
    assert told.returncode == 1, told.stdout + told.stderr
    *_, logged, last = told.stdout.splitlines()
    assert last == "no instance"
    assert logged.startswith("log there 3 logStatusError: this FMU ") and words.format(python=python) in logged
    assert logged.partition(": ")[2] in told.stderr


def test_the_same_source_gives_the_same_library(tmp_path, monkeypatch):
    kept = loader.library()
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", native.compiling()["ZIG_GLOBAL_CACHE_DIR"])  # the C library, built once
    monkeypatch.setenv("DRIVELINE_CACHE", str(tmp_path))
    assert loader.library() == kept
    assert [path.suffix for path in (tmp_path / "loader").iterdir()] == [".so"]


def test_a_source_that_does_not_compile_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(loader, "_SOURCE", tmp_path / "loader.c")
    (tmp_path / "loader.c").write_text("int f(void) { return g(); }\n")
    with pytest.raises(native.Unavailable, match=r"(?s)loader.c does not compile: .*\bg\b"):
        loader.library()


def test_it_has_every_function_of_the_library_behind_it(places):
    from elftools.elf.elffile import ELFFile

    functions = []
    for name in ("plant_fom.so", loader.BEHIND):
        with (places[0] / "binaries/linux64" / name).open("rb") as file:
            symbols = ELFFile(file).get_section_by_name(".dynsym").iter_symbols()
            functions.append({s.name for s in symbols if s["st_shndx"] != "SHN_UNDEF" and s.name.startswith("fmi2")})
    assert functions[0] == functions[1] and len(functions[0]) == 34
