"""A link's three turns are done one by one or as one, whichever costs less; either way they are the same turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.compilation import Kernel, compile_function
from adaptctl.description import JointKind, Pose
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics.recursion import segment
from adaptctl.dynamics.recursion.segment import MIN_TURNED_VECTORS, Segment
from adaptctl.scalars import Column, Vec

X, Z, SKEW = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([0.36, 0.48, 0.8])
UPRIGHT, RIGHT, TILTED = np.eye(3), rotation_about(X, np.pi / 2), rotation_about(X, 0.4)
ANY = rotation_about(SKEW, 1.1)


def turned(one: Segment) -> Kernel:
    """As many vectors as a link's placement turns at least, in the link's coordinates."""

    def equation(q: Column, u: Column) -> Column:
        place = one.at(q[0])
        vectors = [place.down(Vec(*u.of[k : k + 3])) for k in range(0, 3 * MIN_TURNED_VECTORS, 3)]
        return Column(x for vector in vectors for x in vector)

    return compile_function(equation, {"q": 1, "u": 3 * MIN_TURNED_VECTORS})


@pytest.mark.parametrize(
    ("near", "axis", "far", "as_one"),
    [
        (UPRIGHT, Z, UPRIGHT, False),
        (RIGHT, Z, RIGHT, False),
        (UPRIGHT, SKEW, UPRIGHT, False),
        (TILTED, Z, UPRIGHT, False),
        (TILTED, Z, TILTED, True),
        (TILTED, X, TILTED, True),
        (UPRIGHT, Z, ANY, True),
        (ANY, SKEW, ANY, True),
    ],
)
def test_the_way_that_is_taken_costs_no_more_than_the_other(
    near: Array, axis: Array, far: Array, as_one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    (link,) = random_chain(1, 1).links
    joint = replace(link.joint, kind=JointKind.REVOLUTE, axis=axis)
    link = replace(link, joint=joint, parent_to_joint=Pose(near, np.zeros(3)), joint_to_link=Pose(far, np.zeros(3)))
    chosen = Segment.of(link)
    monkeypatch.setattr(segment, "MIN_TURNED_VECTORS", 10**9)  # as one, unless that never costs less
    other = chosen._replace(whole=None) if as_one else Segment.of(link)
    assert (chosen.whole is not None) == as_one
    one, two = turned(chosen), turned(other)
    assert one.operations.flops <= two.operations.flops
    q, u = np.array([0.7]), np.random.default_rng(0).normal(size=3 * MIN_TURNED_VECTORS)
    np.testing.assert_allclose(one(q, u), two(q, u), atol=1e-14)
