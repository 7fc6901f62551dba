"""The equations of a tree of links."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

from adaptctl.caching import cached_property
from adaptctl.description import Description
from adaptctl.description.reach import depths
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.motion import Motion
from adaptctl.dynamics.parameter_layout import ParameterLayout
from adaptctl.dynamics.recursion import energy
from adaptctl.dynamics.recursion.articulated_bodies import accelerations
from adaptctl.dynamics.recursion.drive import DriveTerm
from adaptctl.dynamics.recursion.frame_choice import FrameChoice
from adaptctl.dynamics.recursion.mass_matrix import mass_matrix
from adaptctl.dynamics.recursion.motion import (
    ZERO_PRODUCTS,
    LinkMotion,
    Twist,
    bracket,
    momenta,
    motions,
    moved,
    twists,
)
from adaptctl.dynamics.recursion.newton_euler import (
    joint_power,
    joint_torques,
    powers,
    powers_by_joint,
    subtree_loads,
    torque_regressor,
)
from adaptctl.dynamics.recursion.segment import Placement, Segment, segments
from adaptctl.scalars import ZERO, Column, Scalar, Vec, dot

MIN_ARTICULATED_DEPTH = 6.5
"""Mean number of joints between link and ground from which articulated bodies are faster, as in a chain of 12."""


class TreeTorques(ABC):
    """Torques of a tree that are linear in the parameters, those of the drives among them."""

    __slots__ = ("drives", "layout", "places")

    def __init__(self, layout: ParameterLayout, places: Sequence[Placement], drives: Sequence[Scalar]) -> None:
        self.layout, self.places, self.drives = layout, places, drives

    @abstractmethod
    def torques_of_links(self, tens: Column) -> Column:
        """Torques (n,) of ten parameters of each link."""

    @abstractmethod
    def regressor_of_links(self, columns: Sequence[int]) -> list[Column]:
        """Regressor (n, k) of links' parameters, by rows."""

    def torque(self, parameters: Column) -> Column:
        """Torque (r,) of parameters (P,)."""
        total = list(self.torques_of_links(self.layout.tens(parameters)))
        shares = zip(self.layout.drives, self.drives, self.layout.of_drives(parameters), strict=True)
        for term, share, value in shares:
            for joint, part in term.on_joints(value * share):
                total[joint] = total[joint] + part
        return Column(total)

    def regressor(self, columns: Sequence[int]) -> list[Column]:
        """Regressor (r, k), as r rows."""
        of_bodies, of_drives = self.layout.sorted_out(columns)
        rows = self.regressor_of_links(list(of_bodies.values()))
        by_column = [dict(zip(of_bodies, row, strict=True)) for row in rows]
        for column, k in of_drives.items():
            for joint, share in self.layout.drives[k].on_joints(self.drives[k]):
                by_column[joint][column] = share
        return [Column(row.get(column, 0.0) for column in columns) for row in by_column]


class TreeMotion(TreeTorques, Motion):
    """Motion of a tree at one instant."""

    __slots__ = ("links",)

    def __init__(
        self,
        layout: ParameterLayout,
        places: Sequence[Placement],
        links: Sequence[LinkMotion],
        drives: Sequence[Scalar],
    ) -> None:
        super().__init__(layout, places, drives)
        self.links = links

    def torques_of_links(self, tens: Column) -> Column:
        """Torques (n,) of ten parameters of each link."""
        return joint_torques(self.places, self.links, tens)

    def regressor_of_links(self, columns: Sequence[int]) -> list[Column]:
        """Regressor (n, k) of links' parameters, by rows."""
        return torque_regressor(self.places, self.links, columns)

    def regressor_transpose_product(self, s: Column, columns: Sequence[int]) -> Column:
        """Regressor's transpose times joint rates, Y' s (k,) in W per unit of each parameter."""
        of_bodies, of_drives = self.layout.sorted_out(columns)
        found = dict(zip(of_bodies, powers(self.places, self.links, s, list(of_bodies.values())), strict=True))
        found |= {column: self.layout.drives[k].speed(s) * self.drives[k] for column, k in of_drives.items()}
        return Column(found[column] for column in columns)

    @property
    def numbers(self) -> Column:
        """Scalars from which `restored_motion` rebuilds this motion."""
        placed = (x for place in self.places for x in place.coordinates)
        return Column((*placed, *(x for link in self.links for x in link.numbers), *self.drives))


