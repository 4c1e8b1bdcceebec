"""Entry points to a plain shared library, ahead of time: Python -> LLVM (Numba) -> object -> zig cc.

Runs in a process of its own (``native.build`` starts it), because Numba must be told before its
import to aim at an ordinary x86-64 processor instead of the one at hand: the bytes of the library,
and the numbers it gives, must not depend on the machine that built it.

The entry points of each kernel module are compiled in a process of their own again, and so is the library for each
system: on two cores that takes half as long.

The library exports, for each entry point ``f(array, ..., scalar, ...)``, a C function ::

    int64_t f(void *const *arrays, double or int64_t scalar, ...);

Arrays travel in one table because a call then costs the same however many there are.
"""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

from . import backend
from .backend import F8

# What Numba must see in the environment before it is imported; set by native.build. Vector math
# libraries and processor features of the building machine would change the last bits.
CPU = "x86-64-v2"
ENVIRONMENT = {
    "NUMBA_CPU_NAME": CPU,
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_DISABLE_INTEL_SVML": "1",
    "PYTHONHASHSEED": "0",
}
C_LIBRARY = set("""acos asin atan atan2 cos cosh exp expm1 fmod log log10 log1p log2
    sin sincos sinh sqrt tan tanh floor ceil round trunc fabs memcpy memmove memset""".split())
C_TYPES = {float: "double", int: "int64_t"}
HEADER = """\
#include <stdint.h>
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
"""


# On Windows the library stands on the C runtime that is part of the system, not on MinGW's, which zig
# would first have to compile (a minute on a new machine). That runtime has all of C_LIBRARY but
# sincos, and a library that starts nothing needs no more of a start than this.
WINDOWS_SOURCE = """\
double sin(double);
double cos(double);
void sincos(double x, double *s, double *c) { *s = sin(x); *c = cos(x); }
int __stdcall DllMainCRTStartup(void *library, unsigned reason, void *reserved) { return 1; }
int _fltused = 0;
"""
WINDOWS_RUNTIME = "ucrtbase"


class CompileError(Exception):
    """The kernels cannot be compiled; the message says which rule of backend.py they break."""


def wrapper_source(name: str, function: Callable) -> tuple[str, str]:
    """For one entry point: the Python wrapper Numba compiles, and the C function that is exported."""
    arrays, scalars = backend.signature(function)
    taken = [f"a{i}" for i in range(len(arrays))] + [f"s{i}" for i in range(len(scalars))]
    # The arrays are declared to be empty. Numba makes x[-1] the last item, which costs a comparison
    # and an addition of the size at every access; with the size 0 both vanish, and a plant's step
    # takes half the time. Kernels may therefore not ask for a size; backend.py refuses `len`.
    passed = [f"carray(a{i}, (0,))" for i in range(len(arrays))] + taken[len(arrays):]
    python = f"def wrapper({', '.join(taken)}):\n    return function({', '.join(passed)})\n"

    scalar_types = [C_TYPES[kind] for kind in scalars]
    inner = ["void*"] * len(arrays) + scalar_types
    outer = ["void *const *a"] + [f"{kind} s{i}" for i, kind in enumerate(scalar_types)]
    given = [f"a[{i}]" for i in range(len(arrays))] + taken[len(arrays):]
    c = (f"extern int64_t kernel_{name}({', '.join(inner)});\n"
         f"EXPORT int64_t {name}({', '.join(outer)}) {{ return kernel_{name}({', '.join(given)}); }}\n")
    return python, c


def compile_entry_point(name: str, function: Callable):
    """LLVM module of one entry point, with the wrapper named ``kernel_<name>`` and all else internal."""
    import llvmlite.binding as llvm
    import numba

    pointers = {F8: numba.types.CPointer(numba.types.float64),
                backend.I8: numba.types.CPointer(numba.types.int64)}
    values = {float: numba.types.float64, int: numba.types.int64}
    arrays, scalars = backend.signature(function)
    kinds = [pointers[array] for array in arrays] + [values[scalar] for scalar in scalars]

    scope = {"carray": numba.carray, "function": function}
    exec(wrapper_source(name, function)[0], scope)
    compiled = numba.cfunc(numba.types.int64(*kinds), error_model="numpy")(scope["wrapper"])

    module = llvm.parse_assembly(compiled._library.get_llvm_str())
    for symbol in [*module.functions, *module.global_variables]:
        if symbol.name == compiled._wrapper_name:
            symbol.name = f"kernel_{name}"
            symbol.visibility = "hidden"
        elif not symbol.is_declaration:
            symbol.linkage = "internal"
    return module


