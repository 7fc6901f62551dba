"""Control laws by name."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptiveComputedTorque,
    Composite,
    ComputedTorque,
    Controller,
    PassivityIntegral,
    PDGravity,
    SafetyFilter,
    SlotineLi,
    TaskSpaceSlotineLi,
    adaptation_gain,
)
from adaptctl.errors import NotFoundError, suggested_name
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.tune import Tuning

LAWS = (
    "slotine-li",
    "slotine-li-learning",
    "slotine-li-fixed",
    "slotine-li-composite",
    "passivity-integral",
    "task-space",
    "adaptive-computed-torque",
    "computed-torque",
    "pd-gravity",
)
TORQUE_NOISE = 0.01  # of the torque limits: error of torques predicted over a second
SPEED_MARGIN = 1.5  # over the reference's greatest speed, for joints without a velocity limit
MIN_SPEED_LIMIT = 2.0  # rad/s (m/s)


def named_law(law: str, tuning: Tuning, model: ReducedModel) -> Controller[Any]:
    """Control law of this name. Raises `NotFoundError` for another."""
    if law not in LAWS:
        raise NotFoundError(f"law: unknown law {law!r}{suggested_name(law.lower(), LAWS)}; laws: {', '.join(LAWS)}")
    gains, period, mechanism = tuning.gains, tuning.control_period, tuning.mechanism
    gain, true = adaptation_gain(model, gains=gains, control_period=period), model.fundamental_parameters
    shared: dict[str, Any] = {
        "control_period": period,
        "workspace": tuning.workspace,
        "torque_limits": tuning.torque_limits,
    }
    match law:
        case "slotine-li":
            return SlotineLi(model, gains.bandwidth, gains.damping, gain, **shared)
        case "slotine-li-learning":
            return tuning.controller(model, "learning", anyway=True)
        case "slotine-li-fixed":
            return SlotineLi(model, gains.bandwidth, gains.damping, None, true, **shared)
        case "slotine-li-composite":
            weight = 1.0 / (TORQUE_NOISE * tuning.torque_limits) ** 2
            return SlotineLi(model, gains.bandwidth, gains.damping, Composite(gain, weight), **shared)
        case "passivity-integral":
            return PassivityIntegral(model, gains.bandwidth, gains.damping, gain, **shared)
        case "task-space":
            slowest = float(np.min(gains.bandwidth))
            joints: dict[str, Any] = {"reference_in_joints": True, "singularity": 0.05}
            return TaskSpaceSlotineLi(model, slowest, gains.damping, gain, **joints, **shared)  # type: ignore[arg-type]
        case "adaptive-computed-torque":
            limits = tuning.torque_limits
            return AdaptiveComputedTorque(
                model, gains.bandwidth, true, gain, control_period=period, torque_limits=limits
            )
        case "computed-torque":
            return ComputedTorque.from_model(model, gains.bandwidth)
        case _:
            return PDGravity(mechanism, gains.bandwidth * gains.damping, gains.damping)


def guarded(law: Controller[Any], tuning: Tuning) -> SafetyFilter:
    """Safety filter with the mechanism's limits."""
    joints = [joint.limits for joint in tuning.mechanism.primary_joints]
    speed = np.array([limits.velocity for limits in joints])
    asked = np.abs(tuning.reference(np.linspace(0.0, 20.0, 400)).v).max(axis=0)
    found: Array = np.where(np.isfinite(speed), speed, np.maximum(MIN_SPEED_LIMIT, SPEED_MARGIN * asked))
    lower, upper = np.array([limits.lower for limits in joints]), np.array([limits.upper for limits in joints])
    return SafetyFilter(
        law,
        tuning.torque_limits,
        stop_damping=tuning.gains.damping,
        control_period=tuning.control_period,
        position_limits=(lower, upper),
        velocity_limits=found,
    )
