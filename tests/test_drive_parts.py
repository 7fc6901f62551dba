"""Parts of `drive` by themselves: what is measured, what is asked for, and how far a stop goes."""

from __future__ import annotations

import socket
import struct
import sys
import threading
import time
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from driven_robots import ARM

import adaptctl
from adaptctl.control import SafetyFilter
from adaptctl.control.gains.gain_design import largest_with_delay
from adaptctl.description.inertia import from_center_of_mass
from adaptctl.hardware import (
    FrankaRobot,
    GravityTorque,
    HardwareLimits,
    MuJoCoRobot,
    RobotReading,
    TrossenRobot,
    motion_about,
    udp_plant,
)
from adaptctl.hardware.acceleration import PossibleAcceleration
from adaptctl.hardware.drive import _log
from adaptctl.hardware.lead_in import beyond_limits, led_in
from adaptctl.hardware.preparation import DEFAULT_SAMPLING_RATIO, hold_at
from adaptctl.hardware.resting import MARGIN, StoppingDistance
from adaptctl.hardware.robot import validate_posture
from adaptctl.hardware.stop import PlannedStop
from adaptctl.hardware.torque_guard import RATE_SHARE
from adaptctl.hardware.touch_reaction import Retreat, yielding
from adaptctl.hardware.udp_plant import received

PERIOD = 4e-3
CENTER = np.array([0.3, 0.5])
LIMITS = HardwareLimits.of(ARM, torque_rate=1000.0)
STOPPING = StoppingDistance(ARM, LIMITS, PERIOD)
WIDE = StoppingDistance(ARM, HardwareLimits([1e4, 1e4], [9.0, 9.0], [-9.0, -9.0], [9.0, 9.0]), PERIOD)
MODEL = adaptctl.ReducedModel(ARM)
LAW = adaptctl.SlotineLi(MODEL, 8.0, [6.0, 2.0], initial=MODEL.fundamental_parameters, control_period=PERIOD)
SWING = adaptctl.Sinusoids(CENTER, [0.1, 0.1], [0.5, 0.5])


@pytest.mark.parametrize(("period", "window"), [(1e-3, 0.01), (2e-3, 0.01), (0.02, 0.06)])
def test_an_acceleration_is_that_of_the_last_hundredth_of_a_second_or_of_three_periods(
    period: float, window: float
) -> None:
    moving, speed = PossibleAcceleration(STOPPING.inverses, period), lambda t: np.array([t**2, -(t**2)])
    for k in range(30):
        moving.take(RobotReading(k * period, CENTER, speed(k * period)), np.zeros(2))
    last = 29 * period
    expected = (last**2 - (last - window) ** 2) / window
    np.testing.assert_allclose(moving.along(speed(last), np.zeros(2)), expected, rtol=1e-9)


def test_two_measurements_tell_an_acceleration_and_one_does_not() -> None:
    moving, v = PossibleAcceleration(STOPPING.inverses, PERIOD), np.array([0.5, 1.0])
    for k, expected in ((1, 0.0), (2, v / PERIOD)):
        moving.take(RobotReading(k * PERIOD, CENTER, k * v), np.zeros(2))
        np.testing.assert_allclose(moving.along(v, np.zeros(2)), expected)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_stop_goes_as_far_as_two_periods_and_half_the_time_of_braking(side: float) -> None:
    """The mean speed of a stop along a quintic step is half of the first one."""
    speed = np.array([2.0, 1.0])
    way = speed * (2.0 * PERIOD + 0.5 * STOPPING.duration(speed))
    end = np.minimum(LIMITS.upper, -LIMITS.lower) - MARGIN - way
    for room, beyond in ((1e-6, False), (-1e-6, True)):
        assert (STOPPING.beyond(side * (end - room), side * speed) == beyond).all()
    for away in (0.0, 0.01, 0.9):  # from an end where it rests, or which it leaves, a stop takes it nowhere beyond
        assert not STOPPING.beyond(side * np.minimum(LIMITS.upper, -LIMITS.lower), -side * away * speed).any()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_torque_that_drives_on_is_turned_round_before_a_stop_begins(side: float) -> None:
    """At the rate limit, to its negative: the arm is fastest halfway, as the integral of its acceleration tells."""
    net, acceleration, speed = np.array([40.0, 10.0]), np.array([3.0, 9.0]), np.array([2.0, 1.0])
    turning = 2.0 * PERIOD + 2.0 * net / (RATE_SHARE * 1000.0)
    falling = 1.0 - 2.0 * (np.arange(1000.0) + 0.5) / 1000.0
    fastest = speed + acceleration * turning * np.cumsum(falling).max() / 1000.0
    way = fastest * (turning + 0.5 * STOPPING.duration(fastest))
    end = np.minimum(LIMITS.upper, -LIMITS.lower) - MARGIN - way
    for room, beyond in ((1e-6, False), (-1e-6, True)):
        assert (STOPPING.beyond(side * (end - room), side * speed, side * net, acceleration) == beyond).all()
    stopping = STOPPING.beyond(side * (end + 1e-6), side * speed, -side * net, 0.0)  # it brakes already
    assert not stopping.any()


