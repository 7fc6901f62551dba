"""What moves, as data: links, joints, parameters and their names, and the readers of files."""

from typing import TYPE_CHECKING, Any

from adaptctl.mechanism.denavit_hartenberg import read_denavit_hartenberg
from adaptctl.mechanism.description import GROUND, Description, Joint, JointKind, Limits, Link, depth_first
from adaptctl.mechanism.floating_base import with_floating_base
from adaptctl.mechanism.loops import Closure, ClosureKind, Condition, Coupling, Loops
from adaptctl.mechanism.mechanism_file import read_mechanism_file
from adaptctl.mechanism.mjcf import read_mjcf
from adaptctl.mechanism.pose import Pose
from adaptctl.mechanism.snapping import snapped
from adaptctl.mechanism.sources import builtin_names, read
from adaptctl.mechanism.urdf import read_urdf

if TYPE_CHECKING:
    from adaptctl.mechanism.pinocchio_constraints import to_pinocchio_constraints
    from adaptctl.mechanism.pinocchio_model import from_pinocchio, to_pinocchio

__all__ = [
    "GROUND",
    "Closure",
    "ClosureKind",
    "Condition",
    "Coupling",
    "Description",
    "Joint",
    "JointKind",
    "Limits",
    "Link",
    "Loops",
    "Pose",
    "builtin_names",
    "depth_first",
    "from_pinocchio",
    "read",
    "read_denavit_hartenberg",
    "read_mechanism_file",
    "read_mjcf",
    "read_urdf",
    "snapped",
    "to_pinocchio",
    "to_pinocchio_constraints",
    "with_floating_base",
]


def __getattr__(name: str) -> Any:
    """Pinocchio is imported when it is first asked for."""
    if name in {"from_pinocchio", "to_pinocchio"}:
        from adaptctl.mechanism import pinocchio_model

        return getattr(pinocchio_model, name)
    if name == "to_pinocchio_constraints":
        from adaptctl.mechanism.pinocchio_constraints import to_pinocchio_constraints

        return to_pinocchio_constraints
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
