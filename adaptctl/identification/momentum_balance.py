"""Regressors of the momentum balance (rates of the joints' momenta minus all other forces) at samples of a motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adaptctl.arrays import Array
from adaptctl.caching import cached_property
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.array_equations import COMPILE_AFTER_STATES, is_long
from adaptctl.dynamics.recursion.energy import known_momentum_terms, momentum_terms
from adaptctl.errors import AdaptctlError
from adaptctl.identification.preparation import DIFFERENCE, DIFFERENCE_MARGIN
from adaptctl.scalars import Column, column

# Samples that native code computes at a time, so that its numbers stay in the processor's cache.
SAMPLES_AT_ONCE = 256


class PackedRegressor(NamedTuple):
    """Regressor (n, r, P) as its K entries that are not 0 by structure, joint by joint, and their places."""

    values: Array
    entries: NDArray[np.intp]
    shape: tuple[int, int]

    @classmethod
    def of(cls, regressor: Array) -> PackedRegressor:
        """Entries of a regressor (n, r, P) that are not 0 in all rows."""
        entries = np.flatnonzero(regressor.any(axis=0))
        return cls(regressor.reshape(len(regressor), -1)[:, entries], entries, (regressor.shape[1], regressor.shape[2]))

    @property
    def whole(self) -> Array:
        """Regressor (n, r, P)."""
        regressor = np.zeros((len(self.values), self.shape[0] * self.shape[1]))
        regressor[:, self.entries] = self.values
        return regressor.reshape(-1, *self.shape)

    def spread(self, entries: NDArray[np.intp]) -> PackedRegressor:
        """Regressor as more entries than are not 0."""
        values = np.zeros((len(self.values), len(entries)))
        values[:, np.searchsorted(entries, self.entries)] = self.values
        return PackedRegressor(values, entries, self.shape)

    def beside(self, columns: Array) -> PackedRegressor:
        """Regressor (n, r, P + k) with further columns (n, r, k)."""
        (joints, own), more = self.shape, columns.shape[2]
        width = own + more
        added = (np.arange(joints)[:, None] * width + own + np.arange(more)).ravel()
        entries = np.concatenate([self.entries // own * width + self.entries % own, added])
        order = np.argsort(entries)
        values = np.concatenate([self.values, columns.reshape(len(columns), -1)], axis=1)
        return PackedRegressor(values[:, order], entries[order], (joints, width))

    def joint(self, j: int) -> tuple[NDArray[np.intp], Array]:
        """Indices (k,) of the parameters that a joint's torque depends on, and its rows (n, k)."""
        first, last = np.searchsorted(self.entries, [j * self.shape[1], (j + 1) * self.shape[1]]).tolist()
        return self.entries[first:last] - j * self.shape[1], self.values[:, first:last]

    def torques(self, x: Array) -> Array:
        """Torques (n, r) of parameters (P,)."""
        each = map(self.joint, range(self.shape[0]))
        return np.stack([values @ x[columns] for columns, values in each], axis=-1)


@dataclass(eq=False)
class MomentumBalance:
    """
    Regressor of a mechanism's torques by its momenta, by native code for many samples, or once there were many; of its
    known parameters, their torques as the only column.
    """

    mechanism: Mechanism
    many: bool = False
    known: bool = False
    _states: int = field(default=0, init=False)
    _entries: NDArray[np.intp] | None = field(default=None, init=False)

    def at(self, position: Array, velocity: Array, rate: float) -> PackedRegressor:
        """Regressor (n - 4, r, P) of momenta's rates, by differences of fourth order, less the forces, at n samples."""
        q = self.mechanism.configuration(position)
        self._states += len(q)
        evaluated = self._natively if self._entries is not None and self._compiles else self._in_numpy
        values = evaluated(q, velocity, rate)
        return PackedRegressor(values, self.entries, (self.mechanism.dof, self._columns.stop))

    @property
    def entries(self) -> NDArray[np.intp]:
        """Places (K,) of the entries that are not 0 by structure, among all r times P; known from the first samples."""
        if self._entries is None:
            raise AdaptctlError("entries: expected samples before")
        return self._entries

    @property
    def _compiles(self) -> bool:
        description = self.mechanism.description
        short = len(description.links) <= MAX_COMPILED_LINKS and not is_long(description)
        return short and (self.many or self._states >= COMPILE_AFTER_STATES)

    @property
    def _columns(self) -> range:
        return range(1 if self.known else len(self.mechanism.parameter_names))

    def _terms(self, q: Column, v: Column) -> list[list[Any]]:
        """All entries of the regressors of momenta and forces."""
        mechanism = self.mechanism
        if self.known:
            terms = known_momentum_terms(mechanism.equations, q, v, column(mechanism.inertial_parameters))
        else:
            terms = momentum_terms(mechanism.equations, q, v, self._columns)
        return [[entry for row in rows for entry in row] for rows in terms]

    def _in_numpy(self, q: Array, velocity: Array, rate: float) -> Array:
        terms = self._terms(column(q), column(velocity))
        if self._entries is None:
            differing = [k for k, own in enumerate(zip(*terms, strict=True)) if any(map(_may_differ, own))]
            self._entries = np.array(differing, dtype=np.intp)
        momentum, forces = (_side_by_side([own[k] for k in self._entries], len(q)) for own in terms)
        return _balance(momentum, forces, rate)

    def _natively(self, q: Array, velocity: Array, rate: float) -> Array:
        found = np.empty((len(q) - 2 * DIFFERENCE_MARGIN, len(self.entries)))
        for start in range(0, len(found), SAMPLES_AT_ONCE):
            here = slice(start, start + SAMPLES_AT_ONCE + 2 * DIFFERENCE_MARGIN)
            momentum, forces = self._kernel(q[here], velocity[here]).swapaxes(0, 1)
            found[start : start + SAMPLES_AT_ONCE] = _balance(momentum, forces, rate)
        return found

    @cached_property
    def _kernel(self) -> Callable[[Array, Array], Array]:
        """Entries (n, 2, K) of momenta and forces."""
        from adaptctl.compilation import compile_function

        def packed(q: Column, v: Column) -> list[Column]:
            return [Column(own[k] for k in self.entries) for own in self._terms(q, v)]

        sizes = {"q": len(self.mechanism.description.links), "v": self.mechanism.dof}
        return compile_function(packed, sizes, name=self.mechanism.name).map


def _balance(momentum: Array, forces: Array, rate: float) -> Array:
    """Rates (n - 4, K) of momenta (n, K) less forces."""
    inner = len(momentum) - 2 * DIFFERENCE_MARGIN
    pairs = ((k, weight) for k, weight in enumerate(DIFFERENCE[::-1].tolist()) if weight)
    found = -forces[DIFFERENCE_MARGIN : DIFFERENCE_MARGIN + inner]
    for k, weight in pairs:
        found += (rate * weight) * momentum[k : k + inner]
    return found


def _may_differ(entry: Any) -> bool:
    """False for the number 0 of an entry that is 0 by structure."""
    return np.ndim(entry) > 0 or bool(entry)


def _side_by_side(entries: Sequence[Any], samples: int) -> Array:
    """Array (n, K) of entries for n samples, each of which is contiguous."""
    out = np.empty((len(entries), samples))
    for i, entry in enumerate(entries):
        out[i] = entry
    return out.T
