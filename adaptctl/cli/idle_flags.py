"""Flags that count for nothing beside others."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from cyclopts import App, Argument, ArgumentCollection

from adaptctl.errors import InputError


def idle_flags(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Raise `InputError` for a flag that has no effect, also at its default, where its value does not tell."""
    given = {".".join(one.keys): one for one in arguments if one.keys}
    for entry in fields(arguments[0].hint):
        idle, named = entry.metadata.get("idle"), any(token.source == "cli" for token in given[entry.name].tokens)
        if idle is not None and named and _stays(given[idle.setting], idle.value, arguments[0].hint):
            raise InputError(f"{given[entry.name].name}: has no effect {idle.why}")


def _stays(other: Argument, value: Any, kind: Any) -> bool:
    """True if a setting, given or not, has a value."""
    words = [token.value for token in other.tokens]
    if not words:
        return bool(getattr(kind, ".".join(other.keys)) == value)
    return tuple(map(float, words)) == value if isinstance(value, tuple) else words == [value]
