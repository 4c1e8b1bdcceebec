"""From a model to an ``.fmu`` file: which files go in, under which names, and the same bytes every time.

FMUs in one process share ``sys.modules``. So every Python package inside carries the hash of what is
shipped (``driveline_0123456789ab``), and every slave module the hash of that and its own text: FMUs
built from different sources never meet, FMUs built from the same source share their modules.
"""

from __future__ import annotations

import hashlib
import html
import io
import json
import os
import re
import tempfile
import uuid
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path

import pythonfmu
from elftools.elf.elffile import ELFFile

from driveline.estimators import ESTIMATORS
from driveline.model import Model
from driveline.models import SHIPPED_GEAR, SHIPPED_VARIANT, SHIPPED_VEHICLE
from driveline.quantities import InputError

from . import loader
from .model_description import as_bytes, generation_time, model_description
from .shell import MODEL_FILE

HERE = Path(__file__).parent
DRIVELINE = HERE.parent / "driveline"

# model: folder with its slave script (NAME_slave.py) and README.md
FMUS = {
    "plant_fom": "plant_fom",
    "plant_rom_2dof": "plant_rom",
    "plant_rom_3dof": "plant_rom",
    "plant_rom_3dof_split": "plant_rom",
    **{name: f"estimators/{name}" for name in ESTIMATORS},
}

# the part of pythonfmu that a slave needs; its own __init__ would import the whole builder
_PYTHONFMU_FILES = ("_version", "default_experiment", "enums", "fmi2slave", "logmsg", "variables")
_IMPORT = re.compile(rb"^(\s*(?:from|import)\s+)(driveline|fmus|pythonfmu)\b", re.MULTILINE)
_NEEDS = """
Runs in Python: one with numpy has to be installed where the FMU runs. A host that is no Python gets, on Linux, that of
the program python3 on PATH or of what FMU_PYTHON names; on Windows python3.dll has to be on PATH.
"""
# PythonFMU 0.7 runs a slave script once more at every load and then gives back one reference to its
# namespace too many: after some loads the process would die. Lend one for each.
_LEND_NAMESPACE = b'\nglobals().setdefault("_lent", []).append(globals())\n'
# Its Linux library gives its state back twice where the host exits with the library loaded: once as every
# global object, once more in this function, which the loader calls after that. The second time counts down in
# memory that is no longer its own, and glibc may end the process ("corrupted double-linked list").
_RELEASED_AGAIN = "finalizePythonInterpreter"
_ENDBR64, _RET = b"\xf3\x0f\x1e\xfa", b"\xc3"


def _payload_files(payload: Path, libraries: Iterable[Path]) -> dict[str, bytes]:
    """Everything that FMUs of one build share, by path relative to the resources folder."""
    files = {
        f"driveline/{path.relative_to(payload).as_posix()}": path.read_bytes()
        for path in sorted(payload.rglob("*.py"))
    }
    for library in libraries:
        files[f"driveline/lib/{library.name}"] = library.read_bytes()
    files["fmus/__init__.py"] = b""
    files["fmus/shell.py"] = (HERE / "shell.py").read_bytes()
    files["pythonfmu/__init__.py"] = b""
    for name in _PYTHONFMU_FILES:
        files[f"pythonfmu/{name}.py"] = (Path(pythonfmu.__file__).parent / f"{name}.py").read_bytes()
    return files


def _digest(files: Mapping[str, bytes]) -> str:
    """Hash of names and contents."""
    digest = hashlib.sha256()
    for name in sorted(files):
        for part in (name.encode(), files[name]):
            digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


def _marked_imports(source: bytes, mark: str) -> bytes:
    """Python source that imports the packages under the names that end with the hash."""
    return _IMPORT.sub(rb"\1\2_" + mark.encode(), source)


