"""Cached properties, left out of copies and pickles."""

from __future__ import annotations

import copyreg
import functools
import inspect
import operator
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Self, TypeVar, cast, overload

import numpy as np

Value = TypeVar("Value")
Owner = TypeVar("Owner")
Content = TypeVar("Content", bound=Mapping[Any, Any])
Path = tuple[Any, ...]
State = tuple[dict[str, Any], tuple[Path, ...]]


def sent_as_made(owner: type[Owner]) -> type[Owner]:
    """Class decorator for copies and pickles without caches."""
    if issubclass(owner, tuple):
        setattr(owner, "__reduce__", _record)  # noqa: B010  # a class of any kind
    elif "__getstate__" not in vars(owner):
        for method, does in (("__getstate__", without_caches), ("__setstate__", restored)):
            setattr(owner, method, does)
    return owner


class cached_property(functools.cached_property[Value]):  # noqa: N801  # named like functools' own
    """Property computed once, without a lock."""

    def __set_name__(self, owner: type[Any], name: str) -> None:
        super().__set_name__(owner, name)
        sent_as_made(owner)

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
    """Method that instances replace by one of their properties."""

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
    """Decorator: calls go to the instance's property `name`."""

    def replaced(method: Method) -> Method:
        substitute: Any = _Replaced(method, name)
        return cast(Method, substitute)

    return replaced


def without_caches(instance: object) -> State:
    """State of `instance` for copies and pickles."""
    kind = type(instance)
    caches = cached_property, _Replaced
    kept = {k: v for k, v in vars(instance).items() if not isinstance(inspect.getattr_static(kind, k, None), caches)}
    return kept, _read_only(kept)


def restored(instance: object, state: State) -> None:
    """Restore a state of `without_caches`."""
    kept, paths = state
    vars(instance).update(_protected(kept, paths))


def _read_only(content: Mapping[Any, Any]) -> tuple[Path, ...]:
    within = {(k, i): part for k, v in content.items() if type(v) is tuple for i, part in enumerate(v)}
    values: dict[Path, Any] = {(k,): v for k, v in content.items()} | within
    return tuple(path for path, v in values.items() if isinstance(v, np.ndarray) and not v.flags.writeable)


def _protected(content: Content, paths: tuple[Path, ...]) -> Content:
    for path in paths:
        array: Any = functools.reduce(operator.getitem, path, content)
        array.flags.writeable = False
    return content


def _record(instance: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    content = instance._asdict()
    return _recorded, (type(instance), content, _read_only(content))


def _recorded(kind: Callable[..., Any], content: dict[str, Any], paths: tuple[Path, ...]) -> Any:
    return kind(**_protected(content, paths))


def _proxy(content: dict[Any, Any], paths: tuple[Path, ...]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(_protected(content, paths))


def _reduced(proxy: MappingProxyType[Any, Any]) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    content = dict(proxy)
    return _proxy, (content, _read_only(content))


copyreg.pickle(MappingProxyType, _reduced)
