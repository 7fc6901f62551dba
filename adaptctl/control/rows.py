"""Numbers of many arms as rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.errors import InputError


def rows_of_arms(values: Iterable[ArrayLike], sizes: Mapping[str, int], arms: tuple[int, ...]) -> dict[str, Array]:
    """Numbers (..., n) of each arm as rows (N, n), those of one arm (n,) for all as they are."""
    columns = {}
    for (name, size), given in zip(sizes.items(), values, strict=True):
        try:
            numbers = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{name}: expected numbers, got {given!r}") from error
        if numbers.shape not in ((*arms, size), (size,)):
            raise InputError(f"{name}: expected shape {(*arms, size)} or {(size,)}, got {numbers.shape}")
        columns[name] = numbers.reshape(-1, size) if numbers.ndim > 2 else numbers
    return columns


def row_each(array: Array, arms: tuple[int, ...], name: str) -> Array:
    """Numbers (..., n) of each arm, those of one arm (n,) for all."""
    size = array.shape[-1]
    if array.shape not in ((*arms, size), (size,)):
        raise InputError(f"{name}: expected shape {(*arms, size)} or {(size,)}, got {array.shape}")
    return array if array.shape[:-1] == arms else np.broadcast_to(array, (*arms, size))
