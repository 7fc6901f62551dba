"""Measured forces of a driven arm: biased, silent and late sensors, and touches."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from driven_robots import ARM, RecordedRobot
from nightly import mostly_at_night

import adaptctl
from adaptctl.errors import InputError
from adaptctl.hardware import ForceReading, MuJoCoRobot, RobotReading
from adaptctl.hardware.force_sensor import MAX_LOST, SAMPLES, ForceSensor

PERIOD = 4e-3
CENTER = np.array([0.3, 0.5])
REFERENCE = adaptctl.Sinusoids(CENTER, np.array([0.4, 0.3]), np.array([0.5, 0.8]))
BIAS = np.array([3.0, -1.0, -25.0])


@lru_cache
def law() -> Any:
    model = adaptctl.ReducedModel(ARM, adaptctl.fundamental_basis(adaptctl.essential_space(ARM)))
    return adaptctl.SlotineLi(model, 8.0, [6.0, 2.0], None, model.fundamental_parameters, PERIOD)


class SensingRobot(RecordedRobot):
    """A robot whose last link is pushed, with a biased sensor that fails from a time on."""

    force_on, fails, fault = np.zeros(3), np.inf, "silent"

    def read(self) -> Any:
        data: Any = self.plant._scene._data
        data.xfrc_applied[-1, :3] = self.pushed
        return super().read()

    @property
    def pushed(self) -> Any:
        return self.force_on if self._count * PERIOD >= 1.6 else np.zeros(3)

    def force(self) -> Any:
        now = self._count * PERIOD
        if now >= self.fails:
            if self.fault == "broken":
                raise OSError("gone")
            return None if self.fault == "silent" else ForceReading(now - 0.05, BIAS)
        return ForceReading(now, BIAS + self.pushed)


def driven(**about: Any) -> tuple[Any, SensingRobot]:
    robot = SensingRobot(ARM, PERIOD, CENTER)
    for name, value in about.items():
        setattr(robot, name, value)
    return adaptctl.drive(robot, law(), REFERENCE, 2.0, lead_in=1.5), robot


@pytest.mark.parametrize(
    ("about", "said"),
    mostly_at_night(
        [
            ({"fails": 1.5}, "the force sensor is silent"),
            ({"fails": 1.5, "fault": "late"}, "the force sensor is 0.05 s late"),
            ({"force_on": np.array([15.0, 0.0, 0.0])}, "touched: force sensor felt 15 N, above its level of 10 N"),
            ({"force_on": np.array([8.0, 0.0, 0.0])}, ""),
        ],
        ({"fails": 1.5}, "the force sensor is silent"),
    ),
)
def test_what_a_sensor_shows_stops_the_arm(about: dict[str, Any], said: str) -> None:
    run, robot = driven(**about)
    assert run.stopped.startswith(said)
    assert bool(said) == bool(run.stopped)
    assert run.force_bias == pytest.approx(BIAS)
    assert (run.by_robot, robot.breaches) == (False, [])
    assert run.rollout.flags["measured_force_z"] == pytest.approx(0.0)


class Sensed:
    """A robot at rest, whose sensor shows what it is told."""

    def __init__(self, forces: Any) -> None:
        self.forces, self.count = forces, 0

    def read(self) -> RobotReading:
        self.count += 1
        return RobotReading(self.count * PERIOD, CENTER, 0.0 * CENTER)

    def force(self) -> Any:
        return self.forces(self.count)


@pytest.mark.parametrize(
    ("forces", "said"),
    [
        (lambda k: None, "robot: the force sensor is silent"),
        (lambda k: ForceReading(0.1, BIAS), "robot: the force sensor is silent: it repeats"),
        (lambda k: ForceReading(k * PERIOD, BIAS * np.nan), "robot: the force sensor is silent"),
        (lambda k: ForceReading(k * PERIOD - 0.03, BIAS), "robot: the force sensor is 0.03 s late"),
        (lambda k: ForceReading(k * PERIOD, BIAS if k < 30 else 2.0 * BIAS), "changes by .* N at rest"),
        (lambda k: 1.0 / 0.0, "silent: ZeroDivisionError"),
    ],
)
def test_a_bad_sensor_is_refused_at_rest(forces: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        ForceSensor(Sensed(forces), 10.0).rest()


def test_moments_may_change_at_rest() -> None:
    """What is a touch is a force."""
    sensor = ForceSensor(Sensed(lambda k: ForceReading(k * PERIOD, BIAS, (50.0 * (k % 2), 0.0, 0.0))), 10.0)
    sensor.rest()
    np.testing.assert_allclose(sensor.bias, BIAS)


def test_a_short_gap_is_ridden_out_at_rest_too() -> None:
    sensor = ForceSensor(Sensed(lambda k: None if k <= MAX_LOST else ForceReading(k * PERIOD, BIAS)), 10.0)
    sensor.rest()
    np.testing.assert_allclose(sensor.bias, BIAS)


def test_a_gap_is_ridden_out_and_keeps_the_last_force() -> None:
    robot = Sensed(lambda k: ForceReading(k * PERIOD, BIAS + (k > SAMPLES)) if k < 60 or k > 68 else None)
    sensor = ForceSensor(robot, 10.0)
    sensor.rest()
    told = []
    for _ in range(MAX_LOST + 20):
        sensor.take(robot.read().time)
        told.append(sensor.failed)
        assert sensor.force == pytest.approx(1.0)
    assert set(told) == {""}


def test_mujocos_robot_measures_what_it_touches_if_asked() -> None:
    assert not hasattr(MuJoCoRobot(ARM, PERIOD, start=CENTER), "force")
    robot = MuJoCoRobot(ARM, PERIOD, start=CENTER, force_sensor=True)
    robot.read()
    assert robot.force().force.tolist() == [0.0, 0.0, 0.0]
    assert robot.force().time == PERIOD
