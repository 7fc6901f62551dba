"""Equations of motion on arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, checked, same_samples, stacked, stacked_rows, writable
from adaptctl.caching import cached_property
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.description import Description
from adaptctl.description.reach import depths
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.motion import Motion
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, column

if TYPE_CHECKING:
    from adaptctl.compilation import Kernel


COMPILE_AFTER_CALLS, COMPILE_AFTER_STATES = 50, 25_000
"""Calls and states before compilation, which then takes as long as NumPy took until then."""


class OnArrays(Protocol):
    """Protocol of an equation on arrays."""

    @property
    def call(self) -> Callable[..., Array]:
        """Equation of arrays (..., size) in SI units."""

    @property
    def into(self) -> Callable[..., Array]:
        """Equation that fills its first argument."""

    def is_native(self, states: int) -> bool:
        """True if it runs as native code, which it does once it is asked for enough states."""


# A vector, a matrix by rows, or matrices (..., m, n) on arrays.
EquationResult: TypeAlias = Column | list[Column] | Array


class ArrayEquation:
    """Equation of a mechanism on NumPy arrays."""

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
        function: Callable[..., EquationResult],
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
        """Name of the mechanism, for messages."""
        return self._name

    def is_native(self, states: int) -> bool:
        """True if it runs as native code, which it does once it is asked for enough states."""
        return self._kernel is not None or self._compiled(states) is not None

    def arrays_of(self, *arguments: ArrayLike) -> tuple[list[Array], tuple[int, ...]]:
        """Arguments as float arrays (..., size), and their samples' shape."""
        pairs = zip(self._lengths().items(), arguments, strict=True)
        arrays = {what: checked(values, size, f"{self._name}: {what}") for (what, size), values in pairs}
        return list(arrays.values()), same_samples(**arrays)

    def on_rows(self, *arrays: Array, out: Array | None = None) -> Array:
        """Vectors (k, m) at k arguments, by native code if compiled."""
        if self._kernel is None:
            return self._generally(*arrays, out=out)
        first, *rest = arrays
        found: Array = self._kernel.map(first if self._configured is None else self._configured(first), *rest, out=out)
        return found

    def into(self, out: Array, *arguments: ArrayLike) -> Array:
        """Array `out`, filled with the result."""
        return self._generally(*arguments, out=out)

    def _generally(self, *arguments: ArrayLike, out: Array | None = None) -> Array:
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
        if kernel is not None and self.call == self._generally:  # code of a single state, once there is one
            self.call = kernel.with_fallback(self._generally)
        found = self._in_python(given, samples) if kernel is None else np.asarray(kernel(*given))
        if out is None:
            return found
        writable(out, found.shape, self._name)[...] = found
        return out

    def _mapped(self, kernel: Kernel, given: Sequence[Array], samples: tuple[int, ...], out: Array | None) -> Array:
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
            raise NonFiniteError(f"{self._name}: the result is not finite for finite arguments") from error
        if isinstance(result, Column):
            found = stacked(result.of, samples)
        else:
            found = result if isinstance(result, np.ndarray) else stacked_rows(result, samples)
        if not np.isfinite(found).all():
            raise NonFiniteError(f"{self._name}: the result is not finite for finite arguments")
        return found

    def _compiled(self, states: int) -> Kernel | None:
        self._work += 1.0 / COMPILE_AFTER_CALLS + states / COMPILE_AFTER_STATES
        if self._work < 1.0 or not self._compiles or self._links > MAX_COMPILED_LINKS:
            return None
        from adaptctl.compilation import compile_function

        sizes = dict(self._lengths())
        if self._configured is not None:  # then it is given the closed configuration
            sizes[next(iter(sizes))] = self._links
        function = self._function
        kernel = compile_function(lambda **columns: function(*columns.values()), sizes, name=self._name, finite=True)
        if self._configured is not None:
            self.call = self._closing
        self._kernel = kernel
        return kernel

    def _closing(self, p: ArrayLike, *rest: ArrayLike) -> Array:
        if self._kernel is not None and self._configured is not None and type(p) is np.ndarray and p.ndim == 1:
            with suppress(InputError):  # which is raised below, in this equation's words
                found: Array = self._kernel(self._configured(p), *rest)
                return found
        return self._generally(p, *rest)


def _rows(array: Array, samples: tuple[int, ...]) -> Array:
    size = array.shape[-1]
    if array.ndim == 1:
        return array
    whole = array if array.shape[:-1] == samples else np.broadcast_to(array, (*samples, size))  # that is read-only
    return whole.reshape(math.prod(samples), size)


