"""LLVM types and attributes for numbers in SIMD lanes."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import whole_count
from adaptctl.caching import cached_property
from adaptctl.errors import InputError

Precision: TypeAlias = Literal["double", "single"]
"""IEEE 754's binary64, of 53 bits, or binary32, of 24."""


@dataclass(frozen=True)
class Lanes:
    """LLVM types and attributes for numbers in SIMD lanes."""

    count: int = 1
    precision: Precision = "double"

    def __post_init__(self) -> None:
        validate_precision(self.precision)
        if self.count not in (1, 2, 4, 8, 16)[: 5 if self.precision == "single" else 4]:
            raise InputError(f"lanes: expected 1, 2, 4 or 8, or 16 in single precision, got {self.count}")

    @property
    def size(self) -> int:
        """Bytes of one number."""
        return 8 if self.precision == "double" else 4

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """NumPy type of the numbers."""
        return np.dtype(f"f{self.size}")

    @cached_property
    def scalar(self) -> str:
        """LLVM type of one number."""
        return "double" if self.precision == "double" else "float"

    @cached_property
    def value(self) -> str:
        """LLVM type of the numbers in all lanes, such as "<4 x double>"."""
        return self._of(self.scalar)

    @cached_property
    def integer(self) -> str:
        """LLVM type of whole numbers in all lanes, such as "<4 x i64>"."""
        return self._of(self._whole)

    @cached_property
    def condition(self) -> str:
        """LLVM type of truth values in all lanes, such as "<4 x i1>"."""
        return self._of("i1")

    @cached_property
    def suffix(self) -> str:
        """Suffix of LLVM's intrinsic functions, such as "v4f64"."""
        bits = f"f{8 * self.size}"
        return bits if self.count == 1 else f"v{self.count}{bits}"

    @property
    def alignment(self) -> int:
        """Alignment in bytes of the numbers in all lanes."""
        return self.size * self.count

    @cached_property
    def attributes(self) -> str:
        """LLVM attributes for every function on SIMD lanes."""
        return "nounwind" if self.count == 1 else f'nounwind "stackrealign" alignstack({self.alignment})'

    def constant(self, x: float) -> str:
        """LLVM text of a float in every lane."""
        digits = f"0x{struct.pack('>d', self.rounded(x)).hex()}"  # of a double in either precision
        return digits if self.count == 1 else "<" + ", ".join([f"{self.scalar} {digits}"] * self.count) + ">"

    def rounded(self, x: float) -> float:
        """Float rounded to the precision of these lanes."""
        return x if self.precision == "double" else single(x)

    def whole(self, k: int) -> str:
        """LLVM text of a whole number in every lane."""
        return str(k) if self.count == 1 else "<" + ", ".join([f"{self._whole} {k}"] * self.count) + ">"

    def filled(self, name: str, **values: object) -> str:
        """Template filled with the lanes' types and `values`."""
        types = ("scalar", "value", "integer", "condition", "suffix", "count", "alignment", "attributes")
        template = Template(Path(__file__).with_name(f"{name}.ll").read_text(encoding="utf-8"))
        return template.substitute({of: getattr(self, of) for of in types}, **values)

    @property
    def _whole(self) -> str:
        return f"i{8 * self.size}"

    def _of(self, kind: str) -> str:
        return kind if self.count == 1 else f"<{self.count} x {kind}>"


def validate_precision(precision: object) -> None:
    """Raise `InputError` unless `precision` is a `Precision`: "double" or "single"."""
    if precision not in get_args(Precision):
        raise InputError(f"precision: expected one of {', '.join(get_args(Precision))}, got {precision!r}")


def single(x: float) -> float:
    """Float rounded to single precision (binary32)."""
    if not math.isfinite(x) or x == 0.0:
        return x
    limits = np.finfo(np.float32)
    within = min(max(abs(x), float(limits.tiny)), float(limits.max))
    return math.copysign(float(np.float32(within)), x)


Array = NDArray[np.float64]

CACHE_LINE = 64
"""Bytes that a processor moves at once between its caches and memory."""
_DOUBLE = np.dtype(np.float64)


