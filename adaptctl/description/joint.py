"""Joints as data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from adaptctl.arrays import Array, frozen_array
from adaptctl.caching import sent_as_made
from adaptctl.description.drive import HARMONICS, Drive, Limits
from adaptctl.errors import InputError

if TYPE_CHECKING:
    pass


class JointKind(Enum):
    """
    Kind of a joint: revolute, prismatic, or continuous, which is revolute without position limits.

    Examples
    --------
    >>> from adaptctl.description import JointKind
    >>> JointKind("prismatic").effort_unit
    'N'
    """

    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"

    @property
    def is_revolute(self) -> bool:
        """True for revolute and continuous joints, False for prismatic ones."""
        return self._value_ != "prismatic"  # a member takes five times as long to look up

    @property
    def position_unit(self) -> str:
        """Unit of the joint's position, "rad" or "m"."""
        return "rad" if self.is_revolute else "m"

    @property
    def effort_unit(self) -> str:
        """Unit of the joint's torque or force, "N m" or "N"."""
        return "N m" if self.is_revolute else "N"


@sent_as_made
@dataclass(frozen=True, eq=False)
class Joint:
    """
    Joint of one coordinate, an angle about or a displacement along its axis.

    Parameters
    ----------
    name : str
        Name, unique in a mechanism, by which files and messages refer to the joint.
    kind : JointKind, default JointKind.REVOLUTE
        Kind of motion, rotation or translation; revolute by default, as most joints of arms are.
    axis : array_like, optional
        Direction (3,) in the joint's frame, of any length; kept as a unit vector, z by default.
    limits : Limits, optional
        Position, speed and effort limits; none by default.
    drive : Drive, optional
        Rotor inertia and friction; by default none, and these are no parameters of the model.

    Raises
    ------
    InputError
        If `kind` is not a `JointKind`, the axis has another shape, is not finite or shorter than 1e-9, or the drive of
        a prismatic joint has harmonics of an angle.

    Examples
    --------
    >>> from adaptctl.description import Joint, JointKind
    >>> Joint("slide", JointKind.PRISMATIC, axis=[2.0, 0.0, 0.0]).axis.tolist()
    [1.0, 0.0, 0.0]
    """

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
            what = "other than zero" if norm < 1.0 else f"of finite length, got {axis.tolist()}"
            raise InputError(f"joint {self.name!r}: axis: expected a vector {what}")
        for kind in () if self.kind.is_revolute else HARMONICS:
            if self.drive.value(kind) is not None:
                raise InputError(
                    f"joint {self.name!r}: {kind.value}: harmonics of the angle are of joints that turn; remove it"
                )
        # Dividing a unit vector by its own rounded norm would spoil exact entries such as 0 and 1.
        unit = axis if abs(norm - 1.0) <= 1e-15 else axis / norm
        object.__setattr__(self, "axis", frozen_array(unit, (3,), "axis"))
