"""Equations of motion with closed loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import islice
from typing import Any

from adaptctl.caching import cached_property
from adaptctl.dynamics.equations import ClosedPositions, Equations
from adaptctl.dynamics.loops.constraint import Closing
from adaptctl.dynamics.loops.dyad import Rule
from adaptctl.dynamics.loops.posture import Following, Posture, factored
from adaptctl.dynamics.motion import Motion, Torques
from adaptctl.dynamics.recursion.mass_matrix import factorised
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements
from adaptctl.dynamics.tree_equations import TreeEquations, TreeMotion
from adaptctl.scalars import Column, Mat, Scalar, Vec

NEWTON_STEPS = 3
"""from a configuration at most 0.05 rad away"""


class LoopMotion(Motion):
    """Motion with closed loops at one instant."""

    __slots__ = ("following", "tree")

    def __init__(self, following: Following, tree: TreeMotion) -> None:
        self.following, self.tree = following, tree

    def torque(self, parameters: Column) -> Column:
        """Torque (r,) under the reference motion."""
        return self.following.primary(self.tree.torque(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Slotine-Li regressor (r, k), as r rows."""
        rows = self.tree.regressor(columns)
        by_column = [self.following.primary([row[k] for row in rows]) for k in range(len(columns))]
        return [Column(column[i] for column in by_column) for i in range(len(self.following.slopes))]

    def regressor_transpose_product(self, s: Column, columns: Sequence[int]) -> Column:
        """Regressor's transpose times joint rates, Y' s (k,) in W per unit of each parameter."""
        return self.tree.regressor_transpose_product(self.following.tree(s), columns)

    @property
    def numbers(self) -> Column:
        """Scalars from which `restored_motion` rebuilds this motion."""
        return Column((*(x for slope in self.following.slopes for x in slope), *self.tree.numbers))


class LoopForces:
    """Derivatives of the Lagrangian of a mechanism with loops by its primary positions, less friction."""

    __slots__ = ("_bends", "_following", "_momentum", "_tree")

    def __init__(self, following: Following, tree: Torques, momentum: Torques, bends: Sequence[Column]) -> None:
        self._following, self._tree, self._momentum, self._bends = following, tree, momentum, bends

    def torque(self, parameters: Column) -> Column:
        """Torque (r,) of parameters (P,)."""
        return self._primary(self._tree.torque(parameters), self._momentum.torque(parameters))

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Regressor (r, k), as r rows."""
        rows, momenta = self._tree.regressor(columns), self._momentum.regressor(columns)
        pairs = (([row[k] for row in rows], Column(row[k] for row in momenta)) for k in range(len(columns)))
        by_column = [self._primary(*pair) for pair in pairs]
        return [Column(column[i] for column in by_column) for i in range(len(self._bends))]

    def _primary(self, forces: Sequence[Any] | Column, momentum: Column) -> Column:
        """Forces (r,) of the tree's (n,), and of how its velocities change with the primary positions."""
        return self._following.primary(forces) + Column(bend @ momentum for bend in self._bends)


