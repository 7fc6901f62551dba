"""What moves, as data: links, joints, parameters and their names, and the readers of files."""

from typing import TYPE_CHECKING

from adaptctl.lazily import imported_lazily

if TYPE_CHECKING:
    from adaptctl.mechanism.denavit_hartenberg import read_denavit_hartenberg as read_denavit_hartenberg
    from adaptctl.mechanism.description import GROUND as GROUND
    from adaptctl.mechanism.description import Description as Description
    from adaptctl.mechanism.description import Joint as Joint
    from adaptctl.mechanism.description import JointKind as JointKind
    from adaptctl.mechanism.description import Limits as Limits
    from adaptctl.mechanism.description import Link as Link
    from adaptctl.mechanism.description import depth_first as depth_first
    from adaptctl.mechanism.floating_base import with_floating_base as with_floating_base
    from adaptctl.mechanism.loops import Closure as Closure
    from adaptctl.mechanism.loops import ClosureKind as ClosureKind
    from adaptctl.mechanism.loops import Condition as Condition
    from adaptctl.mechanism.loops import Coupling as Coupling
    from adaptctl.mechanism.loops import Loops as Loops
    from adaptctl.mechanism.mechanism_file import read_mechanism_file as read_mechanism_file
    from adaptctl.mechanism.mjcf import read_mjcf as read_mjcf
    from adaptctl.mechanism.pinocchio_constraints import to_pinocchio_constraints as to_pinocchio_constraints
    from adaptctl.mechanism.pinocchio_model import from_pinocchio as from_pinocchio
    from adaptctl.mechanism.pinocchio_model import to_pinocchio as to_pinocchio
    from adaptctl.mechanism.pose import Pose as Pose
    from adaptctl.mechanism.snapping import snapped as snapped
    from adaptctl.mechanism.sources import builtin_names as builtin_names
    from adaptctl.mechanism.sources import read as read
    from adaptctl.mechanism.urdf import read_urdf as read_urdf
else:
    _HOMES = {
        "denavit_hartenberg": "read_denavit_hartenberg",
        "description": "GROUND Description Joint JointKind Limits Link depth_first",
        "floating_base": "with_floating_base",
        "loops": "Closure ClosureKind Condition Coupling Loops",
        "mechanism_file": "read_mechanism_file",
        "mjcf": "read_mjcf",
        "pinocchio_constraints": "to_pinocchio_constraints",
        "pinocchio_model": "from_pinocchio to_pinocchio",
        "pose": "Pose",
        "snapping": "snapped",
        "sources": "builtin_names read",
        "urdf": "read_urdf",
    }
    __all__, __getattr__, __dir__ = imported_lazily(__name__, _HOMES)
