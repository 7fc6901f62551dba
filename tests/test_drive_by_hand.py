"""The control loop of a drive, at numbers that are written by hand."""

from __future__ import annotations

from dataclasses import replace
from inspect import signature
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driven_robots import ARM

from adaptctl.cli.export import export
from adaptctl.control import ComputedTorque, SafetyFilter, Sinusoids, SlotineLi
from adaptctl.control.controller import ReferencePoint
from adaptctl.errors import InputError
from adaptctl.hardware import HardwareLimits, LoopTimes, RobotReading, drive, loop, udp_plant
from adaptctl.hardware.checks import standing
from adaptctl.hardware.lead_in import _lengths, beyond_limits
from adaptctl.hardware.loop import DriveLoop
from adaptctl.hardware.measurements import Measurements
from adaptctl.hardware.resting import StoppingDistance
from adaptctl.hardware.stop import PlannedStop
from adaptctl.hardware.torque_guard import TorqueGuard
from adaptctl.identifiability import ReducedModel

PERIOD, REST = 0.01, np.zeros(2)
LIMITS = HardwareLimits([50.0, 20.0], [2.0, 4.0], [-1.0, -2.0], [1.5, 2.0], 1000.0)
POINT = ReferencePoint(REST, REST, REST)


def reading(time: float = 1.0, p: Any = REST, v: Any = REST, torque: Any = None) -> RobotReading:
    return RobotReading(time, np.asarray(p, dtype=float), np.asarray(v, dtype=float), torque)


class Asked:
    """A robot that notes what it is asked for."""

    period, limits, compensates_gravity = PERIOD, LIMITS, False

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def read(self) -> RobotReading | None:
        self.asked.append("read")
        return None

    def write(self, torque: Any) -> None:
        self.asked.append(np.array(torque))

    def stop(self) -> None:
        self.asked.append("stop")

    def start(self, torque: Any) -> None:
        self.asked.append(("start", np.array(torque)))


def made(**given: Any) -> Any:
    """A loop with the parts that are given, of an arm that is driven for 10 s and is at 1 s."""
    found: Any = object.__new__(DriveLoop)
    flags = SimpleNamespace(stopped=[False], ringing=[False])
    plain: dict[str, Any] = {
        "robot": Asked(), "duration": 10.0, "time": 1.0, "limits": LIMITS, "names": ["a", "b"], "stop": None,
        "blind": 0, "interrupted": False, "ended": False, "by_robot": False, "stopped": "", "sensor": None,
        "times": LoopTimes(PERIOD), "state": SimpleNamespace(flags=flags), "_holds": True, "start_p": REST,
        "_nears_an_end": lambda now: np.array([False, False]),
        "guard": TorqueGuard(LIMITS, PERIOD, REST), "first_error": 0.0, "worst_error": 0.0, "peak_rate": 0.0,
        "peak_speed_share": 0.0, "moves": False,
    }  # fmt: skip
    vars(found).update(plain | given)
    return found


def test_a_loop_begins_with_nothing_behind_it() -> None:
    stopping: Any = SimpleNamespace(inverses=np.eye(2)[None])
    law: Any = SafetyFilter(ComputedTorque(ARM, 4.0), stop_damping=1.0)
    rest: Any = None
    begun = DriveLoop(Asked(), law, rest, 10.0, ARM, LIMITS, stopping, rest, rest, rest)
    assert (begun.time, begun.blind, begun.good, begun.stop, begun.stopped) == (0.0, 0, 0.0, None, "")
    assert [begun.by_robot, begun.interrupted, begun.ended, begun.moves] == [False] * 4
    peaks = begun.peak_rate, begun.peak_speed_share, begun.first_error, begun.worst_error
    assert peaks == (0.0, 0.0, 0.0, 0.0)
    assert begun._logged < 0.0  # what is at time 0 is logged
    assert str(begun) == "driving, 0 of 10 s, worst error 0 mrad"


