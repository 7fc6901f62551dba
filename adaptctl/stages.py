"""Stages of a computation, told by name as they begin and end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import TypeAlias

COMPILING = "compiling to native code, which the next run finds in the cache"
Watcher: TypeAlias = Callable[[object], AbstractContextManager[object]]

_watcher: ContextVar[Watcher] = ContextVar("_watcher", default=nullcontext)


@contextmanager
def stage(name: object) -> Iterator[None]:
    """Context manager, or decorator, of a stage that a watcher is told of; its text may change meanwhile."""
    with _watcher.get()(name):
        yield


@contextmanager
def watching(watcher: Watcher) -> Iterator[None]:
    """Context manager within which each stage of this thread runs in one of a watcher."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)
