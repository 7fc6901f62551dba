"""Checks of robots that strangers describe: how many parts, masses that can be, and angles that may be degrees."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from adaptctl.description.description import Link, weightless_ends
from adaptctl.errors import InputError, SimplificationWarning, nearest_name, printable

if TYPE_CHECKING:
    from adaptctl.description.loops import Loops

MOST_LINKS = 256
"""Links that move, in one file: regressors of more take minutes."""
MOST_BODIES, MOST_GEOMS = 2_000, 5_000
"""Bodies in one file, those that are fixed to others counted, and geoms."""
LEAST_DEGREES, MOST_DEGREES = 6.0 * math.pi, 3600.0
"""Limits (rad) between these may be degrees: few joints turn thrice, and limits far beyond stand for none."""
MOST_NAMED = 20
"""names that a message lists"""
A_TURN = 2.02 * math.pi
"""Angle (rad) that no frame needs to be turned by."""


def require_at_most(count: int, most: int, what: str) -> None:
    """Raise `InputError` if `count` is above `most`, the greatest number of parts of one kind that a robot's file may
    have; `what` names the parts in the message, as in "links that move"."""
    if count > most:
        raise InputError(f"{count} {what}: at most {most} are read")


def require_mass_of_inertia(link: Link) -> Link:
    """The `link` itself, unchanged. Raises `InputError` where its mass is zero, but its first moment or inertia tensor
    is not."""
    if link.inertia[0] == 0.0 and np.any(link.inertia):
        raise InputError(f"link {link.name!r}: inertia without mass: give the mass that has it, or leave both out")
    return link


def warn_of_weightless(path: Any, links: Sequence[Link], loops: Loops | None, stacklevel: int = 3) -> None:
    """Warn, by a `SimplificationWarning` that names them, of links of a file at `path` that move without inertia or
    rotor and whose descendants have neither. There is no warning where the mechanism has `loops`, or where no link of
    the file has inertia. `stacklevel` is that of `warnings.warn`, 3 by default, the caller's caller."""
    if loops is None and any(np.any(link.inertia) for link in links) and (names := weightless_ends(links)):
        text = "links move without mass and carry none, so that no torque says how they accelerate"
        warnings.warn(f"{path}: {text}: {', '.join(names)}", SimplificationWarning, stacklevel=stacklevel)


def unknown_body(name: str, known: Sequence[str]) -> str:
    """The text of a message that a scene has no body of this `name`: it has the nearest of the `known` names, and the
    nonempty ones among the first 20. Nothing is raised."""
    guess = nearest_name(name, known)
    listed = ", ".join(repr(other) for other in known[:MOST_NAMED] if other)
    return f"there is no body {printable(name)!r}{guess}; there are {listed}{', ...' * (len(known) > MOST_NAMED)}"


def is_more_than_a_turn(angles: Iterable[float] | float | None) -> bool:
    """True where one of the `angles` of a frame, one or several numbers in rad, is above 2.02 pi in size, so that
    degrees may be meant; False for no angles, None. Nothing is raised."""
    given = (angles,) if isinstance(angles, int | float) else angles or ()
    return any(abs(angle) > A_TURN for angle in given)


def warn_of_degrees(path: Any, links: Sequence[Link], frames: Sequence[str], stacklevel: int = 3) -> None:
    """Warn, by a `SimplificationWarning` that names them, of angles in a file at `path` that are read as rad but look
    like degrees. These are position limits of `links`' turning joints above 6 pi and up to 3600 rad in size, and angles
    of `frames`, names of elements in which the caller found such angles. `stacklevel` is that of `warnings.warn`, 3 by
    default, the caller's caller."""
    joints = [f"limits of {link.joint.name}" for link in links if _may_be_degrees(link)]
    if names := [*joints, *frames]:
        text = "angles are read as radians, and these look like degrees"
        warnings.warn(f"{path}: {text}: {', '.join(names)}", SimplificationWarning, stacklevel=stacklevel)


def _may_be_degrees(link: Link) -> bool:
    bounds = (link.joint.limits.lower, link.joint.limits.upper)
    return link.joint.kind.turns and any(LEAST_DEGREES < abs(bound) <= MOST_DEGREES for bound in bounds)
