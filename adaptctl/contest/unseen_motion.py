"""Torques that an estimate predicts on a motion that its law was not run on."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.contest.scene import Scene
from adaptctl.control import Controller
from adaptctl.identifiability import ReducedModel

UNSEEN = 20_000
"""added to a seed, which then draws another motion of the same family"""
TIMES = np.linspace(0.0, 20.0, 201)
"""s at which torques are compared"""


def unseen_torque_error(scene: Scene, law: Controller[Any], estimate: Array, truth: Array, seed: int) -> float:
    """RMS torque error of an estimate (k,) over the torque of the truth (P,); NaN of a law without estimates."""
    model: ReducedModel | None = getattr(law, "model", None)
    if model is None or estimate.shape != (len(model.columns),):
        return float("nan")
    motion = scene.reference(seed + UNSEEN)(TIMES)
    shares = model.slotine_li_regressor(motion.p, motion.v, motion.v, motion.a) / scene.tuning.torque_limits[:, None]
    own = model.regrouping @ truth
    return float(np.linalg.norm(shares @ (estimate - own)) / np.linalg.norm(shares @ own))
