"""Equations on free parameters z, where linear constraints among a mechanism's parameters hold: D = D0 + N z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from adaptctl.dynamics.equations import Equations, Motion
from adaptctl.dynamics.recursion.segment import Segment
from adaptctl.scalars import Column, Scalar


class ConstrainedMotion(Motion):
    """The motion of a mechanism under linear constraints on its parameters at one instant, from which torques,
    regressors and powers in the Z free parameters z follow. All P inertial and friction parameters are D = D0 + N z.

    Made of `equations`, the `ConstrainedEquations`, which have D0 (P,) and N (P, Z), and `whole`, the same motion of
    the mechanism without constraints, a `Motion` of r primary (independent) joints. Nothing is checked.
    """

    __slots__ = ("equations", "whole")

    def __init__(self, equations: ConstrainedEquations, whole: Motion) -> None:
        self.equations, self.whole = equations, whole

    def torque(self, parameters: Column) -> Column:
        """The torque M a_r + C v_r + g + friction at v_r (r,), N m (N if prismatic), of the r primary (independent)
        joints under reference velocities v_r and accelerations a_r. It is for values z (Z,) of the Z free inertial and
        friction `parameters` in SI units, in the order of the constrained mechanism's `parameter_names`. M is the mass
        matrix, C the Christoffel (Coriolis) matrix, g gravity's torque. The contribution of values that linear
        constraints fix is included. Raises `ValueError` for another number of parameters."""
        return self.whole.torque(self.equations.expanded(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """The Slotine-Li regressor Y N (r, k), as r rows, one `Column` (k,) each, for the k of the Z free inertial and
        friction parameters z whose indices `columns` are, in their order: N m (N if prismatic) per unit of each. By
        linear constraints all P parameters are D = D0 + N z, and Y (r, P) is their regressor; over all columns Y N z is
        the torque less the contribution of D0. Raises `IndexError` for an index of Z or more; negative ones are not
        refused."""
        needed = self.equations.needed(columns)
        rows = self.whole.regressor(needed)
        return [self.equations.combined(dict(zip(needed, row, strict=True)), columns) for row in rows]

    def regressor_transpose_product(self, s: Column, columns: Sequence[int]) -> Column:
        """The powers (Y N)' s (k,), W per unit of each, for the k of the Z free inertial and friction parameters whose
        indices `columns` are, at rates `s` (r,) of the r primary (independent) joints, rad/s (m/s if prismatic). Y N
        (r, Z), whose transpose is (Y N)', is the Slotine-Li regressor in the free parameters z, which is not formed; by
        linear constraints all P parameters are D = D0 + N z. Raises `IndexError` for an index of Z or more,
        `IndexError` or `ValueError` for too short an s; negative indices are not refused."""
        needed = self.equations.needed(columns)
        return self.equations.combined(
            dict(zip(needed, self.whole.regressor_transpose_product(s, needed), strict=True)), columns
        )

    @property
    def numbers(self) -> Column:
        """The scalars from which `ConstrainedEquations.remembered` rebuilds this motion, a `Column`."""
        return self.whole.numbers


@dataclass(frozen=True)
class ConstrainedEquations(Equations):
    """Equations of motion in the Z parameters z that linear constraints leave free, all P inertial and friction
    parameters being D = D0 + N z. Regressors are those of z alone: Y N, for a regressor Y (r, P) of D. Torques and
    accelerations include the contribution of D0.

    `whole` are the equations without constraints; `spread` has for each of the Z columns of N its entries other than
    zero, as pairs (index from 0 to P - 1, entry), each in the unit of its D per unit of its z; `known` is D0 (P,), SI
    units. Nothing is checked.
    """

    whole: Equations
    spread: tuple[tuple[tuple[int, float], ...], ...]
    known: tuple[float, ...]

    @property
    def dof(self) -> int:
        """Number r of primary joints, the degrees of freedom: all joints of a tree, the independent ones of loops."""
        return self.whole.dof

    @property
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the spanning tree's n links, a `Segment` each, lengths in m, parents before their children."""
        return self.whole.links

    @property
    def parameters(self) -> int:
        """Number Z of inertial and friction parameters that the linear constraints leave free."""
        return len(self.spread)

    @property
    def has_known_share(self) -> bool:
        """True where linear constraints fix parameters at values other than zero (D0 of D = D0 + N z), False otherwise.
        Torques and energies then have a contribution for which regressors in the free parameters z have no columns."""
        return any(self.known)

    @property
    def closing_numbers(self) -> object:
        """The numbers, texts and kinds that closing the loops depends on, nested tuples to be compared."""
        return self.whole.closing_numbers

    def closed(self, p: Column, guess: Column) -> Column:
        """The closed configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), at positions p (r,) of
        the r primary (independent) joints, on the assembly branch of `guess` (n,), a closed configuration; p itself for
        a tree. Where no closed form exists it is found by three Newton steps, exact to round-off from within 0.05 rad.
        Constraints on parameters do not change it. Arguments are not checked: where the loops stay open, nothing is
        raised; with loops, too short a p or guess raises `ValueError` or `IndexError`, an exactly singular closure
        Jacobian `ZeroDivisionError` in floats."""
        return self.whole.closed(p, guess)

    def projected(self, q: Column) -> Column:
        """A configuration (n,) of the spanning tree's n joints, rad (m if prismatic), near `q` (n,), with q's positions
        of the primary (independent) joints and the loops closed; q itself for a tree. It is exact where a closed form
        exists, else one Newton step from q, which must be near a closed configuration (from 0.05 rad away, 1e-3 rad
        remain). Constraints on parameters do not change it. Arguments are not checked: with loops, too short a q raises
        `IndexError`, an exactly singular closure Jacobian `ZeroDivisionError` in floats."""
        return self.whole.projected(q)

    def rates(self, q: Column, v: Column) -> Column:
        """Velocities J v (n,) of the spanning tree's n joints, rad/s (m/s if prismatic), from velocities `v` (r,) of
        the r primary (independent) joints, at a configuration `q` (n,) of the tree, rad (m). J (n, r) is the derivative
        of q with respect to the primary positions. For a tree they are v itself. Arguments are not checked: with loops,
        vectors too short raise `IndexError` or `ValueError`, an exactly singular closure Jacobian `ZeroDivisionError`
        in floats."""
        return self.whole.rates(q, v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor N' E (Z,), J per unit of each of the Z free inertial and friction parameters z, at a
        configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), and velocities v (r,) of the r
        primary (independent) joints, rad/s (m/s). N' is the transpose of N, D = D0 + N z being all P parameters, and E
        (P,) their energy regressor; the inner product with z is kinetic plus potential energy in J, less the
        contribution of D0. Arguments are not checked: vectors too short raise `IndexError` or `ValueError`, an exactly
        singular closure Jacobian `ZeroDivisionError` in floats."""
        return self._gathered(self.whole.energy_regressor(q, v).of)

    def potential_regressor(self, q: Column) -> Column:
        """The potential part (Z,) of the energy regressor, J per unit of each of the Z free inertial and friction
        parameters z, at a configuration q (n,) of the spanning tree's n joints, rad (m if prismatic). Its inner product
        with z is the potential energy in J, 0 at the ground frame's origin, less the contribution of values that linear
        constraints fix. Arguments are not checked: too short a q raises `IndexError`."""
        return self._gathered(self.whole.potential_regressor(q).of)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> ConstrainedMotion:
        """The motion at one instant, from which torques, regressors and powers in the Z free inertial and friction
        parameters follow, a `ConstrainedMotion`. It is at a configuration q (n,) of the spanning tree's n joints, rad
        (m if prismatic), under velocities v and Slotine and Li's reference velocities v_r (r,) of the r primary
        (independent) joints, rad/s (m/s), and reference accelerations a_r (r,), rad/s^2 (m/s^2). Arguments are not
        checked: vectors too short raise `IndexError` or `ValueError`, an exactly singular closure Jacobian
        `ZeroDivisionError` in floats."""
        return ConstrainedMotion(self, self.whole.motion(q, v, v_r, a_r))

    def remembered(self, numbers: Column) -> ConstrainedMotion:
        """The motion at one instant, a `ConstrainedMotion`, rebuilt from its property `numbers`, scalars."""
        return ConstrainedMotion(self, self.whole.remembered(numbers))

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,), of the primary joints under a torque (r,), gravity and friction."""
        return self.whole.forward_dynamics(q, v, torque, self.expanded(parameters))

    def without_gravity(self) -> ConstrainedEquations:
        """A copy of these equations without gravity."""
        return replace(self, whole=self.whole.without_gravity())

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Mass matrix (r, r) of the primary joints, as r rows of r scalars."""
        return self.whole.mass_matrix(q, self.expanded(parameters))

    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """Damping matrix B (r, r) of the primary joints, as r rows of r scalars."""
        return self.whole.damping(q, v, self.expanded(parameters))

    def expanded(self, parameters: Column) -> Column:
        """All P parameters D = D0 + N z (P,) from values z (Z,) of the free `parameters`, SI units."""
        terms: list[list[tuple[float, Any]]] = [[(1.0, x)] if x else [] for x in self.known]
        for z, enters in zip(parameters, self.spread, strict=True):
            for place, weight in enters:
                terms[place].append((weight, z))
        return Column(map(_sum, terms))

    def needed(self, columns: Sequence[int]) -> list[int]:
        """Indices, in ascending order, of those of all P parameters that depend on the free ones of indices `columns`,
        from 0 to Z
        - 1: the rows in which these columns of N (P, Z), D = D0 + N z, have entries. Raises `IndexError` for an index
        of Z or more; negative ones are not refused."""
        return sorted({place for column in columns for place, _ in self.spread[column]})

    def _gathered(self, entries: Sequence[Scalar]) -> Column:
        return self.combined(dict(enumerate(entries)), range(self.parameters))

    def combined(self, entries: dict[int, Scalar], columns: Sequence[int]) -> Column:
        """Derivatives (k,) of one scalar, such as an energy or a joint's torque, with respect to k of the Z free
        inertial and friction parameters z, from its derivatives y (P,) with respect to all P parameters D = D0 + N z.
        They are those entries of N' y, N' being the transpose of N (P, Z), whose indices `columns` has; their unit is
        that of y times that of N.

        `entries` has y's entries by index from 0 to P - 1, those of `needed(columns)` at least, else `KeyError` is
        raised; an index in `columns` of Z or more raises `IndexError`.
        """
        return Column(_sum([(weight, entries[place]) for place, weight in self.spread[c]]) for c in columns)


def _sum(terms: Sequence[tuple[float, Scalar]]) -> Scalar:
    shares = [entry if weight == 1.0 else weight * entry for weight, entry in terms]
    total: Any = shares[0] if shares else 0.0
    for share in shares[1:]:
        total = total + share
    return total