def _marked_packages(files: Mapping[str, bytes], mark: str) -> dict[str, bytes]:
    """The packages under names that end with the hash."""
    marked = {}
    for path, content in files.items():
        package, _, rest = path.partition("/")
        if path.endswith(".py"):
            content = _marked_imports(content, mark)
        marked[f"{package}_{mark}/{rest}"] = content
    return marked


def released_once(library: bytes) -> bytes:
    """PythonFMU's library for Linux (x86-64), with the second release of its state made an empty function.

    Raises:
        InputError: The function is not there, or does not begin as it does in PythonFMU 0.7.
    """
    with ELFFile(io.BytesIO(library)) as elf:
        found = elf.get_section_by_name(".dynsym").get_symbol_by_name(_RELEASED_AGAIN) or ()
        begins = [next(elf.address_offsets(symbol["st_value"])) for symbol in found]
    if len(begins) != 1 or library[begins[0]:][:len(_ENDBR64)] != _ENDBR64:
        raise InputError(f"PythonFMU {metadata.version('pythonfmu')}: its Linux library is not the one of 0.7 that "
                         "this project knows; see released_once in fmus/packaging.py")
    at = begins[0] + len(_ENDBR64)
    return library[:at] + _RET + library[at + 1:]


def _binaries(identifier: str) -> dict[str, bytes]:
    """PythonFMU's libraries; on Linux behind one that brings Python where the host has none."""
    folder = Path(pythonfmu.__file__).parent / "resources" / "binaries"
    files = {
        f"binaries/{path.parent.name}/{identifier}{path.suffix}": path.read_bytes()
        for path in sorted(folder.rglob("*")) if path.suffix in (".so", ".dll", ".dylib")
    }
    linux = f"binaries/linux64/{identifier}.so"
    return {**files, linux: loader.library(), f"binaries/linux64/{loader.BEHIND}": released_once(files[linux])}


def _documentation(folder: Path, identifier: str, name: str) -> dict[str, bytes]:
    """The folder's readme and reference results, the page FMI asks for, PythonFMU's licence."""
    files = {f"documentation/{path.name}": path.read_bytes() for path in folder.glob(f"{name}_reference.csv")}
    readme = folder / "README.md"
    if readme.exists():
        text = html.escape(readme.read_text(encoding="utf-8") + _NEEDS)
        page = ('<!DOCTYPE html>\n<html lang="en">\n'
                f'<head><meta charset="utf-8"><title>{identifier}</title></head>\n'
                f'<body><pre>{text}</pre></body>\n</html>\n')
        files["documentation/index.html"] = page.encode()
    for entry in metadata.files("pythonfmu") or ():
        if entry.name == "LICENSE":
            files["documentation/licenses/pythonfmu.txt"] = entry.read_binary()
    return files


def fmu_files(model: Model, slave: Path, identifier: str, *, payload: Path = DRIVELINE,
              libraries: Iterable[Path] = ()) -> dict[str, bytes]:
    """All files of an FMU by their path in the archive; arguments as for ``write_fmu``."""
    shared = _payload_files(payload, libraries)
    mark = _digest(shared)[:12]
    script = _marked_imports(slave.read_bytes() + _LEND_NAMESPACE, mark)
    module = f"{slave.stem.removesuffix('_slave')}_{hashlib.sha256(script).hexdigest()[:12]}_slave"
    start_values = {
        variable.name: float(value)
        for variable, value in zip(model.variables, model.values, strict=True)
        if variable.causality != "output"
    }
    resources = {
        **_marked_packages(shared, mark),
        f"{module}.py": script,
        "slavemodule.txt": module.encode(),
        # repr of a double, which json writes, reads back to the same double
        MODEL_FILE: json.dumps({"model": model.name, "start_values": start_values}, indent=1).encode(),
    }
    files = {f"resources/{name}": content for name, content in resources.items()}
    files |= _binaries(identifier) | _documentation(slave.parent, identifier, model.name)
    described = model_description(model, identifier, version=mark)
    date = described.attrib.pop("generationDateAndTime", None)
    guid = _digest({**files, "modelDescription.xml": as_bytes(described)})
    described.set("guid", str(uuid.UUID(guid[:32])))
    if date:
        described.set("generationDateAndTime", date)
    return {"modelDescription.xml": as_bytes(described), **files}


