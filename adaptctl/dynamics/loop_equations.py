"""The equations of a mechanism with loops, in its primary joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

from adaptctl.dynamics.equations import Equations, Motion
from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.loops.dyad import Rule
from adaptctl.dynamics.loops.least_squares import factored
from adaptctl.dynamics.loops.posture import Following, Posture
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.dynamics.tree_equations import TreeEquations, TreeMotion
from adaptctl.scalars import Column, Scalar

NEWTON_STEPS = 3
"""From a configuration at most 0.05 rad away."""


class LoopMotion(Motion):
    """A mechanism with loops at one instant: its tree's motion, and how its dependent joints follow."""

    __slots__ = ("following", "tree")

    def __init__(self, following: Following, tree: TreeMotion) -> None:
        self.following, self.tree = following, tree

    def torque(self, parameters: Column) -> Column:
        """The torques J' tau_tree (r,) of the primary joints, N m, from the tree's."""
        return self.following.primary(self.tree.torque(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Rows (r,) of Y = J' Y_tree, each with the asked columns only."""
        rows = self.tree.regressor(columns)
        by_column = [self.following.primary([row[k] for row in rows]) for k in range(len(columns))]
        return [Column(column[i] for column in by_column) for i in range(len(self.following.slopes))]

    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """Powers Y' s = Y_tree' J s on the asked columns (c,), without forming Y."""
        return self.tree.powers(self.following.tree(s), columns)

    @property
    def numbers(self) -> Column:
        """Slopes of the dependent joints, then the tree's numbers (n,)."""
        return Column((*(x for slope in self.following.slopes for x in slope), *self.tree.numbers))


@dataclass(frozen=True)
class LoopEquations(Equations):
    """The equations of a tree with closures, at configurations q (n,) that close them, in primary velocities and
    torques (r,). The tree keeps all its links, so the parameters are the tree's (P,)."""

    tree: TreeEquations
    closing: Closing
    rules: tuple[Rule, ...] = ()
    """rules by which dependent joints follow in closed form, one after the other; empty where Newton's steps do"""

    @property
    def dof(self) -> int:
        """Number of primary joints r."""
        return len(self.closing.primary)

    @property
    def parameters(self) -> int:
        """Number of parameters P."""
        return self.tree.parameters

    @property
    def links(self) -> tuple[Segment, ...]:
        """The tree's links, as geometry."""
        return self.tree.segments

    def closed(self, p: Column, guess: Column) -> Column:
        """The closed configuration q = U(p) (n,) on the branch of one nearby (n,): by rules where they close all loops,
        else by Newton steps.

        By rules, joints are within half a turn of the nearby ones. The number of steps is fixed, so nothing branches on
        a value: from 0.05 rad away the first leaves 1e-3, the second 1e-6, the third round-off.
        """
        entries = dict(zip(self.closing.primary, p, strict=True))
        q = Column(entries.get(i, guess[i]) for i in range(self.joints))
        for _ in range(1 if self.rules else NEWTON_STEPS):
            q = self.projected(q)
        return q

    def projected(self, q: Column) -> Column:
        """The configuration (n,) with its loops closed, or after one Newton step of the dependent joints."""
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
        """Gaps (m,) of the loops, in m or rad, independent rows only: zero at a closed configuration."""
        return self.closing.residual(placements(self.tree.segments, q), q)

    def posture(self, q: Column) -> Posture:
        """The closed configuration with J factored."""
        return Posture(self.closing, placements(self.tree.segments, q))

    def dependent_block(self, q: Column) -> list[Column]:
        """The columns of the residual's Jacobian (m, m) by the dependent joints: singular where the loop locks."""
        columns = self.closing.jacobian(placements(self.tree.segments, q))
        return [columns[d] for d in self.closing.dependent]

    def rates(self, q: Column, v: Column) -> Column:
        """The tree's joint velocities J v (n,)."""
        return self.posture(q).tree(v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor E (P,): total energy is E' D, in J."""
        return self.tree.energy_regressor(q, self.posture(q).tree(v))

    def potential_regressor(self, q: Column) -> Column:
        """The potential part (P,) of the energy regressor, J per unit of each parameter."""
        return self.tree.potential_regressor(q)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> LoopMotion:
        """The tree's motion under J v, J v_r and J a_r + J_dot v_r."""
        return self._motion(self.posture(q), q, v, v_r, a_r)

    def remembered(self, numbers: Column) -> LoopMotion:
        """The motion that has these numbers."""
        rest, size = iter(numbers), len(self.closing.dependent)
        slopes = [Column(islice(rest, size)) for _ in self.closing.primary]
        return LoopMotion(Following(self.closing, slopes), self.tree.remembered(Column(rest)))

    @property
    def motion_size(self) -> int:
        """Length of `Motion.numbers`."""
        return len(self.closing.primary) * len(self.closing.dependent) + self.tree.motion_size

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Primary accelerations (r,) under primary torques, with J factored once for the bias and M."""
        posture = self.posture(q)
        bias = self._motion(posture, q, v, v, Column.zeros(self.dof)).torque(parameters)
        return solve_symmetric(self._mass_matrix(posture, q, parameters), torque - bias)

    def weightless(self) -> LoopEquations:
        """The same equations without gravity."""
        return replace(self, tree=self.tree.weightless())

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """The rows of the mass matrix M(p) = J' M_tree J (r, r), kg m^2."""
        return self._mass_matrix(self.posture(q), q, parameters)

    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """The rows of the damping matrix B = J' B_tree J (r, r), N m s/rad."""
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
