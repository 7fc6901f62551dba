"""A mechanism as data: a tree of links, each behind one joint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, frozen_array, whole_number
from adaptctl.caching import cached_property
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.description.inertia import is_physically_consistent, parameter_names
from adaptctl.description.link import GROUND, Link, geometry, plain, rounded, weightless_ends
from adaptctl.errors import InputError, validate_kind
from adaptctl.files import hashed

if TYPE_CHECKING:
    from adaptctl.description.loops import Loops
    from adaptctl.description.pose import NamedFrame
    from adaptctl.description.visual import Visual


STANDARD_GRAVITY = (0.0, 0.0, -9.81)
MAX_GRAVITY = 1e9
"""Gravity in m/s^2 that a mechanism may have: energies of larger ones overflow."""


@dataclass(frozen=True, eq=False)
class Description:
    """
    Mechanism as immutable data: its links, joints, gravity and loops.

    Parameters
    ----------
    name : str
        Name of the mechanism.
    links : sequence of Link
        Links in depth-first order: parents first, the descendants of each link together; `depth_first` sorts them so.
    gravity : array_like, optional
        Gravity (3,) in the ground's frame in m/s^2; (0, 0, -9.81) by default.
    source : str, optional
        Origin of the parameter values, such as a paper.
    loops : Loops, optional
        Constraints that close loops; none, for a tree, by default.
    visuals : sequence of Visual, optional
        Shapes to draw, which hashes leave out.
    frames : sequence of NamedFrame, optional
        Named frames besides those of joints and links, which hashes leave out.
    as_written : bool, default False
        If true, nearly special angles and lengths are meant as they stand, and a rank that depends on them is not
        refused. It is no part of the hashes, or of equality.
    locked : mapping of str to float, optional
        Joints of the source that were locked, and their positions in rad (m), which hashes leave out. Default: none.

    Raises
    ------
    InputError
        If links are in another order, missing or of empty or repeated names, gravity is not finite or above 1e9, or a
        shape, frame or drive refers to an unknown link or joint.
    NotFoundError
        If the loops name an unknown link or joint.

    Examples
    --------
    >>> arm.description
    <Description 'two_link': 2 links>
    >>> arm.description.joint_names
    ('shoulder', 'elbow')
    """

    name: str
    links: tuple[Link, ...]
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    source: str = ""
    loops: Loops | None = None
    visuals: tuple[Visual, ...] = ()
    frames: tuple[NamedFrame, ...] = ()
    as_written: bool = False
    locked: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("links", "visuals", "frames"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "locked", dict(self.locked))
        object.__setattr__(self, "gravity", frozen_array(self.gravity, (3,), f"{self.name}: gravity"))
        if np.abs(self.gravity).max() > MAX_GRAVITY:
            raise InputError(
                f"{self.name}: gravity: expected at most {MAX_GRAVITY:g} m/s^2, got {self.gravity.tolist()}"
            )
        if not self.links:
            raise InputError(f"{self.name}: links: expected at least one")
        for each in self.links:
            validate_kind(each, Link, f"{self.name}: links", "as made by Link(...)")
        _validate_unique([link.name for link in self.links], f"{self.name}: link")
        _validate_unique([link.joint.name for link in self.links], f"{self.name}: joint")
        _validate_depth_first(self.name, self.parents)
        fixed = [("a visual", visual.link) for visual in self.visuals]
        for what, link in fixed + [(f"frame {frame.name!r}", frame.link) for frame in self.frames]:
            if not GROUND <= link < len(self.links):
                raise InputError(
                    f"{self.name}: {what}: link: expected an index from -1 to {len(self.links) - 1}, got {link}"
                )
        self._validate_shafts()
        if self.loops is not None:
            self.loops.validate_known([link.name for link in self.links], self.joint_names)

    def __repr__(self) -> str:
        return f"<Description {self.name!r}: {len(self.links)} links>"

    def _validate_shafts(self) -> None:
        for link in self.links:
            others = [name for name, _ in link.joint.drive.turns_with]
            unknown = [name for name in others if name not in self.joint_names or name == link.joint.name]
            if unknown or len(set(others)) < len(others):
                raise InputError(
                    f"{self.name}: joint {link.joint.name!r}: turns_with: expected other joints, each once, among "
                    f"{', '.join(self.joint_names)}; got {', '.join(others)}"
                )

    @property
    def drive_couplings(self) -> list[list[object]]:
        """Joints and ratios of motor shafts that turn with several joints, as lists in JSON's types for hashing."""
        drives = ((i, link.joint.drive.turns_with) for i, link in enumerate(self.links))
        return [[i, [[name, repr(ratio)] for name, ratio in others]] for i, others in drives if others]

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, one for each link."""
        return tuple(link.joint.name for link in self.links)

    @cached_property
    def primary(self) -> tuple[int, ...]:
        """Indices of the r primary (independent) joints among the tree's joints."""
        names = self.joint_names if self.loops is None else self.loops.primary
        return tuple(self.joint_names.index(name) for name in names)

    @property
    def parents(self) -> tuple[int, ...]:
        """Index of each link's parent; -1 for the ground."""
        return tuple(link.parent for link in self.links)

    def within_conditions(self, p: ArrayLike) -> NDArray[np.bool_]:
        """
        Test whether positions meet the loops' conditions (`Condition`).

        Parameters
        ----------
        p : array_like
            Positions (..., r) of the primary joints in rad (m if prismatic).

        Returns
        -------
        ndarray of bool
            Mask (...), true where lower < weighted sum of p < upper for all conditions.

        Examples
        --------
        >>> arm.description.within_conditions(np.zeros((3, 2))).tolist()
        [True, True, True]
        """
        p = np.asarray(p, dtype=np.float64)
        inside = np.ones(p.shape[:-1], dtype=np.bool_)
        for condition in self.loops.conditions if self.loops is not None else ():
            weights = [condition.weights.get(self.joint_names[i], 0.0) for i in self.primary]
            inside &= (p @ np.array(weights) > condition.lower) & (p @ np.array(weights) < condition.upper)
        return inside

    @property
    def bodies(self) -> tuple[int, ...]:
        """Zero-based indices of the links that are not massless."""
        return tuple(i for i, link in enumerate(self.links) if not link.massless)

    @cached_property
    def body_names(self) -> tuple[str, ...]:
        """Names of the links that are not massless, in order."""
        return tuple(self.links[i].name for i in self.bodies)

    @cached_property
    def drive_parameters(self) -> tuple[tuple[int, DriveParameter], ...]:
        """Modelled rotor and friction parameters, as pairs of a link index and a `DriveParameter` of its joint."""
        drives = [link.joint.drive for link in self.links]
        return tuple((i, kind) for kind in DriveParameter for i, d in enumerate(drives) if d.value(kind) is not None)

    def drive_coupling(self, joint: int) -> tuple[tuple[int, float], ...]:
        """
        Return the joints whose motion turns the motor shaft of a joint, with their ratios.

        Parameters
        ----------
        joint : int
            Zero-based index of the joint.

        Returns
        -------
        tuple of (int, float)
            Joint indices and ratios, the joint itself first with ratio 1. The shaft's speed is the sum of ratio times
            velocity.

        Raises
        ------
        InputError
            If there is no such joint.

        Examples
        --------
        >>> arm.description.drive_coupling(1)
        ((1, 1.0),)
        """
        drive = self.links[whole_number(joint, f"{self.name}: joint", 0, len(self.links) - 1)].joint.drive
        return (joint, 1.0), *((self.joint_names.index(name), ratio) for name, ratio in drive.turns_with)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P inertial and friction parameters, such as `link3.I_xx`."""
        joints = self.joint_names
        driven = tuple(f"{joints[i]}.{kind.value}" for i, kind in self.drive_parameters)
        return parameter_names([self.links[i].name for i in self.bodies]) + driven

    @property
    def num_energy_parameters(self) -> int:
        """Number of inertial parameters, which enter the energy; friction parameters do not."""
        rotors = sum(kind.is_rotor for _, kind in self.drive_parameters)
        return 10 * len(self.bodies) + rotors

    @cached_property
    def inertial_parameters(self) -> Array:
        """Values (P,) of the parameters in SI units, in the order of `parameter_names`, read-only."""
        driven = [self.links[i].joint.drive.value(kind) for i, kind in self.drive_parameters]
        tens = [self.links[i].inertia for i in self.bodies]
        stacked = np.concatenate([*tens, np.array(driven, dtype=np.float64)])
        stacked.flags.writeable = False
        return stacked

    @cached_property
    def longest_offset(self) -> float:
        """Largest distance in m from a joint to the next or to its link's frame."""
        hung = [(self.links[k.parent].joint_to_link, k.parent_to_joint) for k in self.links if k.parent != GROUND]
        offsets = [near.rotation @ far.translation + near.translation for near, far in hung]
        offsets += [k.joint_to_link.translation for k in self.links]
        return float(np.linalg.norm(np.reshape(offsets, (-1, 3)), axis=1).max(initial=0.0))

    @cached_property
    def massless_joints(self) -> tuple[str, ...]:
        """Names of end links without inertia and rotor, which torques cannot accelerate; empty with loops."""
        return () if self.loops is not None else weightless_ends(self.links)

    @property
    def inconsistent_links(self) -> tuple[str, ...]:
        """Names of the links whose ten inertial parameters no rigid body can have."""
        bodies = [self.links[i] for i in self.bodies]
        return tuple(body.name for body in bodies if not is_physically_consistent(body.inertia))

    def with_parameters(self, parameters: ArrayLike) -> Description:
        """
        Return a copy with other values of the inertial and friction parameters.

        Parameters
        ----------
        parameters : array_like
            Values (P,) in SI units, in the order of `parameter_names`.

        Returns
        -------
        Description
            Description with the other values.

        Raises
        ------
        InputError
            If the number of values is wrong, one is not finite or above 1e20 in size, or a rotor inertia, viscous or
            Coulomb friction is negative.

        Examples
        --------
        >>> heavy = arm.description.with_parameters(2.0 * arm.inertial_parameters)
        >>> float(heavy.inertial_parameters[0] / arm.inertial_parameters[0])
        2.0
        """
        values = frozen_array(parameters, (len(self.parameter_names),), f"{self.name}: parameters")
        links, tens = list(self.links), 10 * len(self.bodies)
        for i, ten in zip(self.bodies, values[:tens].reshape(-1, 10), strict=True):
            links[i] = replace(links[i], inertia=ten)
        for value, (i, kind) in zip(values[tens:].tolist(), self.drive_parameters, strict=True):
            drive = replace(links[i].joint.drive, **{kind.value: value})
            links[i] = replace(links[i], joint=replace(links[i].joint, drive=drive))
        return replace(self, links=tuple(links))

    def with_drives(self, drives: Drive | Sequence[Drive]) -> Description:
        """
        Return a copy with other rotor inertias and joint friction.

        Parameters
        ----------
        drives : Drive or sequence of Drive
            One drive for all joints or one for each, in the links' order.

        Returns
        -------
        Description
            Description with the other values.

        Raises
        ------
        InputError
            If the number of drives is wrong, one is not a `Drive`, or a motor turns with a joint that does not exist.

        Examples
        --------
        >>> from adaptctl.description.drive import Drive
        >>> arm.description.with_drives(Drive(viscous=0.1)).parameter_names[-1]
        'elbow.viscous'
        """
        several = isinstance(drives, Iterable) and not isinstance(drives, str)
        each: list[Any] = list(drives) if several else [drives] * len(self.links)  # type: ignore[arg-type]  # told by `several`
        if len(each) != len(self.links):
            raise InputError(f"{self.name}: drives: expected one per joint ({len(self.links)}), got {len(each)}")
        if odd := [drive for drive in each if not isinstance(drive, Drive)]:
            raise InputError(f"{self.name}: drives: expected Drive objects, got {odd[0]!r}")
        pairs = zip(self.links, each, strict=True)
        links = tuple(replace(link, joint=replace(link.joint, drive=drive)) for link, drive in pairs)
        return replace(self, links=links)

    @property
    def sha256(self) -> str:
        """SHA-256 hash (64 hexadecimal digits) of this description's name, gravity, links, drives and loops."""
        content: dict[str, object] = {"name": self.name, "gravity": self.gravity.tolist()}
        content["links"] = [plain(link) for link in self.links]
        if self.drive_parameters:
            drives = [(i, kind, self.links[i].joint.drive.value(kind)) for i, kind in self.drive_parameters]
            content["drives"] = [[i, kind.value, repr(value)] for i, kind, value in drives]
        if self.drive_couplings:
            content["shafts"] = self.drive_couplings
        if len(self.bodies) < len(self.links):
            content["bodies"] = list(self.bodies)
        if self.loops is not None:
            content["loops"] = self.loops.plain()
        return hashed(content)

    @cached_property
    def geometry_sha256(self) -> str:
        """SHA-256 hash (hexadecimal) of the data that decide which inertial parameters are identifiable."""
        content: list[object] = [rounded(self.gravity), [geometry(link) for link in self.links]]
        if self.drive_parameters:
            content.append([[i, kind.value] for i, kind in self.drive_parameters])
        if self.drive_couplings:
            content.append(self.drive_couplings)
        if len(self.bodies) < len(self.links):
            content.append(list(self.bodies))
        if self.loops is not None:
            content.append(self.loops.plain(12))
        return hashed(content)

    @property
    def closed(self) -> bool:
        """True if the mechanism has loop closures; couplings of joints do not count."""
        return self.loops is not None and bool(self.loops.closures)

    def __eq__(self, other: object) -> bool:
        return self.sha256 == other.sha256 if isinstance(other, Description) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)


def _validate_unique(names: Sequence[str], what: str) -> None:
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(f"{what} names must be unique, got {repeated[0]!r} more than once")
    if not all(names):
        raise InputError(f"{what} names must not be empty")


def _validate_depth_first(name: str, parents: Sequence[int]) -> None:
    branch: list[int] = []
    for i, parent in enumerate(parents):
        while branch and branch[-1] != parent:
            branch.pop()
        if not branch and parent != GROUND:
            raise InputError(f"{name}: link {i} is not in depth-first order; sort the links with depth_first")
        branch.append(i)
