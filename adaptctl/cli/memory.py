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
LARGE, SPARE = 2**20, 2**22
"""bytes of such a block, an array of a run, and of what small ones leave: to fetch it again and again takes time"""


def return_large_blocks() -> None:
    """Give freed arrays back to the system, where glibc would keep them: a tenth of an experiment's peak."""
    import ctypes  # at use: many commands need none

    with suppress(AttributeError, OSError, TypeError):  # another library of C
        library = ctypes.CDLL(None)
        library.mallopt(MMAP_THRESHOLD, LARGE)
        library.mallopt(TRIM_THRESHOLD, SPARE)


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
