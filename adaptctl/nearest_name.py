"""Hint of messages about unknown names: the known name that is nearest."""

from __future__ import annotations

from collections.abc import Iterable


def nearest_name(name: str, known: Iterable[str], least: float = 0.6) -> str:
    """The hint of an error message, such as " (did you mean 'puma560'?)", with that of the `known` names which is
    nearest to the unknown `name`; the empty text where none is near. `least` is the least likeness that counts, from 0
    to 1, as `difflib` measures it, by default 0.6."""
    from difflib import get_close_matches  # here, since only errors need it

    close = get_close_matches(name, list(known), n=1, cutoff=least)
    return f" (did you mean {close[0]!r}?)" if close else ""
