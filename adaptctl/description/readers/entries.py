"""Entries of links, joints and frames in TOML files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.drive import Drive, DriveParameter, Limits
from adaptctl.description.inertia import from_center_of_mass, from_tensor
from adaptctl.description.joint import Joint, JointKind
from adaptctl.description.link import Link, weightless_ends
from adaptctl.description.pose import Pose, roll_pitch_yaw
from adaptctl.errors import InputError, SimplificationWarning, printable, suggested_name, warn

if TYPE_CHECKING:
    from adaptctl.description.loops import Loops


FLOATING_FLAG = "floating_base=True (--floating-base)"
MAX_ENTRIES = 256
"""Links, closures, couplings or conditions in one file."""

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=128, pattern=r"^[^\n\t]*\Z")]
Triple = tuple[float, float, float]


class Tensor(msgspec.Struct, forbid_unknown_fields=True):
    """Inertia tensor of a TOML file in kg m^2; off-diagonal entries are -integral xy dm."""

    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    xz: float = 0.0
    yz: float = 0.0
    zz: float = 0.0

    def matrix(self) -> Array:
        """Symmetric matrix (3, 3) in kg m^2."""
        return np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])


class FrameEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Pose of a frame in a TOML file."""

    position: Triple = (0.0, 0.0, 0.0)
    rpy: Triple | None = None
    rpy_deg: Triple | None = None

    def pose(self) -> Pose:
        """Pose in m from the properties `position` and `rpy` or `rpy_deg`."""
        if self.rpy is not None and self.rpy_deg is not None:
            raise InputError("rpy is given twice; give either rpy (rad) or rpy_deg")
        degrees = [math.radians(angle) for angle in self.rpy_deg or (0.0, 0.0, 0.0)]
        return Pose(roll_pitch_yaw(self.rpy or degrees), np.array(self.position))


class DriveEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Data of a joint's drive in a TOML file: its rotor inertia, friction and springs."""

    rotor_inertia: float | None = None
    viscous: float | None = None
    coulomb: float | None = None
    square_root: float | None = None
    stribeck: float | None = None
    offset: float | None = None
    stiffness: float | None = None
    sine: float | None = None
    cosine: float | None = None
    sine_2: float | None = None
    cosine_2: float | None = None
    turns_with: dict[Name, float] = {}

    def drive(self) -> Drive:
        """Rotor inertia, friction and springs of a joint; terms left out are None, not modelled."""
        terms = {kind: getattr(self, kind.value) for kind in DriveParameter}
        return Drive(turns_with=tuple(self.turns_with.items())).with_terms(terms)


class LinkEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Entry of a TOML file: one link with the joint before it."""

    name: Name | None = None
    joint: Name | None = None
    type: Literal["revolute", "continuous", "prismatic"] = "revolute"
    range: tuple[float, float] | None = None
    range_deg: tuple[float, float] | None = None
    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None
    mass: float | None = None
    first_moment: Triple | None = None
    inertia: Tensor | None = None
    center_of_mass: Triple | None = None
    inertia_at_center: Tensor | None = None
    drive: DriveEntry = msgspec.field(default_factory=DriveEntry)

    def moving(self, name: str, axis: Triple) -> Joint:
        """Joint of this entry, with the given name and axis (3,)."""
        return Joint(name, JointKind(self.type), np.array(axis), self.limits(), self.drive.drive())

    def limits(self) -> Limits:
        """Limits of the joint that a TOML file's entry gives."""
        lower, upper = self._range()
        return Limits(lower, upper, _or_unlimited(self.velocity), _or_unlimited(self.effort))

    def ten(self) -> Array:
        """Ten inertial parameters of the link; zero where nothing is given."""
        about_origin = (self.first_moment, self.inertia)
        about_center = (self.center_of_mass, self.inertia_at_center)
        self._validate_mass()
        if self.mass is None and about_origin == about_center == (None, None):
            return np.zeros(10)
        if self.mass is not None and about_center == (None, None):
            moment, tensor = about_origin
            if moment is not None and tensor is not None:
                return from_tensor(self.mass, moment, tensor.matrix())
        if self.mass is not None and about_origin == (None, None):
            center, tensor = about_center
            if center is not None and tensor is not None:
                return from_center_of_mass(self.mass, center, tensor.matrix())
        raise InputError(
            "the inertia is incomplete or given twice; give mass, first_moment and inertia (about the frame's "
            "origin), or mass, center_of_mass and inertia_at_center, or none of them for a massless link"
        )

    def _validate_mass(self) -> None:
        if self.mass is not None and self.mass < 0.0:
            raise InputError(f"mass must not be negative, got {self.mass}")
        given = [self.first_moment or (), *(t.matrix() for t in (self.inertia, self.inertia_at_center) if t)]
        if self.mass == 0.0 and any(np.any(numbers) for numbers in given):
            raise InputError("inertia without mass; give the mass, or remove the inertia")

    def _range(self) -> tuple[float, float]:
        bounds = (self.lower, self.upper)
        given = [range for range in (self.range, self.range_deg, bounds) if range not in (None, (None, None))]
        if len(given) > 1:
            raise InputError("the range is given twice; give one of range (rad or m), range_deg, or lower and upper")
        if given and self.type == "continuous":
            raise InputError("a continuous joint has no range; remove the range, or make the joint revolute")
        if self.range_deg is None:
            lower, upper = self.range or bounds
            return _or_unlimited(lower, -math.inf), _or_unlimited(upper)
        if self.type == "prismatic":
            raise InputError("a prismatic joint's range is in m; write range instead of range_deg")
        return math.radians(self.range_deg[0]), math.radians(self.range_deg[1])