def _write_archive(files: Mapping[str, bytes], destination: Path) -> None:
    """Write the zip beside its destination and move it there when it is whole."""
    made = generation_time()
    moment = max(made.timetuple()[:6], (1980, 1, 1, 0, 0, 0)) if made else (1980, 1, 1, 0, 0, 0)
    destination.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=".", suffix=".part", dir=destination.parent)
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(files, key=lambda path: (path != "modelDescription.xml", path)):
                entry = zipfile.ZipInfo(path, moment)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.create_system = 3  # the same on every system that builds
                entry.external_attr = 0o100644 << 16
                archive.writestr(entry, files[path])
        os.chmod(name, 0o644)
        os.replace(name, destination)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def write_fmu(destination: Path, model: Model, slave: Path, *, payload: Path = DRIVELINE,
              libraries: Iterable[Path] = ()) -> Path:
    """Write one FMU; the same arguments and sources give the same bytes.

    Args:
        destination: The ``.fmu`` file; its stem is the model identifier, so letters, digits and ``_``.
        model: Declares the variables; its values (parameters and inputs) become the start values.
        slave: Script with a subclass of ``ModelSlave`` whose ``models`` contain ``model.name``; the
            readme and reference results beside it become the documentation.
        payload: Folder that becomes the package ``driveline_<hash>``.
        libraries: Shared libraries with the compiled kernels, for the payload's folder ``lib``.

    Raises:
        InputError: The name is not an identifier, or a variable cannot be declared in FMI 2.0.
        driveline.kernels.native.Unavailable: What hosts load on Linux cannot be compiled here.
    """
    destination = Path(destination)
    if not re.fullmatch(r"[A-Za-z_]\w*", destination.stem, re.ASCII) or destination.suffix != ".fmu":
        raise InputError(f"{destination.name}: the file of an FMU is named with letters, digits and _, "
                         "and ends with .fmu")
    files = fmu_files(model, slave, destination.stem, payload=payload, libraries=libraries)
    _write_archive(files, destination)
    return destination


def build(out: Path, names: Iterable[str] = tuple(FMUS), vehicle: str = SHIPPED_VEHICLE,
          variant: str | None = SHIPPED_VARIANT, gear: int = SHIPPED_GEAR, suffix: str = "") -> Iterator[Path]:
    """Build FMUs of the table ``FMUS`` into a folder; gives the path of each as it is written.

    Args:
        out: The folder; made where it does not exist.
        names: Which ones, by model name.
        vehicle: Name or path of the vehicle whose values become the start values.
        variant: Variant in the vehicle file, None for the plain one.
        gear: Gear at the start; the reduced plants are computed for it.
        suffix: Put behind the name of each FMU, ``_extended`` for example.

    Raises:
        InputError: A name is not in the table, or the vehicle file is wrong.
        driveline.kernels.native.Unavailable: The kernels cannot be compiled here.
    """
    from driveline.kernels import native
    from driveline.models import MODELS
    from driveline.vehicles import load

    names = tuple(names)
    if unknown := set(names) - set(FMUS):
        raise InputError(f"there is no FMU {', '.join(sorted(unknown))}: possible are {', '.join(FMUS)}")
    values = load(vehicle, variant)
    libraries = native.libraries().values()
    for name in names:
        model = MODELS[name](MODELS[name].defaults_from(values, gear))
        folder = HERE / FMUS[name]
        slave = folder / f"{folder.name}_slave.py"
        yield write_fmu(Path(out) / f"{name}{suffix}.fmu", model, slave, libraries=libraries)
