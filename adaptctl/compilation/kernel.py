"""A compiled equation, called with arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.compilation.builtin import Finite, builtin, builtin_source, has_builtins
from adaptctl.compilation.lanes import Lanes
from adaptctl.compilation.llvm import program
from adaptctl.compilation.loop import ENTRY, NativeLoop, Source, loop
from adaptctl.compilation.native import load
from adaptctl.compilation.routine import Routine, trace
from adaptctl.errors import InputError, NonFiniteError

Array = NDArray[np.float64]


def compile_function(
    function: Callable[..., Any], arguments: Mapping[str, int], *, name: str = "", finite: Finite = False
) -> Kernel:
    """Native code for `function`, which is called once with Columns by keyword: `arguments` has names and lengths.

    The function returns a scalar, a Column, a list of Columns (the rows of a matrix), or a tuple or NamedTuple of
    these; the kernel returns the same with numbers and arrays in their place. If `finite`, it refuses NaN and
    infinity, in what it is given and in what it computes; if "results", only in the latter.
    """
    if not arguments:
        raise InputError(f"{name or function}: expected at least one argument")
    return Kernel(trace(function, arguments, name=name), arguments, finite=finite)


class Kernel:
    """A compiled function of vectors, made by `compile_function`.

    `kernel(*arguments)` evaluates at array-likes of shape (n,), by position; the results are fresh. It raises
    InputError for arguments of another shape or kind, and NonFiniteError if that was asked for. Any number of threads
    may call it at once.

    `arguments` has their names and lengths, `outputs` the shapes of the results, `operations` what one sample costs.
    `call` is what is called with nothing around it: where every call counts, it takes 60 ns less.
    """

    __slots__ = ("__call__", "__dict__", "__weakref__")
    __call__: Callable[..., Any]  # kept in a slot, it is called with no step through Python

    def __init__(self, routine: Routine, arguments: Mapping[str, int], *, finite: Finite) -> None:
        self.name, self.operations = routine.name, routine.operations
        self.arguments, self.outputs = MappingProxyType(dict(arguments)), routine.layout.shapes
        self._layout, self._given = routine.layout, Given(routine.name, self.arguments)
        self._widths, self._finite = (sum(routine.inputs), len(routine.outputs)), finite
        text, symbol = program(routine, Lanes())
        text += "\n" + loop(routine, symbol, Lanes(), dict.fromkeys(Source, ()) | {Source.DRIVEN: routine.inputs})
        self._code = load(f"{text}\n{builtin_source(routine, symbol, finite=finite)}" if has_builtins() else text)
        self._loop = NativeLoop(self._code.address(ENTRY))
        self.call = self.__call__ = self._as_builtin() if has_builtins() else self._one_sample

    def map(self, *arguments: ArrayLike) -> Any:
        """Evaluate at m samples: arrays (m, n) in; out (m, ...), whatever the shape of one result."""
        arrays = self._given.arrays(arguments, sample_axes=1)
        samples, (taken, made) = len(arrays[0]), self._widths
        packed, results = np.empty((samples, taken)), np.empty((samples, made))
        np.concatenate(arrays, axis=1, out=packed)
        self._loop(0, 1, samples, 0, taken, made, None, None, None, packed.ctypes.data, results.ctypes.data)
        sound = results.sum(axis=1) + (packed.sum(axis=1) if self._finite is True else 0.0)
        if self._finite and not np.isfinite(sound).all():
            self._given.refuse(*(array[int(np.isfinite(sound).argmin())] for array in arrays))
        parts = zip(self._layout.places, self._layout.shapes, strict=True)
        return self._layout.contain(results[:, place].reshape(samples, *shape) for place, shape in parts)

    def _as_builtin(self) -> Callable[..., Any]:
        """A built-in function; what it finds unusual is made usual for another, which then only refuses."""
        given, contain = self._given, self._layout.contain
        strict = builtin(self._code, self.name, given.refuse)
        usual = builtin(self._code, self.name, lambda *arguments: strict(*given.arrays(arguments)))
        if self._layout.container in (None, tuple):
            return usual
        return lambda *arguments: contain(usual(*arguments))

    def _one_sample(self, *arguments: ArrayLike) -> Any:
        """Without built-in functions: a map of one sample."""
        results = self.map(*(array[None] for array in self._given.arrays(arguments)))
        parts = results if self._layout.container else (results,)
        return self._layout.contain(
            part[0] if shape else part.item() for part, shape in zip(parts, self.outputs, strict=True)
        )


@dataclass(frozen=True)
class Given:
    """The arguments of a kernel, names and lengths, and how they are checked."""

    kernel: str
    columns: Mapping[str, int]

    def arrays(self, arguments: Sequence[ArrayLike], sample_axes: int = 0) -> list[Array]:
        """The arguments as new arrays of float64; all have the samples of the first."""
        if len(arguments) != len(self.columns):
            expected = f"{len(self.columns)} arguments ({', '.join(self.columns)})"
            raise InputError(f"{self.kernel}: expected {expected}, got {len(arguments)}")
        arrays = [self._numbers(name, x) for name, x in zip(self.columns, arguments, strict=True)]
        samples = arrays[0].shape[:sample_axes]
        for (name, size), array in zip(self.columns.items(), arrays, strict=True):
            if array.shape != (*samples, size):
                what = f"{self.kernel}: argument {name!r}: expected shape {(*samples, size)}, got {array.shape}"
                raise InputError(what + " (one row a sample)" * sample_axes)
        return arrays

    def refuse(self, *arrays: Array) -> NoReturn:
        """Say which of the arrays is not finite; if all are, the result is not."""
        for name, array in zip(self.columns, arrays, strict=True):
            if not np.isfinite(array).all():
                raise NonFiniteError(f"{self.kernel}: argument {name!r}: expected finite numbers, got {array.tolist()}")
        raise NonFiniteError(f"{self.kernel}: the result is not finite, though all it was given is")

    def _numbers(self, name: str, argument: ArrayLike) -> Array:
        try:
            given = np.asarray(argument)
            array = np.empty(given.shape)
            np.copyto(array, given, casting="same_kind")
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.kernel}: argument {name!r}: expected real numbers ({error})") from error
        return array
