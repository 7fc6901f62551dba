"""Numbers of many arms as rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers
from adaptctl.errors import InputError


def rows_of_arms(values: Iterable[ArrayLike], sizes: Mapping[str, int], arms: tuple[int, ...]) -> dict[str, Array]:
    """Dict of float64 arrays by name, made of the array-likes `values`, for N arms evaluated at once. An array (..., n)
    whose leading axes have the shape `arms`, whose product is N, becomes rows (N, n); an array (n,), the same for all
    arms, stays (n,). `sizes` maps names, in the order of `values`, to lengths n. Raises `InputError` for another shape
    and for values that are no numbers, `ValueError` for more or fewer `values` than `sizes`."""
    columns = {}
    for (name, size), given in zip(sizes.items(), values, strict=True):
        array = _for_arms(numbers(given, name), size, arms, name)
        columns[name] = array.reshape(-1, size) if array.ndim > 2 else array
    return columns


def row_each(array: Array, arms: tuple[int, ...], name: str) -> Array:
    """The n numbers (..., n) of each of some arms, from `array`, where the shape of the leading axes is `arms`. It is
    `array` itself where that has this shape, and a read-only view, repeated for all arms, of an `array` (n,). Raises
    `InputError` for another shape; `name` is the numbers' name in its message."""
    size = array.shape[-1]
    array = _for_arms(array, size, arms, name)
    return array if array.shape[:-1] == arms else np.broadcast_to(array, (*arms, size))


def _for_arms(array: Array, size: int, arms: tuple[int, ...], name: str) -> Array:
    """The array itself, (..., n) of each of the arms or (n,) for all. Raises `InputError` for another shape."""
    if array.shape not in ((*arms, size), (size,)):
        raise InputError(f"{name}: expected shape {(*arms, size)} or {(size,)}, got {array.shape}")
    return array
