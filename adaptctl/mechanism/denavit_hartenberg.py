"""Reader of serial chains in Denavit-Hartenberg parameters, from TOML."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from adaptctl.errors import FileError, InputError
from adaptctl.files import read_toml
from adaptctl.mechanism.description import (
    GROUND,
    STANDARD_GRAVITY,
    Description,
    Joint,
    JointKind,
    Limits,
    Link,
)
from adaptctl.mechanism.inertia import from_center_of_mass, from_tensor
from adaptctl.mechanism.pose import Array, Pose, roll_pitch_yaw, rotation_about

SCHEMA = "adaptctl/denavit-hartenberg/1"
MAX_LINKS = 256

Triple = tuple[float, float, float]
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


class Tensor(msgspec.Struct, forbid_unknown_fields=True):
    """An inertia tensor's own entries (kg m^2): xy is -integral xy dm. What is left out is zero."""

    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    xz: float = 0.0
    yz: float = 0.0
    zz: float = 0.0

    def matrix(self) -> Array:
        """The tensor (3, 3)."""
        return np.array([[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]])


class Base(msgspec.Struct, forbid_unknown_fields=True):
    """Where the chain's first frame stands in the world: a place (m) and fixed-axis roll, pitch, yaw (rad)."""

    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)


class Step(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """One link with the joint before it; lengths in m, angles in rad or, where the name says so, degrees.

    `theta` of a turning joint and `d` of a prismatic one are added to the coordinate. The inertia is
    mass, first_moment and inertia about the link frame's origin, or mass, center_of_mass and
    inertia_at_center, or nothing for a massless link; all in the link's frame.
    """

    name: str | None = None
    joint: str | None = None
    type: Literal["revolute", "continuous", "prismatic"] = "revolute"
    a: float = 0.0
    d: float = 0.0
    alpha: float | None = None
    alpha_deg: float | None = None
    theta: float | None = None
    theta_deg: float | None = None
    range: tuple[float, float] | None = None
    range_deg: tuple[float, float] | None = None
    velocity: float | None = None
    effort: float | None = None
    mass: float | None = None
    first_moment: Triple | None = None
    inertia: Tensor | None = None
    center_of_mass: Triple | None = None
    inertia_at_center: Tensor | None = None


class Chain(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A whole file; `source` says where the numbers come from."""

    schema: Literal["adaptctl/denavit-hartenberg/1"]
    convention: Literal["standard", "modified"]
    links: Annotated[list[Step], msgspec.Meta(min_length=1, max_length=MAX_LINKS)]
    name: str | None = None
    source: str = ""
    gravity: Triple = STANDARD_GRAVITY
    base: Base = msgspec.field(default_factory=Base)


def read_denavit_hartenberg(path: str | Path) -> Description:
    """The chain that a TOML file describes, named after the file unless it says otherwise.

    ``convention = "standard"`` puts a link's frame at its far end: Rz(theta) Tz(d) Tx(a) Rx(alpha) leads from
    the link before (Denavit and Hartenberg 1955). ``"modified"`` puts it at its joint:
    Rx(alpha) Tx(a) Rz(theta) Tz(d), a and alpha being those before the joint (Craig 1986).
    Raises FileError.
    """
    chain = read_toml(path, Chain)
    try:
        links = tuple(_link(i, step, chain) for i, step in enumerate(chain.links))
        return Description(chain.name or Path(path).stem, links, np.array(chain.gravity), chain.source.strip())
    except InputError as error:
        raise FileError(f"{path}: {error}") from error


def _link(index: int, step: Step, chain: Chain) -> Link:
    try:
        near, far = _poses(step, chain.convention == "standard")
        if index == 0:
            near = Pose(roll_pitch_yaw(chain.base.rpy), np.array(chain.base.xyz)) @ near
        joint = Joint(step.joint or f"joint{index + 1}", JointKind(step.type), np.array(Z), _limits(step))
        name = step.name or f"link{index + 1}"
        return Link(name, index - 1 if index else GROUND, joint, near, far, _inertia(step))
    except InputError as error:
        raise InputError(f"$.links[{index}]: {error}") from error


def _poses(step: Step, standard: bool) -> tuple[Pose, Pose]:
    """The joint's frame in the link before, and the link's in the joint's."""
    alpha = _angle("alpha", step.alpha, step.alpha_deg)
    if alpha is None:
        raise InputError("the twist is missing: give alpha (rad) or alpha_deg")
    theta = _angle("theta", step.theta, step.theta_deg) or 0.0
    twist = Pose(rotation_about(X, alpha), np.array([step.a, 0.0, 0.0]))
    turn, shift = Pose(rotation_about(Z, theta), np.zeros(3)), Pose(np.eye(3), np.array([0.0, 0.0, step.d]))
    return (turn, shift @ twist) if standard else (twist @ turn @ shift, Pose.identity())


def _angle(name: str, radians: float | None, degrees: float | None) -> float | None:
    if radians is not None and degrees is not None:
        raise InputError(f"{name} is given twice: keep {name} (rad) or {name}_deg")
    return math.radians(degrees) if degrees is not None else radians


def _limits(step: Step) -> Limits:
    bounds = step.range or step.range_deg
    if step.range is not None and step.range_deg is not None:
        raise InputError("the range is given twice: keep range (rad or m) or range_deg")
    if bounds is not None and step.type == "continuous":
        raise InputError("a continuous joint has no range: leave it out or make the joint revolute")
    if step.range_deg is not None:
        if step.type == "prismatic":
            raise InputError("a prismatic joint's range is in m: write range instead of range_deg")
        bounds = math.radians(step.range_deg[0]), math.radians(step.range_deg[1])
    lower, upper = bounds or (-math.inf, math.inf)
    return Limits(lower, upper, _or_unlimited(step.velocity), _or_unlimited(step.effort))


def _or_unlimited(bound: float | None) -> float:
    return math.inf if bound is None else bound


def _inertia(step: Step) -> Array:
    about_origin = (step.first_moment, step.inertia)
    about_center = (step.center_of_mass, step.inertia_at_center)
    if step.mass is None and about_origin == about_center == (None, None):
        return np.zeros(10)
    if step.mass is not None and about_center == (None, None):
        moment, tensor = about_origin
        if moment is not None and tensor is not None:
            return from_tensor(step.mass, moment, tensor.matrix())
    if step.mass is not None and about_origin == (None, None):
        center, tensor = about_center
        if center is not None and tensor is not None:
            return from_center_of_mass(step.mass, center, tensor.matrix())
    raise InputError(
        "the inertia is incomplete or given twice: give mass, first_moment and inertia (about the frame's "
        "origin), or mass, center_of_mass and inertia_at_center, or none of them for a massless link"
    )
