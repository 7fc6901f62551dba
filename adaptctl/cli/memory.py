"""Memory of a command."""

from __future__ import annotations

import atexit
import functools
import gc
from collections.abc import Iterator
from contextlib import contextmanager

COLLECTED_AFTER = 20_000
"""new objects after which cycles among them are looked for: those of imports are none"""


@contextmanager
def collecting_seldom() -> Iterator[None]:
    """Look for cycles of unused objects seldom, and never as the process ends: a tenth of a short command's time."""
    before = gc.get_threshold()
    gc.set_threshold(max(COLLECTED_AFTER, before[0]), *before[1:])
    _leave_all_at_exit()
    try:
        yield
    finally:
        gc.set_threshold(*before)


@functools.cache
def _leave_all_at_exit() -> None:
    atexit.register(gc.freeze)
