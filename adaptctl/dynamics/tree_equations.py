"""The equations of a tree of links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

from adaptctl.caching import cached_property
from adaptctl.description import Description
from adaptctl.dynamics.equations import Equations, Motion
from adaptctl.dynamics.parameter_layout import ParameterLayout
from adaptctl.dynamics.recursion import energy
from adaptctl.dynamics.recursion.articulated_bodies import accelerations
from adaptctl.dynamics.recursion.drive import DriveTerm
from adaptctl.dynamics.recursion.mass_matrix import mass_matrix
from adaptctl.dynamics.recursion.motion import GROUND, LinkMotion, motions
from adaptctl.dynamics.recursion.newton_euler import joint_torques, powers, torque_regressor
from adaptctl.dynamics.recursion.segment import Placement, Segment, placements, segments
from adaptctl.scalars import ZERO, Column, Scalar, Vec

ARTICULATED = 6.5
"""Joints between a link and the ground, on average, from which on accelerations are found by articulated bodies: those
of a chain of 12. In shorter trees the mass matrix costs less, for its entries are one for each of these joints."""


class TreeMotion(Motion):
    """A tree at one instant: every link's place and motion, and the torque that a drive's parameter takes per unit
    (`drives`)."""

    __slots__ = ("drives", "layout", "links", "places")

    def __init__(
        self,
        layout: ParameterLayout,
        places: Sequence[Placement],
        links: Sequence[LinkMotion],
        drives: Sequence[Scalar],
    ) -> None:
        self.layout, self.places, self.links, self.drives = layout, places, links, drives

    def torque(self, parameters: Column) -> Column:
        """The torque M a_r + C(p, v) v_r + g + friction at v_r (r,), N m."""
        total = list(joint_torques(self.places, self.links, self.layout.tens(parameters)))
        shares = zip(self.layout.drives, self.drives, self.layout.of_drives(parameters), strict=True)
        for term, share, value in shares:
            for joint, part in term.on_joints(value * share):
                total[joint] = total[joint] + part
        return Column(total)

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Rows (r,) of Y, each with the asked columns only: Y D is the torque."""
        of_bodies, of_drives = self.layout.sorted_out(columns)
        rows = torque_regressor(self.places, self.links, list(of_bodies.values()))
        by_column = [dict(zip(of_bodies, row, strict=True)) for row in rows]
        for column, k in of_drives.items():
            for joint, share in self.layout.drives[k].on_joints(self.drives[k]):
                by_column[joint][column] = share
        return [Column(row.get(column, 0.0) for column in columns) for row in by_column]

    def powers(self, s: Column, columns: Sequence[int]) -> Column:
        """Powers Y' s on the asked columns (c,), without forming Y."""
        of_bodies, of_drives = self.layout.sorted_out(columns)
        found = dict(zip(of_bodies, powers(self.places, self.links, s, list(of_bodies.values())), strict=True))
        found |= {column: self.layout.drives[k].speed(s) * self.drives[k] for column, k in of_drives.items()}
        return Column(found[column] for column in columns)

    @property
    def numbers(self) -> Column:
        """Coordinates of every link, then twelve numbers of each, then the drives' (n,)."""
        placed = (x for place in self.places for x in place.coordinates)
        return Column((*placed, *(x for link in self.links for x in link.numbers), *self.drives))