def test_a_stop_takes_a_tenth_of_a_second_to_three() -> None:
    assert STOPPING.duration(np.array([[0.0, 0.0], [1e9, 0.0]])).tolist() == [0.1, 3.0]
    steepest = 1.875  # slope of the quintic step 6 s^5 - 15 s^4 + 10 s^3, halfway
    assert STOPPING.duration(np.array([0.5, -0.8]) * STOPPING.deceleration) == pytest.approx(0.8 * steepest)


def test_brakes_use_half_of_the_torque_that_gravity_leaves() -> None:
    p = np.random.default_rng(5).uniform(-np.pi, np.pi, (2000, 2))
    needed = np.abs(ARM.mass_matrix(p)) @ STOPPING.deceleration
    left = LIMITS.torque - np.abs(GravityTorque(ARM)._mechanism.inverse_dynamics(p, 0.0 * p, 0.0 * p))
    assert (needed / left).max() == pytest.approx(0.5, rel=0.1)


def test_an_arm_that_yields_keeps_a_fifth_of_its_damping_and_no_spring() -> None:
    """A law brakes by the difference of velocities, and pulls by that of positions."""
    v = np.array([0.5, 0.0])
    point = yielding(CENTER, v)
    np.testing.assert_allclose(v - point.v, 0.2 * v)
    np.testing.assert_array_equal(point.p, CENTER)
    np.testing.assert_array_equal(point.a, np.zeros(2))


@pytest.mark.parametrize(("time", "back"), [(5.0, 1.0), (0.6, 0.4), (0.2, 0.0)])
def test_a_retreat_turns_goes_back_and_stops_along_its_path(time: float, back: float) -> None:
    """It turns in twice the time of a stop, to where it was, goes back a second or to the start, and stops in half a
    stop's time more; its velocities and accelerations are derivatives."""
    path, seconds, h = adaptctl.Sinusoids(CENTER, [0.4, 0.3], [0.2, 0.3], start_time=0.01), 0.4, 1e-5
    way = Retreat(path, time, seconds)
    assert (way.back, way.end) == (pytest.approx(back), pytest.approx(time + 3.0 * seconds + back))
    inner = np.linspace(time + 1e-3, way.end - 1e-3, 101)
    before, now, after = (way(inner + shift) for shift in (-h, 0.0, h))
    np.testing.assert_allclose(now.v, (after.p - before.p) / (2.0 * h), atol=1e-6)
    np.testing.assert_allclose(now.a, (after.v - before.v) / (2.0 * h), atol=1e-5)
    for part, other in zip(way(np.array([time])), path(np.array([time])), strict=True):
        np.testing.assert_allclose(part, other)
    turned = way(time + 2.0 * seconds)
    np.testing.assert_allclose(turned.p, path(time).p, atol=1e-9)
    np.testing.assert_allclose(turned.v, -path(time).v, atol=1e-9)
    rest = way(way.end)
    np.testing.assert_allclose(rest.p, path(max(0.0, time - back - 0.5 * seconds)).p, atol=1e-9)
    np.testing.assert_allclose(rest.v, 0.0, atol=1e-9)


def test_a_planned_stop_ends_when_its_path_rests() -> None:
    stop = PlannedStop.along(SWING, 3.0, np.array([1.0, 1.0]), None, "", STOPPING)
    assert stop.end == pytest.approx(3.0 + STOPPING.duration(np.array([1.0, 1.0])))
    assert not stop.path(stop.end).v.any()
    assert stop.path(3.0 + 0.9 * (stop.end - 3.0)).v.all()


def test_both_limits_hold() -> None:
    one = HardwareLimits([1.0, 4.0], [1.0, 4.0], [-1.0, -4.0], [1.0, 4.0], [1.0, 4.0])
    other = HardwareLimits([2.0, 3.0], [2.0, 3.0], [-2.0, -3.0], [2.0, 3.0], [2.0, 3.0])
    for both in (one.within(other), other.within(one)):
        for name in ("torque", "velocity", "upper", "torque_rate"):
            np.testing.assert_array_equal(getattr(both, name), [1.0, 3.0])
        np.testing.assert_array_equal(both.lower, [-1.0, -3.0])


