"""Counts from outside: whole numbers, of members, steps, threads, and scalars in a column."""

from __future__ import annotations

import numpy as np

from adaptctl.errors import InputError, printable


def require_count(value: object, what: str, least: int = 0) -> int:
    """The count `value`, a whole number of at least `least`, 0 unless given, as an int. Raises `InputError`, which
    begins with `what`, for all else, such as 2.0, NaN, texts and booleans."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{what}: expected a whole number of at least {least}, got {printable(repr(value))}")
    return int(value)
