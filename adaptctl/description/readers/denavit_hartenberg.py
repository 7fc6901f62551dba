"""Reader of serial chains in Denavit-Hartenberg parameters, from TOML."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from adaptctl.description.description import GROUND, STANDARD_GRAVITY, Description, Link
from adaptctl.description.pose import Pose, roll_pitch_yaw, rotation_about
from adaptctl.description.readers.entries import (
    MAX_ENTRIES,
    LinkEntry,
    Name,
    Triple,
    is_more_than_a_turn,
    warn_of_degrees,
    warn_of_weightless,
)
from adaptctl.errors import FileError, InputError
from adaptctl.files import read_text, read_toml, with_line

X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


class Base(msgspec.Struct, forbid_unknown_fields=True):
    """The pose, in a Denavit-Hartenberg file, of the chain's first frame in the ground's frame: the position `xyz` (m),
    and roll, pitch and yaw `rpy` (rad), turns about the fixed axes x, y and z in this order; all zero by default.
    Nothing is checked at construction."""

    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)


class Step(LinkEntry, kw_only=True):
    """An entry of a Denavit-Hartenberg file: one link with the joint before it.

    Its parameters are length `a` and offset `d` (m), twist `alpha` and angle `theta` (rad; or `alpha_deg`, `theta_deg`
    in degrees), by default 0, save that one of the two twists must be given. The file's convention says how they place
    the link: "standard" leads from the frame of the link before to this link's by Rz(theta) Tz(d) Tx(a) Rx(alpha),
    turns R about and shifts T along the axes z and x (Denavit and Hartenberg 1955), "modified" by Rx(alpha) Tx(a)
    Rz(theta) Tz(d) (Craig 1986). The coordinate of a turning joint is added to theta, that of a prismatic one to d. The
    other fields are those of `LinkEntry`: names, joint type, limits, inertia and drive. Nothing is checked at
    construction.
    """

    a: float = 0.0
    d: float = 0.0
    alpha: float | None = None
    alpha_deg: float | None = None
    theta: float | None = None
    theta_deg: float | None = None


class Chain(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """The contents of a Denavit-Hartenberg file in TOML, as `read_denavit_hartenberg` reads them.

    `schema` names the file format. `convention` says where links' frames are: "standard" at their far ends, leading
    from the frame of the link before to this link's by Rz(theta) Tz(d) Tx(a) Rx(alpha), turns R about and shifts T
    along the axes z and x (Denavit and Hartenberg 1955); "modified" at their joints, by Rx(alpha) Tx(a) Rz(theta) Tz(d)
    (Craig 1986). `links` has 1 to 256 entries, from the ground on; `source` says where the values come from; `gravity`
    (3,) is in m/s^2, by default (0, 0, -9.81); `base` is the pose of the chain's first frame in the ground's. The
    `name` is the mechanism's; without one the file's is taken. Nothing is checked at construction.
    """

    schema: Literal["adaptctl/denavit-hartenberg/1"]
    convention: Literal["standard", "modified"]
    links: Annotated[list[Step], msgspec.Meta(min_length=1, max_length=MAX_ENTRIES)]
    name: Name | None = None
    source: str = ""
    gravity: Triple = STANDARD_GRAVITY
    base: Base = msgspec.field(default_factory=Base)


def read_denavit_hartenberg(path: str | Path) -> Description:
    """The description of the serial chain that the TOML file at `path` gives by Denavit-Hartenberg parameters (m, rad),
    named after the file unless it gives a name.

    The file has ``schema = "adaptctl/denavit-hartenberg/1"``, a convention, and ``[[links]]`` with length a and offset
    d (m), twist alpha and angle theta (rad; or alpha_deg, theta_deg), the joint's type and limits, the inertia and the
    drive; of a link only alpha must be given. ``convention = "standard"`` puts a link's frame at its far end: Rz(theta)
    Tz(d) Tx(a) Rx(alpha), turns R about and shifts T along the axes z and x, leads from the link before (Denavit and
    Hartenberg 1955). ``"modified"`` puts it at its joint: Rx(alpha) Tx(a) Rz(theta) Tz(d), a and alpha being those
    before the joint (Craig 1986). Raises `FileError` for a file that cannot be read and, naming the element, for wrong
    contents. Warns (`SimplificationWarning`) of angles that look like degrees and of links that move without mass and
    whose descendants have none.
    """
    chain = read_toml(path, Chain)
    try:
        links = tuple(_link(i, step, chain) for i, step in enumerate(chain.links))
        name, gravity = chain.name or Path(path).stem, np.array(chain.gravity)
        description = Description(name, links, gravity, chain.source.strip())
    except InputError as error:
        raise FileError(with_line(f"{path}: {error}", read_text(path))) from error
    turned = (f"alpha or theta of {link.name}" for link, s in zip(links, chain.links, strict=True) if _turns(s))
    base = ["rpy of $.base"] if is_more_than_a_turn(chain.base.rpy) else []
    warn_of_degrees(path, links, [*base, *turned])
    warn_of_weightless(path, links, None)
    return description


def _turns(step: Step) -> bool:
    return is_more_than_a_turn(step.alpha) or is_more_than_a_turn(step.theta)


def _link(index: int, step: Step, chain: Chain) -> Link:
    try:
        near, far = _poses(step, chain.convention == "standard")
        if index == 0:
            near = Pose(roll_pitch_yaw(chain.base.rpy), np.array(chain.base.xyz)) @ near
        joint = step.moving(step.joint or f"joint{index + 1}", Z)
        name = step.name or f"link{index + 1}"
        return Link(name, index - 1 if index else GROUND, joint, near, far, step.ten())
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
