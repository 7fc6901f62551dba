"""Checks before an arm is moved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import SafetyFilter
from adaptctl.control.adaptation.late_torques import MAX_DELAY
from adaptctl.control.controller import Controller, ReferencePoint
from adaptctl.control.gains.gain_design import largest_with_delay
from adaptctl.control.gains.sampling_ratio import sampling_ratios
from adaptctl.dynamics import Mechanism
from adaptctl.errors import GainError, InputError, StabilityWarning, validate_kind, warn
from adaptctl.hardware.measurements import Measurements
from adaptctl.hardware.preparation import hold_at, periods_late
from adaptctl.hardware.robot import HardwareLimits, RobotReading, validate_posture

GRAVITY_SHARE, MEASURED_SHARE = 0.1, 0.2
"""shares of a torque limit by which the estimate's gravity torque may differ from the one that the robot or its
description says, and from one that is measured, with friction"""
STILL = 0.02
"""rad/s (m/s) below which an arm stands still"""
READINGS, ATTEMPTS = 5, 50
"""number of sound readings before the loop, and of attempts to get them"""
OTHER_ROBOT = 5.0
"""ratio of torque limits above which the description is of another robot"""


def innermost(wrapped: Any) -> Any:
    """Law of a controller, or its state, within all wrappers."""
    while hasattr(wrapped, "inner"):
        wrapped = wrapped.inner
    return wrapped


def mechanism_of(controller: Any, given: Mechanism | None) -> Mechanism:
    """Mechanism that a controller is made for. Raises `InputError` where it does not say."""
    if given is not None:
        validate_kind(given, Mechanism, "mechanism", "as load(...) gives one")
        return given
    controller = innermost(controller)
    found = getattr(getattr(controller, "model", controller), "mechanism", None)
    if not isinstance(found, Mechanism):
        raise InputError(f"mechanism: {type(controller).__name__} does not say which arm it is for: give mechanism=")
    return found


def validate_periods(controller: Any, period: float) -> None:
    """Raise `InputError` if a controller was made for another period than the robot's."""
    own = getattr(controller, "control_period", None)
    if own is not None and abs(own - period) > 1e-3 * period:
        raise InputError(f"control_period: the controller's is {own:g} s, but the robot's is {period:g} s")


def validate_delay(controller: Any, robot: Any, p: Array) -> None:
    """Raise `GainError` if damping at p (r,) is too high for the delay that a robot states."""
    law = innermost(controller)
    damping: Any = getattr(law, "damping", None)
    model: Any = getattr(law, "model", None)
    delay = periods_late(robot)
    if not delay or model is None or np.shape(damping) != p.shape or not model.fundamental_parameters.any():
        return
    ratio, most = float(sampling_ratios(model.mechanism, p, damping, robot.period)), largest_with_delay(delay)
    if ratio > most:
        raise GainError(
            f"damping: T_c lambda_max(M^-1 K) = {ratio:.3g} is above {most:.3g}, the limit at a delay of {delay} "
            f"control periods, which the robot states: multiply the damping by {most / ratio:.2g} at most, or tune "
            f"with sampling_ratio={hold_at(delay):.2g}"
        )


def warn_of_delay(controller: Any, robot: Any) -> None:
    """Warn if a law learns as if torques came later, or earlier, than the robot states."""
    law, delay = innermost(getattr(innermost(controller), "adaptation_law", None)), min(periods_late(robot), MAX_DELAY)
    if (own := getattr(law, "delay", delay)) != delay:
        warn(
            f"adaptation: it learns as if torques came {own} control periods late, and the robot states {delay}: "
            f"estimates may ring up; give {type(law).__name__}, or ready_controller, delay={delay}",
            StabilityWarning,
        )


def common_limits(robot: Any, mechanism: Mechanism, controller: Any) -> HardwareLimits:
    """Narrowest limits of robot, description and safety filter. Raises `InputError` for another robot."""
    own, described = robot.limits, HardwareLimits.of(mechanism)
    if own.dof != mechanism.dof:
        raise InputError(f"robot: it has {own.dof} joints, but {mechanism.name} has {mechanism.dof}")
    names, told = [joint.name for joint in mechanism.primary_joints], getattr(robot, "joints", None)
    if told is not None and list(told) != names:
        raise InputError(f"robot: its joints are {', '.join(told)}, but those of {mechanism.name} {', '.join(names)}")
    if not np.isfinite(own.torque).all() and not np.isfinite(described.torque).all():
        raise InputError(f"robot: neither it nor {mechanism.name} has torque limits: give them in the description")
    known = np.flatnonzero(np.isfinite(own.torque) & np.isfinite(described.torque))
    ratio = own.torque[known] / described.torque[known]
    for j in known[np.maximum(ratio, 1.0 / ratio) > OTHER_ROBOT]:
        raise InputError(
            f"robot: the torque limit of {names[j]} is {own.torque[j]:g} N m (N), but {described.torque[j]:g} in "
            f"{mechanism.name}: is this the file of another robot?"
        )
    common: HardwareLimits = own.within(described)
    if isinstance(controller, SafetyFilter):
        inf = np.full(own.dof, np.inf)
        lower, upper = controller.position_limits or (-inf, inf)
        common = common.within(
            HardwareLimits(controller.torque_limits, controller.velocity_limits, lower, upper, controller.rate_limits)
        )
    return common


def standing(robot: Any, measurements: Measurements, names: Sequence[str], limits: HardwareLimits) -> RobotReading:
    """Reading of an arm that stands still within its limits. Raises `InputError` otherwise."""
    first, sound, fault = None, 0, ""
    moving: InputError | None = None
    for _ in range(ATTEMPTS):
        reading = measurements.taken(robot.read())
        fault = measurements.fault or fault
        if reading is not None:
            first, sound = first or reading, sound + 1
            try:
                _validate_rest(reading, first, names)
                validate_posture(reading.p, names, limits)
            except InputError as error:  # the first readings may be old ones, that waited
                first, sound, moving = None, 0, error
            if sound == READINGS:
                return reading
    if moving is not None:
        raise moving
    raise InputError(f"robot: {sound} of {ATTEMPTS} measurements were sound: {fault}")


def _validate_rest(reading: RobotReading, first: RobotReading, names: Sequence[str]) -> None:
    passed = reading.time - first.time
    moved = np.abs(reading.p - first.p) > STILL * passed + 1e-3
    for j in map(int, np.flatnonzero((np.abs(reading.v) > STILL) | moved)):
        raise InputError(f"robot: {names[j]} moves, at {reading.v[j]:.3g} rad/s (m/s): start at rest")


def torque_at_rest(controller: Controller[Any], p: Array) -> Array:
    """Torque (r,) by which a controller holds an arm at rest at p (r,): its estimate's gravity torque."""
    rest = np.zeros_like(p)
    torque, _ = controller.step(controller.init(p, rest), p, rest, ReferencePoint(p, rest, rest))
    return torque


def validate_gravity(own: Array, needed: Array, most: float, names: Sequence[str], limits: HardwareLimits) -> None:
    """Raise `InputError` if the controller's gravity torque is off by more than a share of the limits."""
    share = np.abs(own - needed) / limits.torque
    j = int(share.argmax())
    if share[j] > most:
        raise InputError(
            f"estimate: it holds {names[j]} with {own[j]:.3g} N m (N), but {needed[j]:.3g} are needed, "
            f"{share[j]:.0%} of the limit apart: start from the file's parameters, "
            "replace(controller, initial=controller.model.fundamental_parameters), or from a saved estimate"
        )
