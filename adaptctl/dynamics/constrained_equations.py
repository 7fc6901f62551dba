"""Equations on free parameters z, where linear constraints among a mechanism's parameters hold: D = D0 + N z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from adaptctl.dynamics.equations import Equations, Motion
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class ConstrainedMotion(Motion):
    """A mechanism's motion, with torques and regressors in the free parameters z."""

    __slots__ = ("equations", "whole")

    def __init__(self, equations: ConstrainedEquations, whole: Motion) -> None:
        self.equations, self.whole = equations, whole

    def torque(self, parameters: Column) -> Column:
        """The torque M a_r + C(p, v) v_r + g + friction (r,), N m, with the part due to known parameters."""
        return self.whole.torque(self.equations.expanded(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Rows (r,) of Y N, each with the asked columns only."""
        needed = self.equations.needed(columns)
        rows = self.whole.regressor(needed)
        return [self.equations.combined(dict(zip(needed, row, strict=True)), columns) for row in rows]

    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """The product (Y N)' s (c,) of the regressor's asked columns and joint rates s (r,), without forming Y."""
        needed = self.equations.needed(columns)
        return self.equations.combined(dict(zip(needed, self.whole.powers(s, needed), strict=True)), columns)

    @property
    def numbers(self) -> Column:
        """Numbers (n,) of the motion without constraints."""
        return self.whole.numbers


@dataclass(frozen=True)
class ConstrainedEquations(Equations):
    """The equations of motion in free parameters z (Z,), of which all the mechanism's parameters are D = D0 + N z.

    Regressors are those of z alone, Y N; torques and accelerations include the share of D0. Columns of N that are
    zero but for a single one cost nothing: that parameter itself is free.
    """

    whole: Equations
    spread: tuple[tuple[tuple[int, float], ...], ...]
    """for every z, the parameters it enters and its weight there: N by columns"""
    known: tuple[float, ...]
    """D0"""

    @property
    def dof(self) -> int:
        """Number of primary joints r."""
        return self.whole.dof

    @property
    def links(self) -> tuple[Segment, ...]:
        """The tree's links, as geometry."""
        return self.whole.links

    @property
    def parameters(self) -> int:
        """Number of free parameters."""
        return len(self.spread)

    @property
    def has_known_share(self) -> bool:
        """True where D0 is other than zero."""
        return any(self.known)

    def closed(self, p: Column, guess: Column) -> Column:
        """The configuration q = U(p) (n,) for positions p (r,), from a nearby configuration."""
        return self.whole.closed(p, guess)

    def projected(self, q: Column) -> Column:
        """The configuration (n,) with loops closed better, by one Newton step or all the way."""
        return self.whole.projected(q)

    def rates(self, q: Column, v: Column) -> Column:
        """The tree's joint velocities J v (n,)."""
        return self.whole.rates(q, v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor N' E (Z,) of the free parameters: J per unit of each."""
        return self._gathered(self.whole.energy_regressor(q, v).of)

    def potential_regressor(self, q: Column) -> Column:
        """The potential part (Z,) of the energy regressor N' E, J per unit of each free parameter."""
        return self._gathered(self.whole.potential_regressor(q).of)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> ConstrainedMotion:
        """The mechanism's motion, with torques and regressors in the free parameters z."""
        return ConstrainedMotion(self, self.whole.motion(q, v, v_r, a_r))

    def remembered(self, numbers: Column) -> ConstrainedMotion:
        """The motion that has these numbers."""
        return ConstrainedMotion(self, self.whole.remembered(numbers))

    @property
    def motion_size(self) -> int:
        """Length of `Motion.numbers`."""
        return self.whole.motion_size

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,) of the primary joints under their torques (r,), with the part due to known parameters."""
        return self.whole.forward_dynamics(q, v, torque, self.expanded(parameters))

    def weightless(self) -> ConstrainedEquations:
        """The same equations without gravity."""
        return replace(self, whole=self.whole.weightless())

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Rows (r,) of the mass matrix M(p), kg m^2."""
        return self.whole.mass_matrix(q, self.expanded(parameters))

    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """Rows (r,) of the damping B, N m s/rad: derivatives of friction by velocities."""
        return self.whole.damping(q, v, self.expanded(parameters))

    def expanded(self, parameters: Column) -> Column:
        """All parameters D = D0 + N z (P,) of free ones z (Z,)."""
        terms: list[list[tuple[float, Any]]] = [[(1.0, x)] if x else [] for x in self.known]
        for z, enters in zip(parameters, self.spread, strict=True):
            for place, weight in enters:
                terms[place].append((weight, z))
        return Column(map(_sum, terms))

    def needed(self, columns: Sequence[int]) -> list[int]:
        """Indices, rising, of the parameters among D that the asked free ones enter."""
        return sorted({place for column in columns for place, _ in self.spread[column]})

    def _gathered(self, entries: Sequence[Scalar]) -> Column:
        return self.combined(dict(enumerate(entries)), range(self.parameters))

    def combined(self, entries: dict[int, Scalar], columns: Sequence[int]) -> Column:
        """The entries (Z,) of the asked free parameters: N' times entries, one for each `needed` parameter."""
        return Column(_sum([(weight, entries[place]) for place, weight in self.spread[c]]) for c in columns)


def _sum(terms: Sequence[tuple[float, Scalar]]) -> Scalar:
    shares = [entry if weight == 1.0 else weight * entry for weight, entry in terms]
    total: Any = shares[0] if shares else 0.0
    for share in shares[1:]:
        total = total + share
    return total
