"""An equation of a mechanism on arrays: in Python at first, in native code once it is asked for again and again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, same_samples, stacked, stacked_rows, writable
from adaptctl.compilation.kernel import LARGEST_COMPILED
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, column

if TYPE_CHECKING:
    from adaptctl.compilation import Kernel

CALLS, STATES = 50, 25_000
"""Calls and states after which an equation is compiled: until then, with seven links, NumPy has taken about as long as
LLVM would."""


class OnArrays(Protocol):
    """Protocol of an equation of a mechanism on arrays: `call` takes arrays (..., size) whose leading axes are samples,
    and returns one of results; `into` takes the same after a float64 array `out`, which it fills and returns."""

    @property
    def call(self) -> Callable[..., Array]:
        """The equation as a function of one array (..., size) for each argument, size its own, in SI units; leading
        axes are samples. It returns the array of results, with these axes, and raises `InputError` on a wrong shape,
        `NonFiniteError` on NaN or infinity."""

    @property
    def into(self) -> Callable[..., Array]:
        """The equation as a function of `out`, a float64 array of the result's shape, and one array (..., size) for
        each argument, size its own, in SI units. It fills `out` and returns it, and raises `InputError` on a wrong
        shape, `NonFiniteError` on NaN or infinity."""


class ArrayEquation:
    """An equation of a mechanism, such as its inverse dynamics, evaluated on NumPy arrays in Python or in native code.
    Its attribute `call` takes one array (..., size) in SI units for each argument, whose leading axes are samples and
    broadcast, and returns vectors (..., s) of length s or matrices (..., s, k) of s rows and k columns. Its attribute
    `into` takes the same after a float64 array `out` of the result's shape, which it fills and returns.

    Made of the mechanism's `name`, for messages; `function`, called by position with one `Column` (size,), a vector of
    scalars of any kind, for each argument, which returns one `Column` (s,) or a list of s of them, the rows (k,);
    `sizes`, a callable without arguments that returns the arguments' sizes by name, first that of the positions p (r,)
    of the r primary (independent) joints, rad (m if prismatic); `configured`, a callable that makes of p the
    configuration (..., n) of the spanning tree's n joints, which `function` then takes for p, None where that is p
    itself; `links`, the number n of links; and `compiled`, False for an equation that is never compiled.

    It runs in Python at first. Once calls/50 + samples/25000, summed over all calls, is 1 it is compiled and runs as
    native code, with several samples at once in SIMD registers. Both agree to round-off. `call` and `into` raise
    `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity, in their arguments or the result, `ValueError`
    for another number of arguments, and what `configured` and `function` raise.
    """

    __slots__ = (
        "__weakref__",
        "_compiles",
        "_configured",
        "_function",
        "_kernel",
        "_lengths",
        "_links",
        "_name",
        "_work",
        "call",
    )

    def __init__(
        self,
        name: str,
        function: Callable[..., Column | list[Column]],
        sizes: Callable[[], Mapping[str, int]],
        links: int,
        *,
        compiled: bool = True,
        configured: Callable[[Array], Array] | None = None,
    ) -> None:
        self._name, self._function, self._lengths = name, function, sizes
        self._links, self._compiles, self._configured = links, compiled, configured
        self._kernel: Kernel | None = None
        self._work = 0.0
        self.call: Callable[..., Array] = self._generally

    @property
    def name(self) -> str:
        """Name of the mechanism whose equation this is, which its error messages begin with."""
        return self._name

    def is_native(self, states: int) -> bool:
        """True if the equation runs as native code by now. Asking counts as one call at so many `states`, a whole
        number, and compiles the equation where calls/50 + states/25000, summed over all calls, comes to 1 by it;
        mechanisms of too many links are never compiled. Raises what tracing the equation raises."""
        return self._kernel is not None or self._compiled(states) is not None

    def arrays_of(self, *arguments: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
        """The `arguments` as arrays of floats (..., size), size an argument's own, and the shape of their samples, to
        which their leading axes broadcast. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
        `ValueError` for another number of arguments."""
        pairs = zip(self._lengths().items(), arguments, strict=True)
        arrays = {what: checked(values, size, f"{self._name}: {what}") for (what, size), values in pairs}
        return list(arrays.values()), same_samples(**arrays)

    def on_rows(self, *arrays: Array) -> Array:
        """The vectors (k, m) that an equation of a vector of length m has at k arguments at once, in native code if the
        method `is_native` is True. `arrays` are the arguments in order, float64 and finite: (k, size) each, or (size,)
        for all k alike, size an argument's own; the first, the positions (r,) of r joints, is the same for all k. In
        native code shapes and values are not checked here; raises `SingularityError` where loops cannot be followed to
        the positions, `NonFiniteError` for results that are not finite."""
        if self._kernel is None:
            return self._generally(*arrays)
        first, *rest = arrays
        found: Array = self._kernel.map(first if self._configured is None else self._configured(first), *rest)
        return found

    def into(self, out: Array, *arguments: ArrayLike) -> Array:
        """The results of a call, written into `out`, which is returned. Raises `InputError` for an `out` that is no writable
        float64 array of the results' shape, and what a call raises."""
        return self._generally(*arguments, out=out)

    def _generally(self, *arguments: ArrayLike, out: Array | None = None) -> Array:
        """Any arrays that fit together, by whatever way pays. Native code checks plain rows itself."""
        first: Any = arguments[0] if arguments else None
        if self._kernel is not None and self._configured is None and type(first) is np.ndarray and first.ndim == 2:
            with suppress(InputError):  # which is raised below, in this equation's words
                made: Array = self._kernel.map(*arguments, out=out)
                return made
        (p, *rest), samples = self.arrays_of(*arguments)
        kernel = self._kernel if self._kernel is not None else self._compiled(math.prod(samples))
        given = [p if self._configured is None else self._configured(p), *rest]
        if kernel is not None and samples:
            return self._mapped(kernel, given, samples, out)
        found = self._in_python(given, samples) if kernel is None else np.asarray(kernel(*given))
        if out is None:
            return found
        writable(out, found.shape, self._name)[...] = found
        return out

    def _mapped(self, kernel: Kernel, given: Sequence[Array], samples: tuple[int, ...], out: Array | None) -> Array:
        """Native code at many states."""
        rows, shape = [_rows(array, samples) for array in given], kernel.outputs[0]
        if out is None:
            made: Array = kernel.map(*rows)
            return made.reshape(*samples, *shape)
        results = writable(out, (*samples, *shape), self._name)
        if results.flags.carray:
            kernel.map(*rows, out=results.reshape(math.prod(samples), *shape))
        else:
            results[...] = kernel.map(*rows).reshape(results.shape)
        return results

    def _in_python(self, given: Sequence[Array], samples: tuple[int, ...]) -> Array:
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                result = self._function(*map(column, given))
        except ZeroDivisionError as error:
            raise NonFiniteError(f"{self._name}: the result is not finite, though all it was given is") from error
        found = stacked(result.of, samples) if isinstance(result, Column) else stacked_rows(result, samples)
        if not np.isfinite(found).all():
            raise NonFiniteError(f"{self._name}: the result is not finite, though all it was given is")
        return found

    def _compiled(self, states: int) -> Kernel | None:
        """Native code, if it pays by now."""
        self._work += 1.0 / CALLS + states / STATES
        if self._work < 1.0 or not self._compiles or self._links > LARGEST_COMPILED:
            return None
        from adaptctl.compilation import compile_function

        sizes = {"q": self._links, **dict(list(self._lengths().items())[1:])}
        function = self._function
        kernel = compile_function(lambda **columns: function(*columns.values()), sizes, name=self._name, finite=True)
        if self._configured is None:
            self.call = kernel.otherwise(self._generally)
        else:
            self.call = self._closing
        self._kernel = kernel
        return kernel

    def _closing(self, p: ArrayLike, *rest: ArrayLike) -> Array:
        """The native code at one state whose loops are closed first; any other arrays as before."""
        if self._kernel is not None and self._configured is not None and type(p) is np.ndarray and p.ndim == 1:
            with suppress(InputError):  # which is raised below, in this equation's words
                found: Array = self._kernel(self._configured(p), *rest)
                return found
        return self._generally(p, *rest)


def _rows(array: Array, samples: tuple[int, ...]) -> Array:
    """A row a sample (m, n), or one for all (n,)."""
    size = array.shape[-1]
    if array.ndim == 1:
        return array
    whole = array if array.shape[:-1] == samples else np.broadcast_to(array, (*samples, size))  # that is read-only
    return whole.reshape(math.prod(samples), size)
