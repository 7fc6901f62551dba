"""Settings with tunable numbers."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from itertools import accumulate
from math import prod
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.errors import InputError, NotFoundError, suggested_name
from adaptctl.scalars.column import Column


class Structure:
    """
    Identity of an object's native code: its class and the values that are compiled in.

    Parameters
    ----------
    of : object
        Object that the structure belongs to.
    key : hashable
        Class and values; structures with equal keys are equal, and their objects share native code.

    Raises
    ------
    TypeError
        If the key cannot be hashed.

    Examples
    --------
    >>> from adaptctl.scalars import Structure
    >>> Structure("a", ("gains", 2)) == Structure("b", ("gains", 2))
    True
    """

    __slots__ = ("_hash", "_key", "of")

    def __init__(self, of: Any, key: Hashable) -> None:
        self.of, self._key, self._hash = of, key, hash(key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Structure) and self._hash == other._hash and self._key == other._key

    def __hash__(self) -> int:
        return self._hash


class Keyed:
    """
    Base class of frozen dataclasses whose fields are compiled into native code as constants.

    Notes
    -----
    Objects of one class with equal field values have equal `structure` and share native code.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from adaptctl.scalars import Keyed
    >>> @dataclass(frozen=True)
    ... class Filter(Keyed):
    ...     order: int
    >>> Filter(2).structure == Filter(2).structure
    True
    """

    @cached_property
    def structure(self) -> Structure:
        """Identity of this object's native code."""
        return Structure(self, _fields_key(self))


