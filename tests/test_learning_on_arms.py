"""The default learning law on arms of the contest, in whose files its constants were chosen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nightly import nightly

from adaptctl.contest.entries import ContestEntry


def rows(robot: str, condition: str, law: str, seeds: int = 2) -> list[dict[str, Any]]:
    given = (condition,), tuple(range(1, seeds + 1)), 20.0, ("reference", "initial error"), "adaptctl"
    found = ContestEntry(law, robot, "", *given).rows()
    assert not [row["reason"] for row in found if row["reason"]]
    return found


@nightly
@pytest.mark.parametrize(
    "robot", ["finger_edu_description/robots/finger_edu.urdf", "ur_description/urdf/ur10_robot.urdf"]
)
def test_light_arms_learn_with_coarse_encoders(robot: str) -> None:
    true, learned = (rows("{example-robot-data}/" + robot, "encoder-12", law, 3) for law in ("true", "learning"))
    assert np.median([row["error"] for row in learned]) < 1.1 * np.median([row["error"] for row in true])


@nightly
@pytest.mark.parametrize("condition", ["payload", "dropped", "push-ramped"])
@pytest.mark.parametrize("robot", ["puma560", "{example-robot-data}/ur_description/urdf/ur5_robot.urdf"])
def test_loads_and_pushes_below_the_stated_error_are_told_too(robot: str, condition: str) -> None:
    learned, gradient = (rows(robot, condition, law) for law in ("learning", "gradient"))
    for one, other in zip(learned, gradient, strict=True):
        assert one["error"] < 0.02
        assert condition == "push-ramped" or one["error_10_s"] < other["error_10_s"]


@nightly
def test_joints_that_turn_back_raise_no_doubts() -> None:
    robot = "{example-robot-data}/xarm_description/urdf/xarm7.urdf"
    true, learned = (rows(robot, "encoder-12", law) for law in ("true", "learning"))
    assert np.mean([row["error"] for row in learned]) < 1.8 * np.mean([row["error"] for row in true])
