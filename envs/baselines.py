"""Returns of controllers in an environment, to judge what learners reach by."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from adaptctl.arrays import whole_count
from adaptctl.control import ComputedTorque, Controller, PDGravity
from adaptctl.envs.learning import tracking_of
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.simulation.rollout import rollout
from adaptctl.tuning import tune

BANDWIDTH, HOLD = 8.0, 1.0
"""1/s, and the sampling ratio of the damping: stiff, with which all four track as well as they can at 20 ms."""


def baselines(env: Any, *, episodes: int = 1, seed: int = 0) -> dict[str, float]:
    """Mean returns (sums of an episode's rewards, unitless) of five controllers that drive the arm of a tracking
    environment, as a mapping from their names.

    `env` is a `TrackingEnv`, one within wrappers, or a vector environment of adaptctl, of whose arms one is taken; a
    copy is driven, without the wrappers, and `env` is not changed. The names are "zero torque"; "PD", without gravity
    compensation; "PD with gravity", with gravity compensation by the true parameters; "Slotine-Li from nothing",
    Slotine and Li's adaptive law from an initial estimate of zero; and "computed torque" with the true parameters.
    Their gains are those that `tune` designs for a `bandwidth` of 8 1/s and a `hold` of 1, unitless, the upper bound of
    T_c lambda_max((M + T_c B)^-1 K): T_c is the control period, s, lambda_max the largest eigenvalue, M the mass
    matrix, B viscous friction and K the damping gains, N m s/rad (N s/m if prismatic). The mean is over `episodes`
    episodes; episode k, from 0, has the seed `seed` + k.

    Raises `InputError` for another environment, for `episodes` that is no whole number of at least 1, a `seed` that is
    none of at least 0, and where `tune` finds no gains, as for a control period above 0.1 s; `NonFiniteError` where a
    motion diverges to non-finite values.
    """
    first, runs = whole_count(seed, "seed"), whole_count(episodes, "episodes", 1)
    own, seeds = deepcopy(tracking_of(env)), range(first, first + runs)
    driven = {name: np.mean([_driven(own, law, k) for k in seeds]) for name, law in _laws(own).items()}
    return {"zero torque": float(np.mean([_driven(own, None, k) for k in seeds]))} | {
        name: float(value) for name, value in driven.items()
    }


def _laws(env: TrackingEnv) -> dict[str, Controller[Any]]:
    mechanism, period = env.mechanism, env.control_period
    reference = env.trajectory if callable(env.trajectory) else None
    off = env.initial_error if np.any(env.initial_error) else None
    tuning = tune(
        mechanism,
        control_period=period,
        reference=reference,
        initial_error=off,
        bandwidth=BANDWIDTH,
        sampling_ratio=HOLD,
    )
    model = ReducedModel(mechanism, fundamental_basis(essential_space(mechanism)))
    damping = tuning.gains.damping
    stiffness, nothing = tuning.gains.bandwidth * damping, np.zeros_like(mechanism.inertial_parameters)
    return {
        "PD": PDGravity(mechanism, stiffness, damping, nothing),
        "PD with gravity": PDGravity(mechanism, stiffness, damping),
        "Slotine-Li from nothing": tuning.controller(model, anyway=True),
        "computed torque": ComputedTorque.on(model, tuning.gains.bandwidth),
    }


def _driven(env: TrackingEnv, law: Controller[Any] | None, seed: int) -> float:
    """The return of an episode under a law, or under no torque."""
    if law is not None:
        return float(rollout(env, law, seed=seed).reward.sum())
    env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, _ = env.step(np.zeros(env.plant.dof))
        total, over = total + reward, terminated or truncated
    return total
