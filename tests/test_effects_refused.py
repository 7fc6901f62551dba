"""Effects that cannot be, and those that do not fit an arm, are refused."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from adaptctl.dynamics import load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError, NotFoundError
from adaptctl.simulation.effects import (
    ActuatorLag,
    ControlDelay,
    Effect,
    ElasticJoints,
    Encoder,
    FilteredDifferences,
    Friction,
    Payload,
    PayloadHeld,
    PlantEffects,
    TorqueLimit,
    TorqueRateLimit,
)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: ControlDelay(65), InputError, "65 control periods are more than the buffer length of 64"),
        (lambda: ControlDelay(-1), InputError, "control delay: expected a whole number"),
        (lambda: ControlDelay(1.5), InputError, "expected a whole number of control periods, got 1.5"),
        (lambda: ControlDelay(True), InputError, "expected a whole number of control periods, got True"),
        (lambda: ActuatorLag(True), InputError, "actuator lag: expected a positive number of s, got True"),
        (lambda: ActuatorLag(0.0), InputError, "actuator lag: expected a positive number of s, got 0"),
        (lambda: FilteredDifferences(-3.0), InputError, "cutoff: expected a positive number of Hz"),
        (lambda: Friction(stribeck_speed=0.0), InputError, "friction: stribeck_speed: expected a positive number"),
        (lambda: PayloadHeld(1.0, 2.0, 1.0), InputError, "expected a start before its stop, got 2.0 and 1.0 s"),
        (lambda: PayloadHeld(-1.0), InputError, "expected a mass of at least 0 kg"),
        (lambda: Payload(1.0, inertia=np.array([[1, 1e-3, 0], [0, 1, 0], [0, 0, 1]])), InputError, "symmetric tensor"),
        (lambda: Payload(1.0, [1e300, 0.0, 0.0]), InputError, "payload: expected inertial parameters of at most 1e.20"),
        (lambda: Payload(1.0, inertia=1e308 * np.eye(3)), InputError, "inertial parameters of at most 1e.20"),
        (lambda: ElasticJoints(1.0, encoders=np.array(["link"])), InputError, "expected 'link' or 'motor', got array"),
        (lambda: PlantEffects.of([ControlDelay(1), ControlDelay(2)]), InputError, "ControlDelay is given 2 times"),
        (lambda: PlantEffects.of([0.1]), InputError, r"expected plant effects, such as ControlDelay\(2\), got 0.1"),
    ],
)
def test_what_cannot_be_is_refused(make: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make()


@pytest.mark.parametrize(
    ("effect", "error", "message"),
    [
        (Friction(viscous=-1.0), InputError, "friction: viscous: expected numbers of at least 0, got -1"),
        (
            Friction(coulomb=[1.0, 2.0]),
            InputError,
            r"friction: coulomb: expected a number or 6 of them, got shape \(2,\)",
        ),
        (Friction(stribeck=math.inf), InputError, "friction: expected finite numbers"),
        (Friction(load=math.inf), InputError, "friction: expected finite numbers"),
        (Friction(load=-0.1), InputError, "friction: load: expected numbers of at least 0, got -0.1"),
        (TorqueRateLimit(math.nan), InputError, "torque rate limit: expected numbers of at least 0"),
        (TorqueLimit([-1.0] * 6), InputError, "torque limit: expected numbers of at least 0"),
        (Encoder(resolution=math.inf), InputError, "encoder: resolution: expected finite numbers"),
        (Encoder([1e-3] * 5 + [1e-310]), InputError, "encoder: resolution: expected 0 or at least 1e-12"),
        (Encoder(noise=-1e-3), InputError, "encoder: noise: expected numbers of at least 0"),
        (FilteredDifferences(500.0), InputError, "500 Hz is not below half the sampling rate, 500 Hz"),
        (PayloadHeld(1.0, link="hand"), NotFoundError, "unknown link 'hand'; links: link1, link2"),
    ],
)
def test_what_does_not_fit_an_arm_is_refused(effect: Effect, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        TrackingEnv(load("puma560_measured"), effects=[effect])


def test_a_mass_is_any_kind_of_number() -> None:
    """Of NumPy's too, alone in an array or not."""
    for given in (2, 2.0, np.float32(2.0), np.int8(2), np.array(2.0)):
        mass = Payload(given).mass
        assert (type(mass), mass) == (float, 2.0)


@dataclass(frozen=True)
class Backlash(Effect):
    """An effect of no kind that a plant knows where to put."""

    gap: float

    def validate(self, dof: int, links: tuple[str, ...], control_period: float) -> None:
        """Nothing."""


def test_an_effect_of_no_known_kind_is_refused_and_not_left_out() -> None:
    message = r"effects: expected .* ActuatorEffect, SensorEffect, JointEffect or LoadEffect, got Backlash\(gap=0.1\)"
    with pytest.raises(InputError, match=message):
        PlantEffects.of([ControlDelay(1), Backlash(0.1)])


@pytest.mark.parametrize("seed", range(5))
def test_an_inertia_turned_in_floating_point_is_one(seed: int) -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    moments = np.diag([1.0, 2.0, 2.5])
    kept = Payload(1.0, inertia=turn @ moments @ turn.T).inertia
    np.testing.assert_array_equal(kept, kept.T)
    np.testing.assert_allclose(turn.T @ kept @ turn, moments, atol=1e-14)
    with pytest.raises(InputError, match="not that of a body"):  # whose longest moment is more than the others together
        Payload(1.0, inertia=turn @ np.diag([1.0, 1.4, 2.5]) @ turn.T)
