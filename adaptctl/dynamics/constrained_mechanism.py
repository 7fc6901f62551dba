"""A mechanism under linear constraints on its parameters, in those that are left free."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.dynamics.constrained_equations import ConstrainedEquations
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.errors import InputError

if TYPE_CHECKING:
    from adaptctl.dynamics.loops.continuation import Continuation


@sent_as_made
@dataclass(frozen=True, eq=False)
class Parametrisation:
    """Affine map from the Z free parameters, which are some of the P, to all P: D = known + matrix z."""

    left: tuple[int, ...]
    """which of D the free parameters z are, rising"""
    matrix: Array
    """N (P, Z), with N[left] the identity"""
    known: Array
    """D0 (P,)"""

    def expanded(self, z: ArrayLike) -> Array:
        """All parameters D (P,) of the free ones z (Z,)."""
        return self.known + self.matrix @ frozen_array(z, (len(self.left),), "parameters")


class ConstrainedMechanism(Mechanism):
    """A mechanism under linear constraints on its parameters, with the Z parameters that are left free.

    All that takes or gives parameters means those Z: names, values, regressors, and so the essential space, bases
    and controllers made from it. Regressors times parameters leave out the share of known values other than zero
    (`known_torque`); torques and accelerations include it.
    """

    def __init__(self, whole: Mechanism, parametrisation: Parametrisation) -> None:
        if whole.parameter_names != whole.description.parameter_names:
            raise InputError(f"{whole.name}: give all relations at once, not one after another")
        own = whole.inertial_parameters[list(parametrisation.left)]
        super().__init__(whole.description.with_parameters(parametrisation.expanded(own)))
        self.whole, self.parametrisation = whole, parametrisation

    @cached_property
    def equations(self) -> ConstrainedEquations:
        """The equations in the free parameters."""
        N = self.parametrisation.matrix
        columns = (np.flatnonzero(column) for column in N.T)
        spread = tuple(tuple((int(i), float(N[i, j])) for i in places.tolist()) for j, places in enumerate(columns))
        return ConstrainedEquations(self.whole.equations, spread, tuple(self.parametrisation.known.tolist()))

    @property
    def is_plain_tree(self) -> bool:
        """False: the mechanism has constraints, so its parameters are fewer than ten a link."""
        return False

    @property
    def unconstrained(self) -> Mechanism:
        """The mechanism on all its parameters."""
        return self.whole

    @property
    def free_directions(self) -> Array:
        """The matrix N (P, Z) of D = D0 + N z: derivatives of all parameters by the free ones."""
        return self.parametrisation.matrix

    @property
    def continuation(self) -> Continuation | None:
        """The branch of closed configurations, which no parameter changes."""
        return self.whole.continuation

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """The free parameters' names."""
        return tuple(self.whole.parameter_names[i] for i in self.parametrisation.left)

    @cached_property
    def inertial_parameters(self) -> Array:
        """The free parameters' values (Z,), read-only."""
        values = self.description.inertial_parameters[list(self.parametrisation.left)]
        return frozen_array(values, values.shape, "parameters")

    @property
    def energetic(self) -> int:
        """Number of free parameters that enter the energy."""
        return sum(i < self.whole.energetic for i in self.parametrisation.left)

    @property
    def geometry_sha256(self) -> str:
        """A hash of what decides which parameters matter: the mechanism's, and the relations."""
        N, known = self.parametrisation.matrix, self.parametrisation.known
        numbers = [[round(x, 12) + 0.0 for x in array.ravel().tolist()] for array in (N, known)]
        content = [self.whole.geometry_sha256, list(self.parametrisation.left), numbers]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    def with_parameters(self, parameters: ArrayLike) -> ConstrainedMechanism:
        """The same mechanism with other values of the free parameters (Z,)."""
        whole = self.whole.with_parameters(self.parametrisation.expanded(parameters))
        return ConstrainedMechanism(whole, self.parametrisation)

    def energy(self, p: ArrayLike, v: ArrayLike) -> Array:
        """Kinetic plus potential energy (...), in J, with the part due to known parameters."""
        return Mechanism(self.description).energy(p, v)

    def known_torque(self, p: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """The torque (..., r) N m of the known values, which regressors times free parameters leave out."""
        known = self.whole.with_parameters(self.parametrisation.known)
        return known.inverse_dynamics(p, v, a)
