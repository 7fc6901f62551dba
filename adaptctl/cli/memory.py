"""Memory of a command."""

from __future__ import annotations

from contextlib import suppress

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
