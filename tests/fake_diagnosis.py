"""A diagnosis that looks at nothing but the files' times: fast, the same everywhere, and right or wrong at will.

In a module of its own as worker processes import it by name.
"""

import hashlib
from pathlib import Path
from types import SimpleNamespace

from cosim.diagnosis.catalogue import CATALOGUE

FAILS = "ValueError: nothing to be seen"


def digest(path: Path) -> int:
    """A number that the measurement decides: when its loggers sampled, which is the same on every processor."""
    stamps = [line.partition(",")[0] for file in sorted(Path(path).glob("*.csv")) for line in
              file.read_text().splitlines()]
    return int(hashlib.sha256("\n".join(stamps).encode()).hexdigest()[:8], 16)


def guess(path, out=None, *, workers=None):
    """A cause drawn by the measurement; one case in four fails."""
    number = digest(path)
    if number % 4 == 0:
        raise ValueError(FAILS.partition(": ")[2])
    name = list(CATALOGUE)[number % len(CATALOGUE)]
    cause = {"effect": name, "probability": (number % 100) / 100.0, "parameters": {}}
    return SimpleNamespace(reserved=[], identification=None, finding={
        "verdict": "cause", "causes": [cause], "ambiguous_with": [], "next_manoeuvre": None, "unknown": None,
        "gain": None})


def endless(path, out=None, *, workers=None):
    """A finding that JSON cannot hold."""
    found = guess(path)
    found.finding["causes"][0]["probability"] = float("nan")
    return found
