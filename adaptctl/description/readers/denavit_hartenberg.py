"""Reader of serial chains in Denavit-Hartenberg parameters, from TOML."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from adaptctl.description.description import STANDARD_GRAVITY, Description
from adaptctl.description.link import GROUND, Link
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
    """Pose, in a Denavit-Hartenberg file, of the chain's first frame in the ground's frame."""

    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)


class Step(LinkEntry, kw_only=True):
    """Entry of a Denavit-Hartenberg file: one link with the joint before it."""

    a: float = 0.0
    d: float = 0.0
    alpha: float | None = None
    alpha_deg: float | None = None
    theta: float | None = None
    theta_deg: float | None = None


class Chain(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Contents of a Denavit-Hartenberg file in TOML, as `read_denavit_hartenberg` reads them."""

    schema: Literal["adaptctl/denavit-hartenberg/1"]
    convention: Literal["standard", "modified"]
    links: Annotated[list[Step], msgspec.Meta(min_length=1, max_length=MAX_ENTRIES)]
    name: Name | None = None
    source: str = ""
    gravity: Triple = STANDARD_GRAVITY
    base: Base = msgspec.field(default_factory=Base)


def read_denavit_hartenberg(path: str | Path) -> Description:
    r"""
    Read a serial chain from a TOML file of Denavit-Hartenberg parameters.

    Parameters
    ----------
    path : str or Path
        File with ``schema = "adaptctl/denavit-hartenberg/1"``; the mechanism is named after it unless it gives a name.

    Returns
    -------
    Description
        The chain; units in the file are m and rad, or degrees where a key says so.

    Raises
    ------
    FileError
        If the file cannot be read or its contents are wrong; the message names the element.

    Warns
    -----
    SimplificationWarning
        If angles look like degrees, or a link at the end of the chain has no mass.

    Notes
    -----
    A link's frame follows from that before it by turns R and shifts T about and along the axes z and x:
    :math:`R_z(\theta) T_z(d) T_x(a) R_x(\alpha)` for the convention "standard" [1]_ and
    :math:`R_x(\alpha) T_x(a) R_z(\theta) T_z(d)` for "modified" [2]_.

    References
    ----------
    .. [1] Denavit and Hartenberg, "A kinematic notation for lower-pair mechanisms based on matrices", Journal of
       Applied Mechanics, 1955.
    .. [2] Craig, "Introduction to Robotics: Mechanics and Control", 1986.

    Examples
    --------
    >>> from adaptctl.description import read_denavit_hartenberg
    >>> file = tmp / "pendulum.toml"
    >>> _ = file.write_text('''schema = "adaptctl/denavit-hartenberg/1"
    ... convention = "standard"
    ... [[links]]
    ... a = 0.5
    ... alpha_deg = 0
    ... ''')
    >>> read_denavit_hartenberg(file)
    <Description 'pendulum': 1 links>
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
    alpha = _angle("alpha", step.alpha, step.alpha_deg)
    if alpha is None:
        raise InputError("alpha is missing; give alpha (rad) or alpha_deg")
    theta = _angle("theta", step.theta, step.theta_deg) or 0.0
    twist = Pose(rotation_about(X, alpha), np.array([step.a, 0.0, 0.0]))
    turn, shift = Pose(rotation_about(Z, theta), np.zeros(3)), Pose(np.eye(3), np.array([0.0, 0.0, step.d]))
    return (turn, shift @ twist) if standard else (twist @ turn @ shift, Pose.identity())


def _angle(name: str, radians: float | None, degrees: float | None) -> float | None:
    if radians is not None and degrees is not None:
        raise InputError(f"{name} is given twice; give either {name} (rad) or {name}_deg")
    return math.radians(degrees) if degrees is not None else radians
