"""What moves, as data: links, joints, parameters and their names, and the readers of files."""

from adaptctl.mechanism.description import GROUND, Description, Joint, JointKind, Limits, Link, depth_first
from adaptctl.mechanism.pose import Pose

__all__ = ["GROUND", "Description", "Joint", "JointKind", "Limits", "Link", "Pose", "depth_first"]
