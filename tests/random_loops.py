"""Random mechanisms with loops: any tree closed anywhere, spatial or planar, with gears; closed where they stand.

The closures' residual is written again here, by poses alone, so that it can judge the one under test.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from random_trees import random_inertia, random_link, random_tree
from scipy.linalg import qr

from adaptctl.arrays import Array
from adaptctl.description import (
    GROUND,
    Closure,
    ClosureKind,
    Coupling,
    Description,
    Joint,
    JointKind,
    Link,
    Loops,
    Pose,
    depth_first,
)
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism


def world_poses(description: Description, q: Array) -> dict[str | None, Pose]:
    """Every link's pose in the world; the ground's under None."""
    poses: dict[str | None, Pose] = {None: Pose.identity()}
    for link, x in zip(description.links, q, strict=True):
        parent = None if link.parent == GROUND else description.links[link.parent].name
        axis = link.joint.axis
        turn = link.joint.kind.turns
        moved = Pose(rotation_about(axis, x), np.zeros(3)) if turn else Pose(np.eye(3), x * axis)
        poses[link.name] = poses[parent] @ link.near @ moved @ link.far
    return poses


def gaps(description: Description, q: Array) -> Array:
    """What separates closed frames, and coupled joints: zeros where the mechanism is closed."""
    assert description.loops is not None
    poses, out = world_poses(description, q), []
    for closure in description.loops.closures:
        first, second = poses[closure.first] @ closure.first_frame, poses[closure.second] @ closure.second_frame
        between = first.inverse @ second
        out += list(between.translation)
        if closure.kind is ClosureKind.AXIS:
            out += list(between.rotation[:2, 2])
        if closure.kind is ClosureKind.WELD:
            out += list((between.rotation - between.rotation.T)[[2, 0, 1], [1, 2, 0]] / 2.0)
    names = description.joint_names
    for c in description.loops.couplings:
        out.append(q[names.index(c.follower)] - c.ratio * q[names.index(c.leader)] - c.offset)
    return np.array(out)


def gap_rates(description: Description, q: Array, h: float = 1e-6) -> Array:
    """The gaps' Jacobian (rows, n) by central differences."""
    steps = h * np.eye(len(q))
    return np.array([(gaps(description, q + s) - gaps(description, q - s)) / (2.0 * h) for s in steps]).T


@dataclass(frozen=True)
class Recipe:
    """What to close: how many links, which closures, how many gears."""

    links: int
    closures: tuple[ClosureKind, ...]
    gears: int = 0
    planar: bool = False


POINT, AXIS, WELD = ClosureKind.POINT, ClosureKind.AXIS, ClosureKind.WELD
RECIPES = {
    "four-bar": Recipe(3, (POINT,), planar=True),
    "five-bar": Recipe(4, (POINT,), planar=True),
    "planar weld": Recipe(6, (WELD,), planar=True),
    "two planar loops": Recipe(7, (POINT, POINT), planar=True),
    "spatial point": Recipe(6, (POINT,)),
    "spatial hinge": Recipe(8, (AXIS,)),
    "spatial weld": Recipe(9, (WELD,)),
    "two spatial loops": Recipe(9, (POINT, POINT)),
    "gears alone": Recipe(5, (), gears=2),
    "gears in a loop": Recipe(8, (POINT,), gears=2),
}


def random_loop(seed: int, recipe: Recipe) -> tuple[Mechanism, Array]:
    """A mechanism and a closed configuration of it, well away from singularity."""
    rng = np.random.default_rng(seed)
    for _ in range(1000):
        found = _attempt(rng, recipe)
        if found is not None:
            return found
    raise AssertionError("no mechanism of this kind was found")


def _attempt(rng: np.random.Generator, recipe: Recipe) -> tuple[Mechanism, Array] | None:
    size = int(rng.integers(2**32))
    tree = planar_tree(rng, recipe.links) if recipe.planar else random_tree(size, recipe.links).description
    q = rng.uniform(-1.0, 1.0, recipe.links)
    closures = tuple(_closure(rng, tree, q, i, kind) for i, kind in enumerate(recipe.closures))
    if len({frozenset((c.first, c.second)) for c in closures}) < len(closures):
        return None
    couplings = _couplings(rng, tree, q, recipe.gears)
    primary = tree.joint_names[:1]
    if any(c.follower in primary for c in couplings):
        return None
    looped = replace(tree, loops=Loops(primary, closures, couplings))
    chosen = _primary(looped, q)
    if chosen is None or any(c.follower in chosen for c in couplings):
        return None
    reference = dict(zip(tree.joint_names, q.tolist(), strict=True))
    return Mechanism(replace(tree, loops=Loops(chosen, closures, couplings, reference))), q


