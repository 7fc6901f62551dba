"""The equations of a mechanism with loops, in its primary joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import islice
from typing import Any

from adaptctl.caching import cached_property
from adaptctl.dynamics.equations import ClosedPositions, Equations, Motion
from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.loops.dyad import Rule
from adaptctl.dynamics.loops.posture import Following, Posture, factored
from adaptctl.dynamics.recursion.mass_matrix import factorised
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.dynamics.tree_equations import TreeEquations, TreeMotion
from adaptctl.scalars import Column, Mat, Scalar, Vec

NEWTON_STEPS = 3
"""From a configuration at most 0.05 rad away."""


class LoopMotion(Motion):
    """The motion of a mechanism with closed loops at one instant, in its r primary (independent) joints, from that of
    its tree of n joints, whose dependent joints follow the primary ones.

    Made of `following`, the `Following`, which has the Jacobian J (n, r) of the spanning tree's joints with respect to
    the primary ones, and `tree`, the tree's motion, a `TreeMotion`, under velocities that keep the loops closed.
    Nothing is checked.
    """

    __slots__ = ("following", "tree")

    def __init__(self, following: Following, tree: TreeMotion) -> None:
        self.following, self.tree = following, tree

    def torque(self, parameters: Column) -> Column:
        """The torque J' tau (r,), of the primary joints for values (P,) of the P inertial and friction `parameters`."""
        return self.following.primary(self.tree.torque(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """The Slotine-Li regressor Y = J' Y_tree (r, k) of r primary (independent) joints, as r rows, one `Column` (k,)
        each, for the k of the P inertial and friction parameters whose indices `columns` are, in their order: N m (N if
        prismatic) per unit of each. Y_tree (n, k) is that of the spanning tree's n joints, J' the transpose of their
        Jacobian (n, r) with respect to the primary ones. Raises `IndexError` for an index of P or more; negative ones
        are not refused."""
        rows = self.tree.regressor(columns)
        by_column = [self.following.primary([row[k] for row in rows]) for k in range(len(columns))]
        return [Column(column[i] for column in by_column) for i in range(len(self.following.slopes))]

    def regressor_transpose_product(self, s: Column, columns: Sequence[int]) -> Column:
        """The powers Y' s (k,), W per unit of each parameter, for the k of the P inertial and friction parameters whose
        indices `columns` are, at rates `s` (r,) of the r primary (independent) joints, rad/s (m/s if prismatic). Y' is
        the transpose of the Slotine-Li regressor Y (r, k), which is not formed. Raises `IndexError` for an index of P
        or more, `ValueError` for s of a wrong length."""
        return self.tree.regressor_transpose_product(self.following.tree(s), columns)

    @property
    def numbers(self) -> Column:
        """The scalars from which `LoopEquations.remembered` rebuilds this motion, a `Column`."""
        return Column((*(x for slope in self.following.slopes for x in slope), *self.tree.numbers))


@dataclass(frozen=True)
class LoopEquations(Equations):
    """Equations of motion of a mechanism with closed loops, in velocities and torques of its r primary joints."""

    tree: TreeEquations
    closing: Closing
    rules: tuple[Rule, ...] = ()

    @property
    def dof(self) -> int:
        """Number r of primary joints, the degrees of freedom."""
        return len(self.closing.primary)

    @property
    def parameters(self) -> int:
        """Number P of inertial and friction parameters."""
        return self.tree.parameters

    @property
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the spanning tree's n links, a `Segment` each, lengths in m, parents before their children."""
        return self.tree.segments

    def closed(self, p: Column, guess: Column) -> Column:
        """The closed configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), at positions `p` (r,)
        of the r primary (independent) joints, on the assembly branch of `guess` (n,), a closed configuration nearby: in
        closed form where one exists, else by three Newton steps.

        In closed form, angles are within half a turn of the guess's. The number of Newton steps is fixed, so that no
        code branches on a value: from 0.05 rad away the first leaves 1e-3 rad, the second 1e-6 rad, the third
        round-off. Arguments are not checked: where the loops stay open, nothing is raised; too short a p or guess
        raises `ValueError` or `IndexError`, an exactly singular closure Jacobian `ZeroDivisionError` in floats.
        """
        if isinstance(p, ClosedPositions) and self.rules and p.equations.closing_numbers == self.closing_numbers:
            return p.configuration
        entries = dict(zip(self.closing.primary, p, strict=True))
        q = Column(entries.get(i, guess[i]) for i in range(self.joints))
        for _ in range(1 if self.rules else NEWTON_STEPS):
            q = self.projected(q)
        return q

    @cached_property
    def closing_numbers(self) -> object:
        """The numbers, texts and kinds that closing the loops depends on, nested tuples to be compared."""
        return content((self.tree.segments, self.closing, self.rules))

    def projected(self, q: Column) -> Column:
        """A configuration (n,) of the spanning tree's n joints, rad (m if prismatic), near `q` (n,), with q's positions
        of the primary (independent) joints and the loops closed. It is exact where a closed form exists, else one
        Newton step of the dependent joints from q, which must be near a closed configuration (from 0.05 rad away, 1e-3
        rad remain). Arguments are not checked: too short a q raises `IndexError`, an exactly singular closure Jacobian
        `ZeroDivisionError` in floats."""
        return self._placed(q) if self.rules else self._stepped(q)

    def _placed(self, q: Column) -> Column:
        """The configuration whose dependent joints follow from the primary ones, on the branch of q."""
        links, at, known = self.tree.segments, list(q), self.closing.primary
        places: dict[int, Placement] = {}
        for rule in self.rules:
            places |= {i: links[i].at(at[i]) for i in known}
            known = rule.joints
            for joint, x in zip(known, rule.followed(places, links, at), strict=True):
                at[joint] = x
        return Column(at)

    def _stepped(self, q: Column) -> Column:
        """The configuration after one Newton step of the dependent joints."""
        places = placements(self.tree.segments, q)
        columns = self.closing.jacobian(places)
        factor = factored([columns[d] for d in self.closing.dependent])
        step = factor.solve(self.closing.residual(places, q))
        moved = dict(zip(self.closing.dependent, step, strict=True))
        return Column(x - moved[i] if i in moved else x for i, x in enumerate(q))

    def residual(self, q: Column) -> Column:
        """Closure residual (d,) of the loops and couplings at a configuration q (n,) of the tree's joints."""
        return self.closing.residual(placements(self.tree.segments, q), q)

    def posture(self, q: Column) -> Posture:
        """The links' placements, the factored closure Jacobian and the Jacobian J (n, r) of all joints with respect to
        the r primary (independent) ones, as a `Posture`, at a closed configuration q (n,) of the spanning tree's n
        joints, rad (m if prismatic). Arguments are not checked: too short a q raises `IndexError`, an exactly singular
        closure Jacobian `ZeroDivisionError` in floats."""
        return Posture(self.closing, placements(self.tree.segments, q))

    def dependent_block(self, q: Column) -> list[Column]:
        """Jacobian (d, d) of the closure residual with respect to the d = n - r dependent joints, rad or m per rad or
        m, as its d columns, each a `Column` (d,), in the joints' order. It is at a configuration `q` (n,) of the
        spanning tree's n joints, rad (m if prismatic), and is singular where the primary joints do not determine the
        others, at a singularity of the loops. Arguments are not checked: too short a q raises `IndexError`."""
        columns = self.closing.jacobian(placements(self.tree.segments, q))
        return [columns[d] for d in self.closing.dependent]

    def rates(self, q: Column, v: Column) -> Column:
        """Velocities J v (n,) of the spanning tree's n joints, rad/s (m/s if prismatic), from velocities `v` (r,) of
        the r primary (independent) joints, at a closed configuration `q` (n,) of the tree, rad (m). J (n, r) is the
        derivative of q with respect to the primary positions. Arguments are not checked: vectors too short raise
        `IndexError` or `ValueError`, an exactly singular closure Jacobian `ZeroDivisionError` in floats."""
        return self.posture(q).tree(v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor E (P,), J per unit of each of the P inertial and friction parameters D (P,), at a closed
        configuration q (n,) of the spanning tree's n joints, rad (m if prismatic), and velocities v (r,) of the r
        primary (independent) joints, rad/s (m/s). The inner product of E and D is kinetic plus potential energy in J,
        the latter 0 at the ground frame's origin. E is 0 for friction. Arguments are not checked: vectors too short
        raise `IndexError` or `ValueError`, an exactly singular closure Jacobian `ZeroDivisionError` in floats."""
        return self.tree.energy_regressor(q, self.posture(q).tree(v))

    def potential_regressor(self, q: Column) -> Column:
        """The potential part (P,) of the energy regressor, J per unit of each of the P inertial and friction parameters
        D (P,), at a configuration `q` (n,) of the spanning tree's n joints, rad (m if prismatic). Its inner product
        with D is the potential energy in J, 0 at the ground frame's origin. Arguments are not checked: too short a q
        raises `IndexError`."""
        return self.tree.potential_regressor(q)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> LoopMotion:
        """The motion at one instant, from which torques, regressors and powers follow, a `LoopMotion`."""
        return self._motion(self.posture(q), q, v, v_r, a_r)

    def remembered(self, numbers: Column) -> LoopMotion:
        """The motion at one instant, a `LoopMotion`, rebuilt from its property `numbers`, scalars in SI units."""
        rest, size = iter(numbers), len(self.closing.dependent)
        slopes = [Column(islice(rest, size)) for _ in self.closing.primary]
        return LoopMotion(Following(self.closing, slopes), self.tree.remembered(Column(rest)))

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,), rad/s^2 (m/s^2 if prismatic), of the r primary (independent) joints under their `torque`
        (r,), N m (N), gravity and friction, for values (P,) of the P inertial and friction `parameters` in SI units, in
        the order of `Mechanism.parameter_names`. They are at a closed configuration `q` (n,) of the spanning tree's n
        joints, rad (m), and velocities `v` (r,), rad/s (m/s). Arguments are not checked: vectors too short raise
        `IndexError` or `ValueError`, an exactly singular mass matrix or closure Jacobian `ZeroDivisionError` in floats.
        """
        posture = self.posture(q)
        inertia = factorised(self._mass_matrix(posture, q, parameters))
        bias = self._motion(posture, q, v, v, Column.zeros(self.dof)).torque(parameters)
        return inertia.solved(torque - bias)

    def without_gravity(self) -> LoopEquations:
        """A copy of these equations without gravity."""
        return replace(self, tree=self.tree.without_gravity())

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Mass matrix J' M J (r, r) of the primary joints, as r rows of r scalars."""
        return self._mass_matrix(self.posture(q), q, parameters)

    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """Damping matrix B = J' B_tree J (r, r) of the primary joints, as r rows of r scalars."""
        posture = self.posture(q)
        rows = [Column(row) for row in self.tree.damping(q, posture.tree(v), parameters)]
        ways = self._ways(posture)
        loads = [Column(row @ way for row in rows) for way in ways]
        return [[way @ load for load in loads] for way in ways]

    def _ways(self, posture: Posture) -> list[Column]:
        """Columns of J, each (n,)."""
        units = (Column(float(i == j) for j in range(self.dof)) for i in range(self.dof))
        return [posture.tree(unit) for unit in units]

    def _mass_matrix(self, posture: Posture, q: Column, parameters: Column) -> list[list[Scalar]]:
        rows = [Column(row) for row in self.tree.mass_matrix(q, parameters)]
        ways = self._ways(posture)
        loads = [Column(row @ way for row in rows) for way in ways]
        return [[ways[max(i, j)] @ loads[min(i, j)] for j in range(self.dof)] for i in range(self.dof)]

    def _motion(self, posture: Posture, q: Column, v: Column, v_r: Column, a_r: Column) -> LoopMotion:
        u = posture.tree(v)
        w = u if v is v_r else posture.tree(v_r)
        return LoopMotion(posture, self.tree.motion(q, u, w, posture.tree(a_r) + posture.bias(u, w)))


def content(value: Any) -> Any:
    """Content of a `value`, nested tuples to be compared with those of another."""
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), *(content(getattr(value, entry.name)) for entry in fields(value))
    return tuple(map(content, value)) if isinstance(value, tuple | Vec | Mat) else value
