"""Compilation shown on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from threading import Timer
from time import perf_counter

from adaptctl.compilation.watch import watching

PATIENCE = 1.0
"""Seconds of compilation in all after which it is shown."""
TEXT = "adaptctl: compiling to native code, which the next run finds in the cache ..."


class Announcement:
    """Watcher that shows something while compilation goes on, once it has taken a second in all."""

    def __init__(self, show: Callable[[], object], hide: Callable[[], object]) -> None:
        self._show, self._hide, self._left, self._shown = show, hide, PATIENCE, False

    @contextmanager
    def __call__(self) -> Iterator[None]:
        """Context manager of one compilation."""
        timer, started = Timer(max(self._left, 0.0), self._appear), perf_counter()
        timer.daemon = True
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


def compilation_shown() -> AbstractContextManager[None]:
    """Context manager that shows compilation as a line on stderr, where that is a terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        return nullcontext()
    return watching(Announcement(lambda: _put(TEXT), lambda: _put("\r\x1b[K")))


def _put(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()
