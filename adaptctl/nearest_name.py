"""Hint of messages about unknown names: the known name that is nearest."""

from __future__ import annotations

from collections.abc import Iterable


def nearest_name(name: str, known: Iterable[str], least: float = 0.6) -> str:
    """Hint for an error message, such as " (did you mean 'puma560'?)", with the one of the `known` names that is
    nearest to the unknown `name`; the empty text where none is near. A name is near from a similarity of `least` on,
    0.6 by default, as `difflib` measures it, from 0 to 1. Nothing is checked."""
    from difflib import get_close_matches  # here, since only errors need it

    close = get_close_matches(name, list(known), n=1, cutoff=least)
    return f" (did you mean {close[0]!r}?)" if close else ""