def _or_unlimited(bound: float | None, unlimited: float = math.inf) -> float:
    return unlimited if bound is None else bound


MAX_LINKS = 256
"""Links that move, in one file: regressors of more take minutes."""
MAX_BODIES, MAX_GEOMS = 2_000, 5_000
"""Bodies in one file, those that are fixed to others counted, and geoms."""
MIN_SUSPECT_LIMIT, MAX_SUSPECT_LIMIT = 6.0 * math.pi, 3600.0
"""Limits (rad) between these may be degrees: few joints turn three times, and much larger limits mean none."""
MAX_LISTED_NAMES = 20
"""names that a message lists"""
MAX_FRAME_ANGLE = 2.02 * math.pi
"""Angle (rad) that no frame needs to be turned by."""


def validate_at_most(count: int, most: int, what: str) -> None:
    """Raise `InputError` if a file has too many parts of one kind."""
    if count > most:
        raise InputError(f"{count} {what}, above the limit of {most}")


def validate_mass_of_inertia(link: Link) -> Link:
    """The `link` itself, unchanged."""
    if link.inertia[0] == 0.0 and np.any(link.inertia):
        raise InputError(f"link {link.name!r}: inertia without mass; give the mass, or remove the inertia")
    return link


def warn_of_weightless(path: Any, links: Sequence[Link], loops: Loops | None) -> None:
    """Warn of end links of a file that move without inertia or rotor."""
    if loops is None and any(np.any(link.inertia) for link in links) and (names := weightless_ends(links)):
        text = "moving links without mass at the end of the chain, whose accelerations are undetermined"
        warn(f"{path}: {text}: {', '.join(names)}", SimplificationWarning)


def warn_of_repeated(path: Any, names: Sequence[str]) -> None:
    """Warn of constraints that say the same as others of a file."""
    if names:
        text = "constraints given twice are taken once"
        warn(f"{path}: {text}: {', '.join(names)}", SimplificationWarning)


def zero_limits(lower: float | None, upper: float | None, velocity: float | None, effort: float | None) -> str:
    """Limits that are zero, in words; None stands for one that is not given."""
    is_empty = not lower and not upper and (lower, upper) != (None, None)
    most = [f"{name} 0" for name, value in (("velocity", velocity), ("effort", effort)) if value == 0.0]
    return ", ".join(["lower = upper = 0"] * is_empty + most)


def unknown_body(name: str, known: Sequence[str]) -> str:
    """Text of a message that a scene has no body of this `name`."""
    guess = suggested_name(name, known)
    listed = ", ".join(repr(other) for other in known[:MAX_LISTED_NAMES] if other)
    return f"unknown body {printable(name)!r}{guess}; bodies: {listed}{', ...' * (len(known) > MAX_LISTED_NAMES)}"


def is_more_than_a_turn(angles: Iterable[float] | float | None) -> bool:
    """True where an angle is above 2.02 pi in size, perhaps in degrees."""
    given = (angles,) if isinstance(angles, int | float) else angles or ()
    return any(abs(angle) > MAX_FRAME_ANGLE for angle in given)


def warn_of_degrees(path: Any, links: Sequence[Link], frames: Sequence[str]) -> None:
    """Warn of angles read as rad that look like degrees."""
    suspect = [link.joint for link in links if _may_be_degrees(link)]
    if names := [*(f"limits of {joint.name}" for joint in suspect), *frames]:
        most = max((abs(bound) for joint in suspect for bound in _bounds(joint)), default=180.0)
        text = "angles are read in radians, but look like degrees"
        hint = f"{most:g} degrees are {math.radians(most):.4g}"
        warn(f"{path}: {text}: {', '.join(names)}; {hint}", SimplificationWarning)


def _may_be_degrees(link: Link) -> bool:
    suspect = any(MIN_SUSPECT_LIMIT < abs(bound) <= MAX_SUSPECT_LIMIT for bound in _bounds(link.joint))
    return link.joint.kind.is_revolute and suspect


def _bounds(joint: Joint) -> tuple[float, float]:
    return joint.limits.lower, joint.limits.upper