class TreeForces(TreeTorques):
    """Derivatives of a tree's Lagrangian by its positions, less friction."""

    __slots__ = ("_falls", "_momenta", "_moving")

    def __init__(
        self,
        layout: ParameterLayout,
        places: Sequence[Placement],
        drives: Sequence[Scalar],
        moving: Sequence[Twist],
        gravity: Vec,
    ) -> None:
        super().__init__(layout, places, drives)
        self._moving, self._momenta = moving, momenta(moving)
        self._falls = [LinkMotion(ZERO_PRODUCTS, ZERO, weight.gravity) for weight in energy.weights(places, gravity)]

    def torques_of_links(self, tens: Column) -> Column:
        """Torques (n,) of ten parameters of each link."""
        torques: list[Scalar] = [0.0] * len(self.places)
        loads = (subtree_loads(self.places, each, tens) for each in (self._momenta, self._falls))
        for (i, momentum), (_, weight) in zip(*loads, strict=True):
            turned = self._turned(i)
            change = dot(momentum.force, turned.v) + dot(momentum.moment, turned.w)
            torques[i] = change + joint_power(self.places[i], weight)
        return Column(torques)

    def regressor_of_links(self, columns: Sequence[int]) -> list[Column]:
        """Regressor (n, k) of links' parameters, by rows."""
        moving, falling = (self._momenta, self._turned), (self._falls, lambda i: moved(self.places[i], 1.0))
        return powers_by_joint(self.places, [moving, falling], columns)

    def _turned(self, i: int) -> Twist:
        """Derivative of link i's twist by its joint's position."""
        return bracket(self._moving[i], moved(self.places[i], 1.0))


