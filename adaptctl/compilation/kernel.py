"""A compiled equation, called with arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.llvm import program
from adaptctl.compilation.loop import ENTRY, NativeLoop, Source, loop
from adaptctl.compilation.native import load
from adaptctl.compilation.routine import Routine, trace
from adaptctl.errors import InputError

Array = NDArray[np.float64]


def compile_function(function: Callable[..., Any], arguments: Mapping[str, int], *, name: str = "") -> Kernel:
    """Native code for `function`, which is called once with Columns by keyword: `arguments` has names and lengths.

    The function returns a scalar, a Column, or a tuple or NamedTuple of these; the kernel returns the same with
    numbers and arrays in their place.
    """
    return Kernel(trace(function, arguments, name=name), arguments)


class _Frame:
    """Memory for the scalars of one call, and its addresses."""

    __slots__ = ("input", "native", "output")

    def __init__(self, inputs: int, outputs: int) -> None:
        self.input, self.output = np.empty(inputs), np.empty(outputs)
        addresses = (ctypes.c_void_p(array.ctypes.data) for array in (self.input, self.output))
        numbers = (ctypes.c_int64(k) for k in (0, 1, 1, 0, 0, 0))
        self.native = *numbers, None, None, None, *addresses


class Kernel:
    """A compiled function of vectors, made by `compile_function`.

    `arguments` has their names and lengths, `outputs` the lengths of its results, `operations` what one sample
    costs. Any number of threads may call it at once.
    """

    def __init__(self, routine: Routine, arguments: Mapping[str, int]) -> None:
        if not arguments:
            raise InputError(f"{routine.name}: expected at least one argument")
        self.name, self.operations = routine.name, routine.operations
        self.arguments, self.outputs = MappingProxyType(dict(arguments)), routine.layout.sizes
        self._contain, self._places = routine.layout.contain, routine.layout.places
        self._lengths = list(arguments.values())
        text, symbol = program(routine, Lanes())
        columns = dict.fromkeys(Source, ()) | {Source.DRIVEN: routine.inputs}
        self._code = load(text + "\n" + loop(routine, symbol, Lanes(), columns))
        # One sample takes about a microsecond: letting other threads in meanwhile could cost milliseconds.
        self._run = ctypes.PYFUNCTYPE(None)(self._code.address(ENTRY))
        self._run_unlocked = NativeLoop(self._code.address(ENTRY))
        self._frames: list[_Frame] = []  # those not in use: a call borrows one, so that threads never share

    def __call__(self, *arguments: Any) -> Any:
        """Evaluate at array-likes of shape (n,), by position; the results are fresh arrays.

        Raises InputError for arguments of another shape or kind. Those that fit are looked at only once.
        """
        try:
            frame = self._frames.pop()
        except IndexError:
            frame = self._new_frame()
        try:
            fits = list(map(len, arguments)) == self._lengths
            fits = fits and np.concatenate(arguments, out=frame.input) is frame.input
        except (TypeError, ValueError):
            fits = False
        if not fits:
            np.concatenate(self._arrays(arguments), out=frame.input)
        self._run(*frame.native)
        results = frame.output.copy()
        self._frames.append(frame)
        return self._contain(map(results.__getitem__, self._places))

    def map(self, *arguments: ArrayLike) -> Any:
        """Evaluate at m samples: arrays (m, n) in; out (m, k), or (m,) where one sample gives a number."""
        arrays = self._arrays(arguments, sample_axes=1)
        samples = len(arrays[0])
        packed = np.empty((samples, sum(self.arguments.values())))
        results = np.empty((samples, sum(self.outputs)))
        np.concatenate(arrays, axis=1, out=packed)
        strides = 0, packed.shape[1], results.shape[1]
        self._run_unlocked(0, 1, samples, *strides, None, None, None, packed.ctypes.data, results.ctypes.data)
        return self._contain(results[:, place] for place in self._places)

    def _new_frame(self) -> _Frame:
        return _Frame(sum(self.arguments.values()), sum(self.outputs))

    def _arrays(self, arguments: Sequence[Any], sample_axes: int = 0) -> list[Array]:
        """The arguments as float64 arrays; all have the samples of the first."""
        if len(arguments) != len(self.arguments):
            expected = f"{len(self.arguments)} arguments ({', '.join(self.arguments)})"
            raise InputError(f"{self.name}: expected {expected}, got {len(arguments)}")
        arrays = [self._numbers(name, x) for name, x in zip(self.arguments, arguments, strict=True)]
        samples = arrays[0].shape[:sample_axes]
        for (name, size), array in zip(self.arguments.items(), arrays, strict=True):
            if array.shape != (*samples, size):
                what = f"{self.name}: argument {name!r}: expected shape {(*samples, size)}, got {array.shape}"
                raise InputError(what + " (one row a sample)" * sample_axes)
        return arrays

    def _numbers(self, name: str, argument: ArrayLike) -> Array:
        try:
            return np.asarray(argument).astype(np.float64, casting="same_kind", copy=False)
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.name}: argument {name!r}: expected real numbers ({error})") from error
