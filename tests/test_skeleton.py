"""The floor that a drawn arm stands on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_trees import random_tree

from adaptctl.description import Pose
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.recording.skeleton import floor_height, skeleton


def lifted(seed: int, height: float) -> Mechanism:
    """A chain of three links, whose first joint is at a height and the second far below the first."""
    description = random_tree(seed, 3).description
    links = [replace(link, parent=k - 1) for k, link in enumerate(description.links)]
    for k, z in ((0, height), (1, -20.0), (2, 20.0)):
        at = links[k].parent_to_joint
        links[k] = replace(links[k], parent_to_joint=Pose(np.eye(3), [*at.translation[:2], z]))
    return Mechanism(replace(description, links=tuple(links)))


@pytest.mark.parametrize("seed", [1, 2])
def test_the_floor_is_at_zero_unless_the_arm_reaches_below(seed: int) -> None:
    p = np.random.default_rng(seed).normal(size=(250, 3))
    above, below = lifted(seed, 100.0), lifted(seed, -100.0)
    assert floor_height(above, skeleton(above), p) == 0.0
    parts, heights = skeleton(below), link_poses(below, p[::2]).translations[..., 2]
    lowest = min(float(heights.min()), -100.0)
    assert floor_height(below, parts, p) == pytest.approx(lowest - 0.6 * parts.reach)
