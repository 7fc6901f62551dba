"""Ctrl-C while an arm is driven."""

from __future__ import annotations

import os
import select
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

STOPPING = b"adaptctl: stopping; Ctrl-C again uses the robot's own stop\n"
STDERR = 2


@contextmanager
def interruptions(told: Callable[[], None]) -> Iterator[None]:
    """Context in which Ctrl-C calls a function."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(number: int, frame: FrameType | None) -> None:
        told()

    before = signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def ignore_interruptions() -> None:
    """Ignore Ctrl-C until `interruptions` ends: nothing breaks off the robot's own stop."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def tell_of_stop() -> None:
    """Print a line on stderr, unless that would keep the control loop waiting, as a stopped terminal does."""
    with suppress(OSError):  # closed
        if select.select((), (STDERR,), (), 0.0)[1]:
            os.write(STDERR, b"\n" * os.isatty(STDERR) + STOPPING)
