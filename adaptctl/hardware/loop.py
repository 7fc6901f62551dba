"""Loop of control periods at a robot."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control import HeldState, SafetyFilter
from adaptctl.control.controller import Reference, ReferencePoint
from adaptctl.control.minimum_jerk import quintic
from adaptctl.control.ringing import correlation
from adaptctl.control.transitions import point_at
from adaptctl.control.wrench_torque import WrenchTorque
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.joint_units import error_unit
from adaptctl.errors import NonFiniteError
from adaptctl.hardware.acceleration import PossibleAcceleration
from adaptctl.hardware.checks import innermost
from adaptctl.hardware.compensation import Compensation
from adaptctl.hardware.force_sensor import ForceSensor, logged
from adaptctl.hardware.gravity import GravityTorque
from adaptctl.hardware.interruptions import ignore_interruptions, tell_of_stop
from adaptctl.hardware.measurements import Measurements
from adaptctl.hardware.resting import StoppingDistance
from adaptctl.hardware.robot import HardwareLimits, RobotReading
from adaptctl.hardware.stop import HOLD, PATIENCE, PlannedStop
from adaptctl.hardware.timing import LoopTimes, without_collections
from adaptctl.hardware.torque_guard import TorqueGuard
from adaptctl.hardware.touch_reaction import Feeling, Reaction, touch_of, yielding
from adaptctl.recording import Live
from adaptctl.scalars import Column
from adaptctl.simulation import RunLogger

RAMP = 0.2
"""s in which what the torque that holds the arm has beyond the controller's fades"""
BLIND = 10
"""periods in a row without a sound measurement, after which the robot's own stop is asked for"""
LATE = 20
"""periods in a row that may come late before the arm is stopped"""
PROVEN = 0.25
"""s of good tracking after which an estimate is kept for a stop"""
GOOD_SHARE = 0.2
"""share of the largest error within which tracking is good"""
QUIET_SHARE = 0.05
"""share of the torque limits that feedback may add to a good estimate"""
REST = 0.05
"""rad/s (m/s) below which a stopped arm is handed back"""
TOUCHED = "touched:"
"""beginning of a reason to stop that is a touch"""
TOO_FAST = "is above its speed limit"
"""end of a reason for which the path is left, since the arm does not follow it"""
SAG, SAG_TIME = 1e-3, 0.05
"""rad (m) by which an arm may sink within so many s after its brakes opened"""
HAND_BACK = 0.2
"""s in which torques fall to zero where the arm holds itself"""


