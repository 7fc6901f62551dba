"""A mechanism as data: a tree of links, each behind one joint."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adaptctl.arrays import Array, frozen_array, whole_count, whole_number
from adaptctl.caching import cached_property, sent_as_made
from adaptctl.description.drive import LARGEST_TERM, Drive, DriveParameter, Limits
from adaptctl.description.inertia import is_physically_consistent, parameter_names
from adaptctl.description.pose import Pose
from adaptctl.errors import InputError, validate_kind
from adaptctl.files import hashed

if TYPE_CHECKING:
    from adaptctl.description.loops import Loops
    from adaptctl.description.pose import NamedFrame
    from adaptctl.description.visual import Visual

GROUND = -1
"""The parent index of a link whose joint is on the ground."""

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
LARGEST_INERTIA, LARGEST_GRAVITY = LARGEST_TERM, 1e9
"""Inertial parameters (SI units) and gravity (m/s^2) that a mechanism may have: energies of larger ones overflow."""


class JointKind(Enum):
    """The kind of a joint's motion: revolute, prismatic, or continuous, which is revolute without position limits."""

    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"

    @property
    def is_revolute(self) -> bool:
        """True for revolute and continuous joints, whose coordinate is an angle (rad); False for prismatic ones (m)."""
        return self is not JointKind.PRISMATIC

    @property
    def position_unit(self) -> str:
        """Unit of the coordinate of a joint of this kind: "rad" for an angle, "m" for a length."""
        return "rad" if self.is_revolute else "m"

    @property
    def effort_unit(self) -> str:
        """Unit of the effort of a joint of this kind: "N m" for a torque, "N" for a force."""
        return "N m" if self.is_revolute else "N"


