"""Processes that share the work of one command."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.connection import wait
from typing import Any

COPIES = sys.platform == "linux"  # elsewhere a process cannot be copied, or not with the system's own threads in it


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def pool(count: int, begin: Callable[..., None] | None = None, given: tuple[Any, ...] = (), *,
         copied: bool = False) -> ProcessPoolExecutor:
    """Processes that end with this one, even if it is killed.

    Args:
        count: How many.
        begin: What each does first; a function of a module.
        given: Its arguments.
        copied: Copies of this process where the system has such: they are there at once, with ``given`` in them.
            Only for what no other thread of this process holds, as that would be held in a copy for ever. Otherwise,
            and on other systems, they start anew, and are sent what they are given.
    """
    method = "fork" if copied and COPIES else "spawn"
    return ProcessPoolExecutor(count, multiprocessing.get_context(method), _begin, (begin, given))


def _begin(begin: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin(*given)


def _end_with_parent() -> None:
    """Whoever is killed cannot say so to its workers, which would wait for work as long as the machine runs."""
    if (parent := multiprocessing.parent_process()) is not None:
        wait([parent.sentinel])
        os._exit(1)
