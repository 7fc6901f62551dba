"""The equations of one mechanism, as functions of scalars of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from adaptctl.dynamics import energy, newton_euler
from adaptctl.dynamics.drive import DriveTerm
from adaptctl.dynamics.mass_matrix import mass_matrix, solve_symmetric
from adaptctl.dynamics.newton_euler import AdaptiveTick
from adaptctl.dynamics.segment import Segment, placements, segments
from adaptctl.mechanism import Description
from adaptctl.scalars import Column, Scalar, Vec


@dataclass(frozen=True)
class TreeEquations:
    """Every equation of a tree. Joint columns have length r, parameter columns P: ten a body, then the drives'.

    `bodies` are the links that have mass; the others only join two joints.
    """

    links: tuple[Segment, ...]
    gravity: Vec
    bodies: tuple[int, ...]
    drives: tuple[DriveTerm, ...] = ()

    @classmethod
    def of(cls, description: Description) -> TreeEquations:
        """The equations of a described mechanism, its loops, if any, left open."""
        drives = tuple(DriveTerm(joint, kind) for joint, kind in description.drive_parameters)
        return cls(segments(description), Vec(*description.gravity.tolist()), description.bodies, drives)

    @property
    def dof(self) -> int:
        """Number of primary joints r."""
        return len(self.links)

    @property
    def parameters(self) -> int:
        """Number of parameters P."""
        return self._driven + len(self.drives)

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
        links = energy.energy_regressor(self.links, p, v, self.gravity)
        return Column((*self._owned(links), *(term.energy(v[term.joint]) for term in self.drives)))

    def potential_regressor(self, p: Column) -> Column:
        """The potential part of E (P,)."""
        links = energy.potential_regressor(self.links, p, self.gravity)
        return Column((*self._owned(links), *(0.0 for _ in self.drives)))

    def torque_regressor(self, p: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """Rows of Y: Y D = M a_r + C(p, v) v_r + g + friction at v, the asked columns only."""
        of_bodies = [c for c in columns if c < self._driven]
        rows = newton_euler.torque_regressor(self.links, p, v, v_r, a_r, self.gravity, self._of_links(of_bodies))
        torques = self._drive_torques(v, a_r)
        by_column = (dict(zip(of_bodies, row, strict=True)) for row in rows)
        return [self._row(joint, row, torques, columns) for joint, row in enumerate(by_column)]

    def inverse_dynamics(self, p: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C(p, v) v_r + g + friction at v, in N m (N for a prismatic joint)."""
        torque = newton_euler.inverse_dynamics(self.links, p, v, v_r, a_r, self.gravity, self._tens(parameters))
        return self._driving(torque, v, a_r, parameters)

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
        tens, kept = self._tens(parameters), self._of_links(columns)
        tick = newton_euler.adaptive_tick(self.links, p, v, v_r, a_r, s, self.gravity, tens, kept)
        return AdaptiveTick(
            self._driving(tick.torque, v, a_r, parameters), self._learning(tick.gradient, v, a_r, s, columns)
        )

    def adaptation_gradient(
        self, p: Column, v: Column, v_r: Column, a_r: Column, s: Column, columns: Sequence[int]
    ) -> Column:
        """Y_r' s alone; `columns` sorted."""
        kept = self._of_links(columns)
        gradient = newton_euler.adaptation_gradient(self.links, p, v, v_r, a_r, s, self.gravity, kept)
        return self._learning(gradient, v, a_r, s, columns)

    def forward_dynamics(self, p: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations under a torque: M(p) a = torque - C(p, v) v - g(p) - friction."""
        bias = self.inverse_dynamics(p, v, v, Column.zeros(self.dof), parameters)
        return solve_symmetric(self.mass_matrix(p, parameters), torque - bias)

    def mass_matrix(self, p: Column, parameters: Column) -> list[list[Scalar]]:
        """Rows of M(p)."""
        rows = mass_matrix(placements(self.links, p), self._tens(parameters))
        for term, value in zip(self.drives, parameters.of[self._driven :], strict=True):
            if not term.kind.is_friction:
                rows[term.joint][term.joint] = rows[term.joint][term.joint] + value
        return rows

    @property
    def _driven(self) -> int:
        """Where the drives' parameters begin."""
        return 10 * len(self.bodies)

    def _owned(self, tens: Column) -> Sequence[Scalar]:
        """Of ten entries a link, those that are parameters."""
        return [x for i in self.bodies for x in tens.of[10 * i : 10 * i + 10]]

    def _of_links(self, columns: Sequence[int]) -> list[int]:
        """Columns of bodies' parameters, as columns of ten a link; those of drives are left out."""
        return [10 * self.bodies[c // 10] + c % 10 for c in columns if c < self._driven]

    def _tens(self, parameters: Column) -> Column:
        """Ten entries a link (10N,); exact zeros for massless ones, so that they cost nothing once traced."""
        if len(self.bodies) == len(self.links):
            return Column(parameters.of[: self._driven]) if self.drives else parameters
        tens: list[Scalar] = [0.0] * (10 * len(self.links))
        for place, i in enumerate(self.bodies):
            tens[10 * i : 10 * i + 10] = parameters.of[10 * place : 10 * place + 10]
        return Column(tens)

    def _drive_torques(self, v: Column, a_r: Column) -> list[Scalar]:
        return [term.torque(v[term.joint], a_r[term.joint]) for term in self.drives]

    def _row(
        self, joint: int, of_links: dict[int, Scalar], torques: Sequence[Scalar], columns: Sequence[int]
    ) -> Column:
        own = {self._driven + k: torques[k] for k, term in enumerate(self.drives) if term.joint == joint}
        row = of_links | own
        return Column(row.get(c, 0.0) for c in columns)

    def _driving(self, torque: Column, v: Column, a_r: Column, parameters: Column) -> Column:
        """The torque with the drives' share added."""
        total = list(torque)
        shares = zip(self.drives, self._drive_torques(v, a_r), parameters.of[self._driven :], strict=True)
        for term, share, value in shares:
            total[term.joint] = total[term.joint] + value * share
        return Column(total)

    def _learning(self, gradient: Column, v: Column, a_r: Column, s: Column, columns: Sequence[int]) -> Column:
        """The gradient with the drives' entries behind the links'."""
        torques = self._drive_torques(v, a_r)
        asked = [c - self._driven for c in columns if c >= self._driven]
        return Column((*gradient, *(s[self.drives[k].joint] * torques[k] for k in asked)))
