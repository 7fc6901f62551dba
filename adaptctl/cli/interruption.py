"""Interruptions (Ctrl-C, SIGTERM, SIGHUP) that are never lost, so that what was computed is kept."""

from __future__ import annotations

import errno
import io
import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from adaptctl.cli.heartbeat import heartbeat

if TYPE_CHECKING:
    from types import FrameType, TracebackType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, what batch systems send before they kill, and the end of a terminal or connection."""
IMPORTING = "<frozen importlib._bootstrap>"
RETRY_DELAY = 0.01
"""s after which a signal is sent again that came at a wrong moment"""
IMPORT_TIMEOUT = 3.0
"""s that an import is given to end"""

_since: dict[int, float] = {}
"""Signals that wait for an import to end, and since when (s)."""


def raised(number: int, frame: FrameType | None) -> None:
    """
    Handle a signal by raising `KeyboardInterrupt`, after an import that is under way.

    An exception within Python's import code would leave its lock taken for ever, and within a module's be changed or
    lost: the signal is sent again every 10 ms, for up to 3 s.
    """
    innermost = frame is not None and frame.f_code.co_filename == IMPORTING
    waited = time.monotonic() - _since.setdefault(number, time.monotonic())
    if innermost or (_importing(frame) and waited < IMPORT_TIMEOUT):
        _send_again(number)
        return
    del _since[number]
    if number == signal.SIGHUP:
        _leave_terminal()
    raise KeyboardInterrupt


def _send_again(number: int) -> None:
    threading.Timer(RETRY_DELAY, signal.pthread_kill, (threading.main_thread().ident or 0, number)).start()


def repeated_where_lost() -> None:
    """
    Send interruptions again whose exception did not arrive.

    Native code, destructors and callbacks may drop it: the command would go on, with what they left half done.
    """
    told, shown = sys.unraisablehook, sys.excepthook

    def dropped(unraisable: sys.UnraisableHookArgs, /) -> None:
        if unraisable.exc_type is not KeyboardInterrupt:
            told(unraisable)
        elif threading.current_thread() is threading.main_thread():
            _send_again(signal.SIGINT)

    def printed(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if kind is not KeyboardInterrupt:  # printed of one that is dropped; none ends a command
            shown(kind, error, trace)

    sys.unraisablehook, sys.excepthook = dropped, printed


def not_ignored() -> tuple[signal.Signals, ...]:
    """`SIGNALS`, without a SIGHUP that is ignored, as under nohup."""
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return tuple(number for number in SIGNALS if number != signal.SIGHUP or not ignored)


def _leave_terminal() -> None:
    """Print to nowhere where the terminal is gone, and ignore further SIGHUPs: shells send two."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    for stream in (1, 2):
        with suppress(OSError):  # closed
            if stat.S_ISCHR(os.fstat(stream).st_mode) and not os.isatty(stream):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, stream)
                os.close(nowhere)


class _Terminal(io.FileIO):
    """Stream of a terminal; once that is gone, output is dropped, since a signal says so."""

    def write(self, data: Any, /) -> int:
        heartbeat.heard(bytes(data))
        try:
            return super().write(data)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return len(data)


def keep_without_terminal() -> None:
    """Let printing to a terminal that was closed be no error: a signal ends the command, or nohup lets it go on."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper) and stream.isatty():
            raw = io.BufferedWriter(_Terminal(stream.fileno(), "w", closefd=False))
            kept = io.TextIOWrapper(raw, stream.encoding, stream.errors, line_buffering=True)
            setattr(sys, name, kept)


def _importing(frame: FrameType | None) -> bool:
    """True where a frame, or one that called it, is Python's own code that imports."""
    while frame is not None:
        if frame.f_code.co_filename == IMPORTING:
            return True
        frame = frame.f_back
    return False


class Interruption:
    """Record of a request to end the program; `asked` is True once there was one."""

    def __init__(self) -> None:
        self.asked = False
        self._held = False

    def hold(self) -> None:
        """Only note the next signal, so that results are written; one more raises `KeyboardInterrupt`."""
        self._held = True

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal, in the manner of Python's signal handlers."""
        self.asked = True
        if self._held and number == signal.SIGHUP:
            _leave_terminal()
        elif self._held:
            self._held = False
            os.write(2, b"adaptctl: results are being written; interrupt once more to leave them\n")
        else:
            raised(number, frame)

    def heeded(self, progress: Callable[[str, float], object]) -> Callable[[str, float], None]:
        """
        Progress callback that raises `KeyboardInterrupt` once a signal has asked for an end.

        Python loses an exception that a handler raises inside a destructor or callback; here the request is found
        again. The end of a stage passes.
        """

        def checked(what: str, share: float) -> None:
            if self.asked and share < 1.0:
                raise KeyboardInterrupt
            progress(what, share)

        return checked


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Context manager in which `SIGNALS` raise `KeyboardInterrupt` and are noted."""
    interruption = Interruption()

    try:
        before = {number: signal.signal(number, interruption.interrupt) for number in not_ignored()}
    except ValueError:  # not in the main thread, where signals do not arrive
        yield interruption
        return
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
