"""Memory of a command."""

from __future__ import annotations

from contextlib import suppress

MMAP_THRESHOLD = -3
"""glibc's name for the bytes from which blocks are the system's"""
LARGE = 2**20
"""bytes of such a block: an array of a run"""


def return_large_blocks() -> None:
    """Give freed arrays back to the system, where glibc would keep them: a tenth of an experiment's peak."""
    import ctypes  # at use: many commands need none

    with suppress(AttributeError, OSError, TypeError):  # another library of C
        ctypes.CDLL(None).mallopt(MMAP_THRESHOLD, LARGE)
