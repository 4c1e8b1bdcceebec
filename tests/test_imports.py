"""Imports point down only: driveline knows nobody, fmus knows driveline, cosim opens .fmu files."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ALLOWED = {"driveline": {"numpy"}, "fmus": {"driveline"}, "cosim": {"driveline"}}
OURS = set(ALLOWED) | {"tests", "benchmarks", "build_fmus"}
# Rooms of the diagnosis from the ground up; `show` and `hidden` know what is below them, not what is beside.
DIAGNOSIS = {"effect": (), "effects": ("effect",), "catalogue": ("effect", "effects"), "plants": ("effect",),
             "fit": ("effect", "catalogue", "plants"), "search": ("catalogue", "fit"),
             "judge": ("effect", "catalogue", "plants", "fit", "search"), "show": ("plants",),
             "gain": ("plants", "show", "judge"), "benches": ("effect", "catalogue", "plants", "fit", "judge"),
             "hidden": ("effect", "catalogue")}


@dataclass(frozen=True)
class Import:
    """One import statement: the package it reaches, and whether it runs when the module is loaded."""

    package: str
    relative: bool
    at_load: bool
    where: str


def imports_of(path: Path, name: str) -> Iterator[Import]:
    """Every import of a source file; those for type checkers alone do not count."""
    def walk(node: ast.AST, at_load: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            where = f"{name}:{getattr(child, 'lineno', 0)}"
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                continue
            if isinstance(child, ast.Import):
                for alias in child.names:
                    yield Import(alias.name.partition(".")[0], False, at_load, where)
            elif isinstance(child, ast.ImportFrom):
                yield Import((child.module or "").partition(".")[0], child.level > 0, at_load, where)
            in_function = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            yield from walk(child, at_load and not in_function)

    yield from walk(ast.parse(path.read_text(encoding="utf-8"), str(path)), True)


def imports_in(package: str) -> list[Import]:
    """All imports of a package's modules."""
    paths = sorted((ROOT / package).rglob("*.py"))
    assert len(paths) > 3
    return [found for path in paths for found in imports_of(path, str(path.relative_to(ROOT)))]


def foreign(found: Import) -> bool:
    return not found.relative and found.package not in sys.stdlib_module_names


def test_the_walk_sees_every_way_to_import(tmp_path):
    source = tmp_path / "module.py"
    source.write_text("import a.b, c\nfrom .d import e\nfrom . import f\nif x:\n    from g.h import i\n"
                      "def j():\n    import k\n    class L:\n        import m\n"
                      "if TYPE_CHECKING:\n    import n\nclass O:\n    import p\n")
    seen = [(found.package, found.relative, found.at_load) for found in imports_of(source, "module.py")]
    assert seen == [("a", False, True), ("c", False, True), ("d", True, True), ("", True, True),
                    ("g", False, True), ("k", False, False), ("m", False, False), ("p", False, True)]


def test_driveline_imports_itself_relatively_and_at_load_numpy_alone():
    """It is shipped inside FMUs under another name, to machines that have numpy and nothing else."""
    found = imports_in("driveline")
    assert any(one.relative for one in found)
    for one in found:
        if foreign(one):
            assert one.package not in OURS, f"{one.where} imports {one.package}: driveline knows nobody"
            assert not one.at_load or one.package in ALLOWED["driveline"], (
                f"{one.where} imports {one.package} at load: an FMU has numpy alone")


@pytest.mark.parametrize("package", ["fmus", "cosim"])
def test_a_package_imports_only_what_is_below_it(package):
    for one in imports_in(package):
        if not foreign(one) or one.package not in OURS or one.package == package:
            continue
        build_command = one.where.startswith("cosim/cli.py") and one.package == "fmus" and not one.at_load
        assert one.package in ALLOWED[package] or build_command, f"{one.where} imports {one.package}"


def test_a_room_of_the_diagnosis_imports_only_what_is_below_it():
    folder = ROOT / "cosim" / "diagnosis"
    rooms = {path.stem for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert rooms == {*DIAGNOSIS, "diagnose", "__init__"}
    for room, below in DIAGNOSIS.items():
        paths = [folder / f"{room}.py"] if (folder / f"{room}.py").exists() else sorted((folder / room).glob("*.py"))
        for path in paths:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("cosim.diagnosis"):
                    reached = (node.module.split(".")[2:] or [node.names[0].name])[0]
                    assert reached in (room, *below), f"{path.relative_to(ROOT)}:{node.lineno} imports {reached}"


def test_only_the_report_draws():
    drawing = {one.where.partition(":")[0] for package in ALLOWED for one in imports_in(package)
               if one.package == "matplotlib"}
    assert drawing
    assert all(where.startswith("cosim/report/") for where in drawing), drawing


def test_loading_driveline_loads_numpy_and_the_standard_library_alone():
    """What really happens in a new process, with every module of the plants and estimators."""
    code = ("import sys; before = set(sys.modules); import driveline.models, driveline.plants.linear\n"
            "print(*sorted({name.partition('.')[0] for name in set(sys.modules) - before}))")
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {name for name in ran.stdout.split() if name not in sys.stdlib_module_names}
    assert loaded <= {"driveline", "numpy"} | {name for name in loaded if name.startswith("_")}, loaded
    assert {"driveline", "numpy"} <= loaded
