"""Functions of columns called with arrays: in native code where it comes soon enough, else in Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.compilation.builtin import Finite, Form
from adaptctl.compilation.kernel import Given, Kernel, compile_function
from adaptctl.compilation.limits import LARGEST_COMPILED
from adaptctl.scalars import Column

Equation = Callable[..., tuple[Any, ...]]


class OnFloats:
    """A function of columns, called with arrays as a `Kernel` of it is, but run in Python.

    Raises as a kernel does: InputError for arguments of another shape or kind, NonFiniteError if that was asked for.
    """

    def __init__(
        self, function: Equation, arguments: Mapping[str, int], *, name: str = "", finite: Finite = False
    ) -> None:
        self.name, self.arguments = name, MappingProxyType(dict(arguments))
        self._function, self._given, self._finite = function, Given(name, self.arguments), finite

    def __call__(self, *arguments: ArrayLike) -> tuple[Any, ...]:
        """The function's results at array-likes of shape (n,), by position: arrays of columns, numbers of scalars."""
        arrays = self._given.arrays(arguments)
        columns = {name: Column(array.tolist()) for name, array in zip(self.arguments, arrays, strict=True)}
        results = tuple(_plain(result) for result in self._function(**columns))
        sound = (*results, *arrays) if self._finite is True else results
        if self._finite and not all(np.isfinite(array).all() for array in sound):
            self._given.refuse(*arrays)
        return results

    @property
    def call(self) -> OnFloats:
        """The object itself, as a kernel's `call` is its fastest form: on floats there is no faster one."""
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
    """The kernel of `function` for a mechanism of so many links, up to LARGEST_COMPILED; beyond, a function that runs
    it in Python.

    It is called with Columns by keyword, `arguments` has their names and lengths, and returns a tuple of Columns.
    """
    if links > LARGEST_COMPILED:
        return OnFloats(function, arguments, name=name, finite=finite)
    return compile_function(function, arguments, name=name, finite=finite, form=form)
