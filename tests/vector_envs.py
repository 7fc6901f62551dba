"""Vector environments to compare with Gymnasium's own, arm by arm."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from every_effect import RIGID
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

from adaptctl.arrays import Array
from adaptctl.control import ReferencePoint
from adaptctl.envs import VectorTrackingEnv
from adaptctl.simulation.effects import PayloadHeld

PUMA, LOOP, ANY = (f"adaptctl/{name}Tracking-v0" for name in ("Puma560", "SemiDirectDrive", ""))
MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


def effects(payload: float = 1.0) -> list[Any]:
    """All that a plant of rigid joints has at once, with another payload (kg)."""
    return [PayloadHeld(payload, 0.02, 0.05) if isinstance(one, PayloadHeld) else one for one in RIGID]


def vector(name: str, arms: int, **settings: Any) -> VectorTrackingEnv:
    env = gymnasium.make_vec(name, num_envs=arms, vectorization_mode="vector_entry_point", **settings)
    assert isinstance(env, VectorTrackingEnv)
    return env


def one_by_one(name: str, arms: int, mode: AutoresetMode = AutoresetMode.NEXT_STEP, **settings: Any) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: gymnasium.make(name, **settings)] * arms, autoreset_mode=mode)


def agree(ours: Any, theirs: Any, where: str = "") -> None:
    """Equal to 1e-9, whatever is nested in what."""
    if isinstance(theirs, dict | tuple):
        pairs = theirs.items() if isinstance(theirs, dict) else enumerate(theirs)
        assert type(ours) is type(theirs)
        assert len(ours) == len(theirs), (where, ours, theirs)
        for key, value in pairs:
            agree(ours[key], value, f"{where}[{key}]")
    elif theirs.dtype == object:
        for own, other in zip(ours, theirs, strict=True):
            assert (own is None) == (other is None), where
            if other is not None:
                agree(own, other, where)
    else:
        assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape), where
        if theirs.dtype == float and np.all(np.abs(ours - theirs) < 1e-9):
            return  # a tenth of the time, a hundred thousand times
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9, err_msg=where)


def rows(told: Any, arms: list[int]) -> Any:
    """What is told of some arms."""
    if isinstance(told, dict):
        return {key: rows(value, arms) for key, value in told.items()}
    return tuple(rows(value, arms) for value in told) if isinstance(told, tuple) else told[arms]


def pushes(env: VectorEnv[Any, Any, Any], steps: int, share: float, seed: int = 0) -> Array:
    """Random torques (steps, N, r) of up to a share of the limits, held for a while."""
    space = env.action_space
    assert isinstance(space, gymnasium.spaces.Box)
    draws = np.random.default_rng(seed).uniform(-share, share, (steps // 7 + 1, *space.shape))
    return np.repeat(draws, 7, axis=0)[:steps] * space.high


def followed(ours: VectorTrackingEnv, theirs: Any, actions: Array, seed: Any = 3, **options: Any) -> int:
    """The same from both in all steps. Returns how many episodes ended."""
    agree(ours.reset(seed=seed, options=dict(options)), theirs.reset(seed=seed, options=dict(options)), "reset")
    ended = 0
    for k, action in enumerate(actions):
        result = ours.step(action)
        agree(result, theirs.step(action), f"step {k}: ")
        ended += int((result[2] | result[3]).sum())
    return ended


def point(observation: Array, env: Any) -> tuple[Array, Array, ReferencePoint]:
    p, v, *reference = (observation[..., env.observation_slices[name]] for name in ("p", "v", *REFERENCE))
    return p, v, ReferencePoint(*reference)


REFERENCE = ("reference_p", "reference_v", "reference_a")
