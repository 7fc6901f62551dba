"""The equations of one mechanism, as functions of scalars of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from adaptctl.description import Description
from adaptctl.dynamics.recursion import energy
from adaptctl.dynamics.recursion.drive import DriveTerm
from adaptctl.dynamics.recursion.mass_matrix import mass_matrix, solve_symmetric
from adaptctl.dynamics.recursion.motion import Motion, motions
from adaptctl.dynamics.recursion.segment import Segment, placements, segments
from adaptctl.dynamics.tree_motion import TreeMotion
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
        drives = tuple(DriveTerm(description.shaft(joint), kind) for joint, kind in description.drive_parameters)
        return cls(segments(description), Vec(*description.gravity.tolist()), description.bodies, drives)

    @property
    def dof(self) -> int:
        """Number of primary joints r."""
        return len(self.links)

    @property
    def parameters(self) -> int:
        """Number of parameters P."""
        return self.driven + len(self.drives)

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
        return Column((*self._owned(links), *(term.energy(v) for term in self.drives)))

    def potential_regressor(self, p: Column) -> Column:
        """The potential part of E (P,)."""
        links = energy.potential_regressor(self.links, p, self.gravity)
        return Column((*self._owned(links), *(0.0 for _ in self.drives)))

    def motion(self, p: Column, v: Column, v_r: Column, a_r: Column) -> TreeMotion:
        """How the links move, from which the torques M a_r + C(p, v) v_r + g + friction at v follow."""
        places = placements(self.links, p)
        drives = [term.torque(v, a_r) for term in self.drives]
        return TreeMotion(self, places, motions(places, v, v_r, a_r, self.gravity), drives)

    def remembered(self, numbers: Column) -> TreeMotion:
        """The motion that has these numbers."""
        rest = iter(numbers)
        places = [link.placed(tuple(islice(rest, link.coordinates))) for link in self.links]
        return TreeMotion(self, places, [Motion.of(tuple(islice(rest, 12))) for _ in self.links], tuple(rest))

    @property
    def motion_size(self) -> int:
        """How many numbers a motion has."""
        return sum(link.coordinates + 12 for link in self.links) + len(self.drives)

    def torque_regressor(self, p: Column, v: Column, v_r: Column, a_r: Column, columns: Sequence[int]) -> list[Column]:
        """Rows of Y: Y D = M a_r + C(p, v) v_r + g + friction at v, the asked columns only."""
        return self.motion(p, v, v_r, a_r).regressor(columns)

    def inverse_dynamics(self, p: Column, v: Column, v_r: Column, a_r: Column, parameters: Column) -> Column:
        """Torque M a_r + C(p, v) v_r + g + friction at v, in N m (N for a prismatic joint)."""
        return self.motion(p, v, v_r, a_r).torque(parameters)

    def forward_dynamics(self, p: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations under a torque: M(p) a = torque - C(p, v) v - g(p) - friction."""
        bias = self.inverse_dynamics(p, v, v, Column.zeros(self.dof), parameters)
        return solve_symmetric(self.mass_matrix(p, parameters), torque - bias)

    def mass_matrix(self, p: Column, parameters: Column) -> list[list[Scalar]]:
        """Rows of M(p)."""
        rows = mass_matrix(placements(self.links, p), self.tens(parameters))
        for term, value in zip(self.drives, parameters.of[self.driven :], strict=True):
            for joint, share in [] if term.kind.is_friction else term.on_joints(value):
                for other, part in term.on_joints(share):
                    rows[joint][other] = rows[joint][other] + part
        return rows

    @property
    def driven(self) -> int:
        """Where the drives' parameters begin."""
        return 10 * len(self.bodies)

    def sorted_out(self, columns: Sequence[int]) -> tuple[dict[int, int], dict[int, int]]:
        """Of the asked columns, those of bodies as columns of ten a link, and those of drives by number."""
        of_bodies = {c: 10 * self.bodies[c // 10] + c % 10 for c in columns if c < self.driven}
        return of_bodies, {c: c - self.driven for c in columns if c >= self.driven}

    def tens(self, parameters: Column) -> Column:
        """Ten entries a link (10N,); exact zeros for massless ones, so that they cost nothing once traced."""
        if len(self.bodies) == len(self.links):
            return Column(parameters.of[: self.driven]) if self.drives else parameters
        tens: list[Scalar] = [0.0] * (10 * len(self.links))
        for place, i in enumerate(self.bodies):
            tens[10 * i : 10 * i + 10] = parameters.of[10 * place : 10 * place + 10]
        return Column(tens)

    def _owned(self, tens: Column) -> Sequence[Scalar]:
        """Of ten entries a link, those that are parameters."""
        return [x for i in self.bodies for x in tens.of[10 * i : 10 * i + 10]]
