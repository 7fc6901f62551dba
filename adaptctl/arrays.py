"""Checked arrays and numbers."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.errors import InputError, NonFiniteError, printable, shown

MAX_SETTING = 1e30
"""magnitude of settings, and the inverse of the smallest, so that products of several are finite and not 0"""
MIN_PERIOD, MAX_PERIOD, MAX_DURATION = 1e-9, 0.1, 1e9
"""shortest and longest control period and longest run in s: periods can be counted, and ms are not taken for s"""

Array = NDArray[np.float64]
Given = ParamSpec("Given")


class HasName(Protocol):
    """Object with a `name` for error messages."""

    @property
    def name(self) -> str:
        """Name for error messages."""


Named = TypeVar("Named", bound=HasName)


def frozen(array: Array) -> Array:
    """Make an array read-only in place and return it."""
    array.flags.writeable = False
    return array


def frozen_array(values: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """Read-only float64 copy of the given `shape`."""
    array = numbers(values, what, f"of shape {shape}").copy()
    if array.shape != shape:
        raise InputError(f"{what}: expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{what}: expected finite numbers, got {array.tolist()}")
    return frozen(array)


def numbers(values: ArrayLike, what: str, kind: str = "") -> Array:
    """Values as a float64 array, copied only if needed."""
    try:
        validate_plain(values)
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what}: expected numbers {kind}".rstrip() + f", got {shown(values)}") from error


def validate_plain(values: object) -> None:
    """Raise `TypeError` for complex numbers, durations, named fields and masked elements, which floats cannot hold."""
    if getattr(getattr(values, "dtype", None), "kind", "") in ("c", "m", "M", "V"):
        raise TypeError("complex numbers, durations and named fields are not supported")
    if type(values) is np.ndarray:
        return
    parts = values if isinstance(values, list | tuple) else (values,)
    if any(part is None for part in parts):
        raise TypeError("None is no number")
    if "numpy.ma" not in sys.modules:  # then there are no masks, and to look for them would import it
        return
    if any(isinstance(part, np.ma.MaskedArray) and np.ma.is_masked(part) for part in parts):
        raise TypeError("masked elements have no number")


def checked(values: ArrayLike, size: int, what: str) -> Array:
    """Finite numbers as a float64 array (..., size)."""
    array = numbers(values, what, f"of shape (..., {size})")
    if array.ndim == 0 or array.shape[-1] != size:
        raise InputError(f"{what}: expected shape (..., {size}), got {array.shape}")
    if not np.isfinite(array).all():
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise NonFiniteError(f"{what}: expected finite numbers, got {array[place]} at index {place}")
    return array


def vectors(values: ArrayLike, size: int, what: str) -> Array:
    """Finite numbers as a float64 array (..., size)."""
    return checked(np.atleast_1d(numbers(values, what)), size, what)


def writable(out: Array, shape: tuple[int, ...], what: str) -> Array:
    """`out` itself, checked for results of a `shape`."""
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != np.float64 or not out.flags.writeable:
        kind = f"{out.dtype} of shape {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise InputError(f"{what}: out: expected an array of float64 to write to, of shape {shape}, got {kind}")
    return out


def per_joint(values: ArrayLike, dof: int, what: str) -> Array:
    """Read-only float64 array (dof,), one number per joint."""
    array = numbers(values, what)
    if np.asarray(values).dtype == np.bool_:
        raise InputError(f"{what}: expected numbers, got {shown(values)}")
    if array.shape not in ((), (dof,)):
        raise InputError(f"{what}: expected a number or {dof} of them, got shape {array.shape}")
    if np.isnan(array).any():
        raise NonFiniteError(f"{what}: expected numbers, got {array.tolist()}")
    each = np.empty(dof)
    each[:] = array
    return frozen(each)


def positive_per_joint(values: ArrayLike, dof: int, what: str, *, infinite: bool = False) -> Array:
    """Read-only positive numbers (dof,), one per joint."""
    each = per_joint(values, dof, what)
    if not np.all((each > 0.0) & (infinite | np.isfinite(each))):
        raise InputError(f"{what}: expected positive numbers, got {each.tolist()}")
    return each


def positive_numbers(values: ArrayLike, what: str) -> Array:
    """Read-only positive finite numbers (n,), from one or n."""
    return positive_per_joint(values, numbers(values, what).size, what)


def positive_number(value: object, what: str, least: float = 1.0 / MAX_SETTING, most: float = MAX_SETTING) -> float:
    """Positive finite number from `least` to `most` as a float."""
    value = _alone(value)
    try:
        number = float(value) if _is_number(value) else math.nan
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and number > 0.0):
        raise InputError(f"{what}, got {printable(repr(value))}")
    if not least <= number <= most:
        raise InputError(f"{what}, from {least:g} to {most:g}, got {printable(repr(value))}")
    return number


def positive_period(value: object, what: str, least: float = MIN_PERIOD) -> float:
    """Control period in s as a float, from `least` to `MAX_PERIOD`."""
    return positive_number(value, f"{what}: expected a positive time in s (1 ms is 0.001)", least, MAX_PERIOD)


def real_number(value: object, what: str) -> float:
    """Real number as a float."""
    value = _alone(value)
    if _is_number(value):
        return float(numbers(value, what))
    raise InputError(f"{what}: expected a number, got {printable(repr(value))}")


def finite_number(value: object, what: str, least: float = 0.0) -> float:
    """Finite number of at least `least` as a float."""
    number = real_number(value, what)
    if not least <= number < math.inf:
        raise InputError(f"{what}: expected a finite number of at least {least:g}, got {printable(repr(value))}")
    return number


def whole_number(value: object, what: str, least: int, most: int) -> int:
    """Integer from `least` to `most`."""
    if _is_whole(value) and least <= value <= most:
        return int(value)
    raise InputError(f"{what}: expected a whole number from {least} to {most}, got {printable(repr(value))}")


def random_seed(value: object, what: str) -> int:
    """Seed from 0 to 2^32 - 1."""
    return whole_number(value, what, 0, 2**32 - 1)


def whole_count(value: object, what: str, least: int = 0) -> int:
    """Integer of at least `least`."""
    if _is_whole(value) and value >= least:
        return int(value)
    raise InputError(f"{what}: expected a whole number of at least {least}, got {printable(repr(value))}")


def _alone(value: object) -> object:
    return value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value


def _is_whole(value: object) -> TypeGuard[int | np.integer[Any]]:
    return isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)


def _is_number(value: object) -> TypeGuard[int | float | np.integer[Any] | np.floating[Any]]:
    return _is_whole(value) or isinstance(value, float | np.floating)


def finite_results(method: Callable[Concatenate[Named, Given], Array]) -> Callable[Concatenate[Named, Given], Array]:
    """Method decorator: `NonFiniteError` for results not finite."""

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
    """Common shape of the sample axes of arrays (..., n)."""
    try:
        return np.broadcast_shapes(*(array.shape[:-1] for array in arrays.values()))
    except ValueError as error:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise InputError(f"sample axes do not fit together: {shapes}") from error


def stacked(entries: Sequence[Any], samples: tuple[int, ...]) -> Array:
    """Float64 array (*samples, n) of n scalars."""
    out = np.empty((*samples, len(entries)))
    for i, entry in enumerate(entries):
        out[..., i] = entry
    return out


def stacked_rows(rows: Sequence[Iterable[Any]], samples: tuple[int, ...]) -> Array:
    """Float64 array (*samples, m, n) of m rows."""
    given = [list(row) for row in rows]
    widths = [len(row) for row in given]
    if len(set(widths)) > 1:
        raise InputError(f"rows: expected rows of one length, got {', '.join(map(str, widths))}")
    flat = [entry for row in given for entry in row]
    return stacked(flat, samples).reshape(*samples, len(given), max(widths, default=0))