def compile_module(functions: dict[str, Callable]):
    """One LLVM module with every entry point, not yet optimised across kernels."""
    from numba.extending import register_jitable

    for used in backend.reached_kernels(list(functions.values())):
        register_jitable(error_model="numpy")(used)
    modules = [compile_entry_point(name, function) for name, function in functions.items()]
    for other in modules[1:]:
        modules[0].link_in(other)
    return modules[0]


def optimise(module, machine) -> None:
    """Optimise across kernels; only after that is it visible that none of them can raise.

    Raises:
        CompileError: A kernel still needs something of Python, or of an unknown library.
    """
    import llvmlite.binding as llvm

    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    builder.getModulePassManager().run(module, builder)
    needed = {s.name for s in [*module.functions, *module.global_variables] if s.is_declaration}
    foreign = sorted(n for n in needed if not n.startswith("llvm.") and n not in C_LIBRARY)
    if any(name.startswith("NRT_MemInfo_alloc") for name in foreign):
        raise CompileError("a kernel allocates: arrays are passed in, not made")
    if any(name.startswith(("Py", "numba_", "NRT_")) for name in foreign):
        raise CompileError("a kernel can raise an exception: it returns a status instead")
    if foreign:
        raise CompileError(f"a kernel calls {', '.join(foreign)}, not known to give Python's bits")


def intermediate_code(module: str) -> str:
    """The entry points of one kernel module as LLVM's intermediate code.

    Raises:
        CompileError: They cannot be compiled.
    """
    backend.KERNEL_MODULES = (module,)
    try:
        return str(compile_module(backend.import_entry_points()))
    except Exception as error:  # not all that Numba raises can be sent to another process
        raise CompileError(_told(error)) from None


def write_library(code: str, target: Mapping[str, str], out: Path) -> None:
    """Optimise intermediate code for a target and link it; ``exports.c`` is in ``out`` already.

    Raises:
        CompileError: As ``optimise``.
    """
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    module = llvm.parse_assembly(code)
    module.triple = target["triple"]
    machine = llvm.Target.from_triple(target["triple"]).create_target_machine(
        cpu=CPU, opt=3, reloc="pic", codemodel="default")
    module.data_layout = str(machine.target_data)
    optimise(module, machine)
    objects = Path(target["file"]).with_suffix(".o").name
    (out / objects).write_bytes(machine.emit_object(module))
    sources = ["exports.c", objects]
    if "windows" in target["zig"]:
        (out / "windows.c").write_text(WINDOWS_SOURCE)
        sources.append("windows.c")
        names = "\n".join(sorted(C_LIBRARY - {"sincos"}))
        (out / "runtime.def").write_text(f"LIBRARY {WINDOWS_RUNTIME}.dll\nEXPORTS\n{names}\n")
        subprocess.run([sys.executable, "-m", "ziglang", "dlltool", "-m", "i386:x86-64", "-d", "runtime.def",
                        "-l", f"lib{WINDOWS_RUNTIME}.a"], cwd=out, check=True)
    subprocess.run(
        [sys.executable, "-m", "ziglang", "cc", "-O2", "-s", "-shared", "-target", target["zig"],
         *sources, *target["flags"], "-o", target["file"]], cwd=out, check=True)


def build(targets: Sequence[Mapping[str, str]], out: Path) -> None:
    """Compile every entry point for every target into ``out``; see ``native.build``."""
    import llvmlite.binding as llvm

    functions = backend.import_entry_points()
    (out / "exports.c").write_text(HEADER + "".join(wrapper_source(*item)[1] for item in functions.items()))
    with ProcessPoolExecutor(max(len(backend.KERNEL_MODULES), len(targets)), get_context("spawn")) as pool:
        whole, *others = map(llvm.parse_assembly, pool.map(intermediate_code, backend.KERNEL_MODULES))
        for other in others:
            whole.link_in(other)
        for _ in pool.map(write_library, repeat(str(whole)), targets, repeat(out)):
            pass


def _told(error: Exception) -> str:
    """The innermost cause of a failed compilation: Numba tells it last, under every caller's name."""
    if isinstance(error, CompileError):
        return str(error)
    _, nested, cause = str(error).rpartition("raised a specific error:")
    told = cause.partition("During:")[0] if nested else f"{type(error).__name__}: {cause}"
    return textwrap.dedent(told).strip()


if __name__ == "__main__":
    request = json.load(sys.stdin)
    sys.path[:] = request["path"]
    backend.KERNEL_MODULES = tuple(request["modules"])
    try:
        build(list(request["targets"].values()), Path(request["out"]))
    except Exception as error:  # the parent shows one message, not the compiler's own traceback
        sys.exit(_told(error))
