"""Compiling what a host loads on Linux, ``loader.c``: it brings Python where the host has none."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path

from driveline.kernels import native

# PythonFMU's own library beside this one, by its own name, which with its hyphen is that of no FMU; loader.c knows it.
BEHIND = "libpythonfmu-export.so"
_SOURCE = Path(__file__).with_name("loader.c")
_COMMAND = ("cc", "-target", "x86_64-linux-gnu.2.17", "-O2", "-s", "-shared", "-fPIC", "-fvisibility=hidden", "-Wall",
            "-Wextra", "-Werror")


def library() -> bytes:
    """The library for Linux on x86-64: from the user's cache, or compiled into it; the same source, the same bytes.

    Raises:
        driveline.kernels.native.Unavailable: ziglang is missing, or does not compile it.
    """
    try:
        compiler = metadata.version("ziglang")
    except metadata.PackageNotFoundError as error:
        raise native.Unavailable("ziglang is not installed") from error
    source = _SOURCE.read_bytes()
    digest = hashlib.sha256(" ".join((compiler, *_COMMAND)).encode() + source).hexdigest()[:16]
    kept = native.cache_folder() / "loader" / f"{digest}.so"
    if not kept.is_file():
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=kept.parent, prefix=".build-") as scratch:
            (Path(scratch) / _SOURCE.name).write_bytes(source)
            done = subprocess.run([sys.executable, "-m", "ziglang", *_COMMAND, _SOURCE.name, "-o", "loader.so", "-ldl"],
                                  cwd=scratch, env=native.compiling(), capture_output=True, text=True)
            if done.returncode:
                raise native.Unavailable(f"{_SOURCE.name} does not compile: {done.stderr.strip()}")
            os.replace(Path(scratch) / "loader.so", kept)
    return kept.read_bytes()
