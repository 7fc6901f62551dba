"""Run at a robot, from checks to a planned stop."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.arrays import Array, positive_number
from adaptctl.control import SafetyFilter
from adaptctl.control.controller import Controller, Reference
from adaptctl.control.references import validate_reference
from adaptctl.control.wrench_torque import WrenchTorque
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError, validate_kind
from adaptctl.hardware.checks import (
    GRAVITY_SHARE,
    MEASURED_SHARE,
    common_limits,
    mechanism_of,
    standing,
    torque_at_rest,
    validate_delay,
    validate_gravity,
    validate_periods,
    warn_of_delay,
)
from adaptctl.hardware.compensation import Compensation
from adaptctl.hardware.driven_run import DrivenRun
from adaptctl.hardware.force_sensor import ForceSensor, force_flags, sensor_of, validate_felt
from adaptctl.hardware.gravity import GravityTorque
from adaptctl.hardware.interruptions import interruptions
from adaptctl.hardware.lead_in import led_in
from adaptctl.hardware.loop import DriveLoop
from adaptctl.hardware.measurements import Measurements
from adaptctl.hardware.resting import StoppingDistance
from adaptctl.hardware.robot import RobotReading, TorqueRobot, validate_robot
from adaptctl.hardware.touch_reaction import Reaction, touch_of, validate_reaction
from adaptctl.identification import learned_payload, mass_of_change
from adaptctl.recording import Live
from adaptctl.simulation import RunLogger
from adaptctl.stages import stage

MAX_ERROR = 0.3
"""rad (m)"""
TOUCH_FORCE = 10.0
"""N"""
MASS_SAMPLES = 400
"""number of times at which the motion is asked whether it tells a payload's mass"""


def drive(
    robot: TorqueRobot,
    controller: Controller[Any],
    reference: Reference,
    duration: float,
    log: RunLogger | str | Path | None = None,
    *,
    lead_in: float | None = None,
    max_error: float = MAX_ERROR,
    from_zero: bool = False,
    mechanism: Mechanism | None = None,
    live: Live | None = None,
    on_touch: Reaction = "stop",
    touch_force: float = TOUCH_FORCE,
) -> DrivenRun:
    """
    Drive a robot along a reference, from where it stands to a planned stop.

    Parameters
    ----------
    robot : TorqueRobot
        Robot with r joints: an adapter of `adaptctl.hardware`, or any object with its attributes and methods.
    controller : Controller
        Controller for the robot's control period.
    reference : Reference
        Trajectory to follow. It is joined from the arm's posture by minimum jerk.
    duration : float
        Time in s for which the reference is followed, lead-in included; the planned stop comes after it.
    log : RunLogger or str or Path, optional
        Log of the run, or the Parquet file for one. Default: in memory, in the result.
    lead_in : float, optional
        Time in s after which the reference is followed exactly. Default: the shortest of 3 to 20 s within the limits.
    max_error : float, default 0.3
        Tracking error in rad (m) of a joint at which the arm is stopped.
    from_zero : bool, default False
        True to drive an arm whose estimate does not hold it against gravity: it sinks until the estimate has learned.
    mechanism : Mechanism, optional
        Description of the robot. Default: that of the controller.
    live : Live, optional
        Live view of the run. Default: none.
    on_touch : {"ignore", "stop", "comply", "retract"}, default "stop"
        Reaction to external torques above their levels, of a controller `with_external_torque`: stop on the path, and
        go back 1 s of it from what is still felt 0.3 s later, as it is clamped; yield until nothing was felt for 1 s,
        and stop there; or go back 1 s of the path at once; "ignore" follows the path, without learning. Stopping is the
        default, as what was not expected may be a person.
    touch_force : float, default 10.0
        Force in N, beyond that at rest, which is a touch, if the robot has a force sensor.

    Returns
    -------
    DrivenRun
        Run, its times, and why it was stopped, if it was.

    Raises
    ------
    InputError
        If the robot is another one than described, moves, stands outside its limits, would not be held by the
        estimate, the reference leaves the limits, a force sensor is silent, late or changes at rest, or a controller
        needs a measured force that the robot does not give. No torque was sent then.
    GainError
        If the damping is too high for the delay that the robot states. No torque was sent then.
    SingularityError
        If the loops come near a singularity at the start or along the reference. No torque was sent then.
    KeyboardInterrupt
        If Ctrl-C was pressed: before the first torque, or after the planned stop, with the run as argument. A second
        Ctrl-C is the robot's own stop.

    Warns
    -----
    StabilityWarning
        If the adaptation has another `delay` than the robot states.

    Notes
    -----
    Torques stay within the limits and 95 % of the rate limits from the first one on, which starts from the torque that
    holds the arm. Nothing is learned while torques are blended in or limited, measurements missing or late, or the arm
    stopped. *Switch it on* in the documentation says what each stop means. No real arm has been driven yet.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from adaptctl.hardware import MuJoCoRobot
    >>> robot = MuJoCoRobot(arm, control_period=law.control_period, start=p)
    >>> start = replace(law, initial=law.model.fundamental_parameters)
    >>> run = adaptctl.drive(robot, start, reference, duration=0.1)
    >>> run.stopped
    ''
    """
    validate_robot(robot)
    validate_kind(controller, Controller, "controller", "as adaptive_controller(...) gives one")
    seconds = positive_number(duration, "duration: expected a positive time in s")
    greatest = positive_number(max_error, "max_error: expected a positive error in rad")
    force = positive_number(touch_force, "touch_force: expected a positive force in N")
    validate_reference(reference)
    arm = mechanism_of(controller, mechanism)
    validate_periods(controller, robot.period)
    validate_reaction(on_touch, controller)
    limits = common_limits(robot, arm, controller)
    guarded = controller if isinstance(controller, SafetyFilter) else _filtered(controller, robot.period)
    guarded.compile()
    stopping = StoppingDistance(arm, limits, robot.period)
    gravity, names = GravityTorque(arm), [joint.name for joint in arm.primary_joints]
    measurements = Measurements(arm.primary_joints, limits, robot.period, np.asarray(reference(0.0).p))
    now = standing(robot, measurements, names, limits)
    if (sensor := sensor_of(robot, force)) is not None:
        sensor.rest()
        now = standing(robot, measurements, names, limits)
    validate_felt(guarded, sensor, arm)
    path = led_in(reference, now.p, seconds, arm, limits, stopping, lead_in)
    tool = getattr(robot, "tool", None)
    weight = gravity if tool is None or hasattr(robot, "compensation") else GravityTorque(arm, tool)
    compensation = Compensation(robot, weight, bool(np.any(arm.description.gravity)))
    validate_delay(controller, robot, now.p)
    warn_of_delay(controller, robot)
    own = torque_at_rest(guarded, now.p)
    if not from_zero:
        needed, most = _held(robot, now, compensation, gravity)
        validate_gravity(own, needed, most, names, limits)
    mass_row = _mass_row(guarded, path, seconds)
    logger = _log(log, guarded, arm, robot.period, seconds, mass_row is not None, sensor)
    loop = DriveLoop(robot, guarded, path, seconds, arm, limits, stopping, measurements, gravity, compensation)
    loop.log, loop.live, loop.max_error, loop.on_touch = logger, live, greatest, on_touch
    loop.mass_row, loop.sensor = mass_row, sensor
    if sensor is not None and sensor.point is not None and loop.held_state.feels and arm.is_plain_tree:
        loop.wrench_torque = WrenchTorque(arm)
    with interruptions(loop.interrupt), nullcontext() if logger is log else logger:
        with stage(loop):
            loop.run(now, own, gravity(now.p) if from_zero else own)
        run = _uninterrupted(loop, _result(loop, robot))
    return _uninterrupted(loop, run)


