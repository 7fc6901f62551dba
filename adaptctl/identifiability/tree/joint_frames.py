"""Joint frames of a tree as 4x4 matrices: each joint's pose in its parent joint's frame, and its twist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import GROUND
from adaptctl.dynamics import Mechanism
from adaptctl.identifiability.sampling import characteristic_length


def twist_matrices(twists: Array) -> Array:
    """The matrices (..., 4, 4) of `twists` (..., 6): the cross-product matrix of the angular velocity in the upper
    left, the linear velocity in the last column, zeros below. Each twist is an angular velocity (3,), rad/s, and the
    velocity (3,) of the frame's origin, m/s or another unit of length per s, both along the moving frame's own axes. A
    frame of pose T (4, 4) that moves with the twist of matrix X has the rate T X. Nothing is checked."""
    out = np.zeros((*twists.shape[:-1], 4, 4))
    x, y, z = np.moveaxis(twists[..., :3], -1, 0)
    out[..., 2, 1], out[..., 0, 2], out[..., 1, 0] = x, y, z
    out[..., 1, 2], out[..., 2, 0], out[..., 0, 1] = -x, -y, -z
    out[..., :3, 3] = twists[..., 3:]
    return out


def twist_entries(matrices: Array) -> Array:
    """The twists (..., 6) of their `matrices` (..., 4, 4), the inverse of `twist_matrices`: each is an angular velocity
    (3,), rad/s, and the velocity (3,) of the frame's origin, m/s or another unit of length per s, both along the moving
    frame's own axes. Nothing is checked."""
    turn = [matrices[..., 2, 1], matrices[..., 0, 2], matrices[..., 1, 0]]
    return np.stack([*turn, *np.moveaxis(matrices[..., :3, 3], -1, 0)], axis=-1)


@dataclass(frozen=True, eq=False)
class JointFrames:
    """The frames of the N joints of a tree, each moving with its link so that its own joint's twist is constant in it;
    lengths are in units of `length` L in m.

    `parents` (N,) are the parent links' zero-based indices, -1 for the ground; `near` (N, 4, 4) the poses of the
    joints' frames, at joint position zero, in the frames of their parents' joints (in the world for joints on the
    ground); `far` (N, 4, 4) the poses of the links' frames in their joints'; `twists` (N, 6) are the joints' twists,
    angular then linear, along the axes of their own frames, per unit of their positions (rad, or L for a prismatic
    joint); `gravity` (3,) is the unit vector along gravity in the world, zero where there is none. Made by `of`;
    nothing is checked at construction.
    """

    length: float
    parents: tuple[int, ...]
    near: Array
    """Poses (N, 4, 4) of joint frames in their parents' joint frames, at zero; in the world for those on the ground."""
    far: Array
    """Poses (N, 4, 4) of link frames in their joints' frames."""
    twists: Array
    """Twists S (N, 6) of the joints' frames per unit of their coordinates."""
    gravity: Array
    """Direction (3,) of gravity; zero where there is none."""

    @property
    def rotor_scales(self) -> Array:
        """The scales (N,) of the N joints' rotor inertias, with the unit of length L (m) that this object's `length`
        is: L^2, in m^2, where a joint turns, 1 where it slides. Rotor inertias divided by these are in kg."""
        return np.where(self.twists[:, :3].any(axis=1), self.length**2, 1.0)

    @classmethod
    def of(cls, mechanism: Mechanism) -> JointFrames:
        """The joint frames of a mechanism's tree, with lengths in units of its characteristic length (the largest
        distance from a joint to the next or to its link's frame, 1 m where there is none). Loop closures are left out.
        Nothing is checked."""
        links, length = mechanism.links, characteristic_length(mechanism)
        on_parent = _matrices([(k.near.rotation, k.near.translation) for k in links], length)
        far = _matrices([(k.far.rotation, k.far.translation) for k in links], length)
        hangs = np.array([k.parent != GROUND for k in links])
        parents = np.array([k.parent for k in links])
        near = np.where(hangs[:, None, None], far[parents], np.eye(4)) @ on_parent
        turns = np.array([k.joint.kind.turns for k in links])[:, None]
        axes = np.array([k.joint.axis for k in links])
        twists = np.hstack([np.where(turns, axes, 0.0), np.where(turns, 0.0, axes)])
        gravity = mechanism.description.gravity
        strength = float(np.linalg.norm(gravity)) or 1.0
        return cls(length, tuple(k.parent for k in links), near, far, twists, gravity / strength)


def _matrices(poses: list[tuple[Array, Array]], length: float) -> Array:
    out = np.tile(np.eye(4), (len(poses), 1, 1))
    out[:, :3, :3] = [rotation for rotation, _ in poses]
    out[:, :3, 3] = [translation / length for _, translation in poses]
    return out
