"""Rule of the default learning law."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array
from adaptctl.control import GuardedLearning, LeakyIntegral, SlotineLi, mapped_gain
from adaptctl.control.controller import Reference
from adaptctl.control.excitation.torque_uncertainty import TORQUE_ERROR_SHARE
from adaptctl.control.gains.workspace import Workspace
from adaptctl.control.leaky_integral import MAX_RATE
from adaptctl.identifiability import ReducedModel
from adaptctl.tuning.default_gains import HORIZON, prior_ranges
from adaptctl.tuning.feasible_reference import coulomb_friction

FRICTION_ERROR_SHARE = 0.03
"""share of a file's Coulomb friction within which a joint's friction is known at best"""
SPEED_NOISE = 3.3e-3
"""rad/s (m/s): times the damping it is a torque error, which matters where limits are far above the loads"""
MIN_SPEED, MIN_SPEED_SHARE = 0.05, 0.15
"""rad/s (m/s), and share of the reference's greatest speed, below which friction at rest is met"""
SLOWEST = 0.02
"""rad/s that turning joints reach at least, if they move at all: what is slower shows the noise of its speed"""
SPEED_SAMPLES = 400
"""times at which the reference's speeds are read"""
PRIOR_RANGES = 10.0
"""prior ranges of every parameter beyond which no estimate is plausible; on the way ordinary ones exceed three"""
STEP_SHARE = 0.5
"""share of a torque limit by which an update may change a torque; 0.3 was seen after a push"""
MAX_LEARNED = 100
"""parameters up to which learning is the default; its time grows as their square, its compilation to minutes"""


def slotine_li(
    model: ReducedModel, bandwidth: Array, damping: Array, law: Any, initial: Array | None, control_period: float,
    workspace: Workspace | None, limits: ArrayLike | None,
) -> SlotineLi:  # fmt: skip
    """Controller with an adaptation law, and beside one that remembers an integral for what changes faster."""
    shared = model, bandwidth, damping, law, initial, control_period, workspace, limits
    if not isinstance(law, GuardedLearning):
        return SlotineLi(*shared)
    fastest = MAX_RATE / ((1 + law.delay) * control_period)
    rate = min(LeakyIntegral.integral_rate, fastest)
    return LeakyIntegral(*shared, integral_rate=rate, added_rate=fastest - rate)


def learning_by_rule(
    model: ReducedModel,
    gain: Array,
    torque_limits: Array,
    damping: Array,
    control_period: float,
    reference: Reference,
    delay: int = 0,
) -> GuardedLearning:
    """Learning law of a model with the diagonal of a gain (k, k), for torque limits and damping (r,) each."""
    speeds = np.abs(reference(np.linspace(0.0, HORIZON, SPEED_SAMPLES)).v).max(axis=0)
    turns = np.array([joint.kind.is_revolute for joint in model.mechanism.primary_joints])
    least = np.where(turns & (speeds < SLOWEST), MIN_SPEED, np.minimum(MIN_SPEED, MIN_SPEED_SHARE * speeds))
    recall, cutoff = (min(x, 0.5 / control_period) for x in (GuardedLearning.recall, GuardedLearning.cutoff))
    sigma = np.maximum(torque_error(torque_limits, damping), FRICTION_ERROR_SHARE * coulomb_friction(model.mechanism))
    more: dict[str, Any] = {"bound": farthest(model, np.diag(gain)), "torque_step": STEP_SHARE * torque_limits}
    more |= {"cutoff": cutoff, "recall": recall, "min_speed": least, "delay": delay}
    return GuardedLearning(np.diag(gain), 1.0 / sigma**2, **more)


def farthest(model: ReducedModel, gain: Array) -> float:
    """Distance, in units of a gain (k,), from zero to a corner of the box of ten prior ranges."""
    squared = np.diag(mapped_gain(model, prior_ranges(model.mechanism) ** 2))
    return PRIOR_RANGES * float(np.sqrt((squared / gain).sum()))


def torque_error(limits: Array, damping: Array) -> Array:
    """Errors sigma (r,) of torques in N m (N)."""
    return np.asarray(np.minimum(TORQUE_ERROR_SHARE * limits, SPEED_NOISE * damping))
