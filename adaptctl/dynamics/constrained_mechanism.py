"""A mechanism under linear constraints on its parameters."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.description.drive import Drive
from adaptctl.dynamics.constrained_equations import ConstrainedEquations
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.errors import InputError

if TYPE_CHECKING:
    from adaptctl.dynamics.loops.continuation import Continuation


@sent_as_made
@dataclass(frozen=True, eq=False)
class Parametrisation:
    """Affine map D = D0 + N z from free parameters to all."""

    left: tuple[int, ...]
    matrix: Array
    known: Array

    def expanded(self, z: ArrayLike) -> Array:
        """All parameters D (P,) from the free ones (Z,)."""
        return self.known + self.matrix @ frozen_array(z, (len(self.left),), "parameters")

    def among(self, names: Sequence[str], others: Sequence[str]) -> Parametrisation:
        """The same constraints for other drives."""
        taken = [i for i in range(len(names)) if i not in self.left]
        bound = {*taken, *(i for i, column in zip(self.left, self.matrix.T, strict=True) if column[taken].any())}
        if missing := [names[i] for i in sorted(bound) if names[i] not in others]:
            raise InputError(f"drives: the constraints bind {', '.join(missing)}; give the drives these terms")
        rows = {names[i]: others.index(names[i]) for i in taken}
        left = tuple(i for i, name in enumerate(others) if name not in rows)
        N, known = np.eye(len(others))[:, left], np.zeros(len(others))
        shared = [(left.index(others.index(names[i])), k) for k, i in enumerate(self.left) if names[i] in others]
        for i in taken:
            known[rows[names[i]]] = self.known[i]
            for column, k in shared:
                N[rows[names[i]], column] = self.matrix[i, k]
        return Parametrisation(left, N, known)


class ConstrainedMechanism(Mechanism):
    """Mechanism under linear constraints on its parameters D (P,)."""

    def __init__(self, whole: Mechanism, parametrisation: Parametrisation) -> None:
        if whole.parameter_names != whole.description.parameter_names:
            raise InputError(f"{whole.name}: is constrained already; give all relations in one call")
        own = whole.inertial_parameters[list(parametrisation.left)]
        super().__init__(whole.description.with_parameters(parametrisation.expanded(own)))
        self.whole, self.parametrisation = whole, parametrisation

    @cached_property
    def equations(self) -> ConstrainedEquations:
        """Equations of motion in the free parameters z."""
        N = self.parametrisation.matrix
        columns = (np.flatnonzero(column) for column in N.T)
        spread = tuple(tuple((int(i), float(N[i, j])) for i in places.tolist()) for j, places in enumerate(columns))
        return ConstrainedEquations(self.whole.equations, spread, tuple(self.parametrisation.known.tolist()))

    @property
    def is_plain_tree(self) -> bool:
        """False, since linear constraints bind the parameters."""
        return False

    @property
    def unconstrained(self) -> Mechanism:
        """The mechanism without linear constraints."""
        return self.whole

    @property
    def free_directions(self) -> Array:
        """Matrix N (P, Z) of D = D0 + N z."""
        return self.parametrisation.matrix

    @property
    def continuation(self) -> Continuation | None:
        """Assembly branch of the reference configuration."""
        return self.whole.continuation

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the Z free parameters."""
        return tuple(self.whole.parameter_names[i] for i in self.parametrisation.left)

    @cached_property
    def inertial_parameters(self) -> Array:
        """Values (Z,) of the free parameters in SI units, read-only."""
        values = self.description.inertial_parameters[list(self.parametrisation.left)]
        return frozen_array(values, values.shape, "parameters")

    @property
    def num_energy_parameters(self) -> int:
        """Number of free parameters in the energy."""
        return sum(i < self.whole.num_energy_parameters for i in self.parametrisation.left)

    @property
    def geometry_sha256(self) -> str:
        """SHA-256 hash (hexadecimal) of the data that decide identifiability."""
        N, known = self.parametrisation.matrix, self.parametrisation.known
        numbers = [[round(x, 12) + 0.0 for x in array.ravel().tolist()] for array in (N, known)]
        content = [self.whole.geometry_sha256, list(self.parametrisation.left), numbers]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    def with_parameters(self, parameters: ArrayLike) -> ConstrainedMechanism:
        """Copy with other values (Z,) of the free parameters."""
        whole = self.whole.with_parameters(self.parametrisation.expanded(parameters))
        return ConstrainedMechanism(whole, self.parametrisation)

    def with_drives(self, drives: Drive | Sequence[Drive]) -> ConstrainedMechanism:
        """Copy with other drives."""
        whole = self.whole.with_drives(drives)
        return ConstrainedMechanism(
            whole, self.parametrisation.among(self.whole.parameter_names, whole.parameter_names)
        )

    def energy(self, p: ArrayLike, v: ArrayLike) -> Array:
        """Total energy (...) in J, with that of fixed parameters."""
        return Mechanism(self.description).energy(p, v)

    def constraint_bias_torque(self, p: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Torque (..., r) of the constant term D0."""
        known = self.whole.with_parameters(self.parametrisation.known)
        return known.inverse_dynamics(p, v, a)
