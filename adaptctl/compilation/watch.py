"""Watchers of compilation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import TypeAlias

Watcher: TypeAlias = Callable[[], AbstractContextManager[object]]

_watcher: ContextVar[Watcher] = ContextVar("_watcher", default=nullcontext)


def watched() -> AbstractContextManager[object]:
    """Context manager of the compilation of one module."""
    return _watcher.get()()


@contextmanager
def watching(watcher: Watcher) -> Iterator[None]:
    """Context manager within which each compilation of this thread runs in one of a watcher."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)
