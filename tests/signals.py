"""Signals sent to this process at a place in its code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def signalled(function: str, number: signal.Signals, after: float = 0.0) -> Iterator[None]:
    """Send this process a signal when the main thread calls a function of that qualified name, or when the process has
    computed for some time (s) since. However brief the call is, it is seen."""
    over = threading.Event()

    def wait() -> None:
        start = time.process_time()
        while not over.is_set() and time.process_time() < start + after:
            time.sleep(0.001)
        if not over.is_set():
            os.kill(os.getpid(), number)

    waiting = threading.Thread(target=wait)

    def called(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_qualname == function:
            sys.setprofile(None)
            waiting.start() if after else signal.raise_signal(number)

    sys.setprofile(called)
    try:
        yield
    finally:
        sys.setprofile(None)
        over.set()
        if waiting.ident:
            waiting.join()
