"""A compiled equation, called with arrays."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import writable
from adaptctl.compilation.batch import ENTRY, STREAMED, NativeBatch, batch
from adaptctl.compilation.builtin import Finite, Form, builtin, builtin_source, has_builtins
from adaptctl.compilation.lanes import Lanes, aligned
from adaptctl.compilation.llvm import program
from adaptctl.compilation.native import NativeCode, Processor, load
from adaptctl.compilation.routine import Routine, trace
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
    """A `Kernel`, native code of `function`, which is traced: called by keyword with Columns (vectors of symbolic
    scalars) in place of numbers, so that its operations are recorded and compiled. It is traced immediately, and again
    for each further kind of code (`map`, `into`). `arguments` maps the function's argument names to their lengths n.

    The function returns a scalar, a Column, a list of Columns (the rows of a matrix), or a tuple or NamedTuple of
    these; the kernel returns the same with floats, arrays (n,) and (rows, n) in their place. `name` is the kernel's in
    messages, the function's own where empty. `finite` is True for a kernel that refuses NaN and infinity in what it is
    given and in what it computes, "results" for one that does so only in the latter, False, the default, for one that
    never does. `form`, a `Form`, is the calling convention of the function that `Kernel.otherwise` makes, where its
    arguments are not simply the kernel's, as where some are in tuples: it says which argument each column comes from;
    None where each is an argument. Raises `InputError` for no arguments at all and for lengths that are no whole
    numbers of at least 0, `TraceError` for a function that cannot be traced, such as one that branches on a value; what
    the function itself raises goes through.
    """
    if not arguments:
        raise InputError(f"{name or function}: expected at least one argument")
    return Kernel(lambda: trace(function, arguments, name=name), arguments, finite=finite, form=form)


class Kernel:
    """A compiled function of vectors, in native code, made by `compile_function`.

    `kernel(*arguments)` evaluates one sample, from array-likes by position, (n,) each. The results, floats and float64
    arrays, are the caller's own: the memory of an array is used again only once nothing refers to it. Raises
    `InputError` for another number of arguments, another shape and what holds no real numbers, and `NonFiniteError` for
    NaN and infinity where it was compiled to check for them (`finite`). Any number of threads may call it at once.

    `name` is the function's; `arguments` maps the arguments' names to their lengths n; `outputs` has the shapes of the
    results, (), (n,) or (rows, n); `operations` counts the scalar operations of one sample by kind (`Op`). Units are
    the function's own. `call` is the built-in function without its Python wrapper: where every call counts, it takes 60
    ns less. Native code is made at the first use, separately for single samples and for many (`map`).

    The constructor takes `traced`, a callable that returns the function's `Routine`, its expressions, called at once
    and again for each further kind of code, and the same `arguments`, `finite` and `form` as `compile_function`; it
    checks none of them, but what `traced` raises goes through.
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
        self._many: tuple[NativeCode, Any] | None = None
        self._called: Callable[..., Any] | None = None
        self.__call__ = lambda *arguments: self.call(*arguments)

    @property
    def call(self) -> Callable[..., Any]:
        """The raw built-in function behind `kernel(*arguments)`, made at the first use. It takes the same arguments, an
        array-like (n,) each, n its length, and returns the same floats and float64 arrays, without the Python wrapper,
        which saves 60 ns a call. Raises `InputError` for arguments of another number, another shape or that hold no
        real numbers; `NonFiniteError` for NaN and infinity where the kernel checks for them."""
        if self._called is None:
            self._called = self.__call__ = self._as_builtin() if has_builtins() and self._plain else self._one_sample
        return self._called

    def into(self, *given: Any) -> Any:
        """The kernel's results at some arguments, copied into given arrays and returned as these, one array or a tuple.

        `given` are one `out` for each result, of its shape, (), (n,) or (rows, n), in float64, of any strides, which
        may overlap the arguments; then the arguments of a call. Raises `InputError` for an `out` that is missing, no
        writable float64 array or of another shape, and what a call raises."""
        outs, arguments = given[: len(self.outputs)], given[len(self.outputs) :]
        if len(outs) < len(self.outputs):
            raise InputError(f"{self.name}: out: expected an array for each of {len(self.outputs)} results")
        for out, shape in zip(outs, self.outputs, strict=True):
            writable(out, shape, self.name)
        results = self.call(*arguments)
        for out, result in zip(outs, results if self._layout.container else (results,), strict=True):
            out[...] = result
        return self._layout.contain(iter(outs))

    @property
    def _code(self) -> NativeCode:
        """The code for one sample. Threads may both make it, for a lock would outlive a fork."""
        if self._single is None and has_builtins():
            routine = self._routine()
            text, symbol = program(routine, Lanes())
            self._single = load(f"{text}\n{builtin_source(routine, symbol, finite=self._finite, form=self._form)}")
        return self._single

    def _routine(self) -> Routine:
        """The equation, traced; not kept any longer, for its graph is many times as large as code."""
        routine, self._latest = self._latest or self._traced(), None
        return routine

    def map(self, *arguments: ArrayLike, out: Array | Sequence[Array] | None = None) -> Any:
        """Evaluate the kernel at m samples in SIMD lanes, and return its results. Each is a float64 array (m, ...),
        with the shape of one sample's result after the axis of samples; several are in a tuple, or in the `NamedTuple`
        that the compiled function returns. `arguments` are array-likes (m, n) each, n the argument's length, one row a
        sample, or (n,) where all samples share it; m is 1 where all do.

        `out` is the array that is filled and returned, or a sequence of one for each result; None for new ones. Raises
        `InputError` for arguments of another number, another shape or that hold no real numbers, and for an `out` that
        is no writable, contiguous float64 array of these shapes; `NonFiniteError` for NaN and infinity where the kernel
        checks for them: `out` may then hold anything.
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
        """Arrays that native code may write the results to."""
        if len(given) != len(shapes):
            raise InputError(f"{self.name}: out: expected an array for each of {len(shapes)} results")
        for out, shape in zip(given, shapes, strict=True):
            if not writable(out, shape, self.name).flags.c_contiguous:
                raise InputError(f"{self.name}: out: expected a contiguous array")
        return list(given)

    def with_fallback(self, instead: Callable[..., Any], *bound: Any) -> Callable[..., Any]:
        """A function that runs the kernel's native code (the fast path) for usual arguments, and calls `instead` (the
        fallback) with the same arguments for all others. Usual are as many arguments as expected, contiguous float64
        arrays (n,), n each one's length, where the kernel's `form` (calling convention) expects them, and, where the
        kernel checks for them, no NaN or infinity in them or in the results. For example, `add =
        kernel.otherwise(slow)` of a kernel of two vectors calls native code in `add(x, y)`, and `slow([1.0], y)` in
        `add([1.0], y)`.

        `bound` fixes arguments in advance: it has first the types of the form's tuples (its arguments that are tuples
        of arrays), in order, and then the arrays (n,) of those arguments of the kernel that come from no argument of
        the new function, such as gains. The new function raises nothing itself: errors are those of `instead`. On a
        Python whose arrays native code cannot read, such as any but CPython, it is `instead` itself.
        """
        return self._builtin(instead, *bound) if has_builtins() else instead

    def _builtin(self, instead: Callable[..., Any], *bound: Any) -> Callable[..., Any]:
        arrays = sum(map(bool, self.outputs))
        return builtin(self._code, self.name, instead, *bound, results=arrays)

    @property
    def _batch(self) -> Callable[..., bool]:
        """The code for many samples."""
        if self._many is None:
            processor, routine = Processor.host(), self._routine()
            lanes = Lanes(processor.lanes)
            text, symbol = program(routine, lanes)
            checked = {"inputs": self._finite is True, "outputs": bool(self._finite)}
            code = load(f"{text}\n{batch(routine, symbol, lanes, checked)}", processor)
            self._many = code, NativeBatch(code.address(ENTRY))
        return self._many[1]

    def _blame(self, arrays: Sequence[Array], results: Sequence[Array]) -> NoReturn:
        """Raise for the first sample that has something not finite."""
        rows = [np.atleast_2d(array) for array in arrays]
        sound = np.ones(len(results[0]), dtype=np.bool_)
        for array in (*(rows if self._finite is True else ()), *results):
            sound &= np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
        worst = int(sound.argmin())
        self._given.refuse(*(array[worst] if array.ndim > 1 else array for array in arrays))

    def _as_builtin(self) -> Callable[..., Any]:
        """A built-in function; what it finds unusual is made usual for another, which then only refuses."""
        given, contain = self._given, self._layout.contain
        strict = self._builtin(given.refuse)
        usual = self._builtin(lambda *arguments: strict(*given.arrays(arguments)))
        if self._layout.container in (None, tuple):
            return usual
        return lambda *arguments: contain(usual(*arguments))

    def _one_sample(self, *arguments: ArrayLike) -> Any:
        """The result for one sample where built-in functions are not available: a map of one sample."""
        results = self.map(*(array[None] for array in self._given.arrays(arguments)))
        parts = results if self._layout.container else (results,)
        return self._layout.contain(
            part[0] if shape else part.item() for part, shape in zip(parts, self.outputs, strict=True)
        )


class Given(NamedTuple):
    """Check of what a kernel (compiled function of vectors) is called with: `kernel` is its name, for messages, and
    `columns` maps its arguments' names, in order, to their lengths n. Nothing is checked at construction."""

    kernel: str
    columns: Mapping[str, int]

    def arrays(self, arguments: Sequence[ArrayLike], sample_axes: int = 0) -> list[Array]:
        """The `arguments`, array-likes, as C-contiguous float64 arrays (n,) in a list: those that are such arrays
        themselves, others copied. With `sample_axes`, 0 by default, as many leading axes of samples, equal in all, come
        before the n; then an argument (n,) is one for all samples. Raises `InputError` for another number of arguments,
        another shape and what holds no real numbers; NaN and infinity pass."""
        if len(arguments) != len(self.columns):
            expected = f"{len(self.columns)} arguments ({', '.join(self.columns)})"
            raise InputError(f"{self.kernel}: expected {expected}, got {len(arguments)}")
        arrays = [self._numbers(name, x, sample_axes) for name, x in zip(self.columns, arguments, strict=True)]
        samples = next((array.shape[:sample_axes] for array in arrays if array.ndim > 1), ())
        for (name, size), array in zip(self.columns.items(), arrays, strict=True):
            if array.shape != (*samples, size) and not (sample_axes and array.shape == (size,)):
                what = f"{self.kernel}: argument {name!r}: expected shape {(*samples, size)}, got {array.shape}"
                raise InputError(what + " (one row a sample)" * sample_axes)
        return arrays

    def refuse(self, *arrays: Array) -> NoReturn:
        """Raise `NonFiniteError`, always: it names the first of the kernel's arguments, whose `arrays` (n,), n an
        argument's length, are given in order, that holds NaN or infinity, or says that the result does, where all
        arguments are finite."""
        for name, array in zip(self.columns, arrays, strict=True):
            if not np.isfinite(array).all():
                raise NonFiniteError(f"{self.kernel}: argument {name!r}: expected finite numbers, got {array.tolist()}")
        raise NonFiniteError(f"{self.kernel}: the result is not finite, though all it was given is")

    def _numbers(self, name: str, argument: ArrayLike, sample_axes: int) -> Array:
        try:
            if type(argument) is np.ndarray and argument.dtype is _DOUBLE and _in_rows(argument, sample_axes):
                return argument
            given = np.asarray(argument)
            array = np.empty(given.shape)
            np.copyto(array, given, casting="same_kind")
        except (TypeError, ValueError) as error:
            raise InputError(f"{self.kernel}: argument {name!r}: expected real numbers ({error})") from error
        return array


