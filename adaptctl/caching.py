"""Properties that are computed once and never sent: objects reach other processes as what they are made of."""

from __future__ import annotations

import copyreg
import functools
import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Self, TypeVar, cast, overload

import numpy as np

Value = TypeVar("Value")


class cached_property(functools.cached_property[Value]):  # noqa: N801  # stands for functools' own
    """A property computed when it is first asked for, as functools' is, with two differences.

    No lock is held meanwhile: a process that forks while a thread computes, such as a compilation, would inherit the
    lock held, and wait for ever (Python 3.12 has done away with it too). And values are dropped, not sent, when an
    object is copied or pickled: native code cannot be sent, and what is computed can be computed again.
    """

    def __set_name__(self, owner: type[Any], name: str) -> None:
        super().__set_name__(owner, name)
        if "__getstate__" not in vars(owner):
            for method, does in (("__getstate__", without_caches), ("__setstate__", restored)):
                setattr(owner, method, does)

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> Value: ...

    def __get__(self, instance: object | None, owner: type[Any] | None = None) -> Self | Value:
        if instance is None:
            return self
        values, name = vars(instance), str(self.attrname)
        if name not in values:
            values[name] = self.func(instance)
        value: Value = values[name]
        return value


class _Replaced:
    """A method that instances replace by one of their properties."""

    def __init__(self, method: Callable[..., Any], by: str) -> None:
        self.method, self.by = method, by

    def __get__(self, instance: object | None, owner: type[Any]) -> Any:
        if instance is None:
            return self.method
        replacement, name = getattr(instance, self.by), self.method.__name__
        if inspect.getattr_static(owner, name) is self:  # and not a subclass that has its own, and asks for this one
            vars(instance)[name] = replacement
        return replacement


Method = TypeVar("Method", bound=Callable[..., Any])


def replaced_by(name: str) -> Callable[[Method], Method]:
    """Have an instance's property of this name called in place of a method, which then only tells what it does.

    The property is kept where the method would be looked up: what is native is called with no step through Python.
    """

    def replaced(method: Method) -> Method:
        stands: Any = _Replaced(method, name)
        return cast(Method, stands)

    return replaced


def without_caches(instance: object) -> tuple[dict[str, Any], tuple[str, ...]]:
    """The attributes of an object without its caches, by name, and the names of its read-only arrays."""
    kind = type(instance)
    caches = cached_property, _Replaced
    kept = {k: v for k, v in vars(instance).items() if not isinstance(inspect.getattr_static(kind, k, None), caches)}
    return kept, tuple(k for k, v in kept.items() if isinstance(v, np.ndarray) and not v.flags.writeable)


def restored(instance: object, state: tuple[dict[str, Any], tuple[str, ...]]) -> None:
    """Make an object of that again."""
    kept, frozen = state
    vars(instance).update(kept)
    for name in frozen:
        kept[name].flags.writeable = False


def _proxy(content: Mapping[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(dict(content))


def _reduced(proxy: MappingProxyType[Any, Any]) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    return _proxy, (dict(proxy),)


copyreg.pickle(MappingProxyType, _reduced)
