"""Random mechanisms: any tree, any joint kinds, link frames anywhere, bodies a density can have."""

from __future__ import annotations

import numpy as np

from adaptctl.arrays import Array
from adaptctl.description import GROUND, Description, Joint, JointKind, Link, Pose, depth_first
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism

KINDS = tuple(JointKind)


def random_pose(rng: np.random.Generator) -> Pose:
    axis = rng.normal(size=3)
    return Pose(rotation_about(axis / np.linalg.norm(axis), rng.uniform(-3, 3)), rng.uniform(-0.5, 0.5, 3))


def random_inertia(rng: np.random.Generator) -> Array:
    """The ten of five point masses, which no test can call unphysical."""
    points = rng.uniform(-0.5, 0.5, (5, 3))
    masses = rng.uniform(0.1, 2.0, 5)
    return np.sum([from_center_of_mass(m, c, np.zeros((3, 3))) for m, c in zip(masses, points, strict=True)], axis=0)


def random_link(rng: np.random.Generator, i: int, parent: int) -> Link:
    axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
    joint = Joint(f"joint{i}", KINDS[rng.integers(3)], axis)
    return Link(f"link{i}", parent, joint, random_pose(rng), random_pose(rng), random_inertia(rng))


def random_tree(seed: int, links: int) -> Mechanism:
    """Each link hangs on the ground or on any link before it."""
    rng = np.random.default_rng(seed)
    tree = [random_link(rng, i, int(rng.integers(GROUND, i))) for i in range(links)]
    return Mechanism(Description("tree", depth_first(tree), rng.normal(size=3)))


def random_chain(seed: int, links: int) -> Mechanism:
    """Each link hangs on the one before."""
    rng = np.random.default_rng(seed)
    return Mechanism(Description("chain", tuple(random_link(rng, i, i - 1) for i in range(links))))
