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
    """Handle a signal of this `number` by raising `KeyboardInterrupt`; `frame` is what was running, None for nothing.
    In the midst of an import nothing is raised yet: the signal is sent again every 10 ms, for up to 3 s, or longer
    while Python's own import code runs.

    That code takes a lock which every import needs: an exception between two of its lines leaves it taken, and other
    threads wait for ever. What a module does while it is imported makes other errors of the exception, or loses it.
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
    """Record of a user's request to end the program, made by a signal (Ctrl-C, SIGTERM): `asked` is True once there was
    one. It is False at construction."""

    def __init__(self) -> None:
        self.asked = False
        self._held = False

    def hold(self) -> None:
        """Record that results are being written from now on: the next signal is only noted, so that the writing ends,
        and one more raises `KeyboardInterrupt`."""
        self._held = True

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal of this `number`, in the manner of Python's signal handlers; `frame` is what was running.
        Sets the attribute `asked` to True and raises `KeyboardInterrupt`, in the midst of an import a moment later. The
        first signal after a call of `hold`, while results are being written, raises nothing: it prints a line on
        stderr."""
        self.asked = True
        if self._held:
            self._held = False
            os.write(2, b"adaptctl: results are being written; interrupt once more to leave them\n")
            return
        raised(number, frame)

    def heeded(self, progress: Callable[[str, float], object]) -> Callable[[str, float], None]:
        """A progress callback that passes its arguments, a stage's name and the fraction of it that is done, 0 to 1, on
        to `progress`. Once a signal has asked for an end and the fraction is below 1, it raises `KeyboardInterrupt` and
        passes nothing on.

        Python loses an exception that a signal's handler raises inside a destructor or a callback of its own; this is
        where the request is found again. The end of a stage passes, for the stage may just have ended because of the
        request.
        """

        def checked(what: str, share: float) -> None:
            if self.asked and share < 1.0:
                raise KeyboardInterrupt
            progress(what, share)

        return checked


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Context manager in which Ctrl-C (SIGINT) and SIGTERM raise `KeyboardInterrupt` and are noted in the
    `Interruption` that it yields; the earlier signal handlers are restored at its end. Outside the main thread, which
    alone gets signals, it changes nothing."""
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
