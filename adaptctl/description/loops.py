"""Loop closures: coinciding frames, and joints that follow others."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from adaptctl.arrays import real_number
from adaptctl.description.pose import Pose
from adaptctl.errors import InputError, NotFoundError

SAME_FRAME = 1e-9
"""m, and entries of a rotation, by which frames of one constraint given twice may differ"""


class ClosureKind(Enum):
    """
    Kind of a loop closure: equal origins (POINT), equal origins and z axes (AXIS, a hinge), or equal poses (WELD).

    Examples
    --------
    >>> from adaptctl.description import ClosureKind
    >>> [kind.rows for kind in ClosureKind]
    [3, 5, 6]
    """

    POINT = "point"
    AXIS = "axis"
    WELD = "weld"

    @property
    def rows(self) -> int:
        """Number of scalar constraints of the closure, dependent ones included."""
        return {"point": 3, "axis": 5, "weld": 6}[self.value]


@dataclass(frozen=True)
class Closure:
    """
    Loop closure: a frame on one link coincides with a frame on another.

    Parameters
    ----------
    name : str
        Name of the closure.
    first, second : str or None
        Names of the two links; None is the ground.
    first_frame, second_frame : Pose, optional
        Poses of the frames in these links in m; the links' own frames by default.
    kind : ClosureKind, default ClosureKind.POINT
        Coordinates that coincide: the origins by default (POINT), with the z axes too (AXIS), or the whole poses
        (WELD).

    Raises
    ------
    InputError
        If `first` and `second` are the same link, or both the ground.

    Examples
    --------
    >>> from adaptctl.description import Closure, ClosureKind
    >>> Closure("pin", "rocker", None, kind=ClosureKind.AXIS).kind.rows
    5
    """

    name: str
    first: str | None
    second: str | None
    first_frame: Pose = field(default_factory=Pose.identity)
    second_frame: Pose = field(default_factory=Pose.identity)
    kind: ClosureKind = ClosureKind.POINT

    def __post_init__(self) -> None:
        if self.first == self.second:
            raise InputError(
                f"closure {self.name!r}: expected two different links, got {self.first or 'the ground'} twice"
            )


@dataclass(frozen=True)
class Coupling:
    """
    Coupling of two joints by gears, or a mimic joint: follower = ratio * leader + offset.

    Parameters
    ----------
    name : str
        Name of the coupling.
    follower, leader : str
        Names of the two joints.
    ratio : float, default 1.0
        Ratio of the follower's to the leader's position, without unit (m/rad or rad/m between an angle and a
        displacement); 1 for equal motions.
    offset : float, default 0.0
        Position of the follower in rad (m if prismatic) where the leader is at zero; zero by default.

    Raises
    ------
    InputError
        If a joint follows itself, the ratio is zero, or a value is not finite.

    Examples
    --------
    >>> from adaptctl.description import Coupling
    >>> Coupling("gears", follower="finger", leader="thumb", ratio=-1.0).offset
    0.0
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


Constraint = TypeVar("Constraint", Closure, Coupling)


