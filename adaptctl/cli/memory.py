"""Memory of a command."""

from __future__ import annotations

import atexit
import functools
import gc
from collections.abc import Iterator
from contextlib import contextmanager, suppress

COLLECTED_AFTER = 20_000
"""new objects after which cycles among them are looked for: those of imports are none"""
MMAP_THRESHOLD, TRIM_THRESHOLD = -3, -1
"""glibc's names for the bytes from which blocks are the system's, and for those that the heap keeps free at its end"""
LARGE = 2**22
"""bytes of such a block, and of what stays in the heap: to fetch a run's smaller arrays again and again takes time"""


def return_large_blocks() -> None:
    """Give freed arrays back to the system, where glibc would keep them."""
    import ctypes  # at use: many commands need none

    with suppress(AttributeError, OSError, TypeError):  # another library of C
        library = ctypes.CDLL(None)
        for threshold in (MMAP_THRESHOLD, TRIM_THRESHOLD):
            library.mallopt(threshold, LARGE)


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
