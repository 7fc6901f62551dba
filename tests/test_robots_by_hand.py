"""Robots, what is trusted of them and what is asked of them first, at numbers that are written by hand."""

from __future__ import annotations

import math
import runpy
import struct
import sys
from inspect import signature
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driven_robots import ARM

import adaptctl
from adaptctl.control import Gradient, GuardedLearning, Projection
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import StabilityWarning
from adaptctl.hardware import (
    FrankaRobot,
    HardwareLimits,
    MuJoCoRobot,
    RobotReading,
    TrossenRobot,
    UDPRobot,
    URRobot,
    checks,
    mujoco_robot,
    udp_plant,
)
from adaptctl.hardware.force_sensor import ForceReading, ForceSensor
from adaptctl.hardware.franka_robot import FR3_LIMITS
from adaptctl.hardware.measurements import Measurements
from adaptctl.hardware.mujoco_robot import _within
from adaptctl.hardware.preparation import motion_about, periods_late
from adaptctl.hardware.rotors import ROTOR_PROFILES, _guessed
from adaptctl.hardware.stop import PlannedStop

PERIOD, REST = 0.01, np.zeros(2)
LIMITS = HardwareLimits([50.0, 20.0], [2.0, 4.0], [-1.0, -2.0], [1.5, 2.0], 1000.0)
POINT = ReferencePoint(REST, REST, REST)


def reading(time: float = 1.0, p: Any = REST, v: Any = REST, torque: Any = None) -> RobotReading:
    return RobotReading(time, np.asarray(p, dtype=float), np.asarray(v, dtype=float), torque)


def udp(*numbers: float) -> bytes:
    return struct.pack(f"<{len(numbers)}d", *numbers)


def test_a_motor_driver_is_heard_by_the_first_of_its_numbers() -> None:
    robot: Any = object.__new__(UDPRobot)
    robot.limits, robot._peer, robot._count = LIMITS, None, -1.0
    peer, other = ("h", 1), ("h", 2)
    assert robot._valid(udp(0.0, *[5.0, 6.0, 7.0, 8.0]), peer) == (0.0, 5.0, 6.0, 7.0, 8.0)
    robot._peer, robot._count = peer, 4.0
    assert robot._valid(udp(5.0, *[-9.0] * 4), peer) is not None
    for wrong in (udp(4.0, *[9.0] * 4), udp(math.nan, *[9.0] * 4), udp(math.inf, *[9.0] * 4), udp(5.0, *[9.0] * 3)):
        assert robot._valid(wrong, peer) is None
    assert robot._valid(udp(5.0, *[9.0] * 4), other) is None


def test_a_motor_driver_is_waited_for_and_answered_by_its_count() -> None:
    """Five seconds for its first datagram, and five periods from then on."""
    robot: Any = object.__new__(UDPRobot)
    robot.limits, robot.period, robot._peer, robot._count = LIMITS, PERIOD, None, -1.0
    waits, sent, peer = list[float](), list[Any](), ("h", 1)
    coming = [(udp(7.0), peer), (udp(3.0, 5.0, 6.0, -7.0, -8.0), peer), TimeoutError()]

    def recvfrom(most: int) -> Any:
        now = coming.pop(0)
        if isinstance(now, TimeoutError):
            raise now
        return now

    robot._link = SimpleNamespace(settimeout=waits.append, recvfrom=recvfrom, sendto=lambda *what: sent.append(what))
    robot.write(np.array([1.0, 2.0]))  # to nobody
    found = robot.read()
    assert (found.time, found.p.tolist(), found.v.tolist()) == (pytest.approx(3 * PERIOD), [5.0, 6.0], [-7.0, -8.0])
    assert found.torque is None
    robot.write(np.array([1.0, -2.0]))
    assert sent == [(udp(3.0, 1.0, -2.0, 0.0), peer)]
    assert robot.read() is None
    assert waits == pytest.approx([5.0, 5.0 * PERIOD])