class DriveLoop:
    """Control loop of one run: read, check, step, limit, write, log."""

    log: RunLogger
    live: Live | None = None
    max_error: float = 0.3
    on_touch: Reaction = "ignore"
    sensor: ForceSensor | None = None
    wrench_torque: WrenchTorque | None = None
    mass_row: Array | None = None  # (k,), of a payload's mass in kg by changes of the estimate

    def __init__(
        self, robot: Any, controller: SafetyFilter, path: Reference, duration: float, arm: Mechanism,
        limits: HardwareLimits, stopping: StoppingDistance, measurements: Measurements, gravity: GravityTorque,
        compensation: Compensation,
    ) -> None:  # fmt: skip
        self.robot, self.controller, self.path, self.duration = robot, controller, path, duration
        self.limits, self.stopping, self.measurements = limits, stopping, measurements
        self.gravity, self.compensation = gravity, compensation
        self.moving = PossibleAcceleration(stopping.inverses, robot.period)
        self.names, self.error_unit = [joint.name for joint in arm.primary_joints], error_unit(arm)
        self.times, self.held_state = LoopTimes(robot.period), HeldState(controller)
        self.feeling = Feeling(self.names)
        self.time, self.blind, self.good, self._logged = 0.0, 0, 0.0, -1.0
        self.stop: PlannedStop | None = None
        self.stopped, self.by_robot, self.interrupted, self.ended = "", False, False, False
        self.moves = False
        self.peak_rate, self.peak_speed_share, self.first_error, self.worst_error = 0.0, 0.0, 0.0, 0.0

    def __str__(self) -> str:
        doing = "stopping" if self.stop is not None else f"driving, {self.time:.0f} of {self.duration:g} s"
        return f"{doing}, worst error {1e3 * self.worst_error:.3g} {self.error_unit}"

    def run(self, now: RobotReading, own: Array, held: Array) -> None:
        """Run to the end or a stop, from the controller's torque at rest (r,) and one that holds the arm (r,)."""
        with without_collections():
            try:
                self._start(now, own, held)
                while not self.ended:
                    self._tick()
            except KeyboardInterrupt:
                if not self.moves:
                    raise
                ignore_interruptions()
                self._robot_stops("Ctrl-C was pressed twice" if self.interrupted else "the program was told to end")
                self.interrupted = True
            except BaseException:  # whatever it was, the arm must not go on with its last torque
                self._robot_stops("an error in the program")
                raise

    def _start(self, now: RobotReading, own: Array, model: Array) -> None:
        added, rest = self.compensation(now), np.zeros_like(now.p)
        braked = getattr(self.robot, "has_brakes", False)
        held = model - added if braked or now.torque is None else now.torque
        self.guard = TorqueGuard(self.limits, self.robot.period, held)
        self.offset = self.guard.torque + added - own
        self.state = self.controller.init(now.p, rest, torque=self.guard.torque + added)
        self.learned, self._first_estimate, self.applied = self.state, self._estimate, self.guard.torque + added
        self.proven, self._began, self.start_p = self._described(self.state), now.time, now.p
        self._holds = braked and not self.robot.compensates_gravity  # which else has a payload that may sink
        if self.interrupted:
            raise KeyboardInterrupt
        self.moves = True
        getattr(self.robot, "start", _nothing)(self.guard.torque)

    def _tick(self) -> None:
        reading, sound = self._read()
        if self.ended:
            return
        since = time.perf_counter()
        if self.sensor is not None:
            self.sensor.take(reading.time)
        if not self.blind:
            self.moving.take(reading, self.guard.torque)
        point = self._point(reading)
        trouble = self._trouble(reading, point)
        if self.ended:
            return
        if trouble and (self.stop is None or self.stop.yields):
            self._begin_stop(trouble, reading, point)
            point = self._point(reading)
        elif self.stop is not None and self.stop.feels and self.feeling.clamps(self.stop.end, self.time):
            self._free(self.stop)
        added = self.compensation(reading)
        total, after = self._torque(reading, point)
        wanted, before = total - added, self.guard.torque
        sent = self.guard.limited(wanted)
        self._write(sent)
        self.times.answered(since)
        self._note(reading, point, before, sent)
        after = after if sound else self.held_state.unsettled(after)
        self._learn(after, sent + added, sound and np.array_equal(sent, wanted), reading, point)
        self._record(reading, point, total, sent + added, added)
        self._finish(reading)

    def _read(self) -> tuple[RobotReading, bool]:
        """Sound reading, or the expected one in its place; and whether it may be learned from."""
        last, reading = self.measurements.latest, None
        try:
            reading = self.measurements.taken(self.robot.read())
        except Exception as error:  # a vendor's client may raise anything: the page says how long that is ridden out
            self.measurements.fault = f"{type(error).__name__}: {error}"
            time.sleep(self.robot.period)
        before = self.time if last is None else last.time - self._began
        if reading is None:
            self.blind += 1
            self.time += self.robot.period
            if self.blind > BLIND:
                self._robot_stops(f"{self.blind} periods without a sound measurement: {self.measurements.fault}")
            return self.measurements.expected(self._began + self.time), False
        passed, was_blind, self.blind = reading.time - self._began - before, self.blind > 0, 0
        on_time = self.times.count(passed)
        if passed > BLIND * self.robot.period:
            self._began = reading.time - self.time - self.robot.period
        self.time = max(self.time, reading.time - self._began)
        return reading, on_time and not was_blind

    def _point(self, reading: RobotReading) -> ReferencePoint:
        if self.stop is not None and self.stop.yields:
            return yielding(reading.p, reading.v)
        return point_at(self.path if self.stop is None else self.stop.path, self.time)

    def _unsound(self) -> str:
        """Reason why the safety filter stopped."""
        detector, flags = self.state.ringing, self.state.flags
        if not flags.ringing[0]:
            return "a number of the controller is not finite"
        worst = self.names[int(np.argmin(correlation(Column(detector.lag_product), Column(detector.power)).of))]
        return (
            f"{worst} rings: its gains are too high for its inertia; give the rotor inertia in the robot's file, or a "
            "smaller amplitude"
        )

    def _trouble(self, reading: RobotReading, point: ReferencePoint) -> str:
        """Reason for a stop; empty if there is none."""
        if self.time >= self.duration:
            return "done"
        if self.interrupted:
            return "interrupted"
        if self.sensor is not None and self.sensor.failed:
            return self.sensor.failed
        if self.on_touch != "ignore" and self.stop is None and self.feeling.touched:
            return f"{TOUCHED} {self.feeling.events[-1]}"
        if self.stop is not None and self.stop.yields and self.feeling.over(self.time):
            return self.stop.reason
        if self.state.flags.stopped[0]:
            return self._unsound()
        if self.times.late > LATE:
            return f"{self.times.late} periods in a row came late: use a real-time kernel, or a longer period"
        if self.time < SAG_TIME and self._holds and (np.abs(reading.p - self.start_p) > SAG).any():
            self._robot_stops("the arm sagged when its brakes opened")
        for mask, text in (
            (np.abs(reading.v) > self.limits.velocity, TOO_FAST),
            (self._nears_an_end(reading), "comes too near to the end of its range"),
            (np.abs(reading.p - point.p) > self.max_error, f"is {self.max_error:g} rad (m) off the reference"),
        ):
            if mask.any():
                return f"{self.names[int(mask.argmax())]} {text}"
        return ""

    def _nears_an_end(self, reading: RobotReading) -> Array:
        """Mask (r,) of joints that a stop would take beyond their range."""
        weight = 0.0 if self.robot.compensates_gravity else self.gravity(reading.p)
        acceleration = self.moving.along(reading.v, self.guard.torque)
        return self.stopping.beyond(reading.p, reading.v, self.guard.torque - weight, acceleration)

    def _begin_stop(self, reason: str, reading: RobotReading, point: ReferencePoint) -> None:
        if reason.startswith(TOUCHED) and self.stop is None and self.on_touch != "stop":
            self._react(reason, point)
            return
        if self.stop is None:
            self.learned = self.state
        feels = reason.startswith(TOUCHED)
        state = self._proven_feeling() if feels else self.held_state.at(self.proven, self.state)
        near = (np.abs(reading.p - point.p) <= 0.5 * self.max_error).all()
        ends = self._nears_an_end(reading).any()
        if near and self.stop is None and not ends and not reason.endswith(TOO_FAST):
            self.stop = PlannedStop.along(self.path, self.time, point.v, state, reason, self.stopping)
        else:
            self.stop = PlannedStop.ahead(reading.p, self.time, reading.v, state, reason, self.stopping)
        self.stop, self._speed = replace(self.stop, feels=feels), point.v
        self.stopped = self.stopped or ("" if reason == "done" else reason)

    def _proven_feeling(self) -> Any:
        """State of now, which still feels, with the estimate that has proven good."""
        return self.held_state.with_estimate(self.state, np.asarray(innermost(self.proven).estimate))

    def _free(self, stop: PlannedStop) -> None:
        """Go back from what is clamped."""
        self.stop = stop.retreat(self.time, self._speed, self.stopping)
        self.stopped = self.stop.reason

    def _react(self, reason: str, point: ReferencePoint) -> None:
        """Retract or yield, with the estimate of now, which was trusted before the touch."""
        if self.on_touch == "comply":
            self.stop = PlannedStop(self.path, np.inf, self.state, reason, yields=True)
        else:
            state = self.held_state.at(self.proven, self.state)
            self.stop = PlannedStop.back(self.path, self.time, point.v, state, reason, self.stopping)
        self.stopped = reason

    def _torque(self, reading: RobotReading, point: ReferencePoint) -> tuple[Array, Any]:
        """Torque (r,) for the arm, and the controller's next state."""
        if self.stop is not None:
            state = self._told(self.held_state.without_learning(self.stop.state, self.applied), reading)
            torque, after = self.controller.step(state, reading.p, reading.v, point)
            if after.flags.stopped[0] or (np.abs(reading.p - point.p) > self.max_error).any():
                self._robot_stops(f"{self.stop.reason}; and the planned stop failed")
            if not (self.stop.yields or self.stop.feels):
                after = self.held_state.at(self.stop.state, after)
            self.stop = replace(self.stop, state=after)
            return torque, after
        try:
            torque, after = self.controller.step(self._told(self.state, reading), reading.p, reading.v, point)
        except NonFiniteError:
            self._begin_stop("the estimate is not finite", reading, point)
            return self._torque(reading, self._point(reading))
        if self.time < RAMP:
            torque = torque + (1.0 - _risen(self.time / RAMP)) * self.offset
        return torque, after

    def _told(self, state: Any, reading: RobotReading) -> Any:
        """State that knows the torques of a measured wrench, where its point is known."""
        if self.wrench_torque is None or self.sensor is None or self.sensor.point is None:
            return state
        external = self.wrench_torque(reading.p, self.sensor.wrench, self.sensor.point)
        return self.held_state.feeling(state, self.applied, external)

    def _write(self, sent: Array) -> None:
        if self.ended:
            return
        try:
            self.robot.write(sent)
        except Exception as error:  # of a vendor's client, whatever it is
            self._robot_stops(f"the robot refused a torque: {type(error).__name__}: {error}")

    def _learn(self, after: Any, applied: Array, sound: bool, reading: RobotReading, point: ReferencePoint) -> None:
        """Keep the next state, and an estimate that has proven good."""
        self.applied = applied
        if self.stop is None or self.stop.yields or self.stop.feels:
            self.feeling.feel(after, self.time, self.sensor)
        pressed = self.sensor is not None and self.sensor.pressed > 0.0 and self.wrench_torque is None
        self.learning = sound and self.stop is None and self.time >= RAMP and not pressed
        self.state = after if self.learning else self.held_state.without_learning(after, applied)
        if self.stop is not None:
            return
        near = (np.abs(reading.p - point.p) < GOOD_SHARE * self.max_error).all() and self._is_quiet()
        self.good = self.good + self.robot.period if near and sound else 0.0
        if self.good >= PROVEN and not self.state.flags.stopped[0]:
            self.proven = self.state

    def _is_quiet(self) -> bool:
        """True if the model explains nearly all of the torque."""
        s, damping = getattr(self.state.inner, "s", None), getattr(self.controller.inner, "damping", None)
        if s is None or damping is None:
            return True
        return bool((np.abs(damping * s) <= QUIET_SHARE * self.guard.limits).all())

    def _described(self, state: Any) -> Any:
        """State with the description's parameters, which a stop uses until an estimate has proven good."""
        model = getattr(self.controller.inner, "model", None)
        own = None if model is None else model.fundamental_parameters
        return state if own is None or not own.any() else self.held_state.with_estimate(state, own)

    def _note(self, reading: RobotReading, point: ReferencePoint, before: Array, sent: Array) -> None:
        error = float(np.abs(reading.p - point.p).max())
        if self.times.histogram.sum() <= 1:
            self.first_error = error
        self.worst_error = max(self.worst_error, error)
        change: Array = np.abs(sent - before)
        self.peak_rate = max(self.peak_rate, float(change.max()) / self.robot.period)
        share = np.abs(reading.v) / self.limits.velocity
        self.peak_speed_share = max(self.peak_speed_share, float(share.max()))

    def _record(self, reading: RobotReading, point: ReferencePoint, total: Array, applied: Array, added: Array) -> None:
        if not self._logged < self.time <= self.duration:
            return
        self._logged = self.time
        estimate, flags = self._estimate, np.empty(0)
        if self.log.flags:
            told = np.zeros_like(added) if reading.torque is None else reading.torque
            feels, touched = touch_of(self.state) is not None, (float(self.feeling.touched),)
            felt = (*(touched if feels or self.sensor else ()), *(self.feeling.torque if feels else ()))
            felt = (*felt, *logged(self.sensor))
            mass = () if self.mass_row is None else (float(self.mass_row @ (estimate - self._first_estimate)),)
            flags = np.concatenate(((self.learning, self.stop is not None), added, told, felt, mass))
        self.log.append(self.time, reading.p, reading.v, point, total, applied, estimate, flags)
        if self.live is not None:
            self.live.show(self.time, reading.p, point.p, applied)

    @property
    def _estimate(self) -> Any:
        return getattr(getattr(self.state, "inner", self.state), "estimate", np.empty(0))

    def _finish(self, reading: RobotReading) -> None:
        """Hand the arm back once it was held at rest."""
        if self.stop is None or self.ended or self.time < self.stop.end + HOLD:
            return
        if (np.abs(reading.v) < REST).all():
            self._hand_back()
        elif self.time > self.stop.end + HOLD + PATIENCE:
            self._robot_stops("the arm does not come to rest")

    def _hand_back(self) -> None:
        if self.robot.compensates_gravity:
            begun = self.guard.torque
            for k in range(round(HAND_BACK / self.robot.period)):
                self.measurements.taken(self.robot.read())
                self._write(self.guard.limited((1.0 - (k + 1) * self.robot.period / HAND_BACK) * begun))
        if not self.ended:
            getattr(self.robot, "release", self.robot.stop)()
        self.ended = True

    def _robot_stops(self, reason: str) -> None:
        """Ask for the robot's own stop, once."""
        if not self.by_robot:
            self.stopped, self.ended = f"by the robot: {reason}", True
            self.robot.stop()
            self.by_robot = True  # not before: an interruption in between asks for the stop again

    def interrupt(self) -> None:
        """Take a Ctrl-C: the first stops the arm, the next one by its own means, and those after its end are noted."""
        if self.interrupted and not self.ended:
            raise KeyboardInterrupt
        self.interrupted = True
        if self.moves and not self.ended:
            tell_of_stop()


def _risen(u: float) -> float:
    """Smooth step."""
    step: Any = quintic(u)[0]
    return float(step)


def _nothing(torque: Array) -> None:
    """Start of a robot that needs none."""
