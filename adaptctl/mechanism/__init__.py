"""What moves, as data: links, joints, parameters and their names, and the readers of files."""

from adaptctl.mechanism.denavit_hartenberg import read_denavit_hartenberg
from adaptctl.mechanism.description import GROUND, Description, Joint, JointKind, Limits, Link, depth_first
from adaptctl.mechanism.pose import Pose
from adaptctl.mechanism.sources import builtin_names, read

__all__ = [
    "GROUND",
    "Description",
    "Joint",
    "JointKind",
    "Limits",
    "Link",
    "Pose",
    "builtin_names",
    "depth_first",
    "read",
    "read_denavit_hartenberg",
]
