"""A law's memory between ticks: columns by name, and all of them in one array."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import copy
from functools import cache
from itertools import accumulate
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers
from adaptctl.errors import InputError, TraceError
from adaptctl.scalars import Column


def checked_step(law: Any, *given: Any) -> Any:
    """The torque and the next internal state, as the method `law` of the controller `law` returns them: the value of
    `law.law(*given)`, not checked. `given` are the arguments: positions, velocities, reference point, internal state.
    Raises `TraceError`, which names the controller, where the method applies a NumPy function to a `Column`, a vector
    of scalars of any kind, which takes none; other errors go through."""
    try:
        return law.law(*given)
    except TypeError as error:
        if "operand 'Column' does not support ufuncs" not in str(error):
            raise
        raise TraceError(
            f"{type(law).__name__}.law: NumPy's functions take no column: apply those of adaptctl.scalars to each of "
            "its scalars, as in Column(tanh(x) for x in e)"
        ) from error


def validate_step(law: Any, returned: Any) -> tuple[Column, Any]:
    """The torque, a `Column` (vector of scalars) of length r for r joints, and the internal state in `returned`, the
    value that the method `law` of the controller `law` returned. Raises `InputError` unless `returned` is a tuple of
    such a column and an internal state: a named tuple of as many columns, each as long, as the controller's method
    `start` gives."""
    what = f"{type(law).__name__}.law: expected it to return the torque, a Column of {law.dof}, and the memory after it"
    if not isinstance(returned, tuple) or len(returned) != 2:
        raise InputError(f"{what}, got {type(returned).__name__}")
    torque, after = returned
    if not isinstance(torque, Column) or len(torque) != law.dof:
        got = f"a column of {len(torque)}" if isinstance(torque, Column) else type(torque).__name__
        raise InputError(f"{what}, got {got} for the torque")
    sizes = [len(part) for part in leaves(after)] if isinstance(after, tuple) else None
    if sizes != list(law._memory_sizes.values()):
        raise InputError(f"{what}, got another memory than `start` gives: {after!r:.80}")
    return torque, after


Memory = TypeVar("Memory", bound=tuple[Any, ...])
"""A law's memory between ticks: a NamedTuple of columns and of such memories, arrays on the outside."""

Parts = tuple[tuple[str, Any], ...]
"""Names of a memory's parts, each with its length or, where it is a memory, with its type in one array."""


def leaves(memory: tuple[Any, ...]) -> list[Any]:
    """Flat list of the columns of `memory`, a control law's internal state. This is a (named) tuple of columns, arrays
    (..., n), n the length of each, or Columns (n scalars), in the order of its fields, and of further such tuples,
    whose columns are put at their position. Nothing is checked."""
    flat: list[Any] = []
    for part in memory:
        if isinstance(part, tuple):
            flat.extend(leaves(part))
        else:
            flat.append(part)
    return flat


def paths(memory: tuple[Any, ...], to: str = "state") -> Iterator[str]:
    """Iterator over the dotted names of the columns of `memory`, a control law's internal state, such as
    ``state.learning.filtered``. There is one for each column, in the order of the fields, those of a tuple within it at
    its position. `memory` is a (named) tuple of columns and of further such tuples; without field names a part's index,
    from 0, stands for its name. `to` is what names begin with, "state" unless given. Nothing is checked."""
    for name, part in zip(_names(memory), memory, strict=True):
        if isinstance(part, tuple):
            yield from paths(part, f"{to}.{name}")
        else:
            yield f"{to}.{name}"


def like(pattern: Memory, parts: Iterable[Any]) -> Memory:
    """A control law's internal state with the fields of `pattern`, a (named) tuple of columns and of further such
    tuples. Its columns are `parts`, in the order of the fields, those of a tuple within it at its position; the columns
    of `pattern` itself are not used. Raises `StopIteration` for too few parts; further ones are ignored."""
    return _filled(pattern, iter(parts))


