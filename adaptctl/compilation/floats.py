"""Functions of columns called with arrays: in native code where it comes soon enough, else in Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.compilation.builtin import Finite, Form
from adaptctl.compilation.kernel import Given, Kernel, compile_function
from adaptctl.scalars import Column

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
