"""The equations of a mechanism with loops, in its primary joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from adaptctl.dynamics.loop_motion import LoopMotion
from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.loops.least_squares import Factored
from adaptctl.dynamics.loops.posture import Following, Posture
from adaptctl.dynamics.recursion.mass_matrix import solve_symmetric
from adaptctl.dynamics.recursion.segment import Segment, placements
from adaptctl.dynamics.tree_equations import TreeEquations
from adaptctl.scalars import Column, Scalar

NEWTON_STEPS = 3
"""From a configuration at most 0.05 rad away."""


@dataclass(frozen=True)
class LoopEquations:
    """Every equation of a mechanism with loops, at tree configurations q (n,) that close them, in primary
    velocities and torques (r,). The tree keeps all N links, so the parameters are the tree's (10N,)."""

    tree: TreeEquations
    closing: Closing

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
        """The tree's links."""
        return self.tree.links

    @property
    def joints(self) -> int:
        """Number of tree joints n."""
        return len(self.tree.links)

    def closed(self, p: Column, guess: Column) -> Column:
        """q = U(p): Newton steps from a nearby configuration (n,), so that the branch is kept.

        The steps' number is fixed, so nothing branches on a value: from 0.05 rad away the first leaves 1e-3,
        the second 1e-6, the third round-off.
        """
        entries = dict(zip(self.closing.primary, p, strict=True))
        q = Column(entries.get(i, guess[i]) for i in range(self.joints))
        for _ in range(NEWTON_STEPS):
            q = self.projected(q)
        return q

    def projected(self, q: Column) -> Column:
        """One Newton step of the dependent joints."""
        places = placements(self.tree.links, q)
        columns = self.closing.jacobian(places)
        factor = Factored([columns[d] for d in self.closing.dependent])
        step = factor.solve(self.closing.residual(places, q))
        moved = dict(zip(self.closing.dependent, step, strict=True))
        return Column(x - moved[i] if i in moved else x for i, x in enumerate(q))

    def residual(self, q: Column) -> Column:
        """What must vanish: the loops' gaps, in m or rad, independent rows only."""
        return self.closing.residual(placements(self.tree.links, q), q)

    def posture(self, q: Column) -> Posture:
        """J at a closed configuration."""
        return Posture(self.closing, placements(self.tree.links, q))

    def dependent_block(self, q: Column) -> list[Column]:
        """The columns of the residual's Jacobian under the dependent joints: singular where the loop locks."""
        columns = self.closing.jacobian(placements(self.tree.links, q))
        return [columns[d] for d in self.closing.dependent]

    def rates(self, q: Column, v: Column) -> Column:
        """J v (n,): how the configuration moves."""
        return self.posture(q).tree(v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """E (P,): total energy is E' D, in J."""
        return self.tree.energy_regressor(q, self.posture(q).tree(v))

    def potential_regressor(self, q: Column) -> Column:
        """The potential part of E (P,)."""
        return self.tree.potential_regressor(q)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column) -> LoopMotion:
        """How the links move, from which the torques M a_r + C(p, v) v_r + g follow."""
        return self._motion(self.posture(q), q, v, v_r, a_r)

    def remembered(self, numbers: Column) -> LoopMotion:
        """The motion that has these numbers."""
        rest, size = iter(numbers), len(self.closing.dependent)
        slopes = [Column(islice(rest, size)) for _ in self.closing.primary]
        return LoopMotion(Following(self.closing, slopes), self.tree.remembered(Column(rest)))

    @property
    def motion_size(self) -> int:
        """How many numbers a motion has."""
        return len(self.closing.primary) * len(self.closing.dependent) + self.tree.motion_size

    def torque_regressor(self, q: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """Rows of Y = J' Y_tree, the asked columns only."""
        return self.motion(q, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, q: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C(p, v) v_r + g (r,)."""
        return self.motion(q, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Primary accelerations (r,) under primary torques."""
        posture = self.posture(q)
        bias = self._motion(posture, q, v, v, Column.zeros(self.dof)).torque(parameters)
        return solve_symmetric(self._mass_matrix(posture, q, parameters), torque - bias)

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Rows of M(p) = J' M_tree J."""
        return self._mass_matrix(self.posture(q), q, parameters)

    def _mass_matrix(self, posture: Posture, q: Column, parameters: Column) -> list[list[Scalar]]:
        rows = [Column(row) for row in self.tree.mass_matrix(q, parameters)]
        units = [Column(float(i == j) for j in range(self.dof)) for i in range(self.dof)]
        ways = [posture.tree(unit) for unit in units]
        loads = [Column(row @ way for row in rows) for way in ways]
        return [[ways[max(i, j)] @ loads[min(i, j)] for j in range(self.dof)] for i in range(self.dof)]

    def _motion(self, posture: Posture, q: Column, v: Column, v_r: Column, a_r: Column) -> LoopMotion:
        u = posture.tree(v)
        w = u if v is v_r else posture.tree(v_r)
        return LoopMotion(posture, self.tree.motion(q, u, w, posture.tree(a_r) + posture.bias(u, w)))
