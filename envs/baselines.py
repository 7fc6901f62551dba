"""Returns of controllers, for comparison with learners."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from adaptctl.arrays import whole_count
from adaptctl.control import ComputedTorque, Controller, PDGravity
from adaptctl.envs.learning import tracking_of
from adaptctl.envs.tracking import TrackingEnv
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation.rollout import rollout
from adaptctl.tuning import tune

BANDWIDTH, SAMPLING_RATIO = 8.0, 1.0
"""Bandwidth in 1/s, and sampling ratio of the damping."""


def baselines(env: Any, *, episodes: int = 1, seed: int = 0) -> dict[str, float]:
    """
    Compute the mean returns of five controllers in an environment, to compare learners with.

    Parameters
    ----------
    env : gymnasium.Env or gymnasium.vector.VectorEnv
        A `TrackingEnv`, one in wrappers, or a vector environment, of which one arm is taken; a copy is driven.
    episodes : int, default 1
        Number of episodes that each return is averaged over. One is enough for a fixed reference.
    seed : int, default 0
        Seed of the first episode; the next ones count up.

    Returns
    -------
    dict
        Mean returns by name: "zero torque", "PD", "PD with gravity" and "computed torque" (both by the true parameters)
        and "Slotine-Li from zero estimates" (adaptive).

    Raises
    ------
    InputError
        If a value is bad or `tune` finds no gains, as for control periods above 0.1 s.
    NonFiniteError
        If a motion diverges.

    Notes
    -----
    The gains are those of `tune` for a bandwidth of 8 1/s and a sampling ratio of 1.
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
        sampling_ratio=SAMPLING_RATIO,
        nominal_only=True,
    )
    model = ReducedModel(mechanism)
    damping = tuning.gains.damping
    stiffness, nothing = tuning.gains.bandwidth * damping, np.zeros_like(mechanism.inertial_parameters)
    return {
        "PD": PDGravity(mechanism, stiffness, damping, nothing),
        "PD with gravity": PDGravity(mechanism, stiffness, damping),
        "Slotine-Li from zero estimates": tuning.controller(model, anyway=True),
        "computed torque": ComputedTorque.from_model(model, tuning.gains.bandwidth),
    }


def _driven(env: TrackingEnv, law: Controller[Any] | None, seed: int) -> float:
    if law is not None:
        return float(rollout(env, law, seed=seed).reward.sum())
    env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, _ = env.step(np.zeros(env.plant.dof))
        total, over = total + reward, terminated or truncated
    return total