@sent_as_made
@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of one coordinate called `name`: a rotation about or a translation along `axis` (3,), in the joint's
    frame, of any length, kept as a unit vector, z by default. Its `kind`, a `JointKind`, is by default revolute, its
    `limits` are infinite, its `drive` without terms. Raises `InputError` for a `kind` that is no `JointKind`, and for
    an axis not (3,), not finite or shorter than 1e-9."""

    name: str
    kind: JointKind = JointKind.REVOLUTE
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    limits: Limits = field(default_factory=Limits)
    drive: Drive = field(default_factory=Drive)

    def __post_init__(self) -> None:
        if not isinstance(self.kind, JointKind):
            raise InputError(f"joint {self.name!r}: kind: expected a JointKind, such as REVOLUTE, got {self.kind!r}")
        axis = frozen_array(self.axis, (3,), f"joint {self.name!r}: axis")
        norm = math.hypot(*axis) if np.abs(axis).max() > 1e100 else float(np.linalg.norm(axis))
        if not 1e-9 <= norm < math.inf:
            what = "be zero" if norm < 1.0 else f"be longer than numbers go, got {axis.tolist()}"
            raise InputError(f"joint {self.name!r}: axis must not {what}")
        # Dividing a unit vector by its own rounded norm would spoil exact entries such as 0 and 1.
        unit = axis if abs(norm - 1.0) <= 1e-15 else axis / norm
        object.__setattr__(self, "axis", frozen_array(unit, (3,), "axis"))


@sent_as_made
@dataclass(frozen=True, eq=False)
class Link:
    """A link: a rigid body called `name`, and the `joint` that connects it to its parent, the link of zero-based index
    `parent`, or -1 for the ground. `near` is the pose, in the parent link's frame, of the joint's frame at coordinate
    zero; `far` that of the link's frame in the joint's moved frame: the identity for URDF, a Denavit-Hartenberg step
    for frames at the far end. `inertia` (10,) holds m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, by default
    zero: mass (kg), first moment (kg m) and inertia tensor (kg m^2) about the link frame's origin. A `massless` link
    only joins two joints, as in a floating base; its inertia is no parameter. Raises `InputError` for an `inertia` of
    another shape, not finite, above 1e20 in size, or not zero in a massless link."""

    name: str
    parent: int
    joint: Joint
    parent_to_joint: Pose
    joint_to_link: Pose
    inertia: Array = field(default_factory=lambda: np.zeros(10))
    massless: bool = False

    def __post_init__(self) -> None:
        whole_count(self.parent, f"link {self.name!r}: parent", GROUND)
        object.__setattr__(self, "inertia", frozen_array(self.inertia, (10,), f"link {self.name!r}: inertia"))
        if np.abs(self.inertia).max() > LARGEST_INERTIA:
            raise InputError(f"link {self.name!r}: expected inertial parameters of at most {LARGEST_INERTIA:g}")
        if self.massless and np.any(self.inertia):
            raise InputError(f"link {self.name!r}: a massless link has no inertia, got {self.inertia.tolist()}")


@dataclass(frozen=True, eq=False)
class Description:
    """A mechanism's description as immutable data: its `name` and its `links` in depth-first order (parents first, each
    link's descendants together; the function `depth_first` sorts them so, and Pinocchio gives wrong matrices in other
    orders). `gravity` (3,) is in the ground's frame, m/s^2, by default (0, 0, -9.81); `source` says where the values
    come from; `loops` has the constraints that close loops, None for a plain tree. `visuals` are shapes to draw and
    `frames` named frames besides joints' and links'; hashes leave both out. Raises `InputError` for links in another
    order, no links, empty or repeated names, gravity not (3,), not finite or above 1e9, and visuals, frames or drives
    that refer to unknown links or joints; `NotFoundError` for unknown names in `loops`."""

    name: str
    links: tuple[Link, ...]
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    source: str = ""
    loops: Loops | None = None
    visuals: tuple[Visual, ...] = ()
    frames: tuple[NamedFrame, ...] = ()

    def __post_init__(self) -> None:
        for name in ("links", "visuals", "frames"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "gravity", frozen_array(self.gravity, (3,), f"{self.name}: gravity"))
        if np.abs(self.gravity).max() > LARGEST_GRAVITY:
            raise InputError(
                f"{self.name}: gravity: expected at most {LARGEST_GRAVITY:g} m/s^2, got {self.gravity.tolist()}"
            )
        if not self.links:
            raise InputError(f"{self.name}: a mechanism needs at least one movable link")
        for each in self.links:
            validate_kind(each, Link, f"{self.name}: links", "as Link(...) is one")
        _validate_unique([link.name for link in self.links], f"{self.name}: link")
        _validate_unique([link.joint.name for link in self.links], f"{self.name}: joint")
        _validate_depth_first(self.name, self.parents)
        fixed = [("a visual", visual.link) for visual in self.visuals]
        for what, link in fixed + [(f"frame {frame.name!r}", frame.link) for frame in self.frames]:
            if not GROUND <= link < len(self.links):
                raise InputError(f"{self.name}: {what} is fixed to link {link} of {len(self.links)}")
        self._validate_shafts()
        if self.loops is not None:
            self.loops.validate_known([link.name for link in self.links], self.joint_names)

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
        """Motor shafts that turn with several joints, as lists in JSON's types for hashing: [zero-based index of the
        drive's joint, [[name of another joint, ratio, shaft speed over that joint's speed, as text], ...]]."""
        drives = ((i, link.joint.drive.turns_with) for i, link in enumerate(self.links))
        return [[i, [[name, repr(ratio)] for name, ratio in others]] for i, others in drives if others]

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the tree's joints, one for each link, in the links' order."""
        return tuple(link.joint.name for link in self.links)

    @cached_property
    def primary(self) -> tuple[int, ...]:
        """Zero-based indices, among all joints, of the r primary (independent) joints, in the order of positions p."""
        names = self.joint_names if self.loops is None else self.loops.primary
        return tuple(self.joint_names.index(name) for name in names)

    @property
    def parents(self) -> tuple[int, ...]:
        """Zero-based indices of the links' parents among the links, one for each link; -1 for the ground."""
        return tuple(link.parent for link in self.links)

    def within_conditions(self, p: ArrayLike) -> NDArray[np.bool_]:
        """Mask (...) of positions `p` (..., r) of the r primary joints, rad (m if prismatic): True where p meets the
        loops' conditions, lower < weighted sum of p < upper, all True without conditions. Nothing is checked."""
        p = np.asarray(p, dtype=np.float64)
        inside = np.ones(p.shape[:-1], dtype=np.bool_)
        for condition in self.loops.conditions if self.loops is not None else ():
            weights = [condition.weights.get(self.joint_names[i], 0.0) for i in self.primary]
            inside &= (p @ np.array(weights) > condition.lower) & (p @ np.array(weights) < condition.upper)
        return inside

    @property
    def bodies(self) -> tuple[int, ...]:
        """Zero-based indices of the links that are not massless: each has ten inertial parameters, mass to inertia."""
        return tuple(i for i, link in enumerate(self.links) if not link.massless)

    @cached_property
    def body_names(self) -> tuple[str, ...]:
        """Names, in order, of the links that are not massless: each has ten inertial parameters, mass to inertia."""
        return tuple(self.links[i].name for i in self.bodies)

    @cached_property
    def drive_parameters(self) -> tuple[tuple[int, DriveParameter], ...]:
        """Pairs (zero-based link index, `DriveParameter` of its joint) of all modelled drive parameters: rotor
        inertias, then viscous, Coulomb, square-root and Stribeck friction, then offsets, each in the links' order."""
        drives = [link.joint.drive for link in self.links]
        return tuple((i, kind) for kind in DriveParameter for i, d in enumerate(drives) if d.value(kind) is not None)

    def drive_coupling(self, joint: int) -> tuple[tuple[int, float], ...]:
        """Pairs (zero-based joint index, ratio) of the joints that turn the motor shaft of the joint of index `joint`:
        that joint first, with ratio 1. The shaft's speed (rad/s, m/s if prismatic) is the sum of ratio times joint
        velocity. Raises `InputError` for an index that is no joint's."""
        drive = self.links[whole_number(joint, f"{self.name}: joint", 0, len(self.links) - 1)].joint.drive
        return (joint, 1.0), *((self.joint_names.index(name), ratio) for name, ratio in drive.turns_with)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the P inertial and friction parameters: ten of each link not massless, m, mc_x, mc_y, mc_z (mass,
        first moment) and I_xx, I_xy, I_yy, I_xz, I_yz, I_zz, as ``link3.I_xx``, then the drives', as
        ``joint2.viscous``."""
        joints = self.joint_names
        driven = tuple(f"{joints[i]}.{kind.value}" for i, kind in self.drive_parameters)
        return parameter_names([self.links[i].name for i in self.bodies]) + driven

    @property
    def num_energy_parameters(self) -> int:
        """Number of the inertial parameters that enter the kinetic or potential energy: ten for each link that is not
        massless and one for each modelled rotor inertia. They come first; friction parameters, which do not, follow."""
        rotors = sum(not kind.is_friction for _, kind in self.drive_parameters)
        return 10 * len(self.bodies) + rotors

    @cached_property
    def inertial_parameters(self) -> Array:
        """The P inertial and friction parameters (P,), read-only, SI units: m, mc_x, mc_y, mc_z, I_xx, I_xy, I_yy,
        I_xz, I_yz, I_zz of each link not massless (about its frame's origin), then the drives': rotor inertias,
        viscous, Coulomb, square-root and Stribeck friction and offsets; in the order of `parameter_names`."""
        driven = [self.links[i].joint.drive.value(kind) for i, kind in self.drive_parameters]
        tens = [self.links[i].inertia for i in self.bodies]
        stacked = np.concatenate([*tens, np.array(driven, dtype=np.float64)])
        stacked.flags.writeable = False
        return stacked

    @cached_property
    def massless_joints(self) -> tuple[str, ...]:
        """Names of a tree's links that have no inertia and no rotor, nor any descendant with either, so that their
        joints' accelerations are not determined; always empty with loops."""
        return () if self.loops is not None else weightless_ends(self.links)

    @property
    def inconsistent_links(self) -> tuple[str, ...]:
        """Names of the links whose ten inertial parameters no rigid body can have: their pseudo-inertia matrix (4, 4)
        is not positive definite. Massless links are left out."""
        bodies = [self.links[i] for i in self.bodies]
        return tuple(body.name for body in bodies if not is_physically_consistent(body.inertia))

    def with_parameters(self, parameters: ArrayLike) -> Description:
        """A copy of this description with other values of its P inertial and friction `parameters` (P,), SI units, in
        the order of its property `parameter_names`. Raises `InputError` for another number of them, values not finite
        or above 1e20 in size, and rotor inertia, viscous or Coulomb friction below 0."""
        values = frozen_array(parameters, (len(self.parameter_names),), f"{self.name}: parameters")
        links, tens = list(self.links), 10 * len(self.bodies)
        for i, ten in zip(self.bodies, values[:tens].reshape(-1, 10), strict=True):
            links[i] = replace(links[i], inertia=ten)
        for value, (i, kind) in zip(values[tens:].tolist(), self.drive_parameters, strict=True):
            drive = replace(links[i].joint.drive, **{kind.value: value})
            links[i] = replace(links[i], joint=replace(links[i].joint, drive=drive))
        return replace(self, links=tuple(links))

    def with_drives(self, drives: Drive | Sequence[Drive]) -> Description:
        """A copy of this description with other drives (rotor inertia and friction), one for all joints or one each in
        order. Raises `InputError` for another number of drives, for one that is no `Drive`, and for one that turns with
        unknown joints."""
        several = isinstance(drives, Iterable) and not isinstance(drives, str)
        each: list[Any] = list(drives) if several else [drives] * len(self.links)  # type: ignore[arg-type]  # told by `several`
        if len(each) != len(self.links):
            raise InputError(f"{self.name}: expected one drive for each of {len(self.links)} joints, got {len(each)}")
        if odd := [drive for drive in each if not isinstance(drive, Drive)]:
            raise InputError(f"{self.name}: drives: expected Drives, got {odd[0]!r}")
        pairs = zip(self.links, each, strict=True)
        links = tuple(replace(link, joint=replace(link.joint, drive=drive)) for link, drive in pairs)
        return replace(self, links=links)

    @property
    def sha256(self) -> str:
        """SHA-256 hash (64 hexadecimal digits) of this description's name, gravity, links, drives and loops; equal ones
        have equal hashes. Its source, shapes to draw and named frames do not count."""
        content: dict[str, object] = {"name": self.name, "gravity": self.gravity.tolist()}
        content["links"] = [_plain(link) for link in self.links]
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
        """SHA-256 hash (hexadecimal) of the data that decide which inertial parameters are identifiable: gravity, tree,
        links' names, joints' axes, kinds and frames, loops and modelled drive terms, rounded to 1e-12, to be the same
        on all machines. Inertial values, limits, the mechanism's name and named frames do not count."""
        content: list[object] = [_rounded(self.gravity), [_geometry(link) for link in self.links]]
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
        """True if loop closures constrain the mechanism; couplings, by which joints follow others, do not count."""
        return self.loops is not None and bool(self.loops.closures)

    def __eq__(self, other: object) -> bool:
        return self.sha256 == other.sha256 if isinstance(other, Description) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sha256)


