"""Joint positions that bring a point of a robot to its goals, along straight lines in short steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import adaptctl
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.inverse_kinematics import Tip
from adaptctl.errors import InputError

START = np.array([0.1, 0.2, 0.3])


@pytest.fixture(scope="module")
def tip() -> Tip:
    arm = adaptctl.load("puma560_measured").description
    return Tip(Mechanism(replace(arm, links=arm.links[:3])), "link3", np.array([0.0, 0.0, 0.4]))


def test_each_of_many_goals_is_reached_in_steps_of_two_centimetres(tip: Tip, monkeypatch: pytest.MonkeyPatch) -> None:
    ways: list[float] = []
    step = Tip._step

    def spied(self: Tip, jacobian: object, way: np.ndarray) -> object:
        ways.append(np.linalg.norm(way, axis=-1).max())
        return step(self, jacobian, way)  # type: ignore[arg-type]

    monkeypatch.setattr(Tip, "_step", spied)
    goals = tip.at(START) + np.array([[0.07, 0.0, 0.07], [0.0, 0.0, 0.0], [-0.05, 0.03, 0.0]])
    found = tip.joints(goals, START)
    np.testing.assert_allclose(tip.at(found), goals, atol=1e-9)
    np.testing.assert_array_equal(found[1], START)
    assert 0.019 < max(ways) < 0.022


def test_a_joint_moves_a_fifth_of_a_radian_per_step(tip: Tip) -> None:
    ways = np.array([[0.1, -0.05, 0.0], [0.4, -0.2, 0.0]])
    np.testing.assert_allclose(tip._step(np.tile(np.eye(3), (2, 1, 1)), ways), [ways[0], 0.5 * ways[1]])


def test_what_misses_by_a_nanometre_is_not_reached(tip: Tip) -> None:
    goals = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    tip._validate_reached(goals, goals + 0.9e-9 * np.eye(3)[0])
    with pytest.raises(InputError, match=r"link3 cannot reach \[0.4, 0.5, 0.6\] m from its start"):
        tip._validate_reached(goals, goals + np.array([[0.0] * 3, [0.0, 1.1e-9, 0.0]]))
    with pytest.raises(InputError, match=r"cannot reach \[0.1, 0.2, 0.3\]"):
        tip._validate_reached(goals, goals + np.array([[np.nan] * 3, [1.0] * 3]))
    with pytest.raises(InputError, match="cannot reach"):
        tip.joints([5.0, 0.0, 0.0], START)
