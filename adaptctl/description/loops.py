"""Loop closures: coinciding frames, and joints that follow others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType

import numpy as np

from adaptctl.description.pose import Pose
from adaptctl.errors import InputError, NotFoundError


class ClosureKind(Enum):
    """The kind of a loop closure, by what coincides of two frames: POINT, their origins, AXIS, origins and z axes (a
    hinge), or WELD, the whole poses."""

    POINT = "point"
    AXIS = "axis"
    WELD = "weld"

    @property
    def rows(self) -> int:
        """Number of scalar constraints, dependent ones included: 3 for a point, 5 for an axis, 6 for a weld."""
        return {"point": 3, "axis": 5, "weld": 6}[self.value]


@dataclass(frozen=True)
class Closure:
    """A loop closure, the joint that was cut to make a tree: a frame on one link coincides with a frame on another.

    `first` and `second` name the links, None being the ground; the frames are poses in their links, by default the
    links' own frames. `kind` says what coincides: POINT, the default, the origins, AXIS, origins and z axes, WELD, the
    whole poses. Raises `InputError` for a link closed onto itself.
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
    """A coupling of two joints through gears or a mimic: follower = ratio leader + offset (rad or m).

    `follower` and `leader` are joint names; by default the ratio is 1 and the offset 0. Raises `InputError` for a joint
    that follows itself, a ratio that is zero, and numbers that are not finite.
    """

    name: str
    follower: str
    leader: str
    ratio: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if self.follower == self.leader:
            raise InputError(f"coupling {self.name!r}: joint {self.follower!r} cannot follow itself")
        if not (np.isfinite(self.ratio) and np.isfinite(self.offset)) or self.ratio == 0.0:
            raise InputError(
                f"coupling {self.name!r}: expected a finite ratio other than zero and a finite offset, "
                f"got {self.ratio} and {self.offset}"
            )


@dataclass(frozen=True, eq=False)
class Condition:
    """A bound on where a mechanism may work: lower < sum of weight times primary coordinate < upper (rad or m).

    `weights`, without a unit, go by joint name, joints not named having zero; an infinite bound, the default, bounds
    nothing. Sampling and environments keep to it; the semi-direct-drive arm's 0.5236 < p2 - p3 < 2.618 is one. Raises
    `InputError` for no weights, weights that are not finite, and unless lower < upper.
    """

    name: str
    weights: Mapping[str, float]
    lower: float = -np.inf
    upper: float = np.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", MappingProxyType(dict(self.weights)))
        if not self.weights or not all(np.isfinite(w) for w in self.weights.values()):
            raise InputError(f"condition {self.name!r}: expected finite weights of at least one joint")
        if not self.lower < self.upper:
            raise InputError(f"condition {self.name!r}: expected lower < upper, got {self.lower} and {self.upper}")


@dataclass(frozen=True, eq=False)
class Loops:
    """The loops of a mechanism: closures, couplings and primary joints that make a tree a mechanism with loops.

    `primary` names the joints that are driven and whose coordinates describe the motion; the others follow. `reference`
    gives the configuration (rad or m by joint name, zero where not given) from which the motion is followed, so that
    the assembly branch is its; its dependent joints need only be near enough to close. `conditions` say where the
    mechanism may work; there are none by default. Raises `InputError` for no primary joint, a name given twice, a
    follower that is primary or leads another, and a condition on a joint that is not primary.
    """

    primary: tuple[str, ...]
    closures: tuple[Closure, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    reference: Mapping[str, float] = field(default_factory=dict)
    conditions: tuple[Condition, ...] = ()

    def __post_init__(self) -> None:
        for name in ("primary", "closures", "couplings", "conditions"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "reference", MappingProxyType(dict(self.reference)))
        names = [c.name for c in self.closures] + [c.name for c in self.couplings]
        _require_unique("closure or coupling", names)
        _require_unique("follower", [c.follower for c in self.couplings])
        self._require_plain_couplings()
        if not self.primary:
            raise InputError("loops: at least one joint must be primary")
        _require_unique("primary joint", self.primary)
        for condition in self.conditions:
            for joint in condition.weights:
                if joint not in self.primary:
                    raise InputError(f"condition {condition.name!r}: joint {joint!r} is not primary")

    def _require_plain_couplings(self) -> None:
        followers = {c.follower for c in self.couplings}
        for c in self.couplings:
            if c.leader in followers:
                raise InputError(
                    f"coupling {c.name!r}: joint {c.follower!r} follows {c.leader!r}, which itself follows another "
                    "joint: let both follow the first"
                )
            if c.follower in self.primary:
                raise InputError(f"coupling {c.name!r}: joint {c.follower!r} follows another, so it cannot be primary")

    def require_known(self, links: Collection[str], joints: Collection[str]) -> None:
        """Raise `NotFoundError` where the loops name a link or a joint that is not among `links` and `joints`, the
        tree's names."""
        named_links = {link: c.name for c in self.closures for link in (c.first, c.second) if link is not None}
        named_joints = {joint: c.name for c in self.couplings for joint in (c.follower, c.leader)}
        named_joints |= dict.fromkeys(self.primary, "primary") | dict.fromkeys(self.reference, "reference")
        for what, named, known in (("link", named_links, links), ("joint", named_joints, joints)):
            for name, where in named.items():
                if name not in known:
                    raise NotFoundError(f"{where}: there is no {what} {name!r}; there are {', '.join(sorted(known))}")

    def plain(self, digits: int | None = None) -> list[object]:
        """The loops' contents that bear on motion, primary joints, closures, couplings, conditions and reference, as
        lists of JSON's types, for hashing; numbers to so many `digits` after the point, None for all."""

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


def _require_unique(what: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"loops: {what} {name!r} is given more than once")
