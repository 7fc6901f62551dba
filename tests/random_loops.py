"""Random mechanisms with loops: any tree closed anywhere, spatial or planar, with gears; closed where they stand.

The closures' residual is written again here, by poses alone, so that it can judge the one under test.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from random_trees import random_inertia, random_link
from scipy.linalg import qr

from adaptctl.arrays import Array, frozen
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
from adaptctl.dynamics.loop_equations import LoopEquations


def world_poses(description: Description, q: Array) -> dict[str | None, Pose]:
    """Every link's pose in the world; the ground's under None."""
    poses: dict[str | None, Pose] = {None: Pose.identity()}
    for link, x in zip(description.links, q, strict=True):
        parent = None if link.parent == GROUND else description.links[link.parent].name
        axis = link.joint.axis
        turn = link.joint.kind.is_revolute
        moved = Pose(rotation_about(axis, x), np.zeros(3)) if turn else Pose(np.eye(3), x * axis)
        poses[link.name] = poses[parent] @ link.parent_to_joint @ moved @ link.joint_to_link
    return poses


def homogeneous(pose: Pose) -> Array:
    """The matrix (4, 4) of a pose."""
    return np.block([[pose.rotation, pose.translation[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


def motion(joint: Joint, x: Array) -> Array:
    """Matrices (..., 4, 4) of a joint's motions by x (...), a rotation's by Rodrigues' formula."""
    moved = np.zeros((*x.shape, 4, 4)) + np.eye(4)
    if joint.kind.is_revolute:
        across = np.cross(joint.axis, np.eye(3)).T
        moved[..., :3, :3] += np.multiply.outer(np.sin(x), across) + np.multiply.outer(1.0 - np.cos(x), across @ across)
    else:
        moved[..., :3, 3] = np.multiply.outer(x, joint.axis)
    return moved


def world_matrices(description: Description, q: Array) -> dict[str | None, Array]:
    """Every link's pose in the world as a matrix (..., 4, 4), of many configurations (..., n)."""
    poses: dict[str | None, Array] = {None: np.eye(4)}
    for link, x in zip(description.links, np.moveaxis(q, -1, 0), strict=True):
        parent = None if link.parent == GROUND else description.links[link.parent].name
        poses[link.name] = (
            poses[parent] @ homogeneous(link.parent_to_joint) @ motion(link.joint, x) @ homogeneous(link.joint_to_link)
        )
    return poses


def gaps(description: Description, q: Array) -> Array:
    """What separates closed frames, and coupled joints, of configurations (..., n): zeros where they are closed."""
    assert description.loops is not None
    poses, out = world_matrices(description, q), []
    for closure in description.loops.closures:
        first = poses[closure.first] @ homogeneous(closure.first_frame)
        second = poses[closure.second] @ homogeneous(closure.second_frame)
        into = np.swapaxes(first[..., :3, :3], -1, -2)
        rotation = into @ second[..., :3, :3]
        out += list(np.moveaxis((into @ (second - first)[..., :3, 3:])[..., 0], -1, 0))
        if closure.kind is ClosureKind.AXIS:
            out += [rotation[..., 0, 2], rotation[..., 1, 2]]
        if closure.kind is ClosureKind.WELD:
            out += [(rotation[..., i, j] - rotation[..., j, i]) / 2.0 for i, j in ((2, 1), (0, 2), (1, 0))]
    names = description.joint_names
    for c in description.loops.couplings:
        out.append(q[..., names.index(c.follower)] - c.ratio * q[..., names.index(c.leader)] - c.offset)
    return np.stack(out, axis=-1)


def gap_rates(description: Description, q: Array, h: float = 1e-6) -> Array:
    """The gaps' Jacobian (rows, n) by central differences."""
    steps = h * np.eye(len(q))
    return np.asarray((gaps(description, q + steps) - gaps(description, q - steps)).T / (2.0 * h))


@dataclass(frozen=True)
class Recipe:
    """What to close: how many links, which closures, how many gears."""

    links: int
    closures: tuple[ClosureKind, ...]
    gears: int = 0
    planar: bool = False


PLANAR_ROWS = {ClosureKind.POINT: 2, ClosureKind.AXIS: 2, ClosureKind.WELD: 3}
"""Of a closure's rows, those that a planar mechanism can break."""

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


@cache
def random_loop(seed: int, recipe: Recipe) -> tuple[Mechanism, Array]:
    """A mechanism of which every loop moves, and a closed configuration of it, well away from singularity; always the
    same one, with what it has compiled."""
    rng = np.random.default_rng(seed)
    for _ in range(10_000):
        shape = _shape(rng, recipe)
        found = None if shape is None else _attempt(rng, recipe, shape)
        if found is not None:
            return found[0], frozen(found[1])
    raise AssertionError("no mechanism of this kind was found")