def _filled(pattern: Any, parts: Iterator[Any]) -> Any:
    filled: list[Any] = []
    for part in pattern:
        filled.append(_filled(part, parts) if isinstance(part, tuple) else next(parts))
    return type(pattern)(*filled)


def _names(memory: Any) -> tuple[str, ...]:
    return getattr(memory, "_fields", tuple(map(str, range(len(memory)))))


class PackedState(tuple[Any, ...]):
    """Internal state of a control law, a named tuple of columns and of further such tuples, whose columns are views of
    one array (..., n), n their lengths together. Native code reads and makes that one array. `packed_state` makes the
    type for the internal states of one law.

    An instance is also one of the law's own named tuple, with the same fields; views are made when they are asked for.
    What is made of it with other parts, as by `_replace` or by calling its type with `parts`, is an ordinary named
    tuple. It is equal to itself alone and has no hash. Nothing is checked.
    """

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]  # as arrays have none
    _parts: tuple[Callable[[Array], Any], ...]
    _kind: Callable[..., Any]

    @property
    def _array(self) -> Array:
        """Columns (..., n) of the memory, one after the other."""
        array: Array = tuple.__getitem__(self, 0)
        return array

    @classmethod
    def _of(cls, array: Array) -> Any:
        """The memory whose columns are in this array. (Names begin with "_" as no part's does.)"""
        return tuple.__new__(cls, (array,))

    def __new__(cls, *parts: Any) -> Any:
        """An ordinary memory of these parts."""
        return cls._kind(*parts)

    def __iter__(self) -> Iterator[Any]:
        array = self._array
        return iter([part(array) for part in self._parts])

    def __len__(self) -> int:
        return len(self._parts)

    def __getitem__(self, place: Any) -> Any:
        return tuple(self)[place]

    def __eq__(self, other: object) -> bool:
        return self is other

    def __ne__(self, other: object) -> bool:
        return self is not other

    def __repr__(self) -> str:
        return repr(self._kind(*self))

    def _replace(self, **parts: Any) -> Any:
        return self._kind(*self)._replace(**parts)

    def __reduce__(self) -> Any:
        return self._kind, tuple(copy(part) if isinstance(part, tuple) else part.copy() for part in self)


def packed_state(memory: tuple[Any, ...]) -> type[PackedState]:
    """The subclass of `PackedState`, and of the type of `memory`, for internal states of a control law with the fields
    and column lengths of `memory`. This is a (named) tuple of columns (..., n), n the length of each, and of further
    such tuples. Instances of the class keep all columns in one array. Raises `IndexError` for a column that is one
    number, without an axis."""
    parts = zip(_names(memory), memory, strict=True)
    described = ((name, packed_state(x) if isinstance(x, tuple) else np.shape(x)[-1]) for name, x in parts)
    return _type(getattr(memory, "_kind", type(memory)), tuple(described))


@cache
def _type(kind: Any, parts: Parts) -> type[PackedState]:
    lengths = [_length(part) for _, part in parts]
    places = [slice(end - n, end) for n, end in zip(lengths, accumulate(lengths), strict=True)]
    views = tuple(_view(part, place) for (_, part), place in zip(parts, places, strict=True))
    named = {name: _field(view) for (name, _), view in zip(parts, views, strict=True)}
    own = {"__slots__": (), "_parts": views, "_kind": kind, "_length": sum(lengths)}
    return type(kind.__name__, (PackedState, kind), {**named, **own, "__module__": kind.__module__})


def _field(view: Callable[[Array], Any]) -> property:
    return property(lambda memory: view(memory._array))


def _length(part: Any) -> int:
    return part if isinstance(part, int) else part._length


def _view(part: Any, place: slice) -> Callable[[Array], Any]:
    if isinstance(part, int):
        return lambda array: array[..., place]
    if not part._parts:
        return lambda array: part._kind()
    return lambda array: part._of(array[..., place])


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