@dataclass(frozen=True)
class TreeEquations(Equations):
    """The equations of a tree, all of whose joints are primary: q = p. Gravity is an acceleration (m/s^2)."""

    segments: tuple[Segment, ...]
    gravity: Vec
    layout: ParameterLayout

    @classmethod
    def of(cls, description: Description) -> TreeEquations:
        """The equations of a described mechanism, its loops, if any, left open."""
        drives = tuple(DriveTerm(description.shaft(joint), kind) for joint, kind in description.drive_parameters)
        layout = ParameterLayout(len(description.links), description.bodies, drives)
        return cls(segments(description), Vec(*description.gravity.tolist()), layout)

    @property
    def links(self) -> tuple[Segment, ...]:
        """The tree's links, as geometry."""
        return self.segments

    @property
    def dof(self) -> int:
        """Number of joints r."""
        return len(self.segments)

    @property
    def parameters(self) -> int:
        """Number of parameters P."""
        return self.layout.size

    def closed(self, p: Column, guess: Column) -> Column:
        """The configuration q (n,) of primary positions: p itself."""
        return p

    def projected(self, q: Column) -> Column:
        """The configuration q (n,) itself, there being no loop."""
        return q

    def rates(self, q: Column, v: Column) -> Column:
        """The rates of q (n,) at velocities v: v itself."""
        return v

    def energy_regressor(self, p: Column, v: Column) -> Column:
        """Energy regressor E (P,): total energy is E' D, in J."""
        return self.energies(energy.energy_regressor(self.segments, p, v, self.gravity), v)

    def energies(self, tens: Column, v: Column) -> Column:
        """The energy regressor E (P,) from the energies of every link's ten parameters (10N,) and the joints'
        velocities."""
        return Column((*self.layout.owned(tens), *(term.energy(v) for term in self.layout.drives)))

    def potential_regressor(self, p: Column) -> Column:
        """The potential part (P,) of the energy regressor, J per unit of each parameter."""
        links = energy.potential_regressor(self.segments, p, self.gravity)
        return Column((*self.layout.owned(links), *(0.0 for _ in self.layout.drives)))

    def motion(self, p: Column, v: Column, v_r: Column, a_r: Column) -> TreeMotion:
        """The links' motion by Newton-Euler's forward recursion, and the drives' shares."""
        places = placements(self.segments, p)
        drives = [term.torque(v_r, a_r) for term in self.layout.drives]
        return TreeMotion(self.layout, places, motions(places, v, v_r, a_r, self.gravity), drives)

    def remembered(self, numbers: Column) -> TreeMotion:
        """The motion that has these numbers."""
        rest = iter(numbers)
        places = [link.placed(tuple(islice(rest, link.coordinates))) for link in self.segments]
        links = [LinkMotion.of(tuple(islice(rest, 12))) for _ in self.segments]
        return TreeMotion(self.layout, places, links, tuple(rest))

    @property
    def motion_size(self) -> int:
        """Length of `Motion.numbers`."""
        return sum(link.coordinates + 12 for link in self.segments) + len(self.layout.drives)

    def mass_matrix(self, p: Column, parameters: Column) -> list[list[Scalar]]:
        """The rows of the mass matrix M(p) (r, r): the links' by composite bodies, and the rotors'."""
        rows = mass_matrix(placements(self.segments, p), self.layout.tens(parameters))
        for term, value in zip(self.layout.drives, self.layout.of_drives(parameters), strict=True):
            for joint, share in [] if term.kind.is_friction else term.on_joints(value):
                for other, part in term.on_joints(share):
                    rows[joint][other] = rows[joint][other] + part
        return rows

    def damping(self, p: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """The rows of the damping matrix B (r, r), N m s/rad, which is diagonal but for shafts that turn with several
        joints."""
        rows: list[list[Scalar]] = [[0.0] * self.dof for _ in range(self.dof)]
        for term, value in zip(self.layout.drives, self.layout.of_drives(parameters), strict=True):
            if not term.kind.is_friction:
                continue
            for joint, share in term.on_joints(value * term.damping(v)):
                for other, part in term.on_joints(share):
                    rows[joint][other] = rows[joint][other] + part
        return rows

    def forward_dynamics(self, p: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,) under a torque (r,), by articulated bodies or the mass matrix, whichever costs less."""
        if not self._is_long:
            return super().forward_dynamics(p, v, torque, parameters)
        motion, own, rotors = self.motion(p, v, v, Column.zeros(self.dof)), list(torque), [0.0] * self.dof
        values = self.layout.of_drives(parameters)
        for term, share, value in zip(self.layout.drives, motion.drives, values, strict=True):
            for joint, part in term.on_joints(value * share):
                own[joint] = own[joint] - part
            if not term.kind.is_friction:
                rotors[term.joint] = rotors[term.joint] + value
        return accelerations(motion.places, motion.links, self.layout.tens(parameters), rotors, Column(own))

    @cached_property
    def _is_long(self) -> bool:
        """True where articulated bodies cost less; a rotor that turns with several joints is no such body's."""
        depths: list[int] = []
        for link in self.segments:
            depths.append(1 + (depths[link.parent] if link.parent != GROUND else 0))
        coupled = any(len(term.arms) > 1 for term in self.layout.drives if not term.kind.is_friction)
        return sum(depths) >= ARTICULATED * len(depths) and not coupled

    def weightless(self) -> TreeEquations:
        """The same equations without gravity."""
        return replace(self, gravity=ZERO)