@dataclass(frozen=True, eq=False)
class Condition:
    """
    Linear bound on primary positions: lower < sum of weight times position < upper.

    Parameters
    ----------
    name : str
        Name by which messages refer to the condition.
    weights : mapping of str to float
        Weights without a unit by joint name; joints not named have weight zero.
    lower, upper : float, optional
        Bounds in rad (m if prismatic); unlimited by default.

    Raises
    ------
    InputError
        If there are no weights, one is not finite, or `lower` is not below `upper`.

    Examples
    --------
    >>> from adaptctl.description import Condition
    >>> Condition("fold", {"joint2": 1.0, "joint3": -1.0}, lower=0.5236, upper=2.618).lower
    0.5236
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
    """
    Constraints that turn a tree of links into a mechanism with loops.

    Parameters
    ----------
    primary : tuple of str
        Names of the primary (independent) joints, which are driven and whose positions describe the motion.
    closures : tuple of Closure, optional
        Constraints between links. Default: none, where couplings alone make the loops.
    couplings : tuple of Coupling, optional
        Constraints between joints. A follower of a follower is coupled to the joint that leads both. Default: none,
        where closures alone make the loops.
    reference : mapping of str to float, optional
        Configuration, in rad (m) by joint name, that fixes the assembly branch; zero where not given. Values of
        dependent joints only start the Newton iteration.
    conditions : tuple of Condition, optional
        Bounds on weighted sums of primary positions. Default: none, where loops close at all positions.

    Raises
    ------
    InputError
        If there is no primary joint, neither closure nor coupling, a name is given twice, a follower is primary, joints
        follow one another in a ring, or a condition is on a dependent joint.

    Examples
    --------
    >>> from adaptctl.description import Coupling, Loops
    >>> Loops(("thumb",), couplings=(Coupling("gears", "finger", "thumb"),)).primary
    ('thumb',)
    """

    primary: tuple[str, ...]
    closures: tuple[Closure, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    reference: Mapping[str, float] = field(default_factory=dict)
    conditions: tuple[Condition, ...] = ()

    def __post_init__(self) -> None:
        if isinstance(self.primary, str):
            raise InputError(f"loops: primary: expected a sequence of joint names, got {self.primary!r}")
        for name in ("primary", "closures", "couplings", "conditions"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "reference", MappingProxyType(dict(self.reference)))
        names = [c.name for c in self.closures] + [c.name for c in self.couplings]
        _validate_unique("closure or coupling", names)
        _validate_unique("follower", [c.follower for c in self.couplings])
        object.__setattr__(self, "couplings", _resolved(self.couplings))
        self._validate_followers()
        if not self.primary:
            raise InputError("loops: primary: expected at least one joint")
        _validate_unique("primary joint", self.primary)
        for condition in self.conditions:
            for joint in condition.weights:
                if joint not in self.primary:
                    raise InputError(f"condition {condition.name!r}: joint {joint!r} is not primary")
        if not self.closures and not self.couplings:
            raise InputError("loops: expected at least one closure or coupling; give loops=None for a tree")

    def _validate_followers(self) -> None:
        for c in self.couplings:
            if c.follower in self.primary:
                raise InputError(f"coupling {c.name!r}: joint {c.follower!r} is a follower and cannot be primary")

    def validate_known(self, links: Collection[str], joints: Collection[str]) -> None:
        """
        Check that all links and joints that the loops name exist.

        Parameters
        ----------
        links, joints : collection of str
            Names of the tree's links and joints.

        Raises
        ------
        NotFoundError
            If a name is unknown.

        Examples
        --------
        >>> from adaptctl.description import Coupling, Loops
        >>> loops = Loops(("thumb",), couplings=(Coupling("gears", "finger", "thumb"),))
        >>> loops.validate_known([], ["finger", "thumb"])
        """
        named_links = {link: c.name for c in self.closures for link in (c.first, c.second) if link is not None}
        named_joints = {joint: c.name for c in self.couplings for joint in (c.follower, c.leader)}
        named_joints |= dict.fromkeys(self.primary, "primary") | dict.fromkeys(self.reference, "reference")
        for what, named, known in (("link", named_links, links), ("joint", named_joints, joints)):
            for name, where in named.items():
                if name not in known:
                    raise NotFoundError(f"{where}: unknown {what} {name!r}; {what}s: {', '.join(sorted(known))}")

    def plain(self, digits: int | None = None) -> list[object]:
        """
        Return the data that the motion depends on, in JSON's types for hashing.

        Parameters
        ----------
        digits : int, optional
            Digits after the point to which numbers are rounded; not rounded by default.

        Returns
        -------
        list
            Primary joints, closures, couplings, conditions and reference configuration, in SI units.
        """

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


def _resolved(couplings: Sequence[Coupling]) -> tuple[Coupling, ...]:
    """Return couplings to leaders that follow no other joint."""
    ahead = {c.follower: c for c in couplings}
    return tuple(_to_first_leader(c, ahead) for c in couplings)


def _to_first_leader(coupling: Coupling, ahead: Mapping[str, Coupling]) -> Coupling:
    name, follower, leader = coupling.name, coupling.follower, coupling.leader
    ratio, offset = coupling.ratio, coupling.offset
    for _ in ahead:
        if leader not in ahead:
            return coupling if leader == coupling.leader else Coupling(name, follower, leader, ratio, offset)
        more = ahead[leader]
        leader, ratio, offset = more.leader, ratio * more.ratio, ratio * more.offset + offset
    raise InputError(
        f"coupling {name!r}: joint {follower!r} follows {coupling.leader!r}, but its leaders follow in a ring"
    )


def given_once(constraints: Sequence[Constraint]) -> tuple[tuple[Constraint, ...], tuple[str, ...]]:
    """Constraints without those that say the same as another before them, and the names of these."""
    kept: list[Constraint] = []
    repeated = []
    for one in constraints:
        if any(_is_same(one, other) for other in kept):
            repeated.append(one.name)
        else:
            kept.append(one)
    return tuple(kept), tuple(repeated)


def _is_same(one: Closure | Coupling, other: Closure | Coupling) -> bool:
    """True where two constraints say the same, closures in either direction."""
    if isinstance(one, Closure) and isinstance(other, Closure):
        swapped = (other.second, other.first, other.second_frame, other.first_frame)
        ends = ((other.first, other.second, other.first_frame, other.second_frame), swapped)
        return one.kind is other.kind and any(_ends_agree(one, *end) for end in ends)
    return one == replace(other, name=one.name)


def _ends_agree(one: Closure, first: str | None, second: str | None, first_frame: Pose, second_frame: Pose) -> bool:
    frames = (one.first_frame, first_frame), (one.second_frame, second_frame)
    arrays = ["translation"] if one.kind is ClosureKind.POINT else ["translation", "rotation"]
    near = (
        np.allclose(getattr(a, array), getattr(b, array), rtol=0.0, atol=SAME_FRAME)
        for a, b in frames
        for array in arrays
    )
    return (one.first, one.second) == (first, second) and all(near)


def _rounded(x: float, digits: int | None) -> float:
    return x if digits is None else round(x, digits)


def _validate_unique(what: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"loops: {what} {name!r} is given more than once")
