"""A control law on many arms at once, in SIMD lanes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, numbers, stacked
from adaptctl.caching import cached_property
from adaptctl.errors import InputError
from adaptctl.scalars import Column

if TYPE_CHECKING:
    from adaptctl.compilation import Ensemble, Stepper


def rows_of_arms(values: Iterable[ArrayLike], sizes: Mapping[str, int], arms: tuple[int, ...]) -> dict[str, Array]:
    """Dict of float64 arrays by name, made of the array-likes `values`, for N arms evaluated at once. An array (..., n)
    whose leading axes have the shape `arms`, whose product is N, becomes rows (N, n); an array (n,), the same for all
    arms, stays (n,). `sizes` maps names, in the order of `values`, to lengths n. Raises `InputError` for another shape
    and for values that are no numbers, `ValueError` for more or fewer `values` than `sizes`."""
    columns = {}
    for (name, size), given in zip(sizes.items(), values, strict=True):
        array = _for_arms(numbers(given, name), size, arms, name)
        columns[name] = array.reshape(-1, size) if array.ndim > 2 else array
    return columns


def row_each(array: Array, arms: tuple[int, ...], name: str) -> Array:
    """The n numbers (..., n) of each of some arms, from `array`, where the shape of the leading axes is `arms`. It is
    `array` itself where that has this shape, and a read-only view, repeated for all arms, of an `array` (n,). Raises
    `InputError` for another shape; `name` is the numbers' name in its message."""
    size = array.shape[-1]
    array = _for_arms(array, size, arms, name)
    return array if array.shape[:-1] == arms else np.broadcast_to(array, (*arms, size))


def _for_arms(array: Array, size: int, arms: tuple[int, ...], name: str) -> Array:
    """The array itself, (..., n) of each of the arms or (n,) for all. Raises `InputError` for another shape."""
    if array.shape not in ((*arms, size), (size,)):
        raise InputError(f"{name}: expected shape {(*arms, size)} or {(size,)}, got {array.shape}")
    return array


Columns = Mapping[str, Array]
"""Numbers (N, n) by name, or (n,) that all N arms share."""


@dataclass(frozen=True, eq=False)
class ManyArms:
    """Control law for many arms at once: one native step in SIMD lanes (arms computed at once) where `native` is True,
    else NumPy on arrays of arms.

    `law` is the law's equation for one arm: called with Columns by keyword, it returns the torque (r,) of r joints, N m
    (N if prismatic), and then the columns of the internal state after the control period, in the order of `memory`.
    `given` has the names and lengths of the columns that it is given each time, `memory` those of the internal state,
    which each call replaces. Nothing is checked at construction.
    """

    law: Callable[..., tuple[Column, ...]]
    given: Mapping[str, int]
    memory: Mapping[str, int]
    native: bool
    _spare: dict[int, tuple[Ensemble, Columns]] = field(default_factory=dict, init=False)
    """Lanes that no tick is using, by their number of arms, and what was last read from them: to make new ones, and to
    write again what they hold, costs more than a tick."""

    def step(self, arms: int, given: Columns, memory: Columns) -> tuple[Array, list[Array]]:
        """The torques (N, r) of r joints, N m (N if prismatic), for one control period of N = `arms` arms, and the
        internal state after it. This state is a list of arrays (N, n), in the order of the attribute `memory`; all
        arrays are new.

        `given` and `memory` hold the columns given and the last internal state by name, arrays (N, n), n a column's
        length, or (n,) for all arms alike. In native code the first call compiles the law, and the state returned is
        read-only. Raises `InputError` for arrays of another shape in native code, and `TraceError` at the first call
        for a law that cannot be traced; NaN and infinity are not looked for.
        """
        if not self.native:
            return self._on_arrays(arms, given, memory)
        spare: tuple[Ensemble, Columns] | None = self._spare.pop(arms, None)
        ensemble, latest = spare or (self._stepper.ensemble(arms), {})
        for name, values in given.items():
            ensemble.held[name] = values
        for name, values in memory.items():
            if values is not latest.get(name):
                ensemble.state[name] = values
        (torque,) = ensemble.run()
        after = {name: frozen(ensemble.state[name]) for name in self.memory}
        self._spare.clear()
        self._spare[arms] = ensemble, after
        return torque, list(after.values())

    @cached_property
    def _stepper(self) -> Stepper:
        from adaptctl.compilation import compile_step  # a single arm does without it

        def step(**columns: Column) -> tuple[Column, ...]:
            torque, *after = self.law(**columns)
            return (*after, torque)

        return compile_step(step, state=self.memory, held=self.given, name="controller")

    def _on_arrays(self, arms: int, given: Columns, memory: Columns) -> tuple[Array, list[Array]]:
        """A tick in NumPy, for laws too long to compile."""
        columns = {name: Column(np.atleast_2d(values).T) for name, values in {**given, **memory}.items()}
        torque, *after = (stacked(column.of, (arms,)) for column in self.law(**columns))
        return torque, after