def test_an_arm_is_stopped_where_a_limit_is_passed_and_not_where_it_is_met() -> None:
    assert made()._trouble(reading(v=LIMITS.velocity), POINT) == ""
    assert made()._trouble(reading(v=-1.01 * LIMITS.velocity), POINT) == "a is above its speed limit"
    assert made()._trouble(reading(p=[0.0, 0.3]), POINT) == ""
    assert made()._trouble(reading(p=[0.0, -0.31]), POINT) == "b is 0.3 rad (m) off the reference"
    near = made(_nears_an_end=lambda now: np.array([False, True]))
    assert near._trouble(reading(), POINT) == "b comes too near to the end of its range"
    assert made(time=9.99)._trouble(reading(), POINT) == ""
    assert made(time=10.0)._trouble(reading(), POINT) == "done"
    assert made(interrupted=True)._trouble(reading(), POINT) == "interrupted"
    assert made(sensor=SimpleNamespace(failed="silent"))._trouble(reading(), POINT) == "silent"


@pytest.mark.parametrize("late", [20, 21])
def test_so_many_periods_may_be_late_in_a_row(late: int) -> None:
    times = LoopTimes(PERIOD)
    for _ in range(late):
        times.count(1.3 * PERIOD)
    assert made(times=times)._trouble(reading(), POINT).startswith("21 periods in a row came late") == (late > 20)


@pytest.mark.parametrize(
    ("time", "sunk", "holds", "stops"),
    [(0.049, 1.1e-3, True, True), (0.05, 1.1e-3, True, False), (0.04, 1e-3, True, False), (0.0, 0.1, False, False)],
)
def test_an_arm_that_sinks_as_its_brakes_open_is_braked_within_a_twentieth_of_a_second(
    time: float, sunk: float, holds: bool, stops: bool
) -> None:
    driven = made(time=time, _holds=holds)
    driven._trouble(reading(p=[0.0, -sunk]), POINT)
    assert driven.ended == driven.by_robot == stops
    assert driven.robot.asked == ["stop"] * stops


def test_touches_stop_an_arm_once_and_an_arm_that_yields_when_they_are_over() -> None:
    feeling = SimpleNamespace(touched=True, events=["a touch"], over=lambda time: True)
    assert made(feeling=feeling, on_touch="stop")._trouble(reading(), POINT) == "touched: a touch"
    assert made(feeling=feeling, on_touch="ignore")._trouble(reading(), POINT) == ""
    stop = SimpleNamespace(yields=True, reason="touched")
    assert made(feeling=feeling, on_touch="comply", stop=stop)._trouble(reading(), POINT) == "touched"
    feeling.over = lambda time: False
    assert made(feeling=feeling, on_touch="comply", stop=stop)._trouble(reading(), POINT) == ""


@pytest.mark.parametrize(
    ("braked", "measured", "held"),
    [(True, [9.0, 9.0], [2.0, 3.0]), (False, [9.0, 8.0], [9.0, 8.0]), (False, None, [2.0, 3.0])],
)
def test_a_drive_starts_from_the_torque_that_holds_the_arm(braked: bool, measured: Any, held: list[float]) -> None:
    """Of 3 and 5 N m at rest the robot adds 1 and 2 itself; the controller's own torque is 2.5 and 4."""
    begun: list[Any] = []
    controller = SimpleNamespace(
        init=lambda p, v, torque: begun.append((p, v, torque)) or SimpleNamespace(), inner=None
    )
    robot = Asked()
    robot.has_brakes = braked  # type: ignore[attr-defined]
    driven = made(robot=robot, controller=controller, compensation=lambda now: np.array([1.0, 2.0]))
    now = reading(p=[0.1, 0.2], torque=None if measured is None else np.array(measured))
    driven._start(now, np.array([2.5, 4.0]), np.array([3.0, 5.0]))
    total = np.add(held, [1.0, 2.0])
    ((p, v, torque),) = begun
    np.testing.assert_array_equal([p, v, torque], [now.p, REST, total])
    np.testing.assert_array_equal(driven.offset, total - [2.5, 4.0])
    np.testing.assert_array_equal(driven.applied, total)
    ((what, first),) = robot.asked
    assert what == "start"
    np.testing.assert_array_equal(first, held)
    assert (driven.moves, driven._holds) == (True, braked)
    with pytest.raises(KeyboardInterrupt):
        made(robot=Asked(), controller=controller, compensation=lambda now: REST, interrupted=True)._start(
            now, REST, REST
        )


