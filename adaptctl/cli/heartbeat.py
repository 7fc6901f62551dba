"""Signs of life: what is computed, on stderr, where a command prints nothing for a second."""

from __future__ import annotations

import os
import re
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from time import monotonic

PATIENCE = 0.8
"""s without output after which a line tells what is computed"""
REDRAWN = 0.5
"""s between changes of that line, on a terminal"""
STDERR = 2
CONTROL = re.compile(rb"\x1b\[[0-9;?]*[A-Za-z]")
"""what moves, colours or erases on a terminal, and prints nothing"""


class Heartbeat:
    """Thread that tells on stderr what is computed: on a terminal in a line that goes, elsewhere in lines."""

    def __init__(self) -> None:
        self._what: object = "starting"
        self._shown, self._within_line = False, False
        self._started = self._last = monotonic()
        self._lock, self._stopped = threading.RLock(), threading.Event()

    def start(self) -> None:
        """Begin, unless there is no stderr or `ADAPTCTL_PROGRESS` is off."""
        if sys.stderr is None or os.environ.get("ADAPTCTL_PROGRESS") == "off":
            return
        beat = self._on_terminal if sys.stderr.isatty() else self._in_lines
        threading.Thread(target=beat, daemon=True).start()

    def stop(self) -> None:
        """End, and remove the line."""
        self._stopped.set()
        self.hide()

    def doing(self, what: str) -> None:
        """Name what is computed from now on."""
        self._what = what

    @contextmanager
    def during(self, what: object) -> Iterator[None]:
        """Context manager of one stage, which is named."""
        before, self._what = self._what, what
        try:
            yield
        finally:
            self._what = before

    def heard(self, data: bytes) -> None:
        """Make room for bytes that are printed on the terminal now; a line that they leave open is not overwritten."""
        with self._lock:
            self.hide()
            self._last = monotonic()
            if left := CONTROL.sub(b"", data):
                self._within_line = not left.endswith((b"\n", b"\r"))

    def hide(self) -> None:
        """Remove the line."""
        with self._lock:
            if self._shown:
                self._shown = False
                self._put("\r\x1b[K")

    def _text(self) -> str:
        return f"adaptctl: {self._what}, {monotonic() - self._started:.0f} s"

    def _put(self, text: str) -> None:
        try:
            os.write(STDERR, text.encode())
        except OSError:  # nobody reads it any more
            self._stopped.set()

    def _on_terminal(self) -> None:
        while not self._stopped.wait(REDRAWN if self._shown else PATIENCE / 4.0):
            with self._lock:
                if monotonic() - self._last >= PATIENCE and not self._within_line and not self._stopped.is_set():
                    self._put(f"\r\x1b[K{self._text()[: _columns() - 1]}")
                    self._shown = True

    def _in_lines(self) -> None:
        while not self._stopped.wait(PATIENCE):
            self._put(f"{self._text()}\n")


def _columns() -> int:
    with suppress(OSError):
        return os.get_terminal_size(STDERR).columns or 80
    return 80


heartbeat = Heartbeat()
"""That of this process; it is silent until started."""
