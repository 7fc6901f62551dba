"""`drive`: from where the arm stands to a planned stop, within all limits, whatever the robot answers."""

from __future__ import annotations

import dataclasses
import re
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driven_robots import ARM, FAULTS, FaultyRobot, LyingReference, RecordedRobot
from nightly import at_night, mostly_at_night, nightly

import adaptctl
from adaptctl.control import FadeIn, SafetyFilter
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.hardware import (
    GravityTorque,
    HardwareLimits,
    MuJoCoRobot,
    RobotReading,
    TorqueGuard,
    motion_about,
    ready_controller,
)
from adaptctl.hardware.acceleration import PossibleAcceleration
from adaptctl.hardware.loop import DriveLoop
from adaptctl.hardware.resting import StoppingDistance
from adaptctl.identification import told, told_numbers
from adaptctl.stages import COMPILING, watching

PERIOD = 4e-3
CENTER = np.array([0.3, 0.5])
REFERENCE = adaptctl.Sinusoids(center=CENTER, amplitude=[0.4, 0.3], frequency=[0.5, 0.8])
MODEL = adaptctl.ReducedModel(ARM)


def law(scale: float = 1.0) -> adaptctl.SlotineLi:
    gain = np.full(len(MODEL.names), 0.02)
    return adaptctl.SlotineLi(
        MODEL, 8.0, [6.0, 2.0], gain, initial=scale * MODEL.fundamental_parameters, control_period=PERIOD
    )


LAW = law()


@pytest.mark.parametrize("seed", mostly_at_night(range(4), 0, 1))
def test_starts_where_the_arm_stands_and_ends_at_rest(seed: int, tmp_path: Path) -> None:
    start = CENTER + np.random.default_rng(seed).uniform(-0.8, 0.8, 2)
    robot, stages = RecordedRobot(ARM, PERIOD, start), list[object]()
    with watching(lambda stage: nullcontext(stages.append(stage))):
        run = adaptctl.drive(robot, LAW, REFERENCE, 4.5, tmp_path / "run.parquet", lead_in=2.0)
    told = [str(stage) for stage in stages if stage != COMPILING]
    assert re.fullmatch(r"stopping, worst error [\d.]+ mrad", told[-1])
    assert (run.stopped, run.by_robot, robot.breaches) == ("", False, [])
    assert run.first_error < 1e-6
    assert run.peak_torque_rate <= 950.0 + 1e-6
    assert run.final_rms_error.max() < 5e-4
    assert np.abs(np.array(robot.states)[:, 2:]).max() <= run.peak_speed_share * 6.0 + 0.01
    kept = adaptctl.Rollout.load(tmp_path / "run.parquet")
    assert kept.time[-1] == pytest.approx(4.5, abs=0.005)
    assert kept.flags["learning"][:49].sum() == 0.0
    assert kept.flags["learning"][51:1124].all()
    assert np.array_equal(kept.flags["reported_torque.elbow"][1:], kept.applied[:-1, 1])


@pytest.mark.parametrize("tick", mostly_at_night([1, 40, 133, 250, 350, 555], 1, 133, 350))
def test_ctrl_c_stops_on_the_path_and_then_the_program(tick: int) -> None:
    robot = FaultyRobot(ARM, PERIOD, CENTER)
    robot.interrupted_at = tick
    with pytest.raises(KeyboardInterrupt):
        adaptctl.drive(robot, LAW, REFERENCE, 3.0)
    path = FadeIn(REFERENCE, CENTER, 3.0)(np.linspace(0.0, 3.0, 8001)).p
    off = [np.linalg.norm(path - p, axis=1).min() for p in np.array(robot.states)[:, :2]]
    assert robot.breaches == []
    assert max(off) < 0.01
    assert tick + 125 < robot.tick < tick + 375
    assert np.abs(robot.states[-2][2:]).max() < 0.01


