"""Entries of links, joints and frames in TOML files, common to all ways of describing the tree."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec
import numpy as np

from adaptctl.arrays import Array
from adaptctl.description.description import Joint, JointKind, Limits
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import from_center_of_mass, from_tensor
from adaptctl.description.pose import Pose, roll_pitch_yaw
from adaptctl.errors import InputError

MAX_ENTRIES = 256
"""Links, closures, couplings or conditions in one file."""

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=128, pattern=r"^[^\n\t]*\Z")]
Triple = tuple[float, float, float]


class Tensor(msgspec.Struct, forbid_unknown_fields=True):
    """Entry of an inertia tensor (kg m^2): xy is -integral xy dm. What is left out is zero."""

    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    xz: float = 0.0
    yz: float = 0.0
    zz: float = 0.0

    def matrix(self) -> Array:
        """The inertia tensor (3, 3), kg m^2."""
        return np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])


class FrameEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Entry of a frame's pose in another: a place (m) and fixed-axis roll, pitch, yaw (rad, or degrees)."""

    position: Triple = (0.0, 0.0, 0.0)
    rpy: Triple | None = None
    rpy_deg: Triple | None = None

    def pose(self) -> Pose:
        """The frame's pose in its link. Raises `InputError` where rpy is given twice."""
        if self.rpy is not None and self.rpy_deg is not None:
            raise InputError("rpy is given twice: keep rpy (rad) or rpy_deg")
        degrees = [math.radians(angle) for angle in self.rpy_deg or (0.0, 0.0, 0.0)]
        return Pose(roll_pitch_yaw(self.rpy or degrees), np.array(self.position))


class DriveEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Entry of a joint's drive, as `Drive` has it; `turns_with` gives ratios by the names of other joints.

    What is left out is not modelled; what is given, zero too, is a parameter.
    """

    rotor_inertia: float | None = None
    viscous: float | None = None
    coulomb: float | None = None
    square_root: float | None = None
    stribeck: float | None = None
    offset: float | None = None
    turns_with: dict[Name, float] = {}

    def drive(self) -> Drive:
        """The entry's drive. Raises `InputError` for impossible numbers."""
        terms = (self.rotor_inertia, self.viscous, self.coulomb, self.square_root, self.stribeck, self.offset)
        return Drive(*terms, turns_with=tuple(self.turns_with.items()))


class LinkEntry(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Entry of one link with the joint before it; lengths in m, angles in rad or, where the name says so, degrees.

    The inertia is mass, first_moment and inertia about the link frame's origin, or mass, center_of_mass and
    inertia_at_center, or nothing for a massless link; all in the link's frame.
    """

    name: Name | None = None
    joint: Name | None = None
    type: Literal["revolute", "continuous", "prismatic"] = "revolute"
    range: tuple[float, float] | None = None
    range_deg: tuple[float, float] | None = None
    velocity: float | None = None
    effort: float | None = None
    mass: float | None = None
    first_moment: Triple | None = None
    inertia: Tensor | None = None
    center_of_mass: Triple | None = None
    inertia_at_center: Tensor | None = None
    drive: DriveEntry = msgspec.field(default_factory=DriveEntry)

    def moving(self, name: str, axis: Triple) -> Joint:
        """The joint of the entry, with its limits and its drive."""
        return Joint(name, JointKind(self.type), np.array(axis), self.limits(), self.drive.drive())

    def limits(self) -> Limits:
        """The joint's limits; what is not given does not limit."""
        lower, upper = self._range() or (-math.inf, math.inf)
        return Limits(lower, upper, _or_unlimited(self.velocity), _or_unlimited(self.effort))

    def ten(self) -> Array:
        """The link's ten inertial parameters (10,), zero where nothing is given. Raises `InputError` where the inertia
        is incomplete or given twice."""
        about_origin = (self.first_moment, self.inertia)
        about_center = (self.center_of_mass, self.inertia_at_center)
        self._require_mass()
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
            "the inertia is incomplete or given twice: give mass, first_moment and inertia (about the frame's "
            "origin), or mass, center_of_mass and inertia_at_center, or none of them for a massless link"
        )

    def _require_mass(self) -> None:
        if self.mass is not None and self.mass < 0.0:
            raise InputError(f"mass must not be negative, got {self.mass}")
        given = [self.first_moment or (), *(t.matrix() for t in (self.inertia, self.inertia_at_center) if t)]
        if self.mass == 0.0 and any(np.any(numbers) for numbers in given):
            raise InputError("inertia without mass: give the mass that has it, or leave all of it out")

    def _range(self) -> tuple[float, float] | None:
        bounds = self.range or self.range_deg
        if self.range is not None and self.range_deg is not None:
            raise InputError("the range is given twice: keep range (rad or m) or range_deg")
        if bounds is not None and self.type == "continuous":
            raise InputError("a continuous joint has no range: leave it out or make the joint revolute")
        if self.range_deg is None:
            return bounds
        if self.type == "prismatic":
            raise InputError("a prismatic joint's range is in m: write range instead of range_deg")
        return math.radians(self.range_deg[0]), math.radians(self.range_deg[1])


def _or_unlimited(bound: float | None) -> float:
    return math.inf if bound is None else bound