def test_measurements_are_trusted_up_to_what_the_speed_limits_allow() -> None:
    def taken(last: RobotReading, now: RobotReading) -> str:
        found = Measurements(ARM.primary_joints, LIMITS, PERIOD, REST)
        assert found.taken(last) is not None
        found.taken(now)
        return found.fault

    first, reach = reading(), 1.5 * 2.0 * PERIOD + 2e-3
    assert taken(first, reading(1.0 + PERIOD, [0.999 * reach, 0.0])) == ""
    assert taken(first, reading(1.0 + PERIOD, [-1.001 * reach, 0.0])) == "a jump of the measured position"
    assert taken(first, reading(1.001, [0.999 * reach, 0.0])) == ""  # a period at least
    assert taken(first, reading(1.1, [0.29, 0.0])) == ""
    assert taken(first, reading(1.0)) == "a repeated measurement"
    assert taken(first, reading(1.1, v=[4.0, -8.0])) == ""
    assert taken(first, reading(1.1, v=[4.01, 0.0])) == "a speed far above the limit"
    for wrong in (None, (1.0, REST, REST), [1.0, REST, REST, None]):
        assert taken(first, wrong) == "no measurement"  # type: ignore[arg-type]
    for wrong in (reading(math.nan), reading(1.1, [0.0]), reading(1.1, v=[0.0, math.inf])):
        assert taken(first, wrong) == "numbers that are not finite, or too few"


def test_turns_are_undone_from_the_first_measurement_on() -> None:
    free = HardwareLimits([1.0, 1.0], [50.0, 50.0], [-np.inf, -1.0], [np.inf, 1.5], 1000.0)
    half = HardwareLimits([1.0, 1.0], [50.0, 50.0], [-1.0, -1.0], [np.inf, 1.5], 1000.0)
    found = Measurements(ARM.primary_joints, free, PERIOD, np.array([20.0, 0.0]))
    first = found.taken(reading(0.0, [20.0 - 6 * np.pi - 0.5, 1.4 + 2 * np.pi]))
    assert first is not None
    np.testing.assert_allclose(first.p, [19.5, 1.4])
    second = found.taken(reading(0.1, [19.6 - 8 * np.pi, 1.5 - 4 * np.pi]))
    assert second is not None
    np.testing.assert_allclose(second.p, [19.6, 1.5])
    below = Measurements(ARM.primary_joints, half, PERIOD, REST).taken(reading(0.0, [-1.2, 0.0]))
    assert below is not None
    np.testing.assert_allclose(below.p, [-1.2, 0.0])  # a range without an end has no middle
    expected = Measurements(ARM.primary_joints, LIMITS, PERIOD, np.array([0.3, 0.4])).expected(5.0)
    np.testing.assert_array_equal([expected.p, expected.v], [[0.3, 0.4], REST])
    found.latest = reading(1.0, [0.1, 0.2], [1.0, -2.0])
    np.testing.assert_allclose(found.expected(1.5).p, [0.6, -0.8])


def test_a_force_is_taken_up_to_its_age_and_felt_above_its_level() -> None:
    given = SimpleNamespace(stamp=0.0, force=np.array([3.0, 0.0, 4.0]))
    robot = SimpleNamespace(force=lambda: ForceReading(given.stamp, given.force, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)))
    sensor = ForceSensor(robot, 5.0)
    sensor.take(0.02)
    assert (sensor.lost, sensor.pressed) == (0, 0.0)
    assert (sensor.wrench.tolist(), np.asarray(sensor.point).tolist()) == (
        [3.0, 0.0, 4.0, 1.0, 2.0, 3.0],
        [0.1, 0.2, 0.3],
    )
    given.stamp, given.force = 0.1, np.array([3.0, 0.0, 4.01])
    sensor.take(0.121)
    assert (sensor.lost, sensor.fault) == (1, "the force sensor is 0.021 s late")
    sensor.take(0.12)
    assert sensor.lost == 0
    assert sensor.pressed == pytest.approx(np.hypot(3.0, 4.01))
    for k in range(11):
        assert sensor.failed == ""
        sensor.take(0.12)
        assert sensor.lost == k + 1
    assert sensor.failed == "the force sensor is silent: it repeats itself"


