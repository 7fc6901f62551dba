"""Compilation shown among bars of progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Timer
from time import perf_counter

from adaptctl.stages import COMPILING

PATIENCE = 1.0
"""Seconds of compilation in all after which it is shown."""


class Announcement:
    """Watcher that shows something while compilation goes on, once it has taken a second in all."""

    def __init__(self, show: Callable[[], object], hide: Callable[[], object]) -> None:
        self._show, self._hide, self._left, self._shown = show, hide, PATIENCE, False

    @contextmanager
    def __call__(self, what: object) -> Iterator[None]:
        """Context manager of one stage, of which compilations count."""
        if what != COMPILING:
            yield
            return
        timer, started = Timer(max(self._left, 0.0), self._appear), perf_counter()
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
            timer.join()
            self._left -= perf_counter() - started
            if self._shown:
                self._shown = False
                self._hide()

    def _appear(self) -> None:
        self._shown = True
        self._show()
