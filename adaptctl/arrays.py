"""Arrays of numbers from outside: checked, frozen, one number or one a joint; and scalars gathered into arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.errors import InputError, NonFiniteError, printable

Array = NDArray[np.float64]
Given = ParamSpec("Given")


class HasName(Protocol):
    """Protocol of an object with a `name`, by which errors call the owner of wrong numbers."""

    @property
    def name(self) -> str:
        """The object's name."""


Named = TypeVar("Named", bound=HasName)


def frozen(array: Array) -> Array:
    """The same array of any shape, read-only from now on."""
    array.flags.writeable = False
    return array


def frozen_array(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """A read-only float64 copy. Raises `InputError` when its shape is wrong or an entry is not finite."""
    array = numbers(values, what, f"of shape {shape}").copy()
    if array.shape != shape:
        raise InputError(f"{what}: expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{what}: expected finite numbers, got {array.tolist()}")
    return frozen(array)


def numbers(values: ArrayLike, what: str, kind: str = "") -> Array:
    """A float64 array of any shape. Raises `InputError` for what holds no numbers, such as strings or numbers beyond a
    double."""
    try:
        if getattr(getattr(values, "dtype", None), "kind", "") == "c":
            raise TypeError("complex numbers have no place here")
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what}: expected numbers {kind}".rstrip() + f", got {values!r}") from error


def checked(values: ArrayLike, size: int, what: str) -> Array:
    """A finite float64 array (..., size). Raises `InputError` on a wrong shape and `NonFiniteError` on NaN or infinity,
    saying what was expected and what came."""
    array = numbers(values, what, f"of shape (..., {size})")
    if array.ndim == 0 or array.shape[-1] != size:
        raise InputError(f"{what}: expected shape (..., {size}), got {array.shape}")
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise NonFiniteError(f"{what}: expected finite numbers, got {array[place]} at index {place}")
    return array


def writable(out: Array, shape: tuple[int, ...], what: str) -> Array:
    """The array `out`, to which a result of this shape can be written. Raises `InputError` unless it is a writable
    array of float64 of that shape."""
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != np.float64 or not out.flags.writeable:
        kind = f"{out.dtype} of shape {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise InputError(f"{what}: out: expected an array of float64 to write to, of shape {shape}, got {kind}")
    return out


def per_joint(values: ArrayLike, dof: int, what: str) -> Array:
    """One number a joint (dof,), from one for all joints or one each: a read-only copy. Infinity is allowed.

    Raises `InputError` on a wrong shape and `NonFiniteError` on NaN.
    """
    array = numbers(values, what)
    if array.shape not in ((), (dof,)):
        raise InputError(f"{what}: expected a number or {dof} of them, got shape {array.shape}")
    if np.isnan(array).any():
        raise NonFiniteError(f"{what}: expected numbers, got {array.tolist()}")
    each = np.empty(dof)
    each[:] = array
    return frozen(each)


def positive_number(value: object, what: str) -> float:
    """A positive finite number. Raises `InputError` for all else, texts and numbers beyond a double too."""
    value = value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value
    try:
        number = float(value) if isinstance(value, int | float | np.number) else math.nan
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{what}, got {printable(repr(value))}")
    return number


def real_number(value: object, what: str) -> float:
    """A number, also NaN and infinity. Raises `InputError` for all else, texts and arrays of several numbers too."""
    if isinstance(value, int | float | np.number) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return float(numbers(value, what))
    raise InputError(f"{what}: expected a number, got {printable(repr(value))}")


def whole_number(value: object, what: str, least: int, most: int) -> int:
    """A whole number from `least` to `most`. Raises `InputError` for all else."""
    if isinstance(value, int | np.integer) and least <= value <= most:
        return int(value)
    raise InputError(f"{what}: expected a whole number from {least} to {most}, got {printable(repr(value))}")


def whole_count(value: object, what: str, least: int = 0) -> int:
    """A whole number of at least `least`, 0 unless given. Raises `InputError` for all else, such as 2.0, NaN, texts and
    booleans."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InputError(f"{what}: expected a whole number of at least {least}, got {printable(repr(value))}")
    return int(value)


def finite_results(method: Callable[Concatenate[Named, Given], Array]) -> Callable[Concatenate[Named, Given], Array]:
    """A method on arrays that raises `NonFiniteError` rather than return what is not finite, its numbers being too
    large to go on with."""

    @wraps(method)
    def required(self: Named, /, *args: Given.args, **kwargs: Given.kwargs) -> Array:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            result = method(self, *args, **kwargs)
        if not np.isfinite(result).all():
            place = tuple(int(i) for i in np.argwhere(~np.isfinite(result))[0])
            raise NonFiniteError(
                f"{self.name}: {method.__name__} is not finite at index {place}: "
                "the mass matrix is singular, or numbers are too large"
            )
        return result

    return required


def same_samples(**arrays: Array) -> tuple[int, ...]:
    """The common sample axes, broadcast, of arrays (..., n). Raises `InputError` where they do not broadcast."""
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
    except ValueError as error:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(f"sample axes do not fit together: {shapes}") from error


def stacked(entries: Sequence[Any], samples: tuple[int, ...]) -> Array:
    """The array (..., n) of n scalars gathered along a new last axis; constants are repeated over the samples."""
    out = np.empty((*samples, len(entries)))
    for i, entry in enumerate(entries):
        out[..., i] = entry
    return out


def stacked_rows(rows: Sequence[Iterable[Any]], samples: tuple[int, ...]) -> Array:
    """The array (..., rows, columns) of rows of scalars."""
    flat = [entry for row in rows for entry in row]
    return stacked(flat, samples).reshape(*samples, len(rows), len(flat) // max(len(rows), 1))