class RowByRow:
    """Regressor of a long mechanism: its motion, then all rows in lanes, which is shorter code than row after row."""

    def __init__(
        self,
        whole: ArrayEquation,
        motion: ArrayEquation,
        powers: ArrayEquation,
        dof: int,
        columns: Sequence[int] | None,
    ) -> None:
        self._whole, self._motion, self._powers, self._dof = whole, motion, powers, dof
        self._columns = None if columns is None else list(columns)
        self._native = False

    def call(self, *arguments: ArrayLike) -> Array:
        """Regressors (..., r, k) at arguments (..., r)."""
        if self._native and all(type(x) is np.ndarray and x.shape == (self._dof,) for x in arguments):
            with suppress(InputError):  # which is raised below, in this equation's words
                return self._chosen(self._all_rows(self._numbers(*arguments)))
        arrays, samples = self._whole.arrays_of(*arguments)
        count = math.prod(samples)
        if (not self.is_native(count) and count != 1) or not count:
            return self._whole.call(*arguments)
        numbers = self._numbers(*arrays)
        states = numbers.reshape(count, numbers.shape[-1])
        rows = self._all_rows(states[0])
        found = np.empty((count, *self._chosen(rows).shape))
        for k, state in enumerate(states):
            found[k] = self._chosen(self._all_rows(state, rows))
        return found.reshape(*samples, *found.shape[1:])

    def is_native(self, states: int) -> bool:
        """True if it runs as native code, which it does once it is asked for enough states."""
        self._native = self._native or (states > 0 and self._powers.is_native(states * self._dof))
        return self._native

    def _numbers(self, p: ArrayLike, v: ArrayLike, *reference: ArrayLike) -> Array:
        """Numbers (..., m) of motions."""
        return self._motion.call(p, v, *(reference if len(reference) == 2 else (v, *reference)))

    def _all_rows(self, numbers: Array, out: Array | None = None) -> Array:
        """Rows (r, P) of a motion's numbers (m,)."""
        return self._powers.on_rows(numbers, unit_rows(self._dof), out=out)

    def _chosen(self, rows: Array) -> Array:
        return rows if self._columns is None else rows[:, self._columns]

    def into(self, out: Array, *arguments: ArrayLike) -> Array:
        """Array `out`, filled with what `call` returns."""
        found = self.call(*arguments)
        writable(out, found.shape, self._whole.name)[...] = found
        return out


@lru_cache(maxsize=4)
def unit_rows(n: int) -> Array:
    """Identity matrix (n, n), a read-only view."""
    numbers = np.zeros(2 * n - 1)
    numbers[n - 1] = 1.0
    return np.lib.stride_tricks.sliding_window_view(numbers, n)[::-1]


MAX_ENTRIES_AT_ONCE = 1000
"""States times joints, up to which a regressor's rows are computed together: for more, skipping zeros pays."""


def rows_at_once(motion: Motion, joints: int, samples: tuple[int, ...], columns: Sequence[int]) -> Array:
    """Regressors (..., joints, k) at arrays of states, from the powers at unit rates of each joint."""
    rates = np.eye(joints).reshape(joints, joints, *(1 for _ in samples))
    powers = stacked(motion.regressor_transpose_product(Column(rates), columns).of, (joints, *samples))
    return np.ascontiguousarray(np.moveaxis(powers, 0, -2))


MAX_JOINT_LINK_PAIRS = 600
"""Pairs of a joint and a link it moves, above which a regressor is computed by rows: LLVM takes 5 s for so many."""


def is_long(description: Description) -> bool:
    """True for mechanisms whose regressors are not compiled whole."""
    return sum(depths(link.parent for link in description.links)) > MAX_JOINT_LINK_PAIRS


REGRESSORS = "torque_regressor", "slotine_li_regressor"
"""Regressors that can be limited to some columns."""


class ArrayMechanism(Protocol):
    """Protocol of a mechanism for `ArrayEquations`."""

    @property
    def description(self) -> Description:
        """Data that the mechanism is made of."""

    @property
    def equations(self) -> Equations:
        """Equations of motion over scalars."""

    @property
    def name(self) -> str:
        """Mechanism's name, as error messages give it."""

    @property
    def dof(self) -> int:
        """Number r of primary joints."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P parameters."""

    @property
    def neutral_configuration(self) -> Array:
        """Positions (r,) at which loops are closed."""

    def configuration(self, p: ArrayLike) -> Array:
        """Closed configuration (..., n) at positions `p` (..., r)."""

    def validate_mass(self) -> None:
        """Raise `InputError` if torques do not determine the accelerations."""