@pytest.mark.parametrize("fault", [*FAULTS, "closed", "refused"])
def test_faults_are_ridden_out_or_stop_the_arm(fault: str) -> None:
    robot = FaultyRobot(ARM, PERIOD, CENTER)
    robot.fault, robot.faults = fault, ((140, 1), (180, 8), (220, 40))
    run = adaptctl.drive(robot, LAW, REFERENCE, 1.3)
    assert robot.breaches == []
    assert run.rollout is not None
    ridden_out = fault in ("turned", "late")
    assert (run.stopped == "") == ridden_out, run.stopped
    assert run.by_robot == (not ridden_out), run.stopped
    assert robot.tick > {"refused": 139, "early": 185}.get(fault, 225)
    learned = run.rollout.flags["learning"]
    assert learned[130:139].all()
    if fault not in ("turned", "refused"):
        assert not learned[140]
        assert not learned[181:188].any() or fault == "late"  # by as much each, so that periods are as long as ever
        assert learned[160:179].all()


@pytest.mark.parametrize("scale", mostly_at_night([1.0, 0.0, -1.0, 3.0], -1.0, 3.0))
def test_full_speed_towards_an_end_does_not_reach_it(scale: float) -> None:
    random, own = np.random.default_rng(3), law(scale)
    for _ in range(3):
        v = 3.0 * random.choice([-1.0, 1.0], 2) * (1.0, random.uniform())
        robot = RecordedRobot(ARM, PERIOD, CENTER)
        run = adaptctl.drive(robot, own, LyingReference(CENTER, v), 5.0, from_zero=True)
        assert "end of its range" in run.stopped or (scale < 0.0 and "off the reference" in run.stopped)
        assert not run.by_robot
        assert robot.breaches == []


def test_payload_on_an_arm_that_compensates_its_own_weight() -> None:
    """The arm adds what it weighs without the payload; what is missing is learned, while nothing is sent at first."""
    heavy = ARM.with_parameters(ARM.inertial_parameters + np.eye(20)[10] + 0.01 * (np.eye(20)[16] + np.eye(20)[19]))
    robot = RecordedRobot(heavy, PERIOD, CENTER, compensates_gravity=ARM)
    keen = dataclasses.replace(LAW, adaptation=np.full(len(MODEL.names), 0.1))
    run = adaptctl.drive(robot, keen, REFERENCE, 8.0)
    assert (run.stopped, run.compensates_gravity, robot.breaches) == ("", True, [])
    assert np.abs(robot.sent[0]).max() < 1e-12
    assert run.rollout is not None
    rest = GravityTorque(ARM)
    assert run.rollout.flags["compensation.elbow"][0] == pytest.approx(rest(CENTER)[1], rel=1e-2)
    assert run.final_rms_error.max() < 0.01  # of a plain gradient at 4 ms; 0.2 rad without learning
    truth = adaptctl.ReducedModel(heavy, MODEL.basis).inverse_dynamics(
        run.rollout.p[-250:], run.rollout.v[-250:], run.rollout.reference_a[-250:]
    )
    assert np.abs(run.rollout.applied[-250:] - truth).max() < 0.3  # N m at the joints, weight included
    assert run.payload is None  # a plain gradient does not remember what it knows


BODY = np.concatenate((np.zeros(10), from_center_of_mass(0.8, [0.2, 0.05, 0.0], 0.01 * np.eye(3))))
HEAVY = ARM.with_parameters(ARM.inertial_parameters + BODY)
REMEMBERING = dataclasses.replace(
    LAW, adaptation=adaptctl.control.GuardedLearning(np.full(len(MODEL.names), 1.0), prediction_weight=100.0)
)


def test_what_an_arm_carries_is_told_with_its_deviation_and_what_is_open_is_not() -> None:
    """A plane arm tells the mass, while its motion goes on, and leaves the centre across the plane open."""
    run = adaptctl.drive(RecordedRobot(HEAVY, PERIOD, CENTER, compensates_gravity=ARM), REMEMBERING, REFERENCE, 4.0)
    assert run.stopped == ""
    assert run.payload is not None
    assert abs(run.payload.mass - 0.8) < 0.03 * 0.8
    assert 0.01 < run.payload.deviations[0] < 0.05
    assert told(run.payload).tolist() == [True, False, False]
    numbers = told_numbers(run.payload)
    assert (numbers["mass"], numbers["center_of_mass"], numbers["inertia"]) == (run.payload.mass, None, None)
    assert run.rollout is not None
    np.testing.assert_allclose(run.rollout.flags["payload_mass"][-50:], 0.8, atol=0.03)


