"""A compiled equation, called with arrays."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import validate_plain, writable
from adaptctl.compilation.batch import MIN_STREAMED_BYTES, compiled_batch
from adaptctl.compilation.builtin import Finite, Form, builtin, builtin_source, has_builtins
from adaptctl.compilation.lanes import Lanes, aligned
from adaptctl.compilation.llvm import program
from adaptctl.compilation.native import NativeCode, Processor, load
from adaptctl.compilation.routine import MAX_COMPILED_LINKS, Routine, trace
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column

Array = NDArray[np.float64]

_DOUBLE = np.dtype(np.float64)


def compile_function(
    function: Callable[..., Any],
    arguments: Mapping[str, int],
    *,
    name: str = "",
    finite: Finite = False,
    form: Form | None = None,
) -> Kernel:
    """
    Compile a function of vectors to native code.

    Parameters
    ----------
    function : callable
        Function that takes `Column` vectors by keyword and returns a scalar, a column, a list of columns (the rows of a
        matrix), or a tuple or NamedTuple of these. It is traced: called with symbolic scalars to record its operations.
    arguments : mapping of str to int
        Lengths n of the arguments by name.
    name : str, optional
        Name in messages; the function's own by default.
    finite : bool or "results", default False
        If true, NaN and infinity are refused in arguments and results; "results" checks results alone.
    form : Form, optional
        Calling convention of `Kernel.with_fallback`, for arguments in tuples; by default each column is an argument.

    Returns
    -------
    Kernel
        Compiled function of arrays (n,), which returns floats and arrays (n,) or (rows, n).

    Raises
    ------
    InputError
        If there are no arguments or a length is not a whole number of at least 0.
    TraceError
        If the function cannot be traced, for example because it branches on a value (use `adaptctl.scalars.where`).

    Examples
    --------
    >>> from adaptctl.compilation import compile_function
    >>> kernel = compile_function(lambda x, y: x @ y, {"x": 2, "y": 2}, name="inner")
    >>> kernel([1.0, 2.0], [3.0, 4.0])
    11.0
    """
    if not arguments:
        raise InputError(f"{name or function}: expected at least one argument")
    return Kernel(lambda: trace(function, arguments, name=name), arguments, finite=finite, form=form)


class Kernel:
    """
    Compiled function of vectors, as `compile_function` returns it.

    Calls take array-likes (n,) by position and return floats and float64 arrays. The function is compiled at its first
    call. Several threads may call it at once.

    Parameters
    ----------
    traced : callable
        Function without arguments that returns the `Routine`; called again for each further kind of code.
    arguments : mapping of str to int
        Lengths n of the arguments by name.
    finite : bool or "results"
        If true, NaN and infinity are refused in arguments and results; "results" checks results alone.
    form : Form, optional
        Calling convention of `with_fallback`. Default: vectors, each an array of its own.

    Raises
    ------
    InputError
        If a call has arguments of another number or shape, or not of real numbers.
    NonFiniteError
        If a checked value is NaN or infinite.

    Notes
    -----
    `outputs` has the results' shapes and `operations` the scalar operations by `Op`. The function `call` saves 60 ns in
    each call.

    Examples
    --------
    >>> from adaptctl.compilation import compile_function
    >>> double = compile_function(lambda x: 2.0 * x, {"x": 2}, name="double")
    >>> double([1.0, 2.0]).tolist()
    [2.0, 4.0]
    >>> double.outputs
    ((2,),)
    """

    __slots__ = ("__call__", "__dict__", "__weakref__")
    __call__: Callable[..., Any]  # kept in a slot, it is called with no step through Python

    def __init__(
        self, traced: Callable[[], Routine], arguments: Mapping[str, int], *, finite: Finite, form: Form | None = None
    ) -> None:
        routine = traced()
        self._plain, self._form = form is None, form or Form.plain(len(arguments))
        self._traced, self._layout, self._finite = traced, routine.layout, finite
        self._latest: Routine | None = routine
        self.name, self.operations = routine.name, routine.operations
        self.arguments, self.outputs = MappingProxyType(dict(arguments)), routine.layout.shapes
        self._given = Given(self.name, self.arguments)
        self._single: Any = None
        self._many: tuple[tuple[NativeCode, ...], Callable[..., bool]] | None = None
        self._called: Callable[..., Any] | None = None
        self.__call__ = lambda *arguments: self.call(*arguments)

    @property
    def call(self) -> Callable[..., Any]:
        """Built-in function that `kernel(*arguments)` calls; called directly, it saves about 60 ns."""
        if self._called is None:
            self._called = self.__call__ = self._as_builtin() if has_builtins() and self._plain else self._one_sample
        return self._called

    def into(self, *given: Any) -> Any:
        """
        Evaluate the kernel into given arrays.

        Parameters
        ----------
        *given : array_like
            One writable float64 array of its shape for each result, which may overlap the arguments, then the arguments
            (n,) of a call.

        Returns
        -------
        ndarray or tuple of ndarray
            The given arrays of the results, filled.

        Raises
        ------
        InputError
            If an array is missing, not writable float64 or of another shape, or an argument is wrong.

        Examples
        --------
        >>> from adaptctl.compilation import compile_function
        >>> double = compile_function(lambda x: 2.0 * x, {"x": 2}, name="double")
        >>> double.into(np.empty(2), [1.0, 2.0]).tolist()
        [2.0, 4.0]
        """
        outs, arguments = given[: len(self.outputs)], given[len(self.outputs) :]
        if len(outs) < len(self.outputs):
            raise InputError(f"{self.name}: out: expected one array per result ({len(self.outputs)})")
        for out, shape in zip(outs, self.outputs, strict=True):
            writable(out, shape, self.name)
        results = self.call(*arguments)
        for out, result in zip(outs, results if self._layout.container else (results,), strict=True):
            out[...] = result
        return self._layout.contain(iter(outs))

    @property
    def _code(self) -> NativeCode:
        """Code for one sample."""
        if self._single is None and has_builtins():
            routine = self._routine()
            text, symbol, pieces, _ = program(routine, Lanes())
            entry = builtin_source(routine, symbol, finite=self._finite, form=self._form)
            self._single = load(f"{text}\n{entry}", pieces=pieces)
        return self._single

    def _routine(self) -> Routine:
        routine, self._latest = self._latest or self._traced(), None
        return routine

    def map(self, *arguments: ArrayLike, out: Array | Sequence[Array] | None = None) -> Any:
        """
        Evaluate the kernel at many samples, in SIMD lanes.

        Parameters
        ----------
        *arguments : array_like
            Values (m, n) of each argument at m samples, or (n,) where all samples share it.
        out : ndarray or sequence of ndarray, optional
            Contiguous float64 arrays (m, ...) to fill, one for each result. Default: new ones; given ones save their
            allocation.

        Returns
        -------
        ndarray or tuple of ndarray
            Results (m, ...) of the m samples, in a tuple or NamedTuple where there are several.

        Raises
        ------
        InputError
            If an argument or an array to fill does not fit.
        NonFiniteError
            If a checked value is NaN or infinite; the contents of `out` are then undefined.

        Examples
        --------
        >>> from adaptctl.compilation import compile_function
        >>> double = compile_function(lambda x: 2.0 * x, {"x": 2}, name="double")
        >>> double.map(np.ones((5, 2))).shape
        (5, 2)
        """
        arrays = self._given.arrays(arguments, sample_axes=1)
        samples = next((len(array) for array in arrays if array.ndim > 1), 1)
        given = [out] if isinstance(out, np.ndarray) else out
        shapes = [(samples, *shape) for shape in self.outputs]
        results = [*map(_room, shapes)] if given is None else self._taking(given, shapes)
        strides = [array.strides[0] // array.itemsize if array.ndim > 1 else 0 for array in arrays]
        sources, targets = map(_address, arrays), map(_address, results)
        table = np.array([*sources, *strides, *targets], dtype=np.int64)
        first, second = _address(table), len(arrays) * table.itemsize
        if not self._batch(samples, first, first + second, first + 2 * second):
            self._blame(arrays, results)
        return self._layout.contain(
            result if shape else result.reshape(samples) for result, shape in zip(results, self.outputs, strict=True)
        )

    def _taking(self, given: Sequence[Array], shapes: Sequence[tuple[int, ...]]) -> list[Array]:
        if len(given) != len(shapes):
            raise InputError(f"{self.name}: out: expected one array per result ({len(shapes)})")
        for out, shape in zip(given, shapes, strict=True):
            if not writable(out, shape, self.name).flags.c_contiguous:
                raise InputError(f"{self.name}: out: expected a contiguous array")
        return list(given)

    def with_fallback(self, instead: Callable[..., Any], *bound: Any) -> Callable[..., Any]:
        """
        Return a function that calls the native code, or a fallback where the arguments are unusual.

        Parameters
        ----------
        instead : callable
            Function called instead for arguments that are not contiguous float64 arrays of the right lengths, or not
            finite where this is checked.
        *bound : object
            Types of the tuples in the calling convention `form`, then arrays (n,) for those of the kernel's arguments
            that the new function does not take.

        Returns
        -------
        callable
            Native code with `instead` as fallback, whose errors it raises; `instead` itself where Python is not
            CPython.

        Examples
        --------
        >>> from adaptctl.compilation import compile_function
        >>> kernel = compile_function(lambda x: 2.0 * x, {"x": 2}, name="double")
        >>> double = kernel.with_fallback(lambda x: "unusual")
        >>> double(np.ones(2)).tolist(), double([1.0, 1.0])
        ([2.0, 2.0], 'unusual')
        """
        return self._builtin(instead, *bound) if has_builtins() else instead

    def _builtin(self, instead: Callable[..., Any], *bound: Any) -> Callable[..., Any]:
        arrays = sum(map(bool, self.outputs))
        return builtin(self._code, self.name, instead, *bound, results=arrays)

    @property
    def _batch(self) -> Callable[..., bool]:
        """Code for many samples."""
        if self._many is None:
            checked = {"inputs": self._finite is True, "outputs": bool(self._finite)}
            self._many = compiled_batch(self._routine(), Processor.host(), checked)
        return self._many[1]

    def _blame(self, arrays: Sequence[Array], results: Sequence[Array]) -> NoReturn:
        rows = [np.atleast_2d(array) for array in arrays]
        sound = np.ones(len(results[0]), dtype=np.bool_)
        for array in (*(rows if self._finite is True else ()), *results):
            sound &= np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
        worst = int(sound.argmin())
        self._given.refuse(*(array[worst] if array.ndim > 1 else array for array in arrays))

    def _as_builtin(self) -> Callable[..., Any]:
        given, contain = self._given, self._layout.contain
        strict = self._builtin(given.refuse)
        usual = self._builtin(lambda *arguments: strict(*given.arrays(arguments)))
        if self._layout.container in (None, tuple):
            return usual
        return lambda *arguments: contain(usual(*arguments))

    def _one_sample(self, *arguments: ArrayLike) -> Any:
        results = self.map(*(array[None] for array in self._given.arrays(arguments)))
        parts = results if self._layout.container else (results,)
        return self._layout.contain(
            part[0] if shape else part.item() for part, shape in zip(parts, self.outputs, strict=True)
        )


class Given(NamedTuple):
    """Check of a kernel's arguments."""

    kernel: str
    columns: Mapping[str, int]

    def arrays(self, arguments: Sequence[ArrayLike], sample_axes: int = 0) -> list[Array]:
        """The arguments as C-contiguous float64 arrays (n,)."""
        if len(arguments) != len(self.columns):
            expected = f"{len(self.columns)} arguments ({', '.join(self.columns)})"
            raise InputError(f"{self.kernel}: expected {expected}, got {len(arguments)}")
        arrays = [self._numbers(name, x, sample_axes) for name, x in zip(self.columns, arguments, strict=True)]
        samples = next((array.shape[:sample_axes] for array in arrays if array.ndim > 1), ())
        for (name, size), array in zip(self.columns.items(), arrays, strict=True):
            if array.shape != (*samples, size) and not (sample_axes and array.shape == (size,)):
                what = f"{self.kernel}: argument {name!r}: expected shape {(*samples, size)}, got {array.shape}"
                raise InputError(what + " (one row per sample)" * sample_axes)
        return arrays

    def refuse(self, *arrays: Array) -> NoReturn:
        """Raise `NonFiniteError`, always."""
        for name, array in zip(self.columns, arrays, strict=True):
            if not np.isfinite(array).all():
                raise NonFiniteError(f"{self.kernel}: argument {name!r}: expected finite numbers, got {array.tolist()}")
        raise NonFiniteError(f"{self.kernel}: the result is not finite for finite arguments")

    def _numbers(self, name: str, argument: ArrayLike, sample_axes: int) -> Array:
        try:
            if type(argument) is np.ndarray and argument.dtype is _DOUBLE and _in_rows(argument, sample_axes):
                return argument
            validate_plain(argument)
            given = np.asarray(argument)
            array = np.empty(given.shape)
            np.copyto(array, given, casting="same_kind")
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.kernel}: argument {name!r}: expected real numbers ({error})") from error
        return array


