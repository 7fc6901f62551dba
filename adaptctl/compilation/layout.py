"""Layouts: the scalars that make up the arguments and the result of an equation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import accumulate, islice
from typing import Any, NamedTuple

from adaptctl.scalars import Column

Shape = tuple[int, ...]


class Layout(NamedTuple):
    """Layout of a function's result or arguments, whose scalars are all in one sequence: a scalar, a `Column` (vector),
    a list of Columns (the rows of a matrix), or a tuple of such parts.

    `container` is the type of the tuple, a NamedTuple's among them, None where there is one part without a tuple;
    `shapes` has the shape of each part: (), (n,) or (rows, n). Nothing is checked.
    """

    container: type[tuple[Any, ...]] | None
    shapes: tuple[Shape, ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of scalars in the parts (scalars, vectors or matrices) of this layout, one integer a part, in order:
        the product of each shape in its field `shapes`."""
        return tuple(math.prod(shape) for shape in self.shapes)

    @property
    def places(self) -> tuple[slice, ...]:
        """Slices, one for each part (scalar, vector or matrix) of this layout in order: the positions of the part's
        scalars in the sequence of all the layout's scalars."""
        return tuple(slice(end - size, end) for size, end in zip(self.sizes, accumulate(self.sizes), strict=True))

    @property
    def contain(self) -> Callable[[Iterator[Any]], Any]:
        """Function that puts an iterator of parts (scalars, vectors, matrices) into the tuple or NamedTuple that this
        layout is of; for a layout of one part without a tuple, it returns the first part. Nothing is checked here."""
        return next if self.container is None else getattr(self.container, "_make", tuple)

    def restored(self, scalars: Sequence[Any]) -> Any:
        """The value of this layout, a scalar, a `Column`, a list of Columns, or a tuple or NamedTuple of these, made of
        the sequence of all its `scalars` in order. Not checked: too few may raise `IndexError`, too many are
        ignored."""
        parts = (scalars[place] for place in self.places)
        return self.contain(_restored(part, shape) for part, shape in zip(parts, self.shapes, strict=True))


def numbered(sizes: Iterable[int]) -> list[tuple[int, int]]:
    """List of pairs (index of the part, index within it), both from 0, one for each scalar in order, for parts such as
    vectors that have these `sizes`, numbers of scalars. Nothing is checked."""
    return [(part, k) for part, size in enumerate(sizes) for k in range(size)]


def flatten(value: Any) -> tuple[Layout, list[Any]]:
    """The `Layout` of a `value` (a function's result or its tuple of arguments) and the list of all its scalars in
    order. Parts are Columns (vectors), lists of Columns of one length (the rows of a matrix), and anything else, which
    counts as one scalar, whatever it is; a tuple or NamedTuple holds several. Nothing is raised."""
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
