"""Frames of a mechanism that have names of their own: a tool, a camera, a link that is fixed to another."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from adaptctl.description.pose import Pose


class FrameKind(Enum):
    """The kind of a named frame, as Pinocchio's frame types are: operational (such as a tool), a fixed joint, a body
    that is fixed to a link, or a sensor."""

    OPERATIONAL = "operational"
    FIXED_JOINT = "fixed joint"
    BODY = "body"
    SENSOR = "sensor"


@dataclass(frozen=True)
class NamedFrame:
    """A frame with a `name`, such as a tool's, fixed to the link of zero-based index `link`, or to the ground, -1, at
    `pose` in that link's frame (m). `kind` is operational by default; no motion depends on it. Nothing is checked at
    construction."""

    name: str
    link: int
    pose: Pose
    kind: FrameKind = FrameKind.OPERATIONAL
