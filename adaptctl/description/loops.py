"""Loop closures: coinciding frames, and joints that follow others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType

import numpy as np

from adaptctl.arrays import real_number
from adaptctl.description.pose import Pose
from adaptctl.errors import InputError, NotFoundError


class ClosureKind(Enum):
    """The kind of a loop closure, by what two frames have in common: their origins (POINT), their origins and z axes
    (AXIS, a hinge) or their whole poses (WELD)."""

    POINT = "point"
    AXIS = "axis"
    WELD = "weld"

    @property
    def rows(self) -> int:
        """Number of scalar constraints that a closure of this kind makes, dependent ones included: 3 for a point, 5 for
        an axis, 6 for a weld."""
        return {"point": 3, "axis": 5, "weld": 6}[self.value]


@dataclass(frozen=True)
class Closure:
    """A loop closure, the joint that was cut to make a tree: a constraint that a frame on one link coincides with a
    frame on another.

    `first` and `second` name the two links, None being the ground; `first_frame` and `second_frame` are the frames'
    poses in these links (m), by default the links' own frames. `kind` says what coincides: the frames' origins (POINT,
    the default), their origins and z axes (AXIS) or their whole poses (WELD). `name` is the closure's own. Raises
    `InputError` where `first` and `second` are the same link, or both the ground.
    """

    name: str
    first: str | None
    second: str | None
    first_frame: Pose = field(default_factory=Pose.identity)
    second_frame: Pose = field(default_factory=Pose.identity)
    kind: ClosureKind = ClosureKind.POINT

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise InputError(f"closure {self.name!r}: a link cannot be closed onto itself ({self.first or 'ground'})")


@dataclass(frozen=True)
class Coupling:
    """A coupling of two joints' positions through gears or a mimic joint: follower = ratio * leader + offset (rad, m if
    prismatic).

    `name` is the coupling's own, `follower` and `leader` are joint names; by default `ratio` is 1 (no unit, or m/rad or
    rad/m) and `offset` 0 (in the follower's unit). Raises `InputError` for a joint that follows itself, a ratio that is
    zero, and values that are not finite.
    """

    name: str
    follower: str
    leader: str
    ratio: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if self.follower == self.leader:
            raise InputError(f"coupling {self.name!r}: joint {self.follower!r} cannot follow itself")
        for name in ("ratio", "offset"):
            object.__setattr__(self, name, real_number(getattr(self, name), f"coupling {self.name!r}: {name}"))
        if not (np.isfinite(self.ratio) and np.isfinite(self.offset)) or self.ratio == 0.0:
            raise InputError(
                f"coupling {self.name!r}: expected a finite ratio other than zero and a finite offset, "
                f"got {self.ratio} and {self.offset}"
            )


@dataclass(frozen=True, eq=False)
class Condition:
    """A linear bound on the positions of the primary (independent) joints: lower < sum of weight times position <
    upper.

    `name` is the condition's name in messages. `weights` (no unit) go by joint name; joints not named have weight zero.
    `lower` and `upper` (rad, m if prismatic) are infinite, so no bound, by default. Sampled configurations and
    environments keep within the bounds, such as those of the semi-direct-drive arm, 0.5236 < p2 - p3 < 2.618 rad, of
    joints 2 and 3. Raises `InputError` for no weights, weights that are not finite, and unless lower < upper.
    """

    name: str
    weights: Mapping[str, float]
    lower: float = -np.inf
    upper: float = np.inf

    def __post_init__(self) -> None:
        given = {joint: real_number(x, f"condition {self.name!r}: weight") for joint, x in self.weights.items()}
        object.__setattr__(self, "weights", MappingProxyType(given))
        for name in ("lower", "upper"):
            object.__setattr__(self, name, real_number(getattr(self, name), f"condition {self.name!r}: {name}"))
        if not self.weights or not all(np.isfinite(w) for w in self.weights.values()):
            raise InputError(f"condition {self.name!r}: expected finite weights of at least one joint")
        if not self.lower < self.upper:
            raise InputError(f"condition {self.name!r}: expected lower < upper, got {self.lower} and {self.upper}")


@dataclass(frozen=True, eq=False)
class Loops:
    """The loop constraints of a mechanism: closures, couplings and primary joints that turn a tree of links into a
    mechanism with loops.

    `primary` names the primary (independent) joints, which are driven and whose positions describe the motion; the
    others follow. `closures` and `couplings` are the constraints between links and between joints, by default none.
    `reference` gives the configuration (rad, m if prismatic, by joint name, zero where not given) from which the motion
    is followed, and so the assembly branch, which of several ways to close the loops is meant; the values of joints
    that are not primary only start the Newton iteration that closes the loops there. `conditions`, by default none,
    bound weighted sums of primary joints' positions. Raises `InputError` for no primary joint, a text in place of the
    names `primary`, neither closures nor couplings, a closure's, coupling's, follower's or primary joint's name given
    twice, a follower that is primary or leads another, and a condition on a joint that is not primary.
    """

    primary: tuple[str, ...]
    closures: tuple[Closure, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    reference: Mapping[str, float] = field(default_factory=dict)
    conditions: tuple[Condition, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.primary, str):
            raise InputError(f"loops: primary: expected names of joints, got the text {self.primary!r}")
        for name in ("primary", "closures", "couplings", "conditions"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "reference", MappingProxyType(dict(self.reference)))
        names = [c.name for c in self.closures] + [c.name for c in self.couplings]
        _validate_unique("closure or coupling", names)
        _validate_unique("follower", [c.follower for c in self.couplings])
        self._validate_plain_couplings()
        if not self.primary:
            raise InputError("loops: at least one joint must be primary")
        _validate_unique("primary joint", self.primary)
        for condition in self.conditions:
            for joint in condition.weights:
                if joint not in self.primary:
                    raise InputError(f"condition {condition.name!r}: joint {joint!r} is not primary")
        if not self.closures and not self.couplings:
            raise InputError(
                "loops: expected closures or couplings; a mechanism without either is a tree, of loops None"
            )

    def _validate_plain_couplings(self) -> None:
        followers = {c.follower for c in self.couplings}
        for c in self.couplings:
            if c.leader in followers:
                raise InputError(
                    f"coupling {c.name!r}: joint {c.follower!r} follows {c.leader!r}, which itself follows another "
                    "joint: let both follow the first"
                )
            if c.follower in self.primary:
                raise InputError(f"coupling {c.name!r}: joint {c.follower!r} follows another, so it cannot be primary")

    def validate_known(self, links: Collection[str], joints: Collection[str]) -> None:
        """Raise `NotFoundError` unless every link and every joint that these loops name is among `links` and `joints`,
        the names of a tree's links and joints. Nothing is returned."""
        named_links = {link: c.name for c in self.closures for link in (c.first, c.second) if link is not None}
        named_joints = {joint: c.name for c in self.couplings for joint in (c.follower, c.leader)}
        named_joints |= dict.fromkeys(self.primary, "primary") | dict.fromkeys(self.reference, "reference")
        for what, named, known in (("link", named_links, links), ("joint", named_joints, joints)):
            for name, where in named.items():
                if name not in known:
                    raise NotFoundError(f"{where}: there is no {what} {name!r}; there are {', '.join(sorted(known))}")

    def plain(self, digits: int | None = None) -> list[object]:
        """The data of these loops on which motion depends, for hashing, as a list of JSON's types of five entries. They
        are the list of the primary joints' names; a list for each closure (name, both links, both frames as lists of
        rotation and translation, kind) and for each coupling (name, follower, leader, ratio, offset); for each
        condition its weights by joint and its bounds; and the reference configuration, pairs of a joint's name and its
        position. Positions are in rad (m if prismatic), translations in m; numbers, some as text, are rounded to
        `digits` digits after the point, not at all for None, the default. Nothing is checked."""

        def text(x: float) -> str:
            return repr(_rounded(x, digits))

        def frame(pose: Pose) -> list[list[float]]:
            arrays = (pose.rotation, pose.translation)
            return [[_rounded(x, digits) + 0.0 for x in np.ravel(array).tolist()] for array in arrays]

        closures = [
            [c.name, c.first, c.second, frame(c.first_frame), frame(c.second_frame), c.kind.value]
            for c in self.closures
        ]
        couplings = [[c.name, c.follower, c.leader, text(c.ratio), text(c.offset)] for c in self.couplings]
        bounds = [(sorted(c.weights.items()), c.lower, c.upper) for c in self.conditions]
        conditions = [[[(k, _rounded(x, digits)) for k, x in of], text(low), text(up)] for of, low, up in bounds]
        reference = sorted((k, text(float(x))) for k, x in self.reference.items())
        return [list(self.primary), closures, couplings, conditions, reference]


def _rounded(x: float, digits: int | None) -> float:
    return x if digits is None else round(x, digits)


def _validate_unique(what: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"loops: {what} {name!r} is given more than once")
