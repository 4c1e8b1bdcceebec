"""One file a paper's tables and figures: what is printed, what comes out here, and the deviation."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cosim.files import write_text
from cosim.messages import did_you_mean
from driveline.quantities import InputError

# name: module of this package, which has SOURCE and run(out, progress) -> Findings
STUDIES: dict[str, str] = {
    "fom-validation": "fom_validation",
    "torque-meter-filter": "torque_meter_filter",
    "model-reduction": "model_reduction",
    "gears": "gears",
    "observability": "observability",
    "state-estimator": "state_estimator",
    "state-estimator-robustness": "state_estimator_robustness",
    "state-estimator-sensitivity": "state_estimator_sensitivity",
    "size-estimator": "size_estimator",
    "size-estimator-robustness": "size_estimator_robustness",
}

OPTIONS = ("workers", "cluster", "measurement")  # of the command line, for the studies that take them


def summary(name: str) -> str:
    """One line about a study: the first of its module's docstring (read, not imported)."""
    source = Path(__file__).with_name(f"{_module(name)}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]


def run(name: str, out: Path, progress: Callable[[float], None] | None = None, **size: Any) -> dict[str, Any]:
    """Run a study; write ``<name>.json`` and its pictures into the folder ``out``.

    Args:
        name: One of ``STUDIES``.
        progress: Called now and then with the share that is done, 0 to 1.
        size: Arguments of that study that make it smaller, or say how to run it; see its ``run``.

    Returns:
        What is in the JSON file.

    Raises:
        InputError: There is no such study, or it does not take such an argument.
    """
    study = importlib.import_module(f"{__name__}.{_module(name)}")
    known = list(inspect.signature(study.run).parameters)[2:]
    for argument in size:
        if argument in OPTIONS and argument not in known:
            taken = ", ".join(f"--{option}" for option in OPTIONS if option in known)
            raise InputError(f"study '{name}' takes no --{argument}" + (f", but {taken}" if taken else
                                                                        ": it has no options but --out"))
        if argument not in known:
            raise InputError(f"study '{name}' takes no '{argument}'{did_you_mean(argument, known)}")
    progress = progress or (lambda share: None)
    began = time.perf_counter()
    progress(0.0)
    findings = study.run(Path(out), progress, **size)
    progress(1.0)
    result = {
        "study": name,
        "source": study.SOURCE,
        "rows": [row.as_dict() for row in findings.rows],
        "figures": findings.figures,
        "run_seconds": round(time.perf_counter() - began, 3),
    }
    write_text(Path(out) / f"{name}.json", json.dumps(result, indent=2, allow_nan=False) + "\n")
    return result


def _module(name: str) -> str:
    if name not in STUDIES:
        raise InputError(f"there is no study '{name}'{did_you_mean(name, STUDIES)}")
    return STUDIES[name]