def two_arms(seed: int, kind: ClosureKind) -> Mechanism:
    """Two spatial arms of four joints whose hands are closed onto each other as they stand."""
    rng = np.random.default_rng(seed)
    for _ in range(100):
        links = tuple(random_link(rng, i, -1 if i == 4 else i - 1) for i in range(8))
        tree, q = Description("arms", links), rng.uniform(-1.0, 1.0, 8)
        poses = world_poses(tree, q)
        closure = Closure("hands", "link3", "link7", Pose.identity(), poses["link7"].inverse @ poses["link3"], kind)
        chosen = _primary(replace(tree, loops=Loops(tree.joint_names[:1], (closure,))), q)
        if chosen is not None:
            reference = dict(zip(tree.joint_names, q.tolist(), strict=True))
            return Mechanism(replace(tree, loops=Loops(chosen, (closure,), (), reference)))
    raise AssertionError("no arms were found")


def planar_tree(rng: np.random.Generator, links: int) -> Description:
    """Revolute joints about z and prismatic ones across it: whatever closes stays in the plane."""
    chain = []
    for i in range(links):
        kind = JointKind.PRISMATIC if rng.random() < 0.25 else JointKind.REVOLUTE
        angle = rng.uniform(-3.0, 3.0)
        axis = (np.cos(angle), np.sin(angle), 0.0) if kind is JointKind.PRISMATIC else (0.0, 0.0, 1.0)
        near = Pose(rotation_about((0, 0, 1), rng.uniform(-3, 3)), np.append(rng.uniform(-0.5, 0.5, 2), 0.0))
        parent = int(rng.integers(GROUND, i)) if i else GROUND
        chain.append(
            Link(f"link{i}", parent, Joint(f"joint{i}", kind, np.array(axis)), near, near, random_inertia(rng))
        )
    return Description("planar", depth_first(chain), rng.normal(size=3))


def _closure(rng: np.random.Generator, tree: Description, q: Array, number: int, kind: ClosureKind) -> Closure:
    """Two links, or one and the ground, closed as they stand; in a plane, at a place in the plane."""
    names = [None, *(link.name for link in tree.links)]
    first, second = (names[i] for i in rng.choice(len(names), 2, replace=False))
    planar = tree.name == "planar"
    turn = rotation_about((0, 0, 1), rng.uniform(-3, 3))
    if not planar:
        turn = turn @ rotation_about((1, 0, 0), rng.uniform(-3, 3))
    at = rng.uniform(-0.5, 0.5, 3) * (1.0, 1.0, 0.0 if planar else 1.0)
    frame, poses = Pose(turn, at), world_poses(tree, q)
    return Closure(f"loop{number}", first, second, frame, poses[second].inverse @ poses[first] @ frame, kind)


def _couplings(rng: np.random.Generator, tree: Description, q: Array, count: int) -> tuple[Coupling, ...]:
    """Followers and leaders apart, so that no joint follows a follower."""
    order = [int(i) for i in rng.permutation(len(tree.links))]
    names, out = tree.joint_names, []
    for i in range(count):
        follower, leader = order[i], order[count + int(rng.integers(len(order) - count))]
        ratio = float(rng.uniform(0.5, 2.0) * rng.choice([-1.0, 1.0]))
        offset = float(q[follower] - ratio * q[leader])
        out.append(Coupling(f"gear{i}", names[follower], names[leader], ratio, offset))
    return tuple(out)


def _primary(description: Description, q: Array) -> tuple[str, ...] | None:
    """Joints that determine the others well, or None where the closures lock it, add nothing or stand singular."""
    assert description.loops is not None
    J = gap_rates(description, q)
    values = np.linalg.svd(J, compute_uv=False)
    rank = int((values > 1e-6).sum())
    before = 0
    ends = np.cumsum([c.kind.rows for c in description.loops.closures] + [1] * len(description.loops.couplings))
    for end in ends:
        now = int((np.linalg.svd(J[:end], compute_uv=False) > 1e-6).sum())
        if now == before:
            return None
        before = now
    if not 0 < rank < len(q) or values[rank - 1] < 0.1:
        return None
    _, _, order = qr(J, mode="economic", pivoting=True)
    block = np.linalg.svd(J[:, order[:rank]], compute_uv=False)
    if block[-1] < 0.1:
        return None
    return tuple(description.joint_names[i] for i in sorted(order[rank:]))