@nightly
def test_nothing_carried_and_less_than_was_told() -> None:
    empty = adaptctl.drive(RecordedRobot(ARM, PERIOD, CENTER, compensates_gravity=ARM), REMEMBERING, REFERENCE, 4.0)
    assert empty.payload is not None
    assert empty.payload.mass < 2.0 * empty.payload.deviations[0]
    laden = dataclasses.replace(REMEMBERING, initial=MODEL.regrouping @ HEAVY.inertial_parameters)
    less = adaptctl.drive(RecordedRobot(ARM, PERIOD, CENTER, compensates_gravity=HEAVY), laden, REFERENCE, 4.0)
    assert less.payload is None
    assert less.rollout is not None
    assert less.rollout.flags["payload_mass"][-1] == pytest.approx(-0.8, abs=0.03)


def test_a_torque_that_holds_weight_does_not_take_the_arm_to_an_end() -> None:
    stopping = StoppingDistance(ARM, HardwareLimits.of(ARM, torque_rate=1000.0), PERIOD)
    p, net = np.array([HardwareLimits.of(ARM).upper[0] - 0.4, 0.5]), np.array([50.0, 0.0])
    for slope, ends in ((0.0, False), (60.0, True)):
        moving = PossibleAcceleration(stopping.inverses, PERIOD)
        for k in range(5):
            v = np.array([0.05 + slope * k * PERIOD, 0.0])
            moving.take(RobotReading(k * PERIOD, p, v), net)
        assert stopping.beyond(p, v, net, moving.along(v, net))[0] == ends
    assert moving.along(-v, net)[0] == 0.0
    assert moving.along(v, net + np.array([3.8, 0.0]))[0] > moving.along(v, net)[0] > 59.0


