"""Reachable space of a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.errors import SimplificationWarning, warn


@dataclass(frozen=True, eq=False)
class ReachableSpace:
    """Joint positions at which link frames are within a box (m in the ground frame) and links do not collide."""

    mechanism: Mechanism
    lower: Array
    upper: Array
    collides: Callable[[Array], bool] | None

    def allows(self, p: Array) -> bool:
        """True if all of n positions (n, r) are within the box and free of collisions."""
        places = link_poses(self.mechanism, p).translations
        if np.any(places < self.lower) or np.any(places > self.upper):
            return False
        return self.collides is None or not any(self.collides(q) for q in p)


def workspace(
    mechanism: Mechanism, robot: str | Path, lower: Array | None = None, upper: Array | None = None
) -> ReachableSpace:
    """Reachable space by a box and the collision geometry of a URDF file."""
    box = (np.full(3, -np.inf) if lower is None else lower, np.full(3, np.inf) if upper is None else upper)
    return ReachableSpace(mechanism, *box, _self_collision(mechanism, robot))


def _self_collision(mechanism: Mechanism, robot: str | Path) -> Callable[[Array], bool] | None:
    path = Path(robot)
    if path.suffix.lower() != ".urdf" or not path.exists() or mechanism.description.loops is not None:
        return None
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(path))
    try:
        geometry = pinocchio.buildGeomFromUrdf(
            model, str(path), pinocchio.GeometryType.COLLISION, package_dirs=_folders(path)
        )
    except (ValueError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[-1] if str(error).strip() else type(error).__name__
        warn(f"{path}: self-collision is not checked ({reason})", SimplificationWarning)
        return None
    names = [joint.name for joint in mechanism.primary_joints]
    if geometry.ngeoms == 0 or any(joint.nq != 1 for joint in list(model.joints)[1:]):
        return None
    return _checked(model, geometry, [model.idx_qs[model.getJointId(name)] for name in names], mechanism)


def _folders(path: Path) -> list[str]:
    return [str(folder) for folder in path.resolve().parents[:4]]


def _checked(model: Any, geometry: Any, places: list[int], mechanism: Mechanism) -> Callable[[Array], bool]:
    import pinocchio

    geometry.addAllCollisionPairs()
    data, found = model.createData(), pinocchio.GeometryData(geometry)

    def collisions(p: Array, stop: bool) -> bool:
        q = pinocchio.neutral(model)
        q[places] = p
        return bool(pinocchio.computeCollisions(model, data, geometry, found, q, stop))

    collisions(_middle(mechanism), False)
    touching = [
        pair
        for pair, result in zip(geometry.collisionPairs, found.collisionResults, strict=True)
        if result.isCollision()
    ]
    for pair in [pinocchio.CollisionPair(pair.first, pair.second) for pair in touching]:
        geometry.removeCollisionPair(pair)
    found = pinocchio.GeometryData(geometry)
    return lambda p: collisions(p, True)


def _middle(mechanism: Mechanism) -> Array:
    bounds = np.array([[joint.limits.lower, joint.limits.upper] for joint in mechanism.primary_joints])
    bounds[~np.isfinite(bounds).all(axis=1)] = 0.0
    return np.asarray(bounds.mean(axis=1))
