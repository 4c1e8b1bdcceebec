"""Processes that share the work of one command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from cosim import workers

_LEFT = """
import os, sys, time
from cosim import workers

if __name__ == "__main__":
    several = workers.pool(2, copied=sys.argv[1] == "copied")
    for _ in range(2):
        several.submit(time.sleep, 0.2)
    print(*several._processes, flush=True)
    time.sleep(60.0)
"""


def _alive(process: int) -> bool:
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"  # who ended and nobody has asked about
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("how", ["copied", "anew"])
def test_workers_of_a_process_that_is_killed_end(tmp_path, how):
    (tmp_path / "left.py").write_text(_LEFT, encoding="utf-8")
    parent = subprocess.Popen([sys.executable, tmp_path / "left.py", how], stdout=subprocess.PIPE, text=True,
                              env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
    with parent:
        found = [int(number) for number in parent.stdout.readline().split()]
        assert found and all(_alive(number) for number in found)
        parent.kill()
    until = time.monotonic() + 60.0
    while any(_alive(number) for number in found) and time.monotonic() < until:
        time.sleep(0.05)
    left = [number for number in found if _alive(number)]
    for number in left:
        os.kill(number, signal.SIGKILL)
    assert not left


def test_what_each_begins_with_and_does_is_the_same_where_a_system_has_no_copies(monkeypatch):
    for copies in (True, False):
        monkeypatch.setattr(workers, "COPIES", copies)
        with workers.pool(1, os.chdir, (os.sep,), copied=True) as several:
            assert several.submit(os.getcwd).result() == os.path.abspath(os.sep)


def test_cores_are_counted_where_a_system_does_not_say_which(monkeypatch):
    assert 1 <= workers.cores() <= os.cpu_count()
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    assert workers.cores() == os.cpu_count()