@pytest.mark.parametrize(("shaken", "fits"), [(2.4, True), (2.6, False)])
def test_a_force_may_change_at_rest_by_half_of_a_touch(shaken: float, fits: bool) -> None:
    clock = iter(range(1000))
    robot: Any = SimpleNamespace(count=0)
    robot.read = lambda: reading(float(next(clock)))

    def force() -> ForceReading:
        robot.count += 1
        return ForceReading(float(robot.count - 1), np.array([7.0 + shaken * (-1.0) ** robot.count, 0.0, 0.0]))

    robot.force = force
    sensor = ForceSensor(robot, 5.0)
    if fits:
        sensor.rest()
        np.testing.assert_allclose(sensor.bias, [7.0, 0.0, 0.0], atol=1e-9)
    else:
        with pytest.raises(adaptctl.InputError, match="at rest, and 5 N are a touch"):
            sensor.rest()
    assert robot.count == 50


def franka(passed: float = 2e-3) -> Any:
    """A Franka arm whose client notes what it is sent, and whose periods take some time."""
    robot: Any = object.__new__(FrankaRobot)
    state = SimpleNamespace(q=[0.1] * 7, dq=[0.2] * 7, tau_J_d=[0.3] * 7, O_F_ext_hat_K=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    sent: list[Any] = []
    active = SimpleNamespace(readOnce=lambda: (state, SimpleNamespace(to_sec=lambda: passed)), writeOnce=sent.append)
    robot._robot = SimpleNamespace(
        read_once=lambda: state, start_torque_control=lambda: active, stop=lambda: sent.append("stop")
    )
    robot._client = SimpleNamespace(Torques=lambda torque: SimpleNamespace(torque=torque))
    robot._active, robot._state, robot._time, robot.limits, robot.sent = None, None, 0.0, FR3_LIMITS, sent
    return robot


def test_a_franka_arm_tells_its_own_time_and_is_told_when_a_motion_ends() -> None:
    robot = franka()
    assert robot.read().time == 1e-3  # a period, before torques are sent
    robot.start(np.ones(7))
    assert robot.read().time == pytest.approx(5e-3)
    found = robot.read()
    assert (found.p[0], found.v[0], found.torque[0]) == (0.1, 0.2, 0.3)
    assert robot._estimated_force().force.tolist() == [1.0, 2.0, 3.0]
    robot.write(np.full(7, 2.0))
    robot.release()
    assert [one.motion_finished for one in robot.sent] == [False, False, True]
    assert [one.torque for one in robot.sent] == [[1.0] * 7, [2.0] * 7, [0.0] * 7]
    robot.stop()
    assert robot.sent[-1] == "stop"
    assert robot._active is None


def test_a_franka_arm_that_does_not_say_how_it_stands_stands_upright() -> None:
    robot = franka()
    robot._model = None
    assert robot.compensation(reading()) is None
    robot._model = SimpleNamespace(gravity=lambda state: [state.O_ddP_O[2]] * 7)
    robot._state = SimpleNamespace(O_ddP_O=[0.0, 0.0, 0.0])
    assert robot.compensation(reading()).tolist() == [-9.81] * 7
    robot._state = SimpleNamespace(O_ddP_O=[0.0, 0.0, 9.0])
    assert robot.compensation(reading()).tolist() == [9.0] * 7


def test_published_rotors_are_near_what_is_guessed_from_torque_limits() -> None:
    """Those of MuJoCo's menagerie, by the square root of 87 and 12 N m."""
    joints = [SimpleNamespace(name=f"j{k}", limits=SimpleNamespace(effort=x)) for k, x in enumerate(FR3_LIMITS.torque)]
    arm: Any = SimpleNamespace(primary_joints=joints)
    np.testing.assert_allclose(list(_guessed(arm).values()), ROTOR_PROFILES["fr3-menagerie"].inertias, rtol=0.07)
    drake = np.array(ROTOR_PROFILES["fr3"].inertias)
    assert (np.diff(drake) <= 0.0).all()
    assert (FR3_LIMITS.lower < FR3_LIMITS.upper).all()
    np.testing.assert_allclose(np.add(FR3_LIMITS.lower, FR3_LIMITS.upper)[[0, 1, 2, 4, 6]], 0.0)  # but for two joints


def test_a_simulated_arm_keeps_a_twentieth_away_from_its_ends() -> None:
    lower, upper = np.array([-1.0, 0.0, -np.inf]), np.array([1.0, 2.0, np.inf])
    limits = HardwareLimits(np.ones(3), np.ones(3), lower, upper, 100.0)
    for share, moved in ((0.051, False), (0.049, True)):
        near_low, near_high = np.array([-1.0, 0.0]) + 2.0 * share, np.array([1.0, 2.0]) - 2.0 * share
        for near in (near_low, near_high):
            p = _within(np.array([*near, 50.0]), limits)
            np.testing.assert_allclose(p, [0.0, 1.0, 50.0] if moved else [*near, 50.0])


def test_a_motion_keeps_to_shares_of_speed_room_and_amplitude() -> None:
    wide = HardwareLimits([1.0, 1.0], [100.0, 1.0], [-9.0, -9.0], [9.0, 9.0], 100.0)
    found = motion_about(REST, wide)
    np.testing.assert_allclose(np.ravel(found.frequency), [0.2, 0.45])
    np.testing.assert_allclose(np.ravel(found.amplitude), [0.3, 0.15 * 1.0 / (2.0 * np.pi * 0.45)])
    np.testing.assert_allclose(motion_about([8.9, 0.0], wide).amplitude.ravel()[0], 0.4 * 0.1)
    np.testing.assert_allclose(motion_about(REST, wide, 0.1).amplitude.ravel()[0], 0.1)


def test_delays_of_a_robot_are_whole_periods() -> None:
    def late(delay: float) -> int:
        return periods_late(SimpleNamespace(delay=delay, period=PERIOD))

    assert [late(x) for x in (0.0, PERIOD, 1.0001 * PERIOD, 2.0 * PERIOD, 1.0)] == [0, 1, 2, 2, 100]
    for wrong in (-1e-9, 1.0001):
        with pytest.raises(adaptctl.InputError, match="expected a time in s of 0 to 1"):
            late(wrong)


def test_torques_of_vendors_arms_act_a_period_later() -> None:
    period = signature(TrossenRobot).parameters["control_period"].default
    for kind in (FrankaRobot, URRobot, TrossenRobot):
        assert periods_late(SimpleNamespace(delay=kind.delay, period=getattr(kind, "period", period))) == 1


@pytest.mark.parametrize(("delay", "own"), [(0, 1), (1, 0), (2, 1), (99, 0)])
def test_a_law_that_learns_of_another_delay_than_the_robots_is_told_of(delay: int, own: int) -> None:
    robot, ones, most = SimpleNamespace(delay=delay * PERIOD, period=PERIOD), np.ones(6), min(delay, 64)
    bounds = np.full(6, 9.0)
    for late, law in ((Gradient, Projection(Gradient(ones, delay=own), -bounds, bounds)), (GuardedLearning, None)):
        adaptation = law or late(ones, delay=own)
        with pytest.warns(StabilityWarning, match=rf"came {own} .* states {most}: .* {late.__name__}, .* delay={most}"):
            checks.warn_of_delay(SimpleNamespace(inner=SimpleNamespace(adaptation_law=adaptation)), robot)
        checks.warn_of_delay(SimpleNamespace(adaptation_law=late(ones, delay=most)), robot)
    for other in (SimpleNamespace(adaptation_law=None), object()):
        checks.warn_of_delay(other, robot)


def test_a_controller_is_for_the_robots_period_to_a_thousandth() -> None:
    checks.validate_periods(SimpleNamespace(control_period=1.0009e-3), 1e-3)
    checks.validate_periods(SimpleNamespace(control_period=None), 1e-3)
    for wrong in (1.0011e-3, 0.9989e-3):
        with pytest.raises(adaptctl.InputError, match="but the robot's is"):
            checks.validate_periods(SimpleNamespace(control_period=wrong), 1e-3)


def test_an_arm_is_told_by_a_controller_or_by_its_description() -> None:
    assert checks.mechanism_of(object(), ARM) is checks.mechanism_of(SimpleNamespace(mechanism=ARM), None) is ARM
    for controller, given in ((SimpleNamespace(mechanism=ARM), "arm"), (object(), None)):
        with pytest.raises(adaptctl.InputError, match=r"^mechanism: "):
            checks.mechanism_of(controller, given)  # type: ignore[arg-type]


@pytest.mark.parametrize("ratio", [4.9, 5.0, 5.1])
@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_torque_limits_five_times_apart_are_of_another_robot(ratio: float, turned: float) -> None:
    described = HardwareLimits.of(ARM)
    torque = described.torque * [1.0, ratio**turned]
    own = HardwareLimits(torque, described.velocity, described.lower, described.upper, 100.0)
    robot = SimpleNamespace(limits=own)
    if ratio <= 5.0:
        found = checks.common_limits(robot, ARM, None)
        np.testing.assert_allclose(found.torque, np.minimum(torque, described.torque))
    else:
        with pytest.raises(adaptctl.InputError, match="is this the file of another robot"):
            checks.common_limits(robot, ARM, None)


@pytest.mark.parametrize(
    ("own", "described", "fits"), [(9.0, np.inf, True), (np.inf, 9.0, True), (np.inf, np.inf, False)]
)
def test_torque_limits_are_the_robots_or_its_descriptions(own: float, described: float, fits: bool) -> None:
    joint = SimpleNamespace(name="a", limits=SimpleNamespace(effort=described, velocity=1.0, lower=-1.0, upper=1.0))
    arm: Any = SimpleNamespace(name="arm", dof=1, primary_joints=[joint])
    robot = SimpleNamespace(limits=HardwareLimits([own], [1.0], [-1.0], [1.0]))
    if fits:
        assert checks.common_limits(robot, arm, None).torque == [9.0]
    else:
        with pytest.raises(adaptctl.InputError, match="neither it nor arm has torque limits"):
            checks.common_limits(robot, arm, None)


def test_an_arm_stands_still_within_its_limits() -> None:
    for p, told in (([1.4, 0.0], None), ([1.6, 0.0], "stands at 1.6, outside its range -1 to 1.5")):
        times = iter(range(1, 100))
        robot = SimpleNamespace(read=lambda times=times, p=p: reading(next(times) * PERIOD, p))
        measurements = Measurements(ARM.primary_joints, HardwareLimits.of(ARM), PERIOD, REST)
        if told is None:
            assert checks.standing(robot, measurements, ["a", "b"], LIMITS).time == pytest.approx(5 * PERIOD)
        else:
            with pytest.raises(adaptctl.InputError, match=told):
                checks.standing(robot, measurements, ["a", "b"], LIMITS)


def test_a_simulated_robot_waits_for_its_period_in_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    waits, robot = list[float](), MuJoCoRobot(ARM, PERIOD, [0.1, 0.2], real_time=True)
    clock = iter((robot._began + 0.5 * PERIOD, robot._began + 3.0 * PERIOD))
    monkeypatch.setattr(mujoco_robot, "time", SimpleNamespace(monotonic=lambda: next(clock), sleep=waits.append))
    assert [robot.read().time, robot.read().time] == [PERIOD, 2 * PERIOD]
    assert waits == pytest.approx([0.5 * PERIOD, 0.0], abs=1e-9)
    beyond = np.array([robot.limits.upper[0] + 0.1, 0.0])
    with pytest.raises(adaptctl.InputError, match="outside its range"):
        MuJoCoRobot(ARM, PERIOD, beyond)


def test_what_is_no_controller_drives_no_robot() -> None:
    robot: Any = MuJoCoRobot(ARM, PERIOD)
    with pytest.raises(adaptctl.InputError, match=r"^controller: expected"):
        adaptctl.drive(robot, "law", adaptctl.Sinusoids(REST, REST, [0.1, 0.1]), 1.0)  # type: ignore[arg-type]


def test_an_estimate_holds_an_arm_within_a_share_of_its_limits() -> None:
    checks.validate_gravity(np.array([10.0, 1.9]), np.array([5.1, 0.0]), 0.1, ["a", "b"], LIMITS)
    with pytest.raises(adaptctl.InputError, match=r"it holds b with 2.1 N m \(N\), but 0 are needed, 10%|11%"):
        checks.validate_gravity(np.array([10.0, 2.1]), np.array([5.1, 0.0]), 0.1, ["a", "b"], LIMITS)


def test_a_retreat_of_what_is_clamped_begins_where_the_stop_ended() -> None:
    stopping: Any = SimpleNamespace(duration=lambda v: 0.5)
    path = adaptctl.Sinusoids(REST, [0.1, 0.2], [0.5, 0.5])
    stop = PlannedStop.along(path, 2.0, REST, "state", "touched", stopping)
    assert (stop.end, stop.yields, stop.feels) == (2.5, False, False)
    way = stop.retreat(3.0, REST, stopping)
    assert way.end == 3.0 + 3 * 0.5 + 1.0  # from then on it turns and stops, and goes back a second
    np.testing.assert_allclose(way.path(3.0).p, path(2.25).p)  # where it has stopped
    assert (way.reason, way.feels) == ("touched, and clamped", False)
    ahead = PlannedStop.ahead(np.array([0.1, 0.2]), 2.0, np.array([1.0, -1.0]), "state", "x", stopping)
    point = ahead.path(np.array([1.9, 2.0]))
    np.testing.assert_allclose(point.p, [[0.0, 0.3], [0.1, 0.2]], atol=1e-12)
    np.testing.assert_allclose(point.v, [[1.0, -1.0]] * 2)


def test_a_joint_may_stand_at_an_end_that_is_a_turn_away() -> None:
    """Of two turns: positions at both ends stay, and one beyond is taken near the middle."""
    ends = np.full(2, 2.0 * np.pi)
    wide = HardwareLimits([1.0, 1.0], [9.0, 9.0], -ends, ends, 1000.0)
    for p in (-ends, ends):
        found = Measurements(ARM.primary_joints, wide, PERIOD, REST).taken(reading(0.0, p))
        assert found is not None
        np.testing.assert_allclose(found.p, p)
    beyond = Measurements(ARM.primary_joints, wide, PERIOD, REST).taken(reading(0.0, 1.6 * ends))
    assert beyond is not None
    np.testing.assert_allclose(beyond.p, -0.4 * ends)


@pytest.mark.parametrize(
    ("words", "told"), [(["nothing"], "unknown robot 'nothing'"), ([], "^Simulated arm in real time")]
)
def test_the_line_of_the_simulated_arm_is_that_of_the_program(
    words: list[str], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["udp_plant", *words])
    with pytest.raises(SystemExit, match=told):
        runpy.run_path(str(udp_plant.__file__), run_name="__main__")
