"""Frames of a mechanism that have names of their own: a tool, a camera, a link that is fixed to another."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from adaptctl.description.pose import Pose


class FrameKind(Enum):
    """The kind of a named frame, as Pinocchio has it."""

    OPERATIONAL = "operational"
    FIXED_JOINT = "fixed joint"
    BODY = "body"
    SENSOR = "sensor"


@dataclass(frozen=True)
class NamedFrame:
    """A frame that is fixed to a link (GROUND for none), at a pose in the link's frame. No motion depends on it."""

    name: str
    link: int
    pose: Pose
    kind: FrameKind = FrameKind.OPERATIONAL
