"""Guarded learning of an arm that goes to a position once and rests there."""

from __future__ import annotations

import numpy as np
import pytest
from two_links import ARM

from adaptctl import Plant, adaptive_controller, simulate_many
from adaptctl.control import Sinusoids
from adaptctl.simulation.effects import Encoder, Friction
from adaptctl.simulation.effects.effect import Effect
from adaptctl.simulation.simulate_many import Rollouts
from adaptctl.tuning import with_friction

RUBBING = {"shoulder": 0.5, "elbow": 0.05}
"""N m, and N m s/rad"""
HELD = Sinusoids(np.array([0.4, 0.7]), np.zeros(2), np.ones(2))


def rested(effect: Effect, period: float, friction: float, duration: float) -> Rollouts:
    """Four arms that go to a position and rest there."""
    arm = with_friction(ARM)
    named = (name.split(".") for name in arm.parameter_names)
    own = [friction * RUBBING[where] if what in ("viscous", "coulomb") else 0.0 for where, what in named]
    start = HELD(0.0).p + np.array([[0.1, -0.1], [-0.1, 0.1], [0.1, 0.1], [-0.1, -0.1]])
    given = {"parameters": arm.inertial_parameters + own, "p": start, "seed": [0, 1, 2, 3]}
    controller = adaptive_controller(arm, control_period=period)
    return simulate_many(Plant(arm, period, effects=[effect]), controller, HELD, duration=duration, **given)


@pytest.mark.parametrize(
    ("effect", "bound"), [(Friction(stribeck=[0.25, 0.025]), 2e-3), (Encoder(velocity_noise=0.03), 3.5e-3)]
)
def test_an_arm_comes_to_where_it_rests(effect: Effect, bound: float) -> None:
    """A motion in one direction cannot tell a load from friction, of which only the load is there at rest."""
    assert np.sqrt(np.mean(rested(effect, 4e-3, 1.0, 20.0).final_rms_error ** 2)) < bound


def test_minutes_of_noise_leave_an_arm_where_it_rests() -> None:
    runs = rested(Encoder(velocity_noise=0.03), 1e-3, 0.0, 120.0)
    assert runs.final_rms_error.max() < 0.6e-3