def _address(array: NDArray[Any]) -> int:
    if not (array.flags.carray and array.size):
        return array.ctypes.data
    buffer: Any = array
    return ctypes.addressof(ctypes.c_char.from_buffer(buffer))


def _room(shape: tuple[int, ...]) -> Array:
    return (
        np.empty(shape) if math.prod(shape) * _DOUBLE.itemsize < MIN_STREAMED_BYTES else aligned(shape, made=np.empty)
    )


def _in_rows(array: Array, sample_axes: int) -> bool:
    apart = sample_axes == 1 == array.ndim - 1 and array.strides[1] == array.itemsize
    beside = array.flags.c_contiguous or (apart and array.strides[0] % array.itemsize == 0)
    return bool(beside and array.flags.aligned)


Equation = Callable[..., tuple[Any, ...]]


class OnFloats:
    """Function of vectors in Python, called like a `Kernel`."""

    def __init__(
        self, function: Equation, arguments: Mapping[str, int], *, name: str = "", finite: Finite = False
    ) -> None:
        self.name, self.arguments = name, MappingProxyType(dict(arguments))
        self._function, self._given, self._finite = function, Given(name, self.arguments), finite

    def __call__(self, *arguments: ArrayLike) -> tuple[Any, ...]:
        """Result at array-likes (n,) by position."""
        arrays = self._given.arrays(arguments)
        columns = {name: Column(array.tolist()) for name, array in zip(self.arguments, arrays, strict=True)}
        results = tuple(_plain(result) for result in self._function(**columns))
        sound = (*results, *arrays) if self._finite is True else results
        if self._finite and not all(np.isfinite(array).all() for array in sound):
            self._given.refuse(*arrays)
        return results

    @property
    def call(self) -> OnFloats:
        """Function of array-likes (n,), as in a `Kernel`."""
        return self


def _plain(result: Any) -> NDArray[np.float64] | float:
    return np.array(result.of, dtype=np.float64) if isinstance(result, Column) else float(result)


def native_or_floats(
    function: Equation,
    arguments: Mapping[str, int],
    links: int,
    *,
    name: str = "",
    finite: Finite = False,
    form: Form | None = None,
) -> Kernel | OnFloats:
    """Compiled function up to 100 links, else the function in Python."""
    if links > MAX_COMPILED_LINKS:
        return OnFloats(function, arguments, name=name, finite=finite)
    return compile_function(function, arguments, name=name, finite=finite, form=form)
