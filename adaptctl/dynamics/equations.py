"""The equations of one mechanism, as functions of scalars of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from adaptctl.dynamics import energy, mass_matrix, newton_euler
from adaptctl.dynamics.newton_euler import AdaptiveTick
from adaptctl.dynamics.segment import Segment, placements, segments
from adaptctl.mechanism import Description
from adaptctl.scalars import Column, Scalar, Vec


@dataclass(frozen=True)
class TreeEquations:
    """Every equation of a tree. Joint columns have length r, parameter columns P = 10N."""

    links: tuple[Segment, ...]
    gravity: Vec

    @classmethod
    def of(cls, description: Description) -> TreeEquations:
        """The equations of a described mechanism."""
        return cls(segments(description), Vec(*description.gravity.tolist()))

    @property
    def dof(self) -> int:
        """Number of primary joints r."""
        return len(self.links)

    @property
    def parameters(self) -> int:
        """Number of parameters P."""
        return 10 * len(self.links)

    @property
    def joints(self) -> int:
        """Number of tree joints n; every one is primary."""
        return len(self.links)

    def closed(self, p: Column, guess: Column) -> Column:
        """The configuration q = U(p), which for a tree is p itself."""
        return p

    def projected(self, q: Column) -> Column:
        """The nearest configuration that closes all loops: q, there being none."""
        return q

    def rates(self, q: Column, v: Column) -> Column:
        """How the configuration moves: v."""
        return v

    def energy_regressor(self, p: Column, v: Column) -> Column:
        """E (P,): total energy is E' D, in J."""
        return energy.energy_regressor(self.links, p, v, self.gravity)

    def potential_regressor(self, p: Column) -> Column:
        """The potential part of E (P,)."""
        return energy.potential_regressor(self.links, p, self.gravity)

    def torque_regressor(self, p: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """Rows of Y: Y D = M a_r + C(p, v) v_r + g, the asked columns only."""
        return newton_euler.torque_regressor(self.links, p, v, v_r, a_r, self.gravity, columns)

    def inverse_dynamics(self, p: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C(p, v) v_r + g, in N m (N for a prismatic joint)."""
        return newton_euler.inverse_dynamics(self.links, p, v, v_r, a_r, self.gravity, parameters)

    def adaptive_tick(
        self,
        p: Column,
        v: Column,
        v_r: Column,
        a_r: Column,
        s: Column,
        parameters: Column,
        columns: Sequence[int],
    ) -> AdaptiveTick:
        """Y_r D and Y_r' s without forming Y_r; `columns` sorted."""
        return newton_euler.adaptive_tick(self.links, p, v, v_r, a_r, s, self.gravity, parameters, columns)

    def adaptation_gradient(
        self, p: Column, v: Column, v_r: Column, a_r: Column, s: Column, columns: Sequence[int]
    ) -> Column:
        """Y_r' s alone; `columns` sorted."""
        return newton_euler.adaptation_gradient(self.links, p, v, v_r, a_r, s, self.gravity, columns)

    def forward_dynamics(self, p: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations under a torque."""
        return mass_matrix.forward_dynamics(self.links, p, v, torque, self.gravity, parameters)

    def mass_matrix(self, p: Column, parameters: Column) -> list[list[Scalar]]:
        """Rows of M(p)."""
        return mass_matrix.mass_matrix(placements(self.links, p), parameters)
