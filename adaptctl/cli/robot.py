"""Flags of commands that read a robot, and what they say of its rounded angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from adaptctl.errors import AdaptctlError, InputError, RoundedAnglesWarning, SimplificationWarning, warn
from adaptctl.stages import stage

if TYPE_CHECKING:
    from adaptctl.description import Description
    from adaptctl.dynamics import Mechanism

MAX_RANKED = 600
"""parameters of a robot whose two ranks a note has"""


@Parameter(name="*")
@dataclass(frozen=True)
class RobotFlags:
    """Choices in reading a robot, the same in every command."""

    floating_base: Annotated[
        bool, Parameter(help="Let the base float, pushed by ideal forces, instead of holding it.")
    ] = False
    root: Annotated[
        str | None, Parameter(metavar="BODY", help="First body of the robot, in an MJCF scene with several.")
    ] = None
    as_written: Annotated[
        bool, Parameter(help="Take angles and lengths as written, where rounding may have made them.")
    ] = False

    gravity: Annotated[
        tuple[float, float, float] | None,
        Parameter(metavar="X Y Z", help="Gravity in the frame of the base, m/s^2, for a tilted mount."),
    ] = None
    lock: Annotated[
        tuple[str, ...],
        Parameter(metavar="JOINT[=VALUE]", help="Joints to hold fast, at VALUE in rad or m, or at 0."),
    ] = ()

    def load(self, robot: str) -> Mechanism:
        """Robot of a name or file."""
        from adaptctl.dynamics import load

        choices = {name: getattr(self, name) for name in ("floating_base", "root", "as_written", "gravity")}
        with stage("reading the robot"):
            found = load(robot, **choices, lock=self.lock)
        if not found.inertial_parameters[: found.num_energy_parameters].any():
            text = "no link has an inertia: base parameters follow from the geometry alone, all else needs inertias"
            warn(f"{robot}: {text}", SimplificationWarning)
        return found


AS_USUAL = RobotFlags()


def validate_posture_flag(flag: str, arm: Mechanism, places: Sequence[float]) -> None:
    """Raise `InputError` for a posture of another number of joints, or beyond their ranges."""
    names = [joint.name for joint in arm.primary_joints]
    if len(places) != len(names):
        given = f"{len(places)} position{'s are' if len(places) > 1 else ' is'} given"
        raise InputError(f"{flag}: {arm.name} has {len(names)} joints ({', '.join(names)}), but {given}")
    for joint, place in zip(arm.primary_joints, places, strict=True):
        if not joint.limits.lower <= place <= joint.limits.upper:
            ends = f"{joint.limits.lower:g} to {joint.limits.upper:g}"
            raise InputError(f"{flag}: joint {joint.name!r} at {place:g} is outside its range, {ends}")


def note_on(warning: Warning | str) -> str:
    """Text of a warning, with the two ranks and the flag where angles are rounded."""
    if not isinstance(warning, RoundedAnglesWarning):
        return str(warning)
    meant, written = _rank(warning.after), _rank(warning.before)
    if meant is None or written is None or meant == written:
        return f"{warning.finding}; --as-written keeps them"
    return f"{warning.finding}: rank {meant}; --as-written for {written}"


def _rank(description: Description) -> int | None:
    """Exact rank of a tree; None for loops, which take long."""
    from adaptctl.dynamics import Mechanism
    from adaptctl.identifiability.proof.exact_energies import ExactEnergies

    if description.loops is not None or description.num_energy_parameters > MAX_RANKED:
        return None
    try:
        return ExactEnergies(Mechanism(description), strict=True).rank
    except (AdaptctlError, ArithmeticError):
        return None
