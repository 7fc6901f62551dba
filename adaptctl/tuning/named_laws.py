"""Control laws by name, with the gains that a tuning found, behind guards that the mechanism's limits make."""

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
from adaptctl.errors import NotFoundError
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.tune import Tuning

LAWS = (
    "slotine-li",
    "slotine-li-fixed",
    "slotine-li-composite",
    "passivity-integral",
    "task-space",
    "adaptive-computed-torque",
    "computed-torque",
    "pd-gravity",
)
TORQUE_NOISE = 0.01
"""share of the torque limits that predicted torques of `slotine-li-composite` are taken to miss by in a second"""
WIDER = 1.5
"""times the reference's greatest speed, the speed at which guards stop a joint that states none"""
SLOWEST = 2.0
"""rad/s or m/s: no joint is stopped below"""


def named_law(law: str, tuning: Tuning, model: ReducedModel) -> Controller[Any]:
    """The control law of the name `law`, a `Controller`, with the gains, control period and torque limits of a
    `tuning`, on a reduced `model` of the tuning's mechanism.

    Names are "slotine-li", "slotine-li-fixed" (true parameters, no adaptation), "slotine-li-composite" (learning from
    predicted torques too), "passivity-integral", "task-space" (its reference given in joints),
    "adaptive-computed-torque", "computed-torque" and "pd-gravity". The tuning's bandwidth is computed torque's natural
    frequency, PD's stiffness is bandwidth times damping, and in task space the least bandwidth is that of every axis.
    Laws that adapt start from zero parameters, except adaptive computed torque, which starts from the true ones;
    "computed-torque" and "pd-gravity" use the true ones. Raises `NotFoundError` for another name, and what the law's
    class raises, such as `GainError` where the gains are too large for the period.
    """
    if law not in LAWS:
        raise NotFoundError(f"law: unknown law {law!r}; laws: {', '.join(LAWS)}")
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
            return ComputedTorque.on(model, gains.bandwidth)
        case _:
            return PDGravity(mechanism, gains.bandwidth * gains.damping, gains.damping)


def guarded(law: Controller[Any], tuning: Tuning) -> SafetyFilter:
    """The control law `law` behind guards, a `SafetyFilter`: its torques are limited to the torque limits of a
    `tuning`, and it brakes the arm, with the tuning's damping, where a joint is outside the mechanism's position limits
    or too fast. Too fast is faster than the joint's velocity limit or, where that is infinite or 0, than the greater of
    2 rad/s (m/s if prismatic) and 1.5 times its reference's greatest speed in the first 20 s. Raises `InputError` for
    settings that `SafetyFilter` refuses, such as two equal position limits of a joint."""
    joints = [joint.limits for joint in tuning.mechanism.primary_joints]
    speed = np.array([limits.velocity for limits in joints])
    asked = np.abs(tuning.reference(np.linspace(0.0, 20.0, 400)).v).max(axis=0)
    found: Array = np.where(np.isfinite(speed) & (speed > 0.0), speed, np.maximum(SLOWEST, WIDER * asked))
    lower, upper = np.array([limits.lower for limits in joints]), np.array([limits.upper for limits in joints])
    return SafetyFilter(
        law,
        tuning.torque_limits,
        stop_damping=tuning.gains.damping,
        control_period=tuning.control_period,
        position_limits=(lower, upper),
        velocity_limits=found,
    )
