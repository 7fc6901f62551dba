"""How scalars make up the arguments and the result of an equation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from adaptctl.scalars import Column


@dataclass(frozen=True)
class Layout:
    """A scalar, a Column, or a tuple or NamedTuple (its type is `container`) of scalars and Columns.

    `lengths` has the length of each part, None for a scalar.
    """

    container: type[tuple[Any, ...]] | None
    lengths: tuple[int | None, ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """How many scalars each part holds."""
        return tuple(1 if length is None else length for length in self.lengths)

    @property
    def numbers(self) -> list[tuple[int, int]]:
        """Which part each scalar belongs to, and which one of the part it is."""
        return [(part, k) for part, size in enumerate(self.sizes) for k in range(size)]

    @property
    def places(self) -> tuple[int | slice, ...]:
        """Where each part is among all scalars: an index for a scalar, a slice for a Column."""
        spans = zip(self.lengths, accumulate(self.sizes), strict=True)
        return tuple(end - 1 if length is None else slice(end - length, end) for length, end in spans)

    @property
    def contain(self) -> Callable[[Iterator[Any]], Any]:
        """Puts parts into their container; a part that needs none is the first and only one."""
        return next if self.container is None else getattr(self.container, "_make", tuple)

    def columns(self, scalars: Sequence[Any]) -> Any:
        """The scalars as scalars and Columns again, in their container."""
        pairs = ((place, scalars[place]) for place in self.places)
        return self.contain(Column(part) if isinstance(place, slice) else part for place, part in pairs)


def flatten(value: Any) -> tuple[Layout, list[Any]]:
    """The layout of a result or of an argument tuple, and its scalars in order."""
    container = type(value) if isinstance(value, tuple) else None
    parts = value if isinstance(value, tuple) else (value,)
    lengths = tuple(len(part) if isinstance(part, Column) else None for part in parts)
    scalars = [x for part in parts for x in (part if isinstance(part, Column) else (part,))]
    return Layout(container, lengths), scalars
