"""Guarded learning of an arm that goes to a position once and rests there."""

from __future__ import annotations

import numpy as np
import pytest
from two_links import ARM

from adaptctl import Plant, adaptive_controller, simulate_many
from adaptctl.control import Sinusoids
from adaptctl.simulation.effects import Encoder, Friction
from adaptctl.simulation.effects.effect import Effect
from adaptctl.tuning import with_friction

PERIOD = 4e-3
RUBBING = {"shoulder": 0.5, "elbow": 0.05}
"""N m, and N m s/rad"""


@pytest.mark.parametrize("effect", [Friction(stribeck=[0.25, 0.025]), Encoder(velocity_noise=0.03)])
def test_an_arm_comes_to_where_it_rests(effect: Effect) -> None:
    """A motion in one direction cannot tell a load from friction, of which only the load is there at rest."""
    arm = with_friction(ARM)
    named = (name.split(".") for name in arm.parameter_names)
    friction = [RUBBING[where] if what in ("viscous", "coulomb") else 0.0 for where, what in named]
    held = Sinusoids(np.array([0.4, 0.7]), np.zeros(2), np.ones(2))
    start = held(0.0).p + np.array([[0.1, -0.1], [-0.1, 0.1], [0.1, 0.1], [-0.1, -0.1]])
    given = {"parameters": arm.inertial_parameters + friction, "p": start, "seed": [0, 1, 2, 3]}
    controller = adaptive_controller(arm, control_period=PERIOD)
    runs = simulate_many(Plant(arm, PERIOD, effects=[effect]), controller, held, duration=20.0, **given)
    assert np.sqrt(np.mean(runs.final_rms_error**2)) < 2e-3
