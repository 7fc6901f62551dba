"""Internal states as arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import copy
from functools import cache
from itertools import accumulate
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, numbers
from adaptctl.errors import InputError, TraceError, shown
from adaptctl.scalars import Column, where
from adaptctl.scalars.scalar import Condition


def either(condition: Condition, yes: Column, no: Column) -> Column:
    """Entries of one column or of another."""
    return Column(where(condition, x, y) for x, y in zip(yes, no, strict=True))


def checked_step(law: Any, *given: Any) -> Any:
    """Result of `law.law`, else `TraceError`."""
    try:
        return law.law(*given)
    except TypeError as error:
        if "'Column'" not in str(error):
            raise
        raise TraceError(
            f"{type(law).__name__}.law: {error}: NumPy's functions and matrices, comparisons, min and max do not "
            "accept a Column: apply the functions of adaptctl.scalars to each scalar, as in Column(tanh(x) for x in "
            "e); where, minimum, maximum and clip are among them"
        ) from error


def validate_state(law: Any, state: Any) -> Any:
    """Checked first state, else `InputError`."""
    if not _is_state(state):
        raise InputError(
            f"{type(law).__name__}.initial_state: expected it to return a NamedTuple of arrays, or () for no state, "
            f"got {shown(state)}"
        )
    return state


def _is_state(given: Any) -> bool:
    named = isinstance(given, tuple) and (not given or hasattr(given, "_fields"))
    return named and all(_is_state(part) if isinstance(part, tuple) else np.ndim(part) > 0 for part in given)


def validate_point(law: Any, point: Any) -> Any:
    """Three parts of a reference, else `InputError`."""
    if not isinstance(point, tuple) or len(point) != 3:
        what = f"{type(law).__name__}: reference: expected a ReferencePoint, as reference(t) is one"
        raise InputError(f"{what}, got {shown(point)}")
    return point


def validate_step(law: Any, returned: Any) -> tuple[Column, Any]:
    """Checked torque and state, else `InputError`."""
    what = f"{type(law).__name__}.law: expected it to return the torque, a Column of {law.dof}, and the next state"
    if not isinstance(returned, tuple) or len(returned) != 2:
        raise InputError(f"{what}, got {type(returned).__name__}")
    torque, after = returned
    if not isinstance(torque, Column) or len(torque) != law.dof:
        got = f"a column of {len(torque)}" if isinstance(torque, Column) else type(torque).__name__
        raise InputError(f"{what}, got {got} for the torque")
    sizes = [len(part) for part in leaves(after)] if isinstance(after, tuple) else None
    if sizes != list(law._memory_sizes.values()):
        raise InputError(f"{what}, got another type of state than that of `initial_state`: {after!r:.80}")
    return torque, after


Memory = TypeVar("Memory", bound=tuple[Any, ...])  # a law's state: a NamedTuple of columns and of such states

Parts = tuple[tuple[str, Any], ...]  # names, each with a length, or with the type of a nested state in one array


def leaves(memory: tuple[Any, ...]) -> list[Any]:
    """Flat list of a state's columns."""
    flat: list[Any] = []
    for part in memory:
        if isinstance(part, tuple):
            flat.extend(leaves(part))
        else:
            flat.append(part)
    return flat


def paths(memory: tuple[Any, ...], to: str = "state") -> Iterator[str]:
    """Dotted names of a state's columns."""
    for name, part in zip(_names(memory), memory, strict=True):
        if isinstance(part, tuple):
            yield from paths(part, f"{to}.{name}")
        else:
            yield f"{to}.{name}"


def like(pattern: Memory, parts: Iterable[Any]) -> Memory:
    """State with a pattern's fields and these columns."""
    return _filled(pattern, iter(parts))


def _filled(pattern: Any, parts: Iterator[Any]) -> Any:
    filled: list[Any] = []
    for part in pattern:
        filled.append(_filled(part, parts) if isinstance(part, tuple) else next(parts))
    return type(pattern)(*filled)


def _names(memory: Any) -> tuple[str, ...]:
    return getattr(memory, "_fields", tuple(map(str, range(len(memory)))))


class PackedState(tuple[Any, ...]):
    """State whose columns are views of one array (..., n)."""

    __slots__ = ()
    __hash__ = None  # type: ignore[assignment]  # as arrays have none
    _parts: tuple[Callable[[Array], Any], ...]
    _kind: Callable[..., Any]

    @property
    def _array(self) -> Array:
        array: Array = tuple.__getitem__(self, 0)
        return array

    @classmethod
    def _of(cls, array: Array) -> Any:
        """State in this array."""
        return tuple.__new__(cls, (array,))

    def __new__(cls, *parts: Any) -> Any:
        """Ordinary state of these parts."""
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
    """Type of packed states with these fields and lengths."""
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
    """Arrays (N, n) or (n,) by name, checked."""
    columns = {}
    for (name, size), given in zip(sizes.items(), values, strict=True):
        array = _for_arms(numbers(given, name), size, arms, name)
        columns[name] = array.reshape(-1, size) if array.ndim > 2 else array
    return columns


def row_each(array: Array, arms: tuple[int, ...], name: str) -> Array:
    """Array (..., n) of each arm, checked."""
    size = array.shape[-1]
    array = _for_arms(array, size, arms, name)
    return array if array.shape[:-1] == arms else np.broadcast_to(array, (*arms, size))


def _for_arms(array: Array, size: int, arms: tuple[int, ...], name: str) -> Array:
    if array.shape not in ((*arms, size), (size,)):
        raise InputError(f"{name}: expected shape {(*arms, size)} or {(size,)}, got {array.shape}")
    return array