class ArrayEquations:
    """Equations of motion on NumPy arrays."""

    def __init__(self, mechanism: ArrayMechanism) -> None:
        self._mechanism = mechanism
        self._on_columns: dict[tuple[str, tuple[int, ...]], OnArrays] = {}
        self.energy_regressor = self.of(lambda q, v: mechanism.equations.energy_regressor(q, v), "v")

        def torque(q: Column, v: Column, a: Column, parameters: Column) -> Column:
            return mechanism.equations.inverse_dynamics(q, v, v, a, parameters)

        def inertia(q: Column, parameters: Column) -> list[Column]:
            return [Column(row) for row in mechanism.equations.mass_matrix(q, parameters)]

        def accelerations(q: Column, v: Column, torque: Column, parameters: Column) -> Column:
            mechanism.validate_mass()
            return mechanism.equations.forward_dynamics(q, v, torque, parameters)

        self.inverse_dynamics = self.of(torque, "v", "a", "parameters")
        self.forward_dynamics = self.of(accelerations, "v", "torque", "parameters")
        self.mass_matrix = self.of(inertia, "parameters")
        self._motion = self.of(
            lambda q, v, v_r, a_r: mechanism.equations.motion(q, v, v_r, a_r).numbers, "v", "v_r", "a_r"
        )
        self.torque_regressor, self.slotine_li_regressor = (self._regressor(name, None) for name in REGRESSORS)

    def on_columns(self, regressor: str, columns: tuple[int, ...]) -> OnArrays:
        """Regressor's equation for k parameters alone."""
        if regressor not in REGRESSORS:
            raise InputError(f"regressor: expected {' or '.join(REGRESSORS)}, got {regressor!r}")
        key = regressor, columns
        if key not in self._on_columns:
            self._on_columns[key] = self._regressor(*key)
        return self._on_columns[key]

    def of(
        self,
        function: Callable[..., EquationResult],
        *arguments: str,
        compiled: bool = True,
        sizes: Mapping[str, int] | None = None,
    ) -> ArrayEquation:
        """Equation on arrays from a `function` of columns."""
        mechanism = self._mechanism
        configured = None if mechanism.description.loops is None else mechanism.configuration

        def lengths() -> dict[str, int]:
            known = {"parameters": len(mechanism.parameter_names), **(sizes or {})}
            return {name: known.get(name, mechanism.dof) for name in ("p", *arguments)}

        return ArrayEquation(
            mechanism.name,
            function,
            lengths,
            len(mechanism.description.links),
            compiled=compiled,
            configured=configured,
        )

    def _regressor(self, name: str, columns: tuple[int, ...] | None) -> OnArrays:
        mechanism = self._mechanism
        long = is_long(mechanism.description)

        def rows(q: Column, v: Column, v_r: Column, a_r: Column) -> EquationResult:
            equations = mechanism.equations
            chosen = range(equations.parameters) if columns is None else columns
            samples = np.broadcast_shapes(*(x[0].shape for x in (q, v, v_r, a_r) if isinstance(x[0], np.ndarray)))
            few = samples != () and len(v) * math.prod(samples) <= MAX_ENTRIES_AT_ONCE
            if few and chosen and mechanism.description.loops is None:
                return rows_at_once(equations.motion(q, v, v_r, a_r), len(v), samples, chosen)
            return equations.torque_regressor(q, v, v_r, a_r, chosen)

        if name == "slotine_li_regressor":
            whole = self.of(rows, "v", "v_r", "a_r", compiled=not long)
        else:
            whole = self.of(lambda q, v, a: rows(q, v, v, a), "v", "a", compiled=not long)
        return RowByRow(whole, self._motion, self._powers, mechanism.dof, columns) if long else whole

    @cached_property
    def _powers(self) -> ArrayEquation:
        """Powers (P,) of a motion under joint rates s (r,), from its numbers."""
        mechanism = self._mechanism

        def powers(numbers: Column, s: Column) -> Column:
            equations = mechanism.equations
            return equations.restored_motion(numbers).regressor_transpose_product(s, range(equations.parameters))

        def sizes() -> dict[str, int]:
            rest = np.zeros(mechanism.dof)
            numbers = self._motion.call(mechanism.neutral_configuration, rest, rest, rest)
            return {"numbers": numbers.size, "s": mechanism.dof}

        return ArrayEquation(mechanism.name, powers, sizes, len(mechanism.description.links))