def test_a_motion_about_a_posture_keeps_to_shares_of_room_and_speed() -> None:
    limits = HardwareLimits(np.ones(4), [30.0, 30.0, 30.0, 0.6], -np.ones(4), np.ones(4))
    posture = np.array([0.8, -0.7, 0.0, 0.0])
    motion = motion_about(posture, limits)
    points = motion(np.linspace(0.0, 60.0, 20001))
    swings = np.abs(points.p - posture).max(axis=0)
    np.testing.assert_allclose(swings[:3], [0.4 * 0.2, 0.4 * 0.3, 0.3], rtol=1e-3)
    assert np.abs(points.v[5000:]).max(axis=0)[3] == pytest.approx(0.15 * 0.6, rel=1e-3)


@pytest.mark.parametrize(("share", "told"), [(0.88, ""), (0.92, "moves at")])
def test_a_reference_keeps_to_nine_tenths_of_speeds(share: float, told: str) -> None:
    limits = HardwareLimits([1e4, 1e4], [2.0, 2.0], [-9.0, -9.0], [9.0, 9.0])
    swing = adaptctl.Sinusoids(CENTER, [share * 2.0 / (2.0 * np.pi * 0.5), 0.1], [0.5, 0.5])
    found = beyond_limits(swing, 10.0, ARM, limits, STOPPING)
    assert told in found
    assert bool(told) == bool(found)


@pytest.mark.parametrize(("share", "told"), [(0.88, ""), (0.92, "needs")])
def test_a_reference_keeps_to_nine_tenths_of_torques_of_either_sign(share: float, told: str) -> None:
    for place in (CENTER, np.array([np.pi, 0.0]) - CENTER):  # where gravity pulls the other way
        swing = adaptctl.Sinusoids(place, SWING.amplitude, SWING.frequency)
        point = swing(np.linspace(0.0, 10.0, 1001))
        needed = np.abs(ARM.inverse_dynamics(point.p, point.v, point.a)).max(axis=0)
        limits = HardwareLimits(needed / share, [9.0, 9.0], [-9.0, -9.0], [9.0, 9.0])
        found = beyond_limits(swing, 10.0, ARM, limits, WIDE)
        assert told in found
        assert bool(told) == bool(found)


def test_a_lead_in_takes_at_most_half_of_a_motion() -> None:
    """From so far that three seconds are too fast, which five are not."""
    limits = HardwareLimits([1e4, 1e4], [1.3, 1.3], [-9.0, -9.0], [9.0, 9.0])
    start = CENTER + np.array([2.0, 0.0])
    assert led_in(SWING, start, 10.0, ARM, limits, STOPPING).duration == 5.0  # type: ignore[attr-defined]
    with pytest.raises(adaptctl.InputError, match="moves at"):
        led_in(SWING, start, 9.0, ARM, limits, STOPPING)


class Read(MuJoCoRobot):
    """Robot whose readings before it is driven are changed."""

    change: Any = staticmethod(lambda k, reading: reading)

    def read(self) -> RobotReading:
        reading = super().read()
        changed: RobotReading = self.change(self._count, reading) if self._braked else reading
        return changed


def driven(change: Any, brakes: bool = True) -> adaptctl.DrivenRun:
    robot = Read(ARM, PERIOD, CENTER)
    robot.change, robot.has_brakes = change, brakes  # type: ignore[misc]
    return adaptctl.drive(robot, LAW, SWING, 0.1)


def test_an_arm_that_creeps_or_sets_off_at_the_fifth_reading_is_not_at_rest() -> None:
    for change in (
        lambda k, reading: reading._replace(p=reading.p + np.array([1e-3 * k, 0.0])),
        lambda k, reading: reading._replace(v=np.array([0.1 * (k >= 5), 0.0])),
    ):
        with pytest.raises(adaptctl.InputError, match="shoulder moves"):
            driven(change)


def test_old_readings_that_waited_are_passed_over() -> None:
    assert driven(lambda k, reading: reading._replace(p=reading.p + np.array([0.05 * (k < 4), 0.0]))).stopped == ""


@pytest.mark.parametrize(("share", "fits"), [(0.15, True), (0.25, False)])
def test_a_measured_torque_may_differ_by_a_fifth_of_the_limit(share: float, fits: bool) -> None:
    """Friction holds the arm too; of a robot's own gravity model a tenth is the most."""
    own = GravityTorque(ARM)(CENTER)
    change = lambda k, reading: reading._replace(torque=own + share * LIMITS.torque * [1.0, 0.0])  # noqa: E731
    if fits:
        assert not driven(change, brakes=False).by_robot
    else:
        with pytest.raises(adaptctl.InputError, match="of the limit apart"):
            driven(change, brakes=False)


