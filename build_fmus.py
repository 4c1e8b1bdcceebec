"""Build every FMU into build/fmus: python build_fmus.py [--out DIR]."""

import argparse
import sys
from pathlib import Path

from driveline.quantities import InputError
from fmus.packaging import build


def main() -> int:
    """Build, print one line a file; 2 where the input is wrong."""
    parser = argparse.ArgumentParser(description="Build every FMU.")
    parser.add_argument("--out", type=Path, default=Path("build/fmus"), help="folder for the .fmu files")
    try:
        for path in build(parser.parse_args().out):
            print(f"{path}  {path.stat().st_size / 1024:.0f} KiB", flush=True)
    except InputError as error:
        print(f"build_fmus.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
