"""Equations in the free parameters z of constraints D = D0 + N z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.motion import Motion, Torques
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class ConstrainedTorques:
    """Torques with regressors in the free parameters."""

    __slots__ = ("equations", "whole")

    def __init__(self, equations: ConstrainedEquations, whole: Torques) -> None:
        self.equations, self.whole = equations, whole

    def torque(self, parameters: Column) -> Column:
        """Torque (r,) of free parameters (Z,)."""
        return self.whole.torque(self.equations.expanded(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Regressor (r, k), as r rows."""
        needed = self.equations.needed(columns)
        rows = self.whole.regressor(needed)
        return [self.equations.combined(dict(zip(needed, row, strict=True)), columns) for row in rows]


class ConstrainedMotion(ConstrainedTorques, Motion):
    """Motion with regressors in the free parameters."""

    __slots__ = ()
    whole: Motion

    def regressor_transpose_product(self, s: Column, columns: Sequence[int]) -> Column:
        """Regressor's transpose times joint rates, Y' s (k,) in W per unit of each parameter."""
        needed = self.equations.needed(columns)
        return self.equations.combined(
            dict(zip(needed, self.whole.regressor_transpose_product(s, needed), strict=True)), columns
        )

    @property
    def numbers(self) -> Column:
        """Scalars from which `restored_motion` rebuilds this motion."""
        return self.whole.numbers


@dataclass(frozen=True)
class ConstrainedEquations(Equations):
    """Equations of motion in the free parameters z."""

    whole: Equations
    spread: tuple[tuple[tuple[int, float], ...], ...]
    known: tuple[float, ...]

    @property
    def dof(self) -> int:
        """Number r of primary joints."""
        return self.whole.dof

    @property
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the tree's links."""
        return self.whole.links

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return len(self.spread)

    @property
    def has_constraint_bias(self) -> bool:
        """True if the constraints fix parameters at nonzero values (D0)."""
        return any(self.known)

    @property
    def closure_key(self) -> object:
        """Values that a compiled closure of the loops depends on."""
        return self.whole.closure_key

    def closed(self, p: Column, guess: Column) -> Column:
        """Closed configuration (n,) at primary positions (r,)."""
        return self.whole.closed(p, guess)

    def nearest_closed(self, q: Column) -> Column:
        """Configuration (n,) with the loops closed."""
        return self.whole.nearest_closed(q)

    def joint_velocities(self, q: Column, v: Column) -> Column:
        """Velocities (n,) of the tree's joints."""
        return self.whole.joint_velocities(q, v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor (P,)."""
        return self._gathered(self.whole.energy_regressor(q, v).of)

    def potential_regressor(self, q: Column) -> Column:
        """Potential part (P,) of the energy regressor."""
        return self._gathered(self.whole.potential_regressor(q).of)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column, v_f: Column | None = None) -> ConstrainedMotion:
        """Motion at one instant."""
        return ConstrainedMotion(self, self.whole.motion(q, v, v_r, a_r, v_f))

    def momenta(self, q: Column, v: Column, v_f: Column | None = None) -> tuple[ConstrainedTorques, ConstrainedTorques]:
        """Momenta M v, and the forces that change them besides the joints' torques."""
        momentum, forces = self.whole.momenta(q, v, v_f)
        return ConstrainedTorques(self, momentum), ConstrainedTorques(self, forces)

    def restored_motion(self, numbers: Column) -> ConstrainedMotion:
        """Motion rebuilt from its `numbers`."""
        return ConstrainedMotion(self, self.whole.restored_motion(numbers))

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,) under a torque (r,)."""
        return self.whole.forward_dynamics(q, v, torque, self.expanded(parameters))

    def without_gravity(self) -> ConstrainedEquations:
        """Copy of these equations without gravity."""
        return replace(self, whole=self.whole.without_gravity())

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Mass matrix (r, r), as r rows."""
        return self.whole.mass_matrix(q, self.expanded(parameters))

    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """Damping matrix (r, r), as r rows."""
        return self.whole.damping(q, v, self.expanded(parameters))

    def expanded(self, parameters: Column) -> Column:
        """All parameters D (P,) from the free ones (Z,)."""
        terms: list[list[tuple[float, Any]]] = [[(1.0, x)] if x else [] for x in self.known]
        for z, enters in zip(parameters, self.spread, strict=True):
            for place, weight in enters:
                terms[place].append((weight, z))
        return Column(map(_sum, terms))

    def needed(self, columns: Sequence[int]) -> list[int]:
        """Indices of all parameters that the free ones affect."""
        return sorted({place for column in columns for place, _ in self.spread[column]})

    def _gathered(self, entries: Sequence[Scalar]) -> Column:
        return self.combined(dict(enumerate(entries)), range(self.parameters))

    def combined(self, entries: dict[int, Scalar], columns: Sequence[int]) -> Column:
        """Derivatives (k,) by free parameters, from those (P,) by all."""
        return Column(_sum([(weight, entries[place]) for place, weight in self.spread[c]]) for c in columns)


def _sum(terms: Sequence[tuple[float, Scalar]]) -> Scalar:
    shares = [entry if weight == 1.0 else weight * entry for weight, entry in terms]
    total: Any = shares[0] if shares else 0.0
    for share in shares[1:]:
        total = total + share
    return total