@dataclass(frozen=True)
class TreeEquations(Equations):
    """Equations of motion of a tree."""

    segments: tuple[Segment, ...]
    gravity: Vec
    layout: ParameterLayout

    @classmethod
    def of(cls, description: Description) -> TreeEquations:
        """Equations of motion of a description's tree."""
        drives = tuple(
            DriveTerm(((joint, 1.0),) if kind.is_spring else description.drive_coupling(joint), kind)
            for joint, kind in description.drive_parameters
        )
        layout = ParameterLayout(len(description.links), description.bodies, drives)
        return cls(segments(description), Vec(*description.gravity.tolist()), layout)

    @property
    def links(self) -> tuple[Segment, ...]:
        """Geometry of the tree's links."""
        return self.segments

    @property
    def dof(self) -> int:
        """Number r of primary joints."""
        return len(self.segments)

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return self.layout.size

    def closed(self, p: Column, guess: Column) -> Column:
        """Closed configuration (n,) at primary positions (r,)."""
        return p

    def nearest_closed(self, q: Column) -> Column:
        """Configuration (n,) with the loops closed."""
        return q

    def joint_velocities(self, q: Column, v: Column) -> Column:
        """Velocities (n,) of the tree's joints."""
        return v

    def energy_regressor(self, p: Column, v: Column) -> Column:
        """Energy regressor (P,)."""
        moving = self.energies(energy.energy_regressor(self.segments, p, v, self.gravity), v).of
        stored = (term.potential(p) for term in self.layout.drives)
        first = self.layout.driven
        return Column((*moving[:first], *(a + b for a, b in zip(moving[first:], stored, strict=True))))

    def energies(self, tens: Column, v: Column) -> Column:
        """Energy regressor (P,) with rotors, from the links' (10 N,)."""
        return Column((*self.layout.owned(tens), *(term.energy(v) for term in self.layout.drives)))

    def potential_regressor(self, p: Column) -> Column:
        """Potential part (P,) of the energy regressor."""
        links = energy.potential_regressor(self.segments, p, self.gravity)
        return Column((*self.layout.owned(links), *(term.potential(p) for term in self.layout.drives)))

    def motion(self, p: Column, v: Column, v_r: Column, a_r: Column, v_f: Column | None = None) -> TreeMotion:
        """Motion at one instant."""
        places = self._placements(p)
        drives = [term.torque(p, v_r if v_f is None else v_f, a_r) for term in self.layout.drives]
        return TreeMotion(self.layout, places, motions(places, v, v_r, a_r, self.gravity), drives)

    def momenta(self, q: Column, v: Column, v_f: Column | None = None) -> tuple[TreeMotion, TreeForces]:
        """Momenta M v, and the forces that change them besides the joints' torques."""
        places, still = self._placements(q), Column.zeros(self.dof)
        moving = twists(places, v)
        rotors = [term.speed(v) if term.kind.is_rotor else 0.0 for term in self.layout.drives]
        braking = [0.0 - term.torque(q, v if v_f is None else v_f, still) for term in self.layout.drives]
        forces = TreeForces(self.layout, places, braking, moving, self.gravity)
        return TreeMotion(self.layout, places, momenta(moving), rotors), forces

    def restored_motion(self, numbers: Column) -> TreeMotion:
        """Motion rebuilt from its `numbers`."""
        rest = iter(numbers)
        coordinates = [tuple(islice(rest, link.coordinates)) for link in self.segments]
        places = self._held.placements(coordinates)
        links = [LinkMotion.of(tuple(islice(rest, 12))) for _ in self.segments]
        return TreeMotion(self.layout, places, links, tuple(rest))

    def mass_matrix(self, p: Column, parameters: Column) -> list[list[Scalar]]:
        """Mass matrix (r, r), as r rows."""
        rows = mass_matrix(self._placements(p), self.layout.tens(parameters))
        for term, value in zip(self.layout.drives, self.layout.of_drives(parameters), strict=True):
            for joint, share in term.on_joints(value) if term.kind.is_rotor else []:
                for other, part in term.on_joints(share):
                    rows[joint][other] = rows[joint][other] + part
        return rows

    def damping(self, p: Column, v: Column, parameters: Column) -> list[list[Scalar]]:
        """Damping matrix (r, r), as r rows."""
        rows: list[list[Scalar]] = [[0.0] * self.dof for _ in range(self.dof)]
        for term, value in zip(self.layout.drives, self.layout.of_drives(parameters), strict=True):
            if not term.kind.is_friction:
                continue
            for joint, share in term.on_joints(value * term.damping(v)):
                for other, part in term.on_joints(share):
                    rows[joint][other] = rows[joint][other] + part
        return rows

    def forward_dynamics(self, p: Column, v: Column, torque: Column, parameters: Column) -> Column:
        """Accelerations (r,) under a torque (r,)."""
        if not self._is_long:
            return super().forward_dynamics(p, v, torque, parameters)
        motion, own, rotors = self.motion(p, v, v, Column.zeros(self.dof)), list(torque), [0.0] * self.dof
        values = self.layout.of_drives(parameters)
        for term, share, value in zip(self.layout.drives, motion.drives, values, strict=True):
            for joint, part in term.on_joints(value * share):
                own[joint] = own[joint] - part
            if term.kind.is_rotor:
                rotors[term.joint] = rotors[term.joint] + value
        return accelerations(motion.places, motion.links, self.layout.tens(parameters), rotors, Column(own))

    @cached_property
    def _held(self) -> FrameChoice:
        return FrameChoice.of(self.segments)

    def _placements(self, p: Column) -> list[Placement]:
        return self._held.placements(self._held.coordinates(p))

    @cached_property
    def _is_long(self) -> bool:
        deep = depths(link.parent for link in self.segments)
        coupled = any(len(term.arms) > 1 for term in self.layout.drives if term.kind.is_rotor)
        return sum(deep) >= MIN_ARTICULATED_DEPTH * len(deep) and not coupled

    def without_gravity(self) -> TreeEquations:
        """Copy of these equations without gravity."""
        return replace(self, gravity=ZERO)
