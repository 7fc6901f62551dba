"""Places on links by the names of links and of frames, such as `tool0`."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from adaptctl.arrays import Array
from adaptctl.description.description import Description
from adaptctl.description.link import GROUND
from adaptctl.description.pose import Pose
from adaptctl.errors import NotFoundError


class PlaceOnLink(NamedTuple):
    """Link, and the pose of a frame on it."""

    link: str
    pose: Pose


class ToolPoint(NamedTuple):
    """Link's place in the list and name, and a point (3,) in its frame in m."""

    place: int
    link: str
    point: Array


def tool_point(description: Description, link: str | None, point: Array, what: str) -> ToolPoint:
    """Point of a link, of the last one, or of a frame such as `tool0` on the link that carries it."""
    names = [one.name for one in description.links]
    if link is None:
        return ToolPoint(len(names) - 1, names[-1], point)
    carrier, pose = place_on_link(description, link, what)
    moved = point if carrier == link else pose.rotation @ point + pose.translation
    return ToolPoint(names.index(carrier), carrier, moved)


def place_on_link(description: Description, name: str, what: str, links: Collection[str] | None = None) -> PlaceOnLink:
    """Place of a link or frame on one of the links that move (of some, if given)."""
    names = [link.name for link in description.links]
    allowed = names if links is None else links
    if name in allowed:
        return PlaceOnLink(name, Pose.identity())
    for frame in description.frames:
        if frame.name == name and frame.link != GROUND and names[frame.link] in allowed:
            return PlaceOnLink(names[frame.link], frame.pose)
    still = [frame.name for frame in description.frames if frame.link == GROUND]
    if name in still:
        raise NotFoundError(f"{what}: link {name!r} does not move; links: {', '.join(allowed)}")
    moving = [frame.name for frame in description.frames if frame.name not in (*still, *allowed)]
    raise NotFoundError(f"{what}: unknown link {name!r}; links: {', '.join((*allowed, *moving))}")
