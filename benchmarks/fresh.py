"""One FMU in a new process that has only FMPy: what starting it costs, and the memory of an instance.

    python benchmarks/fresh.py FMU [INSTANCES]

Prints JSON: seconds to ``import`` FMPy, to ``extract`` the archive, to ``start`` the first instance (read the
description, load, instantiate, initialize), for ``another`` instance; ``resident`` bytes an instance (null
where the system does not tell).
"""

import json
import sys
import tempfile
import time
from pathlib import Path

began = time.perf_counter()
import fmpy  # noqa: E402
from fmpy.fmi2 import FMU2Slave  # noqa: E402


def start(folder: str, name: str) -> FMU2Slave:
    """An initialized instance that has made a step."""
    described = fmpy.read_model_description(folder)
    slave = FMU2Slave(guid=described.guid, unzipDirectory=folder, instanceName=name,
                      modelIdentifier=described.coSimulation.modelIdentifier)
    slave.instantiate()
    slave.setupExperiment()
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.doStep(0.0, 1e-3)
    return slave


def resident() -> int | None:
    """Resident memory of this process [bytes]; Linux tells it in pages."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return None
    import resource

    return pages * resource.getpagesize()


def main(path: str, instances: int) -> None:
    """Start the FMU once, then more often."""
    clock = [began, time.perf_counter()]
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(path, folder)
        clock.append(time.perf_counter())
        alive = [start(folder, "first")]
        clock.append(time.perf_counter())
        before = resident()
        alive += [start(folder, f"instance {i}") for i in range(instances)]
        clock.append(time.perf_counter())
        grown = None if before is None else (resident() - before) / instances
        for slave in alive:
            slave.freeInstance()
    spans = [late - early for early, late in zip(clock, clock[1:])]
    print(json.dumps({**dict(zip(("import", "extract", "start"), spans)), "another": spans[3] / instances,
                      "resident": grown}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 20)
