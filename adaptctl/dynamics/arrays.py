"""Between arrays with sample axes and columns of scalars, and between few parameters and all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.errors import InputError, NonFiniteError
from adaptctl.mechanism.pose import Array
from adaptctl.scalars import Column


def checked(values: ArrayLike, size: int, what: str) -> Array:
    """A finite float64 array (..., size), or an error that says what was expected and what came."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: expected numbers of shape (..., {size}), got {values!r}") from error
    if array.ndim == 0 or array.shape[-1] != size:
        raise InputError(f"{what}: expected shape (..., {size}), got {array.shape}")
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise NonFiniteError(f"{what}: expected finite numbers, got {array[place]} at index {place}")
    return array


def same_samples(**arrays: Array) -> tuple[int, ...]:
    """The common sample axes, broadcast, of arrays (..., n)."""
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
    except ValueError as error:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(f"sample axes do not fit together: {shapes}") from error


def column(array: Array) -> Column:
    """The entries along the last axis: floats for one sample, arrays of samples otherwise."""
    if array.ndim == 1:
        return Column(array.tolist())
    return Column(array[..., i] for i in range(array.shape[-1]))


def stacked(entries: Sequence[Any], samples: tuple[int, ...]) -> Array:
    """Scalars gathered along a new last axis; constants are repeated over the samples."""
    out = np.empty((*samples, len(entries)))
    for i, entry in enumerate(entries):
        out[..., i] = entry
    return out


def stacked_rows(rows: Sequence[Sequence[Any] | Column], samples: tuple[int, ...]) -> Array:
    """Rows of scalars gathered as (..., rows, columns)."""
    flat = stacked([entry for row in rows for entry in row], samples)
    return flat.reshape(*samples, len(rows), len(rows[0]) if rows else 0)


def spread(values: Column, columns: Sequence[int], size: int) -> Column:
    """Values at their columns, exact zeros elsewhere, so that the rest is never computed once traced."""
    entries: list[Any] = [0.0] * size
    for column, value in zip(columns, values, strict=True):
        entries[column] = value
    return Column(entries)