def _uninterrupted(loop: DriveLoop, run: DrivenRun) -> DrivenRun:
    """Run, unless Ctrl-C was pressed: `KeyboardInterrupt` then has it."""
    if loop.interrupted:
        raise KeyboardInterrupt(run)
    return run


def _result(loop: DriveLoop, robot: TorqueRobot) -> DrivenRun:
    run = loop.log.rollout(loop.interrupted) if loop.log.count >= 2 else None
    numbers = loop.first_error, loop.peak_rate, loop.peak_speed_share
    compensates, touches = bool(robot.compensates_gravity), tuple(loop.feeling.events)
    payload = learned_payload(loop.controller, loop.learned)
    bias = None if loop.sensor is None else loop.sensor.bias
    return DrivenRun(run, loop.times, loop.stopped, loop.by_robot, *numbers, compensates, touches, payload, bias)


def _mass_row(controller: SafetyFilter, path: Reference, duration: float) -> Array | None:
    """Row (k,) of a payload's mass by changes of the estimate, where the motion tells it."""
    times = np.linspace(0.0, duration, MASS_SAMPLES)
    point = path(times)
    return mass_of_change(controller, point.p, point.v, point.a, duration / MASS_SAMPLES)


def _held(robot: Any, now: RobotReading, compensation: Compensation, gravity: GravityTorque) -> tuple[Array, float]:
    """Torque (r,) that holds the arm, and the share of the limits by which an estimate may differ."""
    if robot.compensates_gravity:
        return compensation(now), GRAVITY_SHARE
    if now.torque is None or getattr(robot, "has_brakes", False):
        return gravity(now.p), GRAVITY_SHARE
    return now.torque, MEASURED_SHARE


def _filtered(controller: Controller[Any], period: float) -> SafetyFilter:
    """Controller whose numbers are watched; limits are the loop's."""
    damping = None if getattr(controller, "damping", None) is not None else 0.0
    return SafetyFilter(controller, stop_damping=damping, freeze=False, control_period=period)


def _log(
    log: RunLogger | str | Path | None, controller: SafetyFilter, arm: Mechanism, period: float, duration: float,
    tells_mass: bool, sensor: ForceSensor | None,
) -> RunLogger:  # fmt: skip
    """Logger of a run, for a file unless one is given."""
    if isinstance(log, RunLogger):
        return log
    if log is not None and not isinstance(log, str | Path):
        raise InputError(f"log: expected a RunLogger or a path, got {log!r}")
    names = tuple(joint.name for joint in arm.primary_joints)
    units = tuple(joint.kind.position_unit for joint in arm.primary_joints)
    first = _first_state(controller, arm)
    estimates = np.size(getattr(first, "estimate", ()))
    flags = ("learning", "stopping", *(f"compensation.{n}" for n in names), *(f"reported_torque.{n}" for n in names))
    feels = touch_of(first) is not None
    if feels or sensor is not None:
        torques = (f"external_torque.{n}" for n in names) if feels else ()
        flags = (*flags, "touched", *torques, *force_flags(sensor))
    if tells_mass:
        flags = (*flags, "payload_mass")
    capacity = min(int(duration / period) + 20_000, 2_000_000)
    return RunLogger(
        arm.dof, period, log, estimates=estimates, capacity=capacity, joints=names, position_units=units, flags=flags
    )


def _first_state(controller: SafetyFilter, arm: Mechanism) -> Any:
    return controller.inner.initial_state(controller.neutral_configuration, np.zeros(arm.dof))
