"""How a process is asked to end, and ends in order."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator

_ASKING = ("SIGTERM", "SIGHUP")  # of a batch system, a container or a terminal that closed


class Ended(KeyboardInterrupt):
    """A signal asked the process to end.

    Attributes:
        code: With which it does.
    """

    def __init__(self, number: int, message: str) -> None:
        super().__init__(message)
        self.code = 128 + number


def asking() -> list[int]:
    """The signals, beside Ctrl-C's, by which a process is asked to end here."""
    return [number for name in _ASKING if (number := getattr(signal, name, None)) is not None]


@contextlib.contextmanager
def in_order() -> Iterator[None]:
    """Whoever asks this process to end has it end as by Ctrl-C: nothing half-written stays, and no worker.

    Raises:
        Ended: It was asked to.
    """
    if threading.current_thread() is not threading.main_thread():  # which alone hears of it
        yield
        return
    own = os.getpid()

    def end(number: int, _: object) -> None:
        # a worker has this from the process it was forked from, which ends it in order
        if os.getpid() == own:
            raise Ended(number, "terminated")

    numbers = [number for number in asking() if signal.getsignal(number) == signal.SIG_DFL]  # not ignored, as by nohup
    for number in numbers:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)
