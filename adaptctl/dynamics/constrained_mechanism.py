"""A mechanism whose parameters are related: fewer of them say the same."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen_array
from adaptctl.dynamics.constrained_equations import RelatedEquations
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.errors import InputError

if TYPE_CHECKING:
    from adaptctl.dynamics.loops.continuation import Continuation


@dataclass(frozen=True, eq=False)
class Parametrisation:
    """D = known + matrix z: all P parameters from those that are left, which are some of D themselves."""

    left: tuple[int, ...]
    """which of D the z are, rising"""
    matrix: Array
    """N (P, Z), with N[left] the identity"""
    known: Array
    """D0 (P,)"""

    def expanded(self, z: ArrayLike) -> Array:
        """D (P,) of z (Z,)."""
        return self.known + self.matrix @ frozen_array(z, (len(self.left),), "parameters")


class RelatedMechanism(Mechanism):
    """A mechanism under linear relations among its parameters, on those that are left.

    Everything that takes or gives parameters speaks of the Z that are left: names, values, regressors, and so the
    essential space, bases and controllers that are made from it. Regressors times parameters leave out what is
    known to be other than zero (`known_torque` is that share); torques and accelerations hold it.
    """

    def __init__(self, whole: Mechanism, parametrisation: Parametrisation) -> None:
        if isinstance(whole, RelatedMechanism):
            raise InputError(f"{whole.name}: give all relations at once, not one after another")
        own = whole.inertial_parameters[list(parametrisation.left)]
        super().__init__(whole.description.with_parameters(parametrisation.expanded(own)))
        self.whole, self.parametrisation = whole, parametrisation

    @cached_property
    def equations(self) -> RelatedEquations:
        """The equations in the parameters that are left."""
        whole, N = self.whole.equations, self.parametrisation.matrix
        if isinstance(whole, RelatedEquations):
            raise InputError(f"{self.name}: relations of relations are not understood")
        columns = (np.flatnonzero(column) for column in N.T)
        spread = tuple(tuple((int(i), float(N[i, j])) for i in places.tolist()) for j, places in enumerate(columns))
        return RelatedEquations(whole, spread, tuple(self.parametrisation.known.tolist()))

    @property
    def continuation(self) -> Continuation | None:
        """The branch of closed configurations, which no parameter changes."""
        return self.whole.continuation

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that are left."""
        return tuple(self.whole.parameter_names[i] for i in self.parametrisation.left)

    @cached_property
    def inertial_parameters(self) -> Array:
        """Their values, read-only."""
        values = self.description.inertial_parameters[list(self.parametrisation.left)]
        return frozen_array(values, values.shape, "parameters")

    @property
    def energetic(self) -> int:
        """How many of the parameters that are left enter the energy."""
        return sum(i < self.whole.energetic for i in self.parametrisation.left)

    @property
    def geometry_sha256(self) -> str:
        """A hash of what decides which parameters matter: the mechanism's, and the relations."""
        N, known = self.parametrisation.matrix, self.parametrisation.known
        numbers = [[round(x, 12) + 0.0 for x in array.ravel().tolist()] for array in (N, known)]
        content = [self.whole.geometry_sha256, list(self.parametrisation.left), numbers]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    def with_parameters(self, parameters: ArrayLike) -> RelatedMechanism:
        """The same mechanism with other values of the parameters that are left."""
        whole = self.whole.with_parameters(self.parametrisation.expanded(parameters))
        return RelatedMechanism(whole, self.parametrisation)

    def energy(self, p: ArrayLike, v: ArrayLike) -> Array:
        """Kinetic plus potential energy (...), in J, of what is known too."""
        return Mechanism(self.description).energy(p, v)

    def known_torque(self, p: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """The torque (..., r) of what is known: what a regressor times the parameters that are left leaves out."""
        known = self.whole.with_parameters(self.parametrisation.known)
        return known.inverse_dynamics(p, v, a)