@dataclass(frozen=True)
class LoopEquations(Equations):
    """Equations of motion with closed loops."""

    tree: TreeEquations
    closing: Closing
    rules: tuple[Rule, ...] = ()

    @property
    def dof(self) -> int:
        """Number r of primary joints."""
        return len(self.closing.primary)

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return self.tree.parameters

    @property
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the tree's links."""
        return self.tree.segments

    def closed(self, p: Column, guess: Column) -> Column:
        """Closed configuration (n,) at primary positions (r,)."""
        if isinstance(p, ClosedPositions) and self.rules and p.equations.closure_key == self.closure_key:
            return p.configuration
        entries = dict(zip(self.closing.primary, p, strict=True))
        q = Column(entries.get(i, guess[i]) for i in range(self.num_joints))
        for _ in range(1 if self.rules else NEWTON_STEPS):
            q = self.nearest_closed(q)
        return q

    @cached_property
    def closure_key(self) -> object:
        """Values that a compiled closure of the loops depends on."""
        return content((self.tree.segments, self.closing, self.rules))

    def nearest_closed(self, q: Column) -> Column:
        """Configuration (n,) with the loops closed."""
        return self._placed(q) if self.rules else self._stepped(q)

    def _placed(self, q: Column) -> Column:
        links, at, known = self.tree.segments, list(q), self.closing.primary
        places: dict[int, Placement] = {}
        for rule in self.rules:
            places |= {i: links[i].at(at[i]) for i in known}
            known = rule.joints
            for joint, x in zip(known, rule.followed(places, links, at), strict=True):
                at[joint] = x
        return Column(at)

    def _stepped(self, q: Column) -> Column:
        places = placements(self.tree.segments, q)
        columns = self.closing.jacobian(places)
        factor = factored([columns[d] for d in self.closing.dependent])
        step = factor.solve(self.closing.residual(places, q))
        moved = dict(zip(self.closing.dependent, step, strict=True))
        return Column(x - moved[i] if i in moved else x for i, x in enumerate(q))

    def residual(self, q: Column) -> Column:
        """Closure residual (d,) at a configuration (n,)."""
        return self.closing.residual(placements(self.tree.segments, q), q)

    def posture(self, q: Column) -> Posture:
        """Placements, factored closure Jacobian and Jacobian of all joints."""
        return Posture(self.closing, placements(self.tree.segments, q))

    def dependent_block(self, q: Column) -> list[Column]:
        """Jacobian (d, d) of the residual by the dependent joints, by columns."""
        columns = self.closing.jacobian(placements(self.tree.segments, q))
        return [columns[d] for d in self.closing.dependent]

    def joint_velocities(self, q: Column, v: Column) -> Column:
        """Velocities (n,) of the tree's joints."""
        return self.posture(q).tree(v)

    def energy_regressor(self, q: Column, v: Column) -> Column:
        """Energy regressor (P,)."""
        return self.tree.energy_regressor(q, self.posture(q).tree(v))

    def potential_regressor(self, q: Column) -> Column:
        """Potential part (P,) of the energy regressor."""
        return self.tree.potential_regressor(q)

    def motion(self, q: Column, v: Column, v_r: Column, a_r: Column, v_f: Column | None = None) -> LoopMotion:
        """Motion at one instant."""
        return self._motion(self.posture(q), q, v, v_r, a_r, v_f)

    def momenta(self, q: Column, v: Column, v_f: Column | None = None) -> tuple[LoopMotion, LoopForces]:
        """Momenta M v, and the forces that change them besides the joints' torques."""
        posture = self.posture(q)
        u, rubbing = posture.tree(v), None if v_f is None else posture.tree(v_f)
        momentum, forces = self.tree.momenta(q, u, rubbing)
        bends = [posture.bias(u, way) for way in self._ways(posture)]
        return LoopMotion(posture, momentum), LoopForces(posture, forces, momentum, bends)

    def restored_motion(self, numbers: Column) -> LoopMotion:
        """Motion rebuilt from its `numbers`."""
        rest, size = iter(numbers), len(self.closing.dependent)
        slopes = [Column(islice(rest, size)) for _ in self.closing.primary]
        return LoopMotion(Following(self.closing, slopes), self.tree.restored_motion(Column(rest)))

    def forward_dynamics(self, q: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,) under a torque (r,)."""
        posture = self.posture(q)
        inertia = factorised(self._mass_matrix(posture, q, parameters))
        bias = self._motion(posture, q, v, v, Column.zeros(self.dof)).torque(parameters)
        return inertia.solved(torque - bias)

    def without_gravity(self) -> LoopEquations:
        """Copy of these equations without gravity."""
        return replace(self, tree=self.tree.without_gravity())

    def mass_matrix(self, q: Column, parameters: Column) -> list[list[Scalar]]:
        """Mass matrix (r, r), as r rows."""
        return self._mass_matrix(self.posture(q), q, parameters)

    def damping(self, q: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """Damping matrix (r, r), as r rows."""
        posture = self.posture(q)
        return self._projected(posture, self.tree.damping(q, posture.tree(v), parameters))

    def _ways(self, posture: Posture) -> list[Column]:
        units = (Column(float(i == j) for j in range(self.dof)) for i in range(self.dof))
        return [posture.tree(unit) for unit in units]

    def _mass_matrix(self, posture: Posture, q: Column, parameters: Column) -> list[list[Scalar]]:
        return self._projected(posture, self.tree.mass_matrix(q, parameters))

    def _projected(self, posture: Posture, rows: list[list[Scalar]]) -> list[list[Scalar]]:
        """Symmetric matrix J' A J (r, r) of the tree's A (n, n), by rows."""
        loads = [posture.primary(row) for row in rows]
        columns = [posture.primary([load[j] for load in loads]) for j in range(self.dof)]
        return [[columns[min(i, j)][max(i, j)] for j in range(self.dof)] for i in range(self.dof)]

    def _motion(
        self, posture: Posture, q: Column, v: Column, v_r: Column, a_r: Column, v_f: Column | None = None
    ) -> LoopMotion:
        u = posture.tree(v)
        w = u if v is v_r else posture.tree(v_r)
        rubbing = None if v_f is None else posture.tree(v_f)
        return LoopMotion(posture, self.tree.motion(q, u, w, posture.tree(a_r) + posture.bias(u, w), rubbing))


def content(value: Any) -> Any:
    """Comparable content of a value in nested tuples."""
    if is_dataclass(value) and not isinstance(value, type):
        return type(value), *(content(getattr(value, entry.name)) for entry in fields(value))
    return tuple(map(content, value)) if isinstance(value, tuple | Vec | Mat) else value
