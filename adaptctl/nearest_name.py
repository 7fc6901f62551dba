"""Hint of messages about unknown names: the known name that is nearest."""

from __future__ import annotations

from collections.abc import Iterable


def nearest_name(name: str, known: Iterable[str], least: float = 0.6) -> str:
    """The known name that is nearest to an unknown one, as text in brackets that asks for it; empty where none comes
    near. `least` is the least likeness, from 0 to 1, by `difflib`."""
    from difflib import get_close_matches  # here, since only errors need it

    close = get_close_matches(name, list(known), n=1, cutoff=least)
    return f" (did you mean {close[0]!r}?)" if close else ""