def test_periods_without_a_measurement_are_ridden_out_ten_times(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr(loop.time, "sleep", slept.append)
    joints = ARM.primary_joints
    driven = made(measurements=Measurements(joints, LIMITS, PERIOD, REST), _began=0.0, time=0.0)
    for k in range(10):
        now, sound = driven._read()
        assert not sound
        assert now.time == pytest.approx((k + 1) * PERIOD)
        assert not driven.ended
    driven._read()
    assert driven.stopped == "by the robot: 11 periods without a sound measurement: no measurement"
    assert slept == []
    driven.robot.read = lambda: 1.0 / 0.0
    driven._read()
    assert (driven.measurements.fault, slept) == ("ZeroDivisionError: float division by zero", [PERIOD])


@pytest.mark.parametrize(("gap", "passed"), [(10, 10), (11, 1)])
def test_a_gap_of_more_than_ten_periods_counts_as_one(gap: int, passed: int) -> None:
    """As of a robot whose clock jumped: the arm goes on where it was on its path, in the periods after it too."""
    driven = made(measurements=Measurements(ARM.primary_joints, LIMITS, PERIOD, REST), _began=5.0)
    for after, periods in ((0, 0), (gap, passed), (gap + 2, passed + 2)):
        driven.robot.read = lambda after=after: reading(6.0 + after * PERIOD)
        driven._read()
        assert driven.time == pytest.approx(1.0 + periods * PERIOD)


@pytest.mark.parametrize(
    ("apart", "before", "ends", "reason", "path"),
    [
        (0.25, False, False, "interrupted", "along"),
        (0.26, False, False, "interrupted", "ahead"),
        (0.0, True, False, "interrupted", "ahead"),
        (0.0, False, True, "interrupted", "ahead"),
        (0.0, False, False, f"a {loop.TOO_FAST}", "ahead"),
    ],
)
def test_a_stop_is_on_the_path_where_the_arm_is_near_it_and_it_is_the_first(
    apart: float, before: bool, ends: bool, reason: str, path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = PlannedStop(lambda time: POINT, 3.0, None, "touched", yields=True)
    for name in ("along", "ahead"):
        monkeypatch.setattr(PlannedStop, name, lambda *given, name=name: replace(stop, reason=name))
    driven = made(
        stop=stop if before else None, max_error=0.5, on_touch="stop", path=None, stopping=None, proven=None,
        held_state=SimpleNamespace(at=lambda proven, state: state),
        _nears_an_end=lambda now: np.array([False, ends]),
    )  # fmt: skip
    point = POINT._replace(p=np.array([0.0, 0.5]))
    driven._begin_stop(reason, reading(p=[0.0, 0.5 - apart]), point)
    assert driven.stop.reason == path
    assert driven.stopped == reason


def test_a_stop_ends_after_half_a_second_at_rest_and_two_more_at_most() -> None:
    def finished(time: float, speed: float) -> Any:
        driven = made(time=time, stop=SimpleNamespace(end=3.0))
        driven._finish(reading(v=[0.0, -speed]))
        return driven.ended, driven.by_robot

    assert finished(3.49, 0.0) == (False, False)
    assert finished(3.5, 0.049) == (True, False)
    assert finished(3.5, 0.05) == (False, False)
    assert finished(5.5, 0.05) == (False, False)
    assert finished(5.51, 0.05) == (True, True)


def test_an_arm_that_holds_its_weight_is_handed_back_with_torques_that_fall_for_a_fifth_of_a_second() -> None:
    driven = made(measurements=Measurements(ARM.primary_joints, LIMITS, PERIOD, REST))
    driven.robot.compensates_gravity = True
    driven.guard = TorqueGuard(LIMITS, PERIOD, begun := np.array([8.0, -4.0]))
    driven._hand_back()
    written = [asked for asked in driven.robot.asked if not isinstance(asked, str)]
    np.testing.assert_allclose(written, np.outer(1.0 - np.arange(1, 21) / 20.0, begun), atol=1e-12)
    assert driven.robot.asked[-1] == "stop"  # a robot that has no way of its own to be released
    assert driven.ended
    plain = made()
    plain._hand_back()
    assert plain.robot.asked == ["stop"]


@pytest.mark.parametrize(("refused", "apart", "failed"), [(False, 0.49, False), (True, 0.0, True), (False, 0.51, True)])
def test_a_planned_stop_fails_with_its_law_or_far_from_its_path(refused: bool, apart: float, failed: bool) -> None:
    after: Any = SimpleNamespace(flags=SimpleNamespace(stopped=[refused]))
    driven = made(
        stop=PlannedStop(lambda time: POINT, np.inf, None, "touched", yields=True), max_error=0.5, applied=REST,
        controller=SimpleNamespace(step=lambda *given: (REST, after)), _told=lambda state, now: state,
        held_state=SimpleNamespace(without_learning=lambda state, torque: state),
    )  # fmt: skip
    driven._torque(reading(p=[0.0, -apart]), POINT)
    assert ("planned stop failed" in driven.stopped) == failed


def test_peaks_of_a_drive_are_noted() -> None:
    driven = made()
    driven.times.count(PERIOD)
    driven._note(reading(p=[0.02, -0.03], v=[1.0, -3.0]), POINT, REST, np.array([0.5, -2.0]))
    driven.times.count(PERIOD)
    driven._note(reading(p=[0.01, 0.0]), POINT, np.array([0.5, -2.0]), np.array([0.5, -2.1]))
    peaks = driven.first_error, driven.worst_error, driven.peak_rate, driven.peak_speed_share
    assert peaks == pytest.approx((0.03, 0.03, 200.0, 0.75))


def test_the_model_explains_a_torque_if_feedback_adds_a_twentieth_of_the_limits_at_most() -> None:
    def quiet(s: Any, damping: Any) -> bool:
        state = SimpleNamespace(inner=SimpleNamespace(s=s))
        found: bool = made(state=state, controller=SimpleNamespace(inner=SimpleNamespace(damping=damping)))._is_quiet()
        return found

    assert quiet(np.array([0.25, -0.1]), np.array([10.0, 10.0]))
    assert not quiet(np.array([-0.26, 0.0]), np.array([10.0, 10.0]))
    assert quiet(np.array([9.0, 9.0]), None)
    assert quiet(None, np.array([10.0, 10.0]))


def learning(**given: Any) -> Any:
    """A loop that is at the reference, with a state that learns and one that does not."""
    flags, held = SimpleNamespace(stopped=[False]), SimpleNamespace(without_learning=lambda after, applied: KEPT)
    feeling, controller = SimpleNamespace(feel=lambda *of: None), SimpleNamespace(inner=SimpleNamespace())
    found = {"held_state": held, "feeling": feeling, "controller": controller, "good": 0.0, "proven": "none"}
    LEARNED.flags = KEPT.flags = flags
    return made(**(found | given))


LEARNED, KEPT = SimpleNamespace(inner=SimpleNamespace()), SimpleNamespace(inner=SimpleNamespace())


@pytest.mark.parametrize(
    ("given", "sound", "learns"),
    [
        ({"time": 0.19}, True, False),
        ({"time": 0.2}, True, True),
        ({}, False, False),
        ({"stop": SimpleNamespace(yields=False, feels=False)}, True, False),
        ({"sensor": SimpleNamespace(pressed=0.0)}, True, True),
        ({"sensor": SimpleNamespace(pressed=9.0)}, True, False),
        ({"sensor": SimpleNamespace(pressed=9.0), "wrench_torque": "known"}, True, True),
    ],
)
def test_a_loop_learns_where_its_torques_are_its_own(given: dict[str, Any], sound: bool, learns: bool) -> None:
    driven = learning(**given)
    driven._learn(LEARNED, REST, sound, reading(), POINT)
    assert driven.learning == learns
    assert driven.state is (LEARNED if learns else KEPT)


@pytest.mark.parametrize(("rings", "said"), [(True, "b rings: "), (False, "a number of the controller is not finite")])
def test_a_filter_that_stops_says_which_joint_rings(rings: bool, said: str) -> None:
    detector = SimpleNamespace(lag_product=np.array([-0.5, -0.9]), power=np.ones(2))
    state = SimpleNamespace(ringing=detector, flags=SimpleNamespace(ringing=[rings]))
    assert made(state=state)._unsound().startswith(said)


@pytest.mark.parametrize("place", [None, "tool"])
def test_a_law_knows_measured_torques_where_the_sensor_has_a_place(place: str | None) -> None:
    given = {"applied": "sent", "held_state": SimpleNamespace(feeling=lambda *of: of)}
    driven = made(sensor=SimpleNamespace(wrench="w", point=place), wrench_torque=lambda p, *felt: [*felt], **given)
    assert driven._told("before", reading()) == (("before", "sent", ["w", place]) if place else "before")


@pytest.mark.parametrize(("error", "proves"), [(0.059, True), (0.06, False)])
def test_an_estimate_is_proven_by_a_quarter_of_a_second_within_a_fifth_of_the_largest_error(
    error: float, proves: bool
) -> None:
    driven = learning()
    for _ in range(24):
        driven._learn(LEARNED, REST, True, reading(p=[0.0, -error]), POINT)
        assert driven.proven == "none"
    for _ in range(2):  # a hundredth of a second each, to round-off
        driven._learn(LEARNED, REST, True, reading(p=[0.0, -error]), POINT)
    assert (driven.proven is LEARNED) == proves
    driven._learn(LEARNED, REST, True, reading(p=[0.0, 0.1]), POINT)
    assert driven.good == 0.0


def test_lead_ins_are_as_documented_and_at_most_half_of_a_run() -> None:
    assert _lengths(40.0) == [3.0, 5.0, 8.0, 12.0, 20.0]
    assert _lengths(39.9) == [3.0, 5.0, 8.0, 12.0]
    assert _lengths(1.0) == [3.0]


@pytest.mark.parametrize(("joints", "spoilt"), [(1, 0.0), (3, 0.0), (2, np.nan), (2, np.inf)])
def test_a_reference_has_finite_points_of_all_joints(joints: int, spoilt: float) -> None:
    def reference(t: Any) -> ReferencePoint:
        still = np.zeros((len(t), joints))
        return ReferencePoint(still, still + spoilt, still)

    told = beyond_limits(reference, 1.0, ARM, LIMITS, StoppingDistance(ARM, LIMITS, PERIOD))
    assert told == "expected finite positions, velocities and accelerations of 2 joints"


def test_an_arm_whose_measurements_are_not_sound_is_refused_with_the_last_fault() -> None:
    faults = iter(["late", "not finite", *[""] * 48])
    measurements: Any = SimpleNamespace(fault="")

    def taken(now: RobotReading | None) -> None:
        measurements.fault = next(faults)

    measurements.taken = taken
    with pytest.raises(InputError, match=r"^robot: 0 of 50 measurements were sound: not finite$"):
        standing(Asked(), measurements, ["a", "b"], LIMITS)


def test_code_is_compiled_before_an_arm_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, model = Asked(), ReducedModel(ARM)
    monkeypatch.setattr(SafetyFilter, "compile", lambda own: robot.asked.append("compile"))
    law = SlotineLi(model, 4.0, [3.0, 0.5], initial=model.fundamental_parameters, control_period=PERIOD)
    with pytest.raises(InputError, match="measurements were sound"):
        drive(robot, law, Sinusoids(REST, REST + 0.1, REST + 0.5), 1.0)
    assert robot.asked[:2] == ["compile", "read"]


def test_the_simulated_arm_keeps_the_period_of_exported_code() -> None:
    assert signature(export).parameters["control_period"].default == udp_plant.PERIOD