@pytest.mark.parametrize("law", [LAW, at_night(REMEMBERING)], ids=["gradient", "memory"])
def test_an_estimate_that_is_not_finite_is_stopped_from_with_the_last_good_one(
    law: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tick, count = DriveLoop._tick, []

    def spoilt(loop: DriveLoop) -> None:
        count.append(1)
        if len(count) == 350:
            loop.state = loop.held_state.with_estimate(loop.state, np.full(len(MODEL.names), np.nan))
        tick(loop)

    monkeypatch.setattr(DriveLoop, "_tick", spoilt)
    robot = RecordedRobot(ARM, PERIOD, CENTER)
    run = adaptctl.drive(robot, law, REFERENCE, 4.0, lead_in=1.0)
    assert (run.stopped, run.by_robot, robot.breaches) == ("the estimate is not finite", False, [])
    path = FadeIn(REFERENCE, CENTER, 1.0)(np.linspace(0.0, 4.0, 8001)).p
    assert max(np.linalg.norm(path - p, axis=1).min() for p in np.array(robot.states)[:, :2]) < 0.01
    assert np.abs(robot.states[-2][2:]).max() < 0.01


def test_a_stop_closes_loops_near_where_the_arm_is(monkeypatch: pytest.MonkeyPatch) -> None:
    step, off = SafetyFilter.step, []

    def watched(self: Any, state: Any, p: Any, v: Any, point: Any) -> Any:
        off.append(np.abs(state.inner.q - p).max())
        return step(self, state, p, v, point)

    monkeypatch.setattr(SafetyFilter, "step", watched)
    robot = FaultyRobot(ARM, PERIOD, CENTER)
    robot.interrupted_at = 555
    with pytest.raises(KeyboardInterrupt):
        adaptctl.drive(robot, LAW, REFERENCE, 3.0)
    assert max(off[2:]) < 3.0 * PERIOD  # what the arm moves in a period


class Turned(RecordedRobot):
    """Encoders that count from 0 to a turn, and wrap."""

    def read(self) -> RobotReading:
        reading = super().read()
        return reading._replace(p=reading.p % (2.0 * np.pi))


def test_encoders_that_wrap_are_followed_across_the_turn() -> None:
    low = adaptctl.Sinusoids(center=[0.0, 0.0], amplitude=[0.3, 0.3], frequency=[0.5, 0.5])
    robot = Turned(ARM, PERIOD, [-0.05, 0.05])
    run = adaptctl.drive(robot, LAW, low, 4.0)
    assert (run.stopped, robot.breaches) == ("", [])
    assert run.final_rms_error.max() < 1e-3


def test_limits_hold_from_the_first_torque_on_and_fall_at_the_rate() -> None:
    limits = HardwareLimits([9.0, 5.0], [1.0, 1.0], [-1.0, -1.0], [1.0, 1.0], torque_rate=1000.0)
    guard = TorqueGuard(limits, PERIOD, np.array([0.0, 4.5]))
    assert guard.limited(np.array([-20.0, 20.0])) == pytest.approx([-3.8, 5.0])
    assert guard.limited(np.array([np.nan, -np.inf])) == pytest.approx([-3.8, 5.0])
    guard.limits = np.array([9.0, 1.0])
    assert [guard.limited(np.array([0.0, 9.0]))[1] for _ in range(3)] == pytest.approx([1.2, 1.0, 1.0])


class Bare:
    """Object with what a robot needs, and no more."""

    period, compensates_gravity = PERIOD, False
    limits = HardwareLimits.of(ARM, torque_rate=1000.0)

    def __init__(self) -> None:
        self.robot = MuJoCoRobot(ARM, PERIOD, CENTER)
        self.robot.start(GravityTorque(ARM)(CENTER))
        self.stopped = False

    def read(self) -> Any:
        return tuple(self.robot.read())

    def write(self, torque: Any) -> None:
        self.robot.write(torque)

    def stop(self) -> None:
        self.stopped = True


def test_any_object_with_the_methods_is_a_robot() -> None:
    robot = Bare()
    run = adaptctl.drive(robot, SafetyFilter(LAW, torque_limits=30.0), REFERENCE, 2.0)
    assert (run.stopped, robot.stopped) == ("", True)
    assert np.abs(run.rollout.applied).max() <= 30.0 if run.rollout else False


def altered(robot: Any, **changes: Any) -> Any:
    for name, value in changes.items():
        setattr(robot, name, value)
    return robot


def moving() -> Any:
    robot = RecordedRobot(ARM, PERIOD, CENTER)
    robot._state = robot.plant.init(CENTER, np.array([0.1, 0.0]))
    return robot


TUNED = dataclasses.replace(LAW, damping=[11.01, 0.8476])
NARROW = HardwareLimits([60.0, 25.0], [6.0, 6.0], [-0.5, 0.6], [0.5, 2.0], 1000.0)
OTHER = HardwareLimits([600.0, 25.0], [6.0, 6.0], [-2.0, -2.0], [2.0, 2.0], 1000.0)
THREE = HardwareLimits([60.0] * 3, [6.0] * 3, [-2.0] * 3, [2.0] * 3, 1000.0)


@pytest.mark.parametrize(
    ("robot", "changes", "message"),
    [
        (lambda: object(), {}, "has no read, write, stop, limits, period, compensates_gravity"),
        (lambda: altered(MuJoCoRobot(ARM, PERIOD), limits=THREE), {}, "it has 3 joints, but two_link has 2"),
        (lambda: altered(MuJoCoRobot(ARM, PERIOD), joints=["a", "b"]), {}, "its joints are a, b"),
        (lambda: altered(MuJoCoRobot(ARM, PERIOD), limits=OTHER), {}, "file of another robot"),
        (
            lambda: altered(MuJoCoRobot(ARM, PERIOD, CENTER), limits=NARROW),
            {},
            "elbow stands at 0.5, outside its range",
        ),
        (lambda: MuJoCoRobot(ARM, PERIOD, [0.3, 90.0]), {}, "elbow stands at 90, outside its range .* rad"),
        (moving, {}, "shoulder moves, at 0.1 rad/s"),
        (lambda: MuJoCoRobot(ARM, 1.01 * PERIOD), {}, "the controller's is 0.004 s, but the robot's is 0.00404 s"),
        (lambda: MuJoCoRobot(ARM, PERIOD, CENTER), {"controller": law(0.0)}, "start from the file's parameters"),
        (
            lambda: altered(MuJoCoRobot(ARM, PERIOD, CENTER), delay=8 * PERIOD),
            {"controller": TUNED},
            "above 0.138, the limit at a delay of 8 control periods, .* multiply the damping by 0.35 at most",
        ),
        (lambda: altered(MuJoCoRobot(ARM, PERIOD, CENTER), delay=-1.0), {}, "robot: delay: expected a time in s"),
        (lambda: MuJoCoRobot(ARM, PERIOD, CENTER), {"duration": 0.0}, "duration: expected a positive time"),
        (lambda: MuJoCoRobot(ARM, PERIOD, CENTER), {"log": 3}, "log: expected a RunLogger or a path"),
        (
            lambda: MuJoCoRobot(ARM, PERIOD, CENTER),
            {"reference": adaptctl.Sinusoids([0.3, 0.5], [2.9, 0.1], [0.1, 0.1]), "duration": 20.0},
            "at .* s shoulder",
        ),
        (
            lambda: MuJoCoRobot(ARM, PERIOD, CENTER),
            {"reference": adaptctl.Sinusoids([0.3], [0.1], [0.1])},
            "expected",
        ),
    ],
)
def test_refused_before_a_torque_is_sent(robot: Any, changes: dict[str, Any], message: str) -> None:
    given = {"controller": LAW, "reference": REFERENCE, "duration": 1.0} | changes
    with pytest.raises(adaptctl.InputError, match=message):
        adaptctl.drive(robot(), **given)


@nightly
def test_gains_for_a_robot_whose_torques_act_late() -> None:
    class Late(RecordedRobot):
        delay = 3 * PERIOD

        def start(self, torque: Any) -> None:
            self.queue = [np.array(torque)] * 3
            super().start(torque)

        def write(self, torque: Any) -> None:
            super().write(torque)
            self.queue.append(self._torque)
            self._torque = self.queue.pop(0)

    robot = Late(ARM, PERIOD, CENTER)
    reference = motion_about(CENTER, robot.limits)
    run = adaptctl.drive(robot, ready_controller(ARM, PERIOD, reference, delay=3), reference, 4.0)
    assert (run.stopped, robot.breaches) == ("", [])  # as tuned without the delay, the loop rings until it is stopped
    assert run.final_rms_error.max() < 0.01


@pytest.mark.parametrize(("ringing", "told"), [(1.0, "elbow rings: its gains are too high"), (0.0, "not finite")])
def test_why_the_safety_filter_stopped_is_told(ringing: float, told: str) -> None:
    detector = SimpleNamespace(lag_product=np.array([0.1, -0.4]), power=np.array([0.4, 0.4]))
    state = SimpleNamespace(ringing=detector, flags=SimpleNamespace(ringing=np.array([ringing])))
    loop: Any = SimpleNamespace(state=state, names=["shoulder", "elbow"])
    assert told in DriveLoop._unsound(loop)


def test_an_arm_that_sags_is_braked_again() -> None:
    light = dataclasses.replace(LAW, initial=0.85 * MODEL.fundamental_parameters)
    robot = RecordedRobot(ARM, PERIOD, CENTER)
    run = adaptctl.drive(robot, light, REFERENCE, 1.0)
    assert run.stopped == "by the robot: the arm sagged when its brakes opened"
    assert len(robot.sent) < 50


def test_after_a_period_off_time_the_filters_settle_again(monkeypatch: pytest.MonkeyPatch) -> None:
    model = adaptctl.ReducedModel(ARM)
    learning = adaptctl.SlotineLi(model, 5.0, 4.0, adaptctl.control.GuardedLearning(np.full(6, 0.1)))
    held, state = adaptctl.control.HeldState(learning), learning.init([0.1, 0.2], [0.5, 0.5])
    for k in range(20):
        _, state = learning.step(state, [0.1 + 5e-4 * k, 0.2 + 5e-4 * k], [0.5, 0.5], REFERENCE.at(1e-3 * k))
    after = held.unsettled(state)
    assert (state.law_state.watch.moving > 0.0).any()
    assert not after.law_state.watch.moving.any()
    np.testing.assert_array_equal(after.law_state.stored.information, state.law_state.stored.information)
    np.testing.assert_array_equal(after.estimate, state.estimate)

    told, unsettled = [], adaptctl.control.HeldState.unsettled
    monkeypatch.setattr(adaptctl.control.HeldState, "unsettled", lambda self, x: told.append(1) or unsettled(self, x))
    robot = FaultyRobot(ARM, PERIOD, CENTER)
    robot.fault, robot.faults = "late", ((140, 1),)
    adaptctl.drive(robot, LAW, REFERENCE, 0.8)
    assert 1 <= len(told) <= 3


def test_a_motion_about_a_posture_outside_the_limits_is_refused() -> None:
    with pytest.raises(adaptctl.InputError, match="joint 2 stands at 90, outside its range"):
        motion_about([0.3, 90.0], HardwareLimits.of(ARM))