@dataclass(frozen=True)
class Shape:
    """Which link hangs on which, each on the ground or on any link before; which two each closure holds together."""

    parents: list[int]
    ends: list[tuple[int, int]]

    @property
    def loops(self) -> list[list[str]]:
        """The joints of each loop."""
        ways = [[set(self._way(end)) for end in ends] for ends in self.ends]
        return [[f"joint{i}" for i in first ^ second] for first, second in ways]

    def _way(self, link: int) -> Iterator[int]:
        while link != GROUND:
            yield link
            link = self.parents[link]


def _shape(rng: np.random.Generator, recipe: Recipe) -> Shape | None:
    """None where a loop has too few joints to move, or two closures hold the same links together."""
    parents = [int(rng.integers(GROUND, i)) for i in range(recipe.links)]
    places = range(GROUND, recipe.links)
    shape = Shape(parents, [tuple(rng.choice(places, 2, replace=False).tolist()) for _ in recipe.closures])
    rows = [PLANAR_ROWS[kind] if recipe.planar else kind.rows for kind in recipe.closures]
    short = any(len(loop) <= needed for loop, needed in zip(shape.loops, rows, strict=True))
    return None if short or len({frozenset(ends) for ends in shape.ends}) < len(shape.ends) else shape


def _attempt(rng: np.random.Generator, recipe: Recipe, shape: Shape) -> tuple[Mechanism, Array] | None:
    tree = (planar_tree if recipe.planar else _spatial_tree)(rng, shape.parents)
    q = rng.uniform(-1.0, 1.0, recipe.links)
    pairs = zip(shape.ends, recipe.closures, strict=True)
    closures = tuple(_closure(rng, tree, q, f"loop{i}", ends, kind) for i, (ends, kind) in enumerate(pairs))
    couplings = _couplings(rng, tree, q, recipe.gears)
    primary = tree.joint_names[:1]
    if any(c.follower in primary for c in couplings):
        return None
    looped = replace(tree, loops=Loops(primary, closures, couplings))
    chosen = _primary(looped, q)
    if chosen is None or any(c.follower in chosen for c in couplings) or not every_loop_moves(looped, shape, q):
        return None
    reference = dict(zip(tree.joint_names, q.tolist(), strict=True))
    return Mechanism(replace(tree, loops=Loops(chosen, closures, couplings, reference))), q


def every_loop_moves(description: Description, shape: Shape, q: Array) -> bool:
    """Whether the motions that the closures leave free turn joints of every loop, and not just barely: where joints
    only slide, the Jacobian stays the same."""
    _, values, directions = np.linalg.svd(gap_rates(description, q))
    free = directions[int((values > 1e-6).sum()) :]
    turning = [(i, link.joint.name) for i, link in enumerate(description.links) if link.joint.kind.is_revolute]
    return all(np.linalg.norm(free[:, [i for i, name in turning if name in loop]]) > 0.3 for loop in shape.loops)


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


def _spatial_tree(rng: np.random.Generator, parents: list[int]) -> Description:
    links = [random_link(rng, i, parent) for i, parent in enumerate(parents)]
    return Description("spatial", depth_first(links), rng.normal(size=3))


def equations(mechanism: Mechanism) -> LoopEquations:
    """Those of a mechanism with loops."""
    assert isinstance(mechanism.equations, LoopEquations)
    return mechanism.equations


def planar_tree(rng: np.random.Generator, parents: list[int]) -> Description:
    """Revolute joints about z and prismatic ones across it: whatever closes stays in the plane."""
    chain = []
    for i, parent in enumerate(parents):
        kind = JointKind.PRISMATIC if rng.random() < 0.25 else JointKind.REVOLUTE
        angle = rng.uniform(-3.0, 3.0)
        axis = (np.cos(angle), np.sin(angle), 0.0) if kind is JointKind.PRISMATIC else (0.0, 0.0, 1.0)
        near = Pose(rotation_about((0, 0, 1), rng.uniform(-3, 3)), np.append(rng.uniform(-0.5, 0.5, 2), 0.0))
        chain.append(
            Link(f"link{i}", parent, Joint(f"joint{i}", kind, np.array(axis)), near, near, random_inertia(rng))
        )
    return Description("planar", depth_first(chain), rng.normal(size=3))


def _closure(
    rng: np.random.Generator, tree: Description, q: Array, name: str, ends: tuple[int, int], kind: ClosureKind
) -> Closure:
    """Two links, or one and the ground, closed as they stand; in a plane, at a place in the plane."""
    first, second = (None if i == GROUND else f"link{i}" for i in ends)
    planar = tree.name == "planar"
    turn = rotation_about((0, 0, 1), rng.uniform(-3, 3))
    if not planar:
        turn = turn @ rotation_about((1, 0, 0), rng.uniform(-3, 3))
    at = rng.uniform(-0.5, 0.5, 3) * (1.0, 1.0, 0.0 if planar else 1.0)
    frame, poses = Pose(turn, at), world_poses(tree, q)
    return Closure(name, first, second, frame, poses[second].inverse @ poses[first] @ frame, kind)


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
