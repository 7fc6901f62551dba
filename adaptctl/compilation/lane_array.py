"""Columns of numbers for many members, arranged so that one instruction works on neighbours."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import accumulate
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import whole_count
from adaptctl.errors import InputError

Array = NDArray[np.float64]

CACHE_LINE = 64
"""Bytes that a processor moves at once between its caches and memory."""
_DOUBLE = np.dtype(np.float64)


class LaneArray:
    """An array of named columns (n,) of numbers for each of a number of members, as an array of structures of arrays:
    blocks of `lanes` members each, in which the members' values of a scalar are contiguous, as SIMD lanes need them.

    The constructor takes `columns`, a mapping from the columns' names to their lengths n; the number of `members`;
    `lanes`, the number of members in a block, 1 by default; `steps`, the shape of leading axes, of steps in time, () by
    default; the `dtype` of the numbers, float64 by default; and `made`, `np.zeros` by default, so that all are zero, or
    `np.empty`. `array[name]` is a copy (..., members, n) of a column, in float64; assigning to it takes real numbers
    that broadcast to that, NaN and infinity too. Raises `InputError` for lengths, members and steps that are no whole
    numbers of at least 0 and lanes that are none of at least 1, for an unknown name, and on assigning what is no real
    numbers or does not broadcast.

    Besides `columns`, `members` and `lanes` it has three attributes. `blocks` (..., ceil(members / lanes), scalars,
    lanes), scalars the sum of all n, is the memory itself: member i is in lane i % lanes of block i // lanes, and lanes
    left over in the last block repeat the last member. `address` is that of its first number, `stride` the number of
    numbers from one step to the next.
    """

    def __init__(
        self,
        columns: Mapping[str, int],
        members: int,
        lanes: int = 1,
        steps: tuple[int, ...] = (),
        dtype: np.dtype[Any] = _DOUBLE,
        made: Callable[..., Any] = np.zeros,
    ) -> None:
        self.columns, self.members, self.lanes = MappingProxyType(dict(columns)), members, lanes
        try:
            if min(members, lanes - 1, *steps, *columns.values()) < 0:
                raise ValueError("sizes below 0")
            self.blocks = aligned((*steps, -(-members // lanes), sum(columns.values()), lanes), dtype, made)
        except (TypeError, ValueError):
            _require_sizes(columns, members, lanes, steps)
            raise
        self.address, self.stride = self.blocks.ctypes.data, math.prod(self.blocks.shape[1:])
        ends = accumulate(columns.values())
        self._places = {name: slice(end - n, end) for (name, n), end in zip(columns.items(), ends, strict=True)}

    def __getitem__(self, name: str) -> Array:
        part = self.blocks[..., self._place(name), :].swapaxes(-1, -2)
        *steps, blocks, lanes, n = part.shape
        return part.astype(np.float64).reshape(*steps, blocks * lanes, n)[..., : self.members, :]

    def __setitem__(self, name: str, values: ArrayLike) -> None:
        part = self.blocks[..., self._place(name), :].swapaxes(-1, -2)
        rows = self._rows(name, values, (*part.shape[:-3], self.members, self.columns[name]))
        spare = -self.members % self.lanes
        if spare:
            rows = np.concatenate([rows, np.repeat(rows[..., -1:, :], spare, axis=-2)], axis=-2)
        part[...] = rows.reshape(part.shape)

    def view(self, name: str) -> Array:
        """The column `name` of this array's only member, a view (..., n) of the memory itself, in its number type, not
        a copy. n is the column's length; the leading axes are those of steps, none in an array without steps. Writing
        to it changes the array. Raises `InputError` where there are more members or lanes than one, and for an unknown
        name."""
        if self.members != 1 or self.lanes != 1:
            raise InputError(f"view: expected one member in one lane, got {self.members} in {self.lanes}")
        column: Array = self.blocks[..., 0, self._place(name), 0]
        return column

    def address_of(self, step: int) -> int:
        """The address in memory, an integer, at which the numbers of the step of index `step`, from 0, begin, in an
        array with one axis of steps. Not checked: an index out of range gives an address out of the array."""
        return self.address + self.blocks.itemsize * step * self.stride

    def put(self, name: str, members: ArrayLike, values: ArrayLike) -> None:
        """Assign `values`, which broadcast to (k, n), NaN and infinity too, to the column `name` (length n) of k
        members, given by their indices `members` (k,) from 0. Of an index given twice the last values stay. Raises
        `InputError` for indices that are no whole numbers, of another shape or of no member, an unknown name, values
        that are no real numbers or do not broadcast, and where the array has axes of steps."""
        if self.blocks.ndim > 3:
            raise InputError(f"put: expected an array without axes of steps, got steps {self.blocks.shape[:-3]}")
        chosen = np.asarray(members)
        if chosen.dtype.kind not in "iu" or chosen.ndim != 1 or np.any((chosen < 0) | (chosen >= self.members)):
            raise InputError(f"members: expected numbers from 0 to {self.members - 1}, got {chosen.tolist()}")
        place = self._place(name)
        rows = self._rows(name, values, (len(chosen), self.columns[name]))
        self.blocks[..., chosen // self.lanes, place, chosen % self.lanes] = rows
        last = (self.members - 1) % self.lanes
        self.blocks[..., -1, place, last:] = self.blocks[..., -1, place, last : last + 1]

    def _place(self, name: str) -> slice:
        if name not in self._places:
            raise InputError(f"{name!r}: there is no such column; there are {', '.join(self._places) or 'none'}")
        return self._places[name]

    def _rows(self, name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
        try:
            with np.errstate(over="ignore"):  # infinity, in single precision
                numbers = np.asarray(values).astype(self.blocks.dtype, casting="same_kind", copy=False)
            return numbers if numbers.shape == shape else np.broadcast_to(numbers, shape)
        except (TypeError, ValueError) as error:
            raise InputError(f"{name!r}: expected real numbers that broadcast to shape {shape} ({error})") from error


def _require_sizes(columns: Mapping[str, int], members: int, lanes: int, steps: tuple[int, ...]) -> None:
    """Raise `InputError` that names the size which is no count."""
    whole_count(members, "members")
    whole_count(lanes, "lanes", 1)
    for size in steps:
        whole_count(size, "steps")
    for name, length in columns.items():
        whole_count(length, f"length of {name!r}")


def aligned(shape: tuple[int, ...], dtype: np.dtype[Any] = _DOUBLE, made: Callable[..., Any] = np.zeros) -> Array:
    """A new C-contiguous array of a `shape` and `dtype`, float64 by default, whose memory begins on a cache line (an
    address divisible by 64). `made`, `np.zeros` by default or `np.empty`, allocates the memory; its errors pass, such
    as `MemoryError`, or `ValueError` for negative sizes."""
    size = dtype.itemsize * math.prod(shape)
    memory = made(size + CACHE_LINE, dtype=np.uint8)
    skip = -memory.ctypes.data % CACHE_LINE
    array: Array = memory[skip : skip + size].view(dtype).reshape(shape)
    return array
