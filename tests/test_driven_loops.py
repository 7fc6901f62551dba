"""`drive` for arms with kinematic loops: gravity on their own branch, and no torque near a singularity."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from five_bars import five_bar

import adaptctl
from adaptctl.control.gains.workspace import reachable
from adaptctl.dynamics.loops.continuation import MAX_PRIMARY_STEP
from adaptctl.errors import SingularityError
from adaptctl.hardware import GravityTorque, HardwareLimits, RobotReading
from adaptctl.hardware.resting import StoppingDistance

ARM = five_bar(np.array([0.4, 0.2, 0.3, 0.25]))
HOME = ARM.neutral_configuration
SINGULAR = np.array([0.0, 0.0, -0.7])  # away from home, where links 4 and 5 are in line
STILL = np.zeros(3)


def test_gravity_is_that_of_the_posture_however_far_from_the_reference() -> None:
    arm = five_bar(np.array([0.4, 0.2, 0.45, 0.35]), near=True)
    gravity, random = GravityTorque(arm), np.random.default_rng(0)
    for away in random.uniform(-1.0, 1.0, (40, 3)):
        p = arm.neutral_configuration + away
        np.testing.assert_allclose(gravity(p), arm.inverse_dynamics(p, STILL, STILL), atol=1e-9)


@pytest.mark.parametrize(("step", "far"), [(-1.0, False), (1.0, False), (-1.01, True), (1.01, True)])
def test_loops_are_continued_where_a_joint_moved_far_since_the_last_posture(step: float, far: bool) -> None:
    gravity: Any = object.__new__(GravityTorque)
    last, continued = np.array([2.0, 9.0, 0.0]), np.array([7.0, 7.0, 7.0])
    gravity._last, gravity._loops = last, SimpleNamespace(primary=[0, 2])
    gravity._mechanism = SimpleNamespace(configuration=lambda p, near: continued if near is last else None)
    assert gravity._near(np.array([2.0, step * MAX_PRIMARY_STEP])) is (continued if far else last)


def test_stops_are_reckoned_with_postures_of_the_whole_range() -> None:
    """At its neutral posture this arm can be slowed down up to six times as hard as elsewhere."""
    limits = HardwareLimits.of(ARM, torque_rate=1000.0)
    p = np.random.default_rng(1).uniform(np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi), (300, 3))
    p = p[reachable(ARM, p)]
    left = 0.5 * (limits.torque - np.abs(ARM.inverse_dynamics(p, 0.0 * p, 0.0 * p)))
    possible = (left / (np.abs(ARM.mass_matrix(p)) @ limits.velocity)).min(axis=-1)
    stated = StoppingDistance(ARM, limits, 4e-3).deceleration / limits.velocity
    assert np.mean(possible < stated[0]) < 0.05
    at_home = 0.5 * limits.torque / (np.abs(ARM.mass_matrix(HOME)) @ limits.velocity)
    assert stated[0] < 0.3 * at_home.min()


class Standing:
    """Robot that stands at a posture and is never to be moved."""

    period, compensates_gravity = 4e-3, False
    limits = HardwareLimits.of(ARM, torque_rate=1000.0)

    def __init__(self, p: Any) -> None:
        self.p, self.count = np.asarray(p), 0

    def read(self) -> RobotReading:
        self.count += 1
        return RobotReading(self.count * self.period, self.p, STILL)

    def write(self, torque: Any) -> None:
        raise AssertionError(f"{torque} was sent")

    stop = write


@pytest.mark.parametrize(("start", "end"), [(SINGULAR, STILL), (STILL, SINGULAR)], ids=["start", "reference"])
def test_near_a_singularity_nothing_is_sent(start: Any, end: Any) -> None:
    law = adaptctl.ComputedTorque(ARM, 8.0)
    there = adaptctl.Sinusoids(HOME + end, [0.01] * 3, [0.3] * 3)
    with pytest.raises(SingularityError, match="the loops are near a singularity at p = "):
        adaptctl.drive(Standing(HOME + start), law, there, 8.0)