class LaneArray:
    """
    Array of named vectors (n,) for each member of an ensemble, laid out for SIMD instructions.

    A member is one of many independent systems, a lane one entry of a SIMD register. ``array[name]`` is a float64 copy
    (..., members, n) of a column; values that broadcast to this shape can be assigned to it.

    Parameters
    ----------
    columns : mapping of str to int
        Lengths n by name.
    members : int
        Number of members, such as simulated robots, at least 1.
    lanes : int, default 1
        Number of members that are computed at once; their values of one scalar are contiguous. One by default, which
        gives each member a plain row.
    steps : tuple of int, optional
        Lengths of leading axes, such as the number of time steps. None by default.
    dtype : dtype, default float64
        Type of the numbers, by default as in compiled code of double precision.
    made : callable, default numpy.zeros
        Function that allocates the memory, given its shape; `numpy.empty` leaves it uninitialised.

    Raises
    ------
    InputError
        If a size is wrong, a name unknown, or assigned values are not real or do not broadcast.

    Notes
    -----
    `blocks` (..., ceil(members / lanes), scalars, lanes) is the memory, `address` its address and `stride` the count of
    numbers in a step. Lanes beyond the last member repeat it.

    Examples
    --------
    >>> from adaptctl.compilation import LaneArray
    >>> array = LaneArray({"x": 2}, members=3)
    >>> array["x"] = [1.0, 2.0]
    >>> array["x"].shape
    (3, 2)
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
            _validate_sizes(columns, members, lanes, steps)
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
        """
        Return a view of a column of an array of one lane.

        Parameters
        ----------
        name : str
            Name of the column.

        Returns
        -------
        ndarray
            The memory itself (..., n) of a single member, else (..., members, n); writing to it changes the array.

        Raises
        ------
        InputError
            If there are several lanes, or the name is unknown.

        Examples
        --------
        >>> from adaptctl.compilation import LaneArray
        >>> array = LaneArray({"x": 2}, members=1)
        >>> array.view("x")[:] = 3.0
        >>> array["x"].tolist()
        [[3.0, 3.0]]
        """
        if self.lanes != 1:
            raise InputError(f"view: expected one lane, got {self.lanes}")
        column: Array = self.blocks[..., self._place(name), 0]
        return column if self.members != 1 else column[..., 0, :]

    def address_of(self, step: int) -> int:
        """
        Return the memory address of the numbers of a time step.

        Parameters
        ----------
        step : int
            Index of the step from 0, in an array with one axis of steps; not checked.

        Returns
        -------
        int
            Memory address in bytes.
        """
        return self.address + self.blocks.itemsize * step * self.stride

    def put(self, name: str, members: ArrayLike, values: ArrayLike) -> None:
        """
        Set the values of a column for some members of the ensemble.

        Parameters
        ----------
        name : str
            Name of the column, of length n.
        members : array_like of int
            Indices (k,) of the members, from 0. Where an index is repeated, its last values stay.
        values : array_like
            Values of shape (k, n), or that broadcast to it, in the column's unit. NaN and infinity are allowed.

        Raises
        ------
        InputError
            If an index, the name or the values do not fit, or the array has axes of steps.

        Examples
        --------
        >>> from adaptctl.compilation import LaneArray
        >>> array = LaneArray({"x": 2}, members=3)
        >>> array.put("x", [0, 2], [1.0, 5.0])
        >>> array["x"].tolist()
        [[1.0, 5.0], [0.0, 0.0], [1.0, 5.0]]
        """
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
            raise InputError(f"unknown column {name!r}; columns: {', '.join(self._places) or 'none'}")
        return self._places[name]

    def _rows(self, name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
        try:
            with np.errstate(over="ignore"):  # infinity, in single precision
                numbers = np.asarray(values).astype(self.blocks.dtype, casting="same_kind", copy=False)
            return numbers if numbers.shape == shape else np.broadcast_to(numbers, shape)
        except (TypeError, ValueError) as error:
            raise InputError(f"{name!r}: expected real numbers that broadcast to shape {shape} ({error})") from error


def _validate_sizes(columns: Mapping[str, int], members: int, lanes: int, steps: tuple[int, ...]) -> None:
    whole_count(members, "members")
    whole_count(lanes, "lanes", 1)
    for size in steps:
        whole_count(size, "steps")
    for name, length in columns.items():
        whole_count(length, f"length of {name!r}")


def aligned(shape: tuple[int, ...], dtype: np.dtype[Any] = _DOUBLE, made: Callable[..., Any] = np.zeros) -> Array:
    """New C-contiguous array whose memory begins on a cache line."""
    size = dtype.itemsize * math.prod(shape)
    memory = made(size + CACHE_LINE, dtype=np.uint8)
    skip = -memory.ctypes.data % CACHE_LINE
    array: Array = memory[skip : skip + size].view(dtype).reshape(shape)
    return array


class Instructions:
    """LLVM instructions of one function's body, as lines of text."""

    def __init__(self, lanes: Lanes) -> None:
        self.memory: list[str] = []
        self.lines: list[str] = []
        self.lanes = lanes
        self._count = 0

    def add(self, line: str) -> None:
        """Append an instruction, the text `line`, as it is."""
        self.lines.append(line)

    def reserve(self, name: str, size: int) -> str:
        """Append the instruction that reserves memory for `size` values."""
        self.memory.append(f"{name} = alloca [{size} x {self.lanes.value}], align {max(self.lanes.alignment, 64)}")
        return name

    def new(self, instruction: str) -> str:
        """Append an instruction, and return the name of its result: a number, which LLVM reads in half the time."""
        self._count += 1
        self.lines.append(f"%{self._count} = {instruction}")
        return f"%{self._count}"

    def load(self, pointer: str, k: int) -> str:
        """Append instructions that load a value in every lane."""
        at = self.new(f"getelementptr {self.lanes.value}, ptr {pointer}, i64 {k}")
        return self.new(f"load {self.lanes.value}, ptr {at}, align {self.lanes.size}")

    def broadcast(self, pointer: str, k: int) -> str:
        """Append instructions that load one number into every lane."""
        value, scalar, n = self.lanes.value, self.lanes.scalar, self.lanes.count
        at = self.new(f"getelementptr {scalar}, ptr {pointer}, i64 {k}")
        one = self.new(f"load {scalar}, ptr {at}, align {self.lanes.size}")
        first = self.new(f"insertelement {value} poison, {scalar} {one}, i32 0")
        return self.new(f"shufflevector {value} {first}, {value} poison, <{n} x i32> zeroinitializer")

    def store(self, pointer: str, k: int, value: str) -> None:
        """Append instructions that store a value in every lane."""
        at = self.new(f"getelementptr {self.lanes.value}, ptr {pointer}, i64 {k}")
        self.add(f"store {self.lanes.value} {value}, ptr {at}, align {self.lanes.size}")

    def clear(self, pointer: str, size: int) -> None:
        """Append the instruction that clears memory at a `pointer`."""
        self.add(f"call void @llvm.memset.p0.i64(ptr {pointer}, i8 0, i64 {size * self.lanes.alignment}, i1 false)")
