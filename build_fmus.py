"""Build every FMU into build/fmus: python build_fmus.py [--out DIR]."""

import argparse
import sys
from pathlib import Path

from driveline.kernels.native import Unavailable
from driveline.quantities import InputError
from fmus.packaging import build


def main() -> int:
    """Build, print one line a file; 2 where the input is wrong, 1 where the build is not possible."""
    parser = argparse.ArgumentParser(description="Build every FMU.")
    parser.add_argument("--out", type=Path, default=Path("build/fmus"), help="folder for the .fmu files")
    try:
        for path in build(parser.parse_args().out):
            print(f"{path}  {path.stat().st_size / 1024:.0f} KiB", flush=True)
    except (InputError, Unavailable, OSError) as error:
        print(f"build_fmus.py: {error}", file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