def depth_first(links: Iterable[Link]) -> tuple[Link, ...]:
    """The `links` in depth-first order (parents first, descendants together, siblings as given), their `parent` indices
    into that order, -1 the ground. Raises `InputError` for a link whose chain of parents does not end at the ground."""
    given = tuple(links)
    order: list[int] = []
    pending = [i for i, link in enumerate(given) if link.parent == GROUND][::-1]
    while pending:
        order.append(pending.pop())
        pending += [i for i, link in enumerate(given) if link.parent == order[-1]][::-1]
    if len(order) != len(given):
        missing = sorted(set(range(len(given))) - set(order))
        raise InputError(f"link {given[missing[0]].name!r} does not hang on the ground through its parents")
    place = {GROUND: GROUND} | {old: new for new, old in enumerate(order)}
    return tuple(replace(given[i], parent=place[given[i].parent]) for i in order)


def weightless_ends(links: Sequence[Link]) -> tuple[str, ...]:
    """Names of those `links`, a tree with parents first, that have no inertia and no rotor, nor any descendant with
    either, so that their joints' accelerations are not determined. Nothing is checked."""
    heavy: set[int] = set()
    for i, link in reversed(list(enumerate(links))):
        if i in heavy or np.any(link.inertia) or link.joint.drive.rotor_inertia:
            heavy |= {i, link.parent}
    return tuple(link.name for i, link in enumerate(links) if i not in heavy)


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
            raise InputError(f"{name}: links must be in depth-first order (use depth_first), link {i} is not")
        branch.append(i)


def _plain(link: Link) -> list[object]:
    joint, limits = link.joint, link.joint.limits
    arrays = (
        joint.axis,
        link.parent_to_joint.rotation,
        link.parent_to_joint.translation,
        link.joint_to_link.rotation,
        link.joint_to_link.translation,
    )
    bounds = [limits.lower, limits.upper, limits.velocity, limits.effort]
    moving = [[float(x) + 0.0 for x in np.ravel(array)] for array in (*arrays, link.inertia)]
    return [link.name, link.parent, joint.name, joint.kind.value, [repr(float(b)) for b in bounds], moving]


def _geometry(link: Link) -> list[object]:
    poses = (
        link.parent_to_joint.rotation,
        link.parent_to_joint.translation,
        link.joint_to_link.rotation,
        link.joint_to_link.translation,
    )
    frames = [_rounded(array) for array in (link.joint.axis, *poses)]
    return [link.name, link.parent, link.joint.kind.is_revolute, frames]


def _rounded(array: Array) -> list[float]:
    return [round(x, 12) + 0.0 for x in np.ravel(array).tolist()]
