"""Interruptions (Ctrl-C, SIGTERM) that are never lost, so that what was computed is kept."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""Ctrl-C, and what batch systems send before they kill."""
IMPORTING = "<frozen importlib._bootstrap>"
SOON = 0.01
"""s after which a signal is sent again that came at a wrong moment"""
PATIENCE = 3.0
"""s that an import is given to end"""

_since: dict[int, float] = {}
"""Signals that wait for an import to end, and since when (s)."""


def raised(number: int, frame: FrameType | None) -> None:
    """Handle a signal by KeyboardInterrupt, at once or, in the midst of an import, soon.

    Python's own code that imports takes a lock which every import needs: an exception between two of its lines leaves
    it taken, and other threads wait for ever. What a module does while it is imported makes other errors of it: in
    `__set_name__` a RuntimeError, in a destructor nothing.
    """
    innermost = frame is not None and frame.f_code.co_filename == IMPORTING
    waited = time.monotonic() - _since.setdefault(number, time.monotonic())
    if innermost or (_importing(frame) and waited < PATIENCE):
        main = threading.main_thread().ident or 0
        threading.Timer(SOON, signal.pthread_kill, (main, number)).start()
        return
    del _since[number]
    raise KeyboardInterrupt


def _importing(frame: FrameType | None) -> bool:
    """True where a frame, or one that called it, is Python's own code that imports."""
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            return True
        frame = frame.f_back
    return False


class Interruption:
    """Flag of a user's request to end, set by a signal."""

    def __init__(self) -> None:
        self.asked = False
        self._held = False

    def hold(self) -> None:
        """Begin to write results: the next interruption is noted and lets the writing finish, one more ends it."""
        self._held = True

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal. Raises KeyboardInterrupt, as `raised` does, unless results are being written."""
        self.asked = True
        if self._held:
            self._held = False
            os.write(2, b"adaptctl: results are being written; interrupt once more to leave them\n")
            return
        raised(number, frame)

    def heeded(self, progress: Callable[[str, float], object]) -> Callable[[str, float], None]:
        """A `progress` callback that raises KeyboardInterrupt in the midst of a stage when an end was asked for.

        Python loses an exception that a signal raises inside a destructor or a callback of its own; this is
        where it is found again. The end of a stage passes, for the stage may just have ended because of it.
        """

        def checked(what: str, share: float) -> None:
            if self.asked and share < 1.0:
                raise KeyboardInterrupt
            progress(what, share)

        return checked


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Context in which any of SIGNALS raises KeyboardInterrupt, and is remembered."""
    interruption = Interruption()

    try:
        before = {number: signal.signal(number, interruption.interrupt) for number in SIGNALS}
    except ValueError:  # not in the main thread, where signals do not arrive
        yield interruption
        return
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
