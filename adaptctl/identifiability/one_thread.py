"""Factorisations without the threads of the library that makes them, which cost far more than they save here."""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """The linear algebra within in one thread.

    OpenBLAS wakes a thread for every processor, and waits for each in a loop: where one is busy with something else,
    0.1 s instead of 0.1 ms, and seconds in all for a robot of many joints. Linear algebra of other threads is in one
    thread for so long too.
    """
    libraries = _libraries()
    with libraries.turn, libraries.controller.limit(limits=1, user_api="blas"):
        yield


class _Libraries(NamedTuple):
    """Their numbers of threads, set by one of ours at a `turn`, so that the numbers before come back."""

    controller: ThreadpoolController
    turn: threading.RLock


@functools.cache
def _libraries() -> _Libraries:
    """Those that are loaded when first asked for, NumPy's among them."""
    turn = threading.RLock()
    os.register_at_fork(before=turn.acquire, after_in_parent=turn.release, after_in_child=turn.release)
    return _Libraries(ThreadpoolController(), turn)