def test_a_plant_on_the_network_takes_the_answer_to_its_own_datagram() -> None:
    """Of a controller that answers late, cuts a datagram off, and then answers."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with ours, theirs:
        for count in (6.0, 7.0):
            theirs.send(struct.pack("<4d", count, 10.0 * count, 1.0, 2.0))
            theirs.send(struct.pack("<3d", 7.0, 0.0, 0.0))
        torque, status = received(ours, 7, 2, 1.0) or (None, None)
        assert (np.asarray(torque).tolist(), status) == ([70.0, 1.0], 2)
        assert received(ours, 8, 2, 0.01) is None


def test_an_arm_on_the_network_holds_a_torque_once_and_then_falls(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a controller that leaves out the third and the fourth answer of six; the second period begins late."""
    monkeypatch.setattr(udp_plant, "PERIOD", period := 0.1)
    planned: list[float] = []

    def begun(due: float) -> float:
        planned.append(due)
        return due + 1.5 * period * (len(planned) == 2)

    monkeypatch.setattr(udp_plant, "begun", begun)
    torques = [np.array([1.0 + k, -0.3]) for k in range(6)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as theirs:
        theirs.bind(("127.0.0.1", 0))
        theirs.settimeout(5.0)

        def answer() -> None:
            for k, torque in enumerate(torques):
                data, place = theirs.recvfrom(4096)
                assert struct.unpack("<5d", data)[0] == k
                if k not in (2, 3):
                    theirs.sendto(struct.pack("<4d", k, *torque, 1 << k), place)

        peer = threading.Thread(target=answer, daemon=True)
        peer.start()
        udp_plant.main("two_link", 6 * period, theirs.getsockname()[1])
        peer.join(5.0)
    plant = adaptctl.Plant(ARM, period)
    state = plant.init(np.zeros(2), np.zeros(2))
    for torque in (*torques[:2], torques[1], np.zeros(2), *torques[4:]):
        state = plant.step(state, torque)
    np.testing.assert_allclose(np.diff(planned), period)
    told = capsys.readouterr().out
    assert abs(float(told.partition("round trips 50 %: ")[2].split()[0])) < 1e6  # not a time of day
    assert "us; 1 periods began late" in told
    assert "4 of 6 torques came, 2 did not" in told
    assert f"statuses together {0b110011}" in told
    assert f"in the end: {np.abs(state.v).max():.3g} rad/s, positions {np.round(state.p, 3).tolist()}" in told


def test_a_period_begins_when_it_is_due_or_at_once() -> None:
    now = time.perf_counter()
    assert udp_plant.begun(now + 0.01) >= now + 0.01
    assert udp_plant.begun(now - 0.01) >= now


def test_a_line_of_the_simulated_arm_may_leave_out_its_seconds_and_its_port() -> None:
    words = ["two_link", "3", "77"]
    found = [udp_plant.asked(words[:count]) for count in (1, 2, 3)]
    assert found == [("two_link", 20.0, 5150), ("two_link", 3.0, 5150), ("two_link", 3.0, 77)]


@pytest.mark.parametrize(("duration", "rows"), [(4.0, 21_000), (1e6, 2_000_000)])
def test_a_log_has_room_for_a_run_and_what_may_follow_it(
    duration: float, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eighty seconds at 250 Hz for a lead-in and a stop; a run of days is no reason to take all memory."""
    made = MagicMock()
    monkeypatch.setitem(_log.__globals__, "RunLogger", type("RunLogger", (), {"__new__": made}))
    _log("run.parquet", SafetyFilter(LAW, control_period=PERIOD), ARM, PERIOD, duration, True, None)
    told = made.call_args.kwargs
    assert (told["capacity"], told["joints"], told["estimates"]) == (rows, ("shoulder", "elbow"), 6)
    assert told["flags"][-1] == "payload_mass"


def test_times_are_told_by_their_middle_and_their_slowest() -> None:
    assert udp_plant.percentiles([1e-6 * k for k in range(1001)]) == "50 %: 500 us, 99 %: 990 us, 99.9 %: 999 us"
    assert udp_plant.percentiles([]) == "none"


def test_gains_fall_with_the_largest_that_a_delay_allows() -> None:
    assert hold_at(0) == hold_at(1) == DEFAULT_SAMPLING_RATIO
    for delay in (2, 3, 8):
        assert hold_at(delay) / hold_at(1) == pytest.approx(largest_with_delay(delay) / largest_with_delay(1))


def test_a_hand_is_of_the_last_link_where_the_flange_is() -> None:
    """Franka tells of the hand in the flange's frame, 107 mm beyond that of link 7."""
    robot: Any = object.__new__(FrankaRobot)
    inertia = np.diag([0.01, 0.02, 0.025])
    state = SimpleNamespace(m_total=0.7, F_x_Ctotal=[0.01, 0.0, 0.03], I_total=inertia.ravel().tolist())
    robot._robot = SimpleNamespace(read_once=lambda: state)
    mass, *moment = robot.tool[:4]
    assert (mass, moment) == (0.7, pytest.approx([0.7 * 0.01, 0.0, 0.7 * 0.137]))
    np.testing.assert_allclose(robot.tool, from_center_of_mass(0.7, [0.01, 0.0, 0.137], inertia))


@pytest.fixture
def trossen(monkeypatch: pytest.MonkeyPatch) -> MagicMock:
    """The names of trossen_arm, of an arm of two joints and a gripper."""
    client = MagicMock()
    limit = {"effort_max": 27.0, "velocity_max": 3.0, "position_min": -1.0, "position_max": 2.0}
    client.TrossenArmDriver.return_value.get_joint_limits.return_value = [SimpleNamespace(**limit)] * 3
    arm = SimpleNamespace(positions=[0.1, 0.2], velocities=[0.3, 0.4], compensation_efforts=[0.0, 0.005])
    output = SimpleNamespace(header=SimpleNamespace(timestamp=2_500_000), joint=SimpleNamespace(arm=arm))
    client.TrossenArmDriver.return_value.get_robot_output.return_value = output
    client.VectorDouble = list
    monkeypatch.setitem(sys.modules, "trossen_arm", client)
    return client


def test_a_trossen_arm_is_read_every_period_in_seconds_without_its_gripper(trossen: MagicMock) -> None:
    robot = TrossenRobot("192.168.1.2", 0.01, torque_rate=300.0)
    driver = trossen.TrossenArmDriver.return_value
    assert driver.configure.call_args.args[2:] == ("192.168.1.2", False)  # errors of the arm are not cleared
    assert (robot.limits.dof, robot.limits.torque[1], robot.limits.velocity[0]) == (2, 27.0, 3.0)
    assert (robot.limits.lower[0], robot.limits.upper[0], robot.limits.torque_rate[0]) == (-1.0, 2.0, 300.0)
    started = time.monotonic()
    readings = [robot.read() for _ in range(4)]
    assert 0.03 <= time.monotonic() - started < 0.5
    assert readings[0].time == 2.5
    assert (readings[0].p.tolist(), readings[0].v.tolist()) == ([0.1, 0.2], [0.3, 0.4])
    robot.start(np.array([1.0, -2.0]))
    driver.set_arm_modes.assert_called_once_with(trossen.Mode.external_effort)
    driver.set_arm_external_efforts.assert_called_once_with([1.0, -2.0], 0.0, False)
    robot.release()
    assert driver.set_arm_modes.call_args.args == (trossen.Mode.position,)
    driver.set_arm_positions.assert_called_once_with([0.1, 0.2], 0.0, False)


def test_what_a_trossen_arm_adds_counts_once_it_has_told_of_any(trossen: MagicMock) -> None:
    robot = TrossenRobot("192.168.1.2")
    reading, arm = robot.read(), trossen.TrossenArmDriver.return_value.get_robot_output.return_value.joint.arm
    assert robot.compensation(reading) is None  # of nothing but noise
    arm.compensation_efforts = [0.0, 3.0]
    assert np.asarray(robot.compensation(reading)).tolist() == [0.0, 3.0]
    arm.compensation_efforts = [0.0, 0.0]
    assert np.asarray(robot.compensation(reading)).tolist() == [0.0, 0.0]


def test_an_arm_may_stand_at_the_ends_of_its_range() -> None:
    limits = HardwareLimits(np.ones(2), np.ones(2), np.array([-1.0, 0.0]), np.array([0.5, 2.0]), np.full(2, 100.0))
    for p in (limits.lower, limits.upper):
        validate_posture(p, ["a", "b"], limits)
    for p, stands in (((0.0, -0.01), "-0.01"), ((0.0, 2.01), "2.01")):
        with pytest.raises(adaptctl.InputError, match=f"b stands at {stands}, outside its range 0 to 2 rad"):
            validate_posture(np.array(p), ["a", "b"], limits)
