"""The equations of a mechanism that can be called with arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, writable
from adaptctl.description import Description
from adaptctl.description.reach import depths
from adaptctl.dynamics.array_equation import ArrayEquation, OnArrays
from adaptctl.dynamics.equations import Equations
from adaptctl.errors import InputError
from adaptctl.scalars import Column

STATES = 64
"""Number of states whose rows are computed at once."""


class RowByRow:
    """Regressor (r, k) of a mechanism of r primary (independent) joints, evaluated on NumPy arrays row by row, by
    native code of a single row, which compiles where that of the whole matrix would take too long. `call` and `into`
    are those of an `ArrayEquation`.

    Made of `whole`, the `ArrayEquation` of the matrix, which is used for several states at once until the row's native
    code is compiled; `powers`, the `ArrayEquation` of the powers (P,) of all P parameters at positions, velocities,
    reference velocities and accelerations and joint rates, (r,) each; `rows`, the number r; and `columns`, the
    zero-based indices of the k parameters, None, the default, for all P. Construction checks nothing. `call` and `into`
    raise `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity in arguments or results, `SingularityError`
    near a singularity of kinematic loops, and `ValueError` for another number of arguments.
    """

    def __init__(
        self, whole: ArrayEquation, powers: ArrayEquation, rows: int, columns: Sequence[int] | None = None
    ) -> None:
        self._whole, self._powers, self._rows = whole, powers, rows
        self._columns = None if columns is None else list(columns)

    def call(self, *arguments: ArrayLike) -> Array:
        """The regressors (..., r, k) at `arguments` (..., r) in SI units, those of `whole`, whose leading axes are
        samples and broadcast. Raises `InputError` on a wrong shape, `NonFiniteError` on NaN or infinity,
        `SingularityError` near a singularity of kinematic loops, `ValueError` for another number of arguments."""
        arrays, samples = self._whole.arrays_of(*arguments)
        count = math.prod(samples)
        if not count or (not self._powers.is_native(count * self._rows) and count != 1):
            return self._whole.call(*arguments)
        if not samples:
            return self._rows_at(*arrays)
        given = [np.broadcast_to(x, (*samples, x.shape[-1])).reshape(count, x.shape[-1]) for x in arrays]
        first = self._rows_at(*(x[:STATES] for x in given))
        found = np.empty((count * self._rows, first.shape[1]))
        found[: len(first)] = first
        for k in range(STATES, count, STATES):
            found[k * self._rows : (k + STATES) * self._rows] = self._rows_at(*(x[k : k + STATES] for x in given))
        return found.reshape(*samples, self._rows, first.shape[1])

    def _rows_at(self, *states: Array) -> Array:
        """The rows at one state (size,) or at several (c, size), one state's after another's."""
        units = unit_rows(self._rows)
        if states[0].ndim > 1:
            units = np.tile(units, (len(states[0]), 1))
            states = tuple(np.repeat(x, self._rows, axis=0) for x in states)
        p, v, *reference = states
        rows = self._powers.on_rows(p, v, *(reference if len(reference) == 2 else (v, *reference)), units)
        return rows if self._columns is None else rows[:, self._columns]

    def into(self, out: Array, *arguments: ArrayLike) -> Array:
        """The array `out`, float64 of the result's shape, filled with the matrices that `call` returns for the
        `arguments`. Raises `InputError` for an `out` of another type or shape or that is read-only, and what `call`
        raises."""
        found = self.call(*arguments)
        writable(out, found.shape, self._whole.name)[...] = found
        return out


@lru_cache(maxsize=4)
def unit_rows(n: int) -> Array:
    """Identity matrix (n, n) of floats, read-only: a view of 2n - 1 numbers, of which each row is another part. `n` is
    a whole number of at least 1, not checked."""
    numbers = np.zeros(2 * n - 1)
    numbers[n - 1] = 1.0
    return np.lib.stride_tricks.sliding_window_view(numbers, n)[::-1]


MOST_PAIRS = 600
"""Pairs of a joint and a link that it moves up to which a whole regressor is compiled: those of a chain of 34 links, or
of most humanoids. LLVM takes 5 s for so many."""

REGRESSORS = "torque_regressor", "slotine_li_regressor"
"""Names of the regressors that are evaluated on some columns alone."""


class ArrayMechanism(Protocol):
    """Protocol of the members of a `Mechanism` from which `ArrayEquations` are made: its description and equations of
    motion, its name, the number r of its primary (independent) joints, its parameters' names, its configurations, and
    the check that its links have mass."""

    @property
    def description(self) -> Description:
        """The data that the mechanism is made of, as a `Description`: its links, joints, loops, gravity and inertial
        parameters."""

    @property
    def equations(self) -> Equations:
        """The mechanism's equations of motion over scalars of any kind (floats, arrays, dual numbers, symbolic ones),
        as an `Equations`."""

    @property
    def name(self) -> str:
        """The mechanism's name, as error messages give it."""

    @property
    def dof(self) -> int:
        """Number r of primary joints, the degrees of freedom: all joints of a tree, the independent ones of loops."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P inertial and friction parameters, such as `link3.I_xx` or `joint2.viscous`, in the order of
        their values."""

    def configuration(self, p: ArrayLike) -> Array:
        """The closed configuration (..., n) of the spanning tree's n joints, rad (m if prismatic), at positions p (...,
        r) of the r primary (independent) joints; p itself for a tree. An implementation raises `InputError` on a wrong
        shape, `NonFiniteError` on NaN or infinity, `LoopError` where loops cannot be closed, and `SingularityError`
        near a singularity of the loops."""

    def require_mass(self) -> None:
        """Raise `InputError` where torques do not determine the accelerations: for links of a tree that have neither
        mass nor rotor, and no descendant with either. Nothing is returned."""


class ArrayEquations:
    """The equations of motion of one mechanism on NumPy arrays: attributes that are `ArrayEquation` objects, whose
    method `call` takes arrays and returns one. Made of a `mechanism`, of r primary (independent) joints and P inertial
    and friction parameters.

    `energy_regressor.call(p, v)` is (..., P), J per unit of each parameter; `torque_regressor.call(p, v, a)` and
    `slotine_li_regressor.call(p, v, v_r, a_r)` are (..., r, P), N m (N if prismatic) per unit of each;
    `inverse_dynamics.call(p, v, a, D)` is the torque (..., r), N m (N); `forward_dynamics.call(p, v, torque, D)` the
    accelerations (..., r), rad/s^2 (m/s^2); `mass_matrix.call(p, D)` (..., r, r), kg m^2 (kg between prismatic joints,
    kg m mixed). p, v, a are positions, velocities, accelerations (..., r), v_r and a_r Slotine and Li's reference
    velocities and accelerations, rad, rad/s, rad/s^2 (m, m/s, m/s^2 if prismatic), and D (P,) or (..., P) parameters in
    SI units; leading axes are samples. Calls raise `InputError` on a wrong shape and for accelerations of links without
    mass, `NonFiniteError` on NaN or infinity, `LoopError` where loops cannot be closed, `SingularityError` near a
    singularity of the loops. No equation is compiled before it is called.
    """

    def __init__(self, mechanism: ArrayMechanism) -> None:
        self._mechanism = mechanism
        self._on_columns: dict[tuple[str, tuple[int, ...]], OnArrays] = {}
        self.energy_regressor = self.of(lambda q, v: mechanism.equations.energy_regressor(q, v), "v")

        def torque(q: Column, v: Column, a: Column, parameters: Column) -> Column:
            return mechanism.equations.inverse_dynamics(q, v, v, a, parameters)

        def inertia(q: Column, parameters: Column) -> list[Column]:
            return [Column(row) for row in mechanism.equations.mass_matrix(q, parameters)]

        def accelerations(q: Column, v: Column, torque: Column, parameters: Column) -> Column:
            mechanism.require_mass()
            return mechanism.equations.forward_dynamics(q, v, torque, parameters)

        self.inverse_dynamics = self.of(torque, "v", "a", "parameters")
        self.forward_dynamics = self.of(accelerations, "v", "torque", "parameters")
        self.mass_matrix = self.of(inertia, "parameters")
        self._powers = self.of(self._all_powers, "v", "v_r", "a_r", "s")
        self.torque_regressor, self.slotine_li_regressor = (self._regressor(name, None) for name in REGRESSORS)

    def on_columns(self, regressor: str, columns: tuple[int, ...]) -> OnArrays:
        """The equation on arrays of a `regressor`, "torque_regressor" or "slotine_li_regressor", of the k parameters of
        indices `columns` alone, each from 0 to P - 1.

        Its `call` takes arrays (p, v, a), or (p, v, v_r, a_r), each (..., r), rad, rad/s, rad/s^2 (m, m/s, m/s^2 if
        prismatic), and returns (..., r, k), N m (N) per unit of each parameter, for r primary (independent) joints. The
        same request returns the same object. Raises `InputError` for another name; indices are not checked.
        """
        if regressor not in REGRESSORS:
            raise InputError(f"regressor: expected {' or '.join(REGRESSORS)}, got {regressor!r}")
        key = regressor, columns
        if key not in self._on_columns:
            self._on_columns[key] = self._regressor(*key)
        return self._on_columns[key]

    def of(
        self,
        function: Callable[..., Column | list[Column]],
        *arguments: str,
        compiled: bool = True,
        sizes: Mapping[str, int] | None = None,
    ) -> ArrayEquation:
        """An equation of this mechanism on arrays, an `ArrayEquation`, from a `function` of `Column` objects (vectors
        of scalars of any kind). The function is called with the configuration q (n,) of the spanning tree's n joints,
        rad (m if prismatic), and one column for each further name in `arguments`, and returns a `Column` (m,) or a
        matrix of k columns as a list of m rows (k,).

        The equation's `call` takes the positions p (..., r) of the r primary (independent) joints in place of q, then
        the further arguments, and returns an array (..., m) or (..., m, k). An argument named in `sizes` has that size,
        `parameters` otherwise P (the number of parameters), any other r. It is never compiled where `compiled` is
        False, True by default, nor for more than 100 links. Nothing is checked or run before the equation is called.
        """
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
        """A regressor of all parameters, or of some; a long mechanism's row by row."""
        mechanism = self._mechanism
        long = sum(depths(link.parent for link in mechanism.description.links)) > MOST_PAIRS

        def rows(q: Column, v: Column, v_r: Column, a_r: Column) -> list[Column]:
            equations = mechanism.equations
            chosen = range(equations.parameters) if columns is None else columns
            return equations.torque_regressor(q, v, v_r, a_r, chosen)

        if name == "slotine_li_regressor":
            whole = self.of(rows, "v", "v_r", "a_r", compiled=not long)
        else:
            whole = self.of(lambda q, v, a: rows(q, v, v, a), "v", "a", compiled=not long)
        return RowByRow(whole, self._powers, mechanism.dof, columns) if long else whole

    def _all_powers(self, q: Column, v: Column, v_r: Column, a_r: Column, s: Column) -> Column:
        """Y' s, of which each row of Y is that of a unit vector s."""
        equations = self._mechanism.equations
        return equations.motion(q, v, v_r, a_r).powers(s, range(equations.parameters))
