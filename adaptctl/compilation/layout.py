"""Layouts: the scalars that make up the arguments and the result of an equation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import accumulate, islice
from typing import Any, NamedTuple

from adaptctl.scalars import Column

Shape = tuple[int, ...]


class Layout(NamedTuple):
    """The layout of a result: a scalar, a Column, a list of Columns (the rows of a matrix), or a tuple or NamedTuple
    (its type is `container`) of these.

    `shapes` has the shape of each part: (), (n,) or (rows, n).
    """

    container: type[tuple[Any, ...]] | None
    shapes: tuple[Shape, ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of scalars in each part."""
        return tuple(math.prod(shape) for shape in self.shapes)

    @property
    def places(self) -> tuple[slice, ...]:
        """Index of each part among all scalars."""
        return tuple(slice(end - size, end) for size, end in zip(self.sizes, accumulate(self.sizes), strict=True))

    @property
    def contain(self) -> Callable[[Iterator[Any]], Any]:
        """Function that puts parts into their container; a part that needs none is the first and only one."""
        return next if self.container is None else getattr(self.container, "_make", tuple)

    def restored(self, scalars: Sequence[Any]) -> Any:
        """The result in its own form, from its scalars in order."""
        parts = (scalars[place] for place in self.places)
        return self.contain(_restored(part, shape) for part, shape in zip(parts, self.shapes, strict=True))


def numbered(sizes: Iterable[int]) -> list[tuple[int, int]]:
    """For each scalar of parts of these sizes, the index of its part and its index within the part."""
    return [(part, k) for part, size in enumerate(sizes) for k in range(size)]


def flatten(value: Any) -> tuple[Layout, list[Any]]:
    """The layout of a result or of an argument tuple, and its scalars in order."""
    container = type(value) if isinstance(value, tuple) else None
    parts = [_flat(part) for part in (value if isinstance(value, tuple) else (value,))]
    return Layout(container, tuple(shape for shape, _ in parts)), [x for _, scalars in parts for x in scalars]


def _flat(part: Any) -> tuple[Shape, list[Any]]:
    if isinstance(part, Column):
        return (len(part),), list(part)
    rows = part if isinstance(part, list) and all(isinstance(row, Column) for row in part) else []
    if len({len(row) for row in rows}) == 1:
        return (len(rows), len(rows[0])), [x for row in rows for x in row]
    return (), [part]


def _restored(scalars: Sequence[Any], shape: Shape) -> Any:
    if not shape:
        return scalars[0]
    if len(shape) == 1:
        return Column(scalars)
    rest = iter(scalars)
    return [Column(islice(rest, shape[1])) for _ in range(shape[0])]
