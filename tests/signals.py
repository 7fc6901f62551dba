"""Signals sent to this process at a place in its code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def signalled(function: str, number: signal.Signals, after: float) -> Iterator[None]:
    """Send this process a signal when it has computed for some time (s) since its main thread is inside a function
    of that name."""
    main_thread, over = threading.main_thread().ident, threading.Event()

    def inside() -> bool:
        frame = sys._current_frames()[main_thread] if main_thread else None
        while frame is not None and frame.f_code.co_name != function:
            frame = frame.f_back
        return frame is not None

    def watch() -> None:
        while not over.is_set() and not inside():
            time.sleep(0.001)
        start = time.process_time()
        while not over.is_set() and time.process_time() < start + after:
            time.sleep(0.001)
        if not over.is_set():
            os.kill(os.getpid(), number)

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        watcher.join()