def _address(array: NDArray[Any]) -> int:
    """The address of an array's numbers: by its buffer, if it has one to write to, which takes a third of the time."""
    if not (array.flags.carray and array.size):
        return array.ctypes.data
    buffer: Any = array
    return ctypes.addressof(ctypes.c_char.from_buffer(buffer))


def _room(shape: tuple[int, ...]) -> Array:
    """Room for a result; a large one begins on a cache line, since it is written past the caches."""
    return np.empty(shape) if math.prod(shape) * _DOUBLE.itemsize < STREAMED else aligned(shape, made=np.empty)


def _in_rows(array: Array, sample_axes: int) -> bool:
    """True if the numbers of each row lie side by side. Where there is an axis of rows, these may lie apart."""
    apart = sample_axes == 1 == array.ndim - 1 and array.strides[1] == array.itemsize
    beside = array.flags.c_contiguous or (apart and array.strides[0] % array.itemsize == 0)
    return bool(beside and array.flags.aligned)


LARGEST_COMPILED = 100
"""Links up to which equations are compiled. LLVM takes 6 s for the mass matrix of a chain of so many."""


Equation = Callable[..., tuple[Any, ...]]


class OnFloats:
    """Function of vectors that runs in Python and is called with arrays, as a `Kernel` of it, native code, would be:
    for mechanisms of more than 100 links.

    Made of `function`, called by keyword with a `Column` (vector of floats) for each argument, which returns a tuple of
    Columns and scalars; `arguments`, the arguments' names and lengths n; `name`, the function's name in messages, empty
    by default; and `finite`, the check for NaN and infinity: True in arguments and results, "results" in results alone,
    False, the default, nowhere. Construction checks nothing. A call takes array-likes (n,) by position and returns a
    tuple of float64 arrays (n,) and floats, in the function's own units; it raises `InputError` for another number of
    arguments, another shape and what holds no real numbers, `NonFiniteError` for NaN and infinity where `finite`
    refuses them, and what the function raises.
    """

    def __init__(
        self, function: Equation, arguments: Mapping[str, int], *, name: str = "", finite: Finite = False
    ) -> None:
        self.name, self.arguments = name, MappingProxyType(dict(arguments))
        self._function, self._given, self._finite = function, Given(name, self.arguments), finite

    def __call__(self, *arguments: ArrayLike) -> tuple[Any, ...]:
        """The function's results at array-likes of shape (n,), n each argument's length, by position: arrays of
        columns, numbers of scalars."""
        arrays = self._given.arrays(arguments)
        columns = {name: Column(array.tolist()) for name, array in zip(self.arguments, arrays, strict=True)}
        results = tuple(_plain(result) for result in self._function(**columns))
        sound = (*results, *arrays) if self._finite is True else results
        if self._finite and not all(np.isfinite(array).all() for array in sound):
            self._given.refuse(*arrays)
        return results

    @property
    def call(self) -> OnFloats:
        """The object itself, a function of array-likes (n,), n each argument's length, by position. It is there because
        the `call` of a `Kernel`, compiled code, is that one's fastest form; in Python there is no faster one."""
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
    """A `Kernel`, native code for a `function` of vectors, where a mechanism has up to 100 `links` (LARGEST_COMPILED);
    else an `OnFloats`, which runs the function in Python. Both are called with array-likes (n,) by position.

    The function is called by keyword with a `Column` (vector of scalars) for each argument, `arguments` has their names
    and lengths n, and it returns a tuple of Columns and scalars. `name` is the function's name in messages; where it is
    empty, a `Kernel` has the function's own, an `OnFloats` none; `finite` says where NaN and infinity raise
    `NonFiniteError` in calls: True in arguments and results, "results" in results alone, False, the default, nowhere;
    `form`, a `Form`, says which argument of a built-in function made with `Kernel.otherwise` each column comes from,
    None where each is one. Up to 100 links it raises `InputError` for no arguments at all and for lengths that are no
    whole numbers of at least 0, `TraceError` for a function that cannot be traced, and what the function raises;
    beyond, nothing is checked.
    """
    if links > LARGEST_COMPILED:
        return OnFloats(function, arguments, name=name, finite=finite)
    return compile_function(function, arguments, name=name, finite=finite, form=form)