class Tunable:
    """
    Base class of settings with tunable numbers, which can change without compiling again.

    Notes
    -----
    Tunable numbers are arguments of native code; other attributes are compiled in. The property `tunable` names the
    attributes, each a number, an array (n,) or (m, n), or None; a subclass overrides it with all names. Equations read
    them with `column` and `each`.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from adaptctl.scalars import Tunable
    >>> @dataclass(frozen=True)
    ... class Spring(Tunable):
    ...     stiffness: float
    ...     @property
    ...     def tunable(self):
    ...         return ("stiffness",)
    >>> Spring(2.0).structure == Spring(3.0).structure
    True
    >>> Spring(2.0).tuned({"stiffness": 4.0})
    Spring(stiffness=4.0)
    """

    @property
    def tunable(self) -> tuple[str, ...]:
        """Names of the tunable attributes, by default none."""
        return ()

    sparse: ClassVar[tuple[str, ...]] = ()
    """Those arrays (n,) whose zeros are compiled in; inherited."""
    unread: ClassVar[tuple[str, ...]] = ()
    """Those attributes that no equation reads, such as what only checks need; inherited."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "tunable" not in vars(cls):
            cls.tunable = ()  # type: ignore[assignment, method-assign]

    @property
    def tunable_parts(self) -> Mapping[str, Tunable]:
        """Attributes that are `Tunable` themselves, by name."""
        return {name: value for name, value in self._settings() if isinstance(value, Tunable)}

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Tunable numbers by name, such as ``adaptation.gain``."""
        given = {name: getattr(self, name) for name in self.tunable}
        own = {name: np.asarray(value, dtype=np.float64) for name, value in given.items() if value is not None}
        parts = self.tunable_parts.items()
        return own | {f"{part}.{name}": array for part, of in parts for name, array in of.numbers.items()}

    @cached_property
    def packed(self) -> Array:
        """All g tunable numbers as an array (g,), in the order of `numbers`."""
        return np.concatenate([np.zeros(0), *(array.ravel() for array in self.numbers.values())])

    def substituted(self, packed: Column) -> Self:
        """
        Return a copy whose tunable numbers are scalars of any kind, such as symbolic ones.

        Parameters
        ----------
        packed : Column
            All g tunable numbers (g,) in their own units and the order of `numbers`, matrices row by row; not checked.

        Returns
        -------
        Tunable
            Settings with the other numbers.

        Raises
        ------
        InputError
            If their number is wrong.

        Examples
        --------
        >>> from dataclasses import dataclass
        >>> from adaptctl.scalars import Column, Tunable
        >>> @dataclass(frozen=True)
        ... class Spring(Tunable):
        ...     stiffness: float
        ...     tunable = ("stiffness",)
        >>> float(Spring(2.0).substituted(Column([3.0])).stiffness)
        3.0
        """
        return self._having(self.unpacked(packed))

    def unpacked(self, packed: Column) -> dict[str, Any]:
        """
        Return the tunable numbers of a column by name.

        Parameters
        ----------
        packed : Column
            All g tunable numbers (g,) in their own units and the order of `numbers`, matrices row by row.

        Returns
        -------
        dict
            Scalars, columns (n,), and tuples of rows for matrices, by name.

        Raises
        ------
        InputError
            If their number is wrong.

        Examples
        --------
        >>> from dataclasses import dataclass
        >>> from adaptctl.scalars import Column, Tunable
        >>> @dataclass(frozen=True)
        ... class Spring(Tunable):
        ...     stiffness: float
        ...     tunable = ("stiffness",)
        >>> Spring(2.0).unpacked(Column([3.0]))
        {'stiffness': 3.0}
        """
        if len(packed) != self.packed.size:
            raise InputError(f"{type(self).__name__}: packed: expected {self.packed.size} numbers, got {len(packed)}")
        ends = accumulate(array.size for array in self.numbers.values())
        parts = zip(self.numbers.items(), ends, strict=True)
        return {name: _shaped(packed.of[end - array.size : end], array.shape) for (name, array), end in parts}

    def having(self, numbers: Mapping[str, Any]) -> Self:
        """
        Return a copy with other tunable numbers, which are not checked.

        Parameters
        ----------
        numbers : mapping
            New values by name, each a float, a symbolic scalar or an array with leading axes of samples, in the unit of
            the old value. Names that are not given keep their values.

        Returns
        -------
        Tunable
            Settings with the other numbers.

        Raises
        ------
        NotFoundError
            If a name is unknown.

        Examples
        --------
        >>> from dataclasses import dataclass
        >>> from adaptctl.scalars import Column, Tunable
        >>> @dataclass(frozen=True)
        ... class Spring(Tunable):
        ...     stiffness: float
        ...     tunable = ("stiffness",)
        >>> Spring(2.0).having({"stiffness": np.array([1.0, 2.0])}).stiffness.tolist()  # two samples
        [1.0, 2.0]
        """
        self._validate_named(numbers, self._names)
        return self._having(numbers)

    def _having(self, numbers: Mapping[str, Any]) -> Self:
        other = object.__new__(type(self))
        other.__dict__.update(self._settings())
        other.__dict__.update({name: value for name, value in numbers.items() if "." not in name})
        for name in self.sparse:
            if isinstance(given := other.__dict__[name], Column):
                other.__dict__[name] = Column(
                    x if own else 0.0 for x, own in zip(given, getattr(self, name), strict=True)
                )
        for name, part in self.tunable_parts.items():
            other.__dict__[name] = part._having(_within(name, numbers))
        return other

    def fixed(self) -> Self:
        """
        Return a copy whose arrays named by `sparse` are compiled in, so that multiplications by zero are left out.

        Returns
        -------
        Tunable
            The copy; its tunable parts are treated in the same way.
        """
        other = self._having({})
        other.__dict__.update({name: part.fixed() for name, part in self.tunable_parts.items()})
        if self.sparse:
            other.__dict__["tunable"] = tuple(name for name in self.tunable if name not in self.sparse)
        return other

    def tuned(self, numbers: Mapping[str, ArrayLike]) -> Self:
        """
        Return a copy with other tunable numbers, which are checked.

        Parameters
        ----------
        numbers : mapping
            Values by the names in `numbers`, such as "adaptation.gain", in their attributes' units; others stay.

        Returns
        -------
        Tunable
            Settings with the other numbers.

        Raises
        ------
        NotFoundError
            If a name is unknown.

        Examples
        --------
        >>> from dataclasses import dataclass
        >>> from adaptctl.scalars import Column, Tunable
        >>> @dataclass(frozen=True)
        ... class Spring(Tunable):
        ...     stiffness: float
        ...     tunable = ("stiffness",)
        >>> Spring(2.0).tuned({"stiffness": 4.0})
        Spring(stiffness=4.0)
        """
        self._validate_named(numbers, self.numbers)
        own: dict[str, Any] = {name: value for name, value in numbers.items() if "." not in name}
        parts = {name: part.tuned(_within(name, numbers)) for name, part in self.tunable_parts.items()}
        return replace(self, **own, **parts)  # type: ignore[type-var]  # what has names to tune is a dataclass

    @property
    def _names(self) -> tuple[str, ...]:
        parts = self.tunable_parts.items()
        return *self.tunable, *(f"{part}.{name}" for part, of in parts for name in of._names)

    def _validate_named(self, names: Iterable[str], known: Collection[str]) -> None:
        for name in names:
            if name not in known:
                guess, there = suggested_name(name, known), ", ".join(known) or "none"
                raise NotFoundError(f"{type(self).__name__} has no number {name!r} to tune{guess}; there are: {there}")

    @cached_property
    def structure(self) -> Structure:
        """Identity of these settings' native code, without tunable numbers."""
        parts = self.tunable_parts
        shapes = tuple((name, array.shape, self._zeros(name, array)) for name, array in self.numbers.items())
        fixed = [(name, value) for name, value in self._settings() if name not in parts and name not in self.unread]
        rest = tuple((name, _key(value)) for name, value in fixed if name not in self.tunable or value is None)
        return Structure(self, (type(self), shapes, rest, tuple((name, of.structure) for name, of in parts.items())))

    def _zeros(self, name: str, array: Array) -> bytes:
        return (array == 0.0).tobytes() if name in self.sparse else b""

    def _settings(self) -> Iterator[tuple[str, Any]]:
        kind = type(self)
        for name, value in vars(self).items():
            if not isinstance(getattr(kind, name, None), cached_property):
                yield name, value


class _Same:
    """Object equal to itself only."""

    __slots__ = ("of",)

    def __init__(self, of: object) -> None:
        self.of = of

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.of is self.of

    def __hash__(self) -> int:
        return id(self.of)


def _key(value: Any) -> Hashable:
    """Value of a setting, or the object itself if not comparable."""
    if isinstance(value, Tunable | Keyed):
        return value.structure
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, tuple):
        return type(value), tuple(map(_key, value))
    if value is None or isinstance(value, bool | int | float | str):
        return type(value), value
    if is_dataclass(value) and getattr(type(value), "__dataclass_params__").frozen:  # noqa: B009  # typeshed has none
        return _fields_key(value)
    return _Same(value)


def _fields_key(value: Any) -> Hashable:
    return type(value), tuple(_key(getattr(value, entry.name)) for entry in fields(value))


def _within(part: str, numbers: Mapping[str, Any]) -> dict[str, Any]:
    return {name.removeprefix(f"{part}."): value for name, value in numbers.items() if name.startswith(f"{part}.")}


def _shaped(scalars: tuple[Any, ...], shape: tuple[int, ...]) -> Any:
    if not shape:
        return scalars[0]
    if len(shape) == 1:
        return Column(scalars)
    size = prod(shape[1:])
    return tuple(_shaped(scalars[k * size : (k + 1) * size], shape[1:]) for k in range(shape[0]))
