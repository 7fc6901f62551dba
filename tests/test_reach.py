"""How far chains reach: never less than what forward kinematics shows, and exactly the sum of a straight chain."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree

from adaptctl.description import GROUND
from adaptctl.description.reach import chain_reach, joint_line, link_end, reach_behind
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.kinematics import joint_axes, link_poses


def ancestors(mechanism: Mechanism, link: int) -> list[int]:
    """The link itself and all before it."""
    return [] if link == GROUND else [link, *ancestors(mechanism, mechanism.links[link].parent)]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_no_end_is_farther_from_a_joint_than_its_reach(seed: int, links: int) -> None:
    """At zero, where a prismatic joint has not moved; elsewhere turning joints keep all lengths."""
    mechanism = random_tree(seed, links)
    turns = np.array([link.joint.kind.is_revolute for link in mechanism.links])
    p = np.where(turns, np.random.default_rng(seed).normal(size=links), 0.0)
    poses, joints, behind = link_poses(mechanism, p), joint_axes(mechanism, p).positions, reach_behind(mechanism.links)
    for i, link in enumerate(mechanism.links):
        end = poses.rotations[i] @ link_end(link) + poses.translations[i]
        for j in ancestors(mechanism, i):
            assert np.linalg.norm(end - joints[j]) <= behind[j] + 1e-12
    firsts = [i for i, link in enumerate(mechanism.links) if link.parent == GROUND]
    farthest = max(chain_reach(mechanism.links, i) for i in range(links))
    np.testing.assert_allclose(max(behind[i] for i in firsts), farthest, rtol=1e-12)


def test_the_pumas_reach() -> None:
    """From the shoulder: the upper arm 0.4318 m, the offset and the forearm to the centre of the last link's mass."""
    puma = load("puma560_measured")
    behind = reach_behind(puma.links)
    steps = [
        np.linalg.norm(b.parent_to_joint.translation - joint_line(a)[0])
        for a, b in zip(puma.links, puma.links[1:], strict=False)
    ]
    np.testing.assert_allclose(behind[:-1] - behind[1:], steps, atol=1e-15)
    assert 0.43 < steps[1] < 0.46
