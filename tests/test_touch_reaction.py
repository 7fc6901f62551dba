"""What a driven arm does when it is touched: it stops, yields, or goes back; MuJoCo applies the force."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from driven_robots import ARM, RecordedRobot

import adaptctl
from adaptctl.control import GuardedLearning, SafetyFilter, TaskSpaceSlotineLi, with_external_torque
from adaptctl.errors import InputError
from adaptctl.hardware import TouchEvent
from adaptctl.hardware.touch_reaction import CALM, Feeling, Retreat
from adaptctl.simulation import Plant

PERIOD = 4e-3
CENTER = np.array([0.3, 0.5])
REFERENCE = adaptctl.Sinusoids(CENTER, np.array([0.4, 0.3]), np.array([0.5, 0.8]))


@lru_cache
def law(kind: Any = adaptctl.SlotineLi, **more: Any) -> Any:
    model = adaptctl.ReducedModel(ARM, adaptctl.fundamental_basis(adaptctl.essential_space(ARM)))
    start = model.fundamental_parameters
    learning = GuardedLearning(np.maximum(0.1 * start**2, 1e-5), 1.0 / np.array([0.18, 0.07]) ** 2)
    given: Any = (model, 8.0, [6.0, 2.0], learning, start, PERIOD)
    return with_external_torque(kind(*given, **more))


class PushedRobot(RecordedRobot):
    """A robot whose last link is pushed between two times, N."""

    force, first, last = (0.0, 0.0, 0.0), 4.0, 4.5

    def read(self) -> Any:
        data: Any = self.plant._scene._data
        now = self._count * PERIOD
        data.xfrc_applied[-1, :3] = self.force if self.first <= now < self.last else 0.0
        return super().read()


def driven(force: tuple[float, float, float], last: float = 4.5, **more: Any) -> tuple[Any, PushedRobot]:
    robot = PushedRobot(ARM, PERIOD, CENTER)
    robot.force, robot.last = force, last
    return adaptctl.drive(robot, law(), REFERENCE, 6.0, lead_in=1.5, **more), robot


def test_without_a_touch_nothing_is_felt() -> None:
    run, robot = driven((0.0, 0.0, 0.0))
    assert (run.stopped, run.touches, robot.breaches) == ("", (), [])
    assert run.rollout.flags["touched"].sum() == 0.0
    assert np.abs(run.rollout.flags["external_torque.elbow"][750:]).max() < 0.1


def test_a_touch_stops_the_arm_on_its_path() -> None:
    run, robot = driven((15.0, 0.0, 0.0), last=4.2)
    event = run.touches[0]
    assert isinstance(event, TouchEvent)
    assert 3.96 < event.time < 4.04
    assert run.stopped == f"touched: {event}"
    assert (run.by_robot, robot.breaches) == (False, [])
    assert run.rollout.time[-1] < 5.8


def test_a_touch_can_be_ignored_and_is_told() -> None:
    run, _ = driven((15.0, 0.0, 0.0), on_touch="ignore")
    assert run.stopped == ""
    assert len(run.touches) == 1
    assert run.rollout.flags["touched"].sum() > 100
    torque = run.rollout.flags["external_torque.shoulder"]
    pushed = (run.rollout.time > 4.1) & (run.rollout.time < 4.45)
    assert np.abs(torque[pushed]).max() > 2.0
    assert np.abs(torque[~pushed & (run.rollout.time > 4.7)]).max() < 0.2


def test_a_touched_arm_goes_back_the_way_it_came() -> None:
    run, robot = driven((15.0, 0.0, 0.0), on_touch="retract")
    assert run.stopped.startswith("touched: ")
    assert (run.by_robot, robot.breaches) == (False, [])
    touched = round(run.touches[0].time / PERIOD)
    states = np.array(robot.states)[:, :2]
    came = states[touched - 350 : touched]
    off = np.linalg.norm(states[-1] - came, axis=1)
    assert off.min() < 0.02
    assert 0.5 < (350 - off.argmin()) * PERIOD < 1.4


class ClampingRobot(PushedRobot):
    """A robot whose last link has a soft wall in its way, from a time on."""

    def read(self) -> Any:
        data, now = self.plant._scene._data, self._count * PERIOD
        if now == self.first:
            self.wall, self.side = data.xipos[-1].copy(), data.xipos[-1] - self.before
        self.before = data.xipos[-1].copy()
        if now >= self.first:
            way = self.side / np.linalg.norm(self.side)
            self.deep = float(way @ (data.xipos[-1] - self.wall))
            data.xfrc_applied[-1, :3] = -2000.0 * max(self.deep, 0.0) * way
        return RecordedRobot.read(self)


def test_a_stopped_arm_that_clamps_something_goes_back() -> None:
    robot = ClampingRobot(ARM, PERIOD, CENTER)
    run = adaptctl.drive(robot, law(), REFERENCE, 6.0, lead_in=1.5)
    assert run.stopped.startswith("touched: ")
    assert run.stopped.endswith(", and clamped")
    assert (run.by_robot, robot.breaches) == (False, [])
    assert robot.deep < 0.0


def test_a_touched_arm_yields_until_it_is_left_alone() -> None:
    held, pushed = driven((15.0, 0.0, 0.0), last=5.0)[1], driven((15.0, 0.0, 0.0), last=5.0, on_touch="comply")
    run, robot = pushed
    assert run.stopped.startswith("touched: ")
    assert (run.by_robot, robot.breaches) == (False, [])
    ways = [np.abs(np.array(r.states)[1000:1240, :2] - np.array(r.states)[1000, :2]).max() for r in (held, robot)]
    assert ways[1] > 2.0 * ways[0]
    assert 5.8 < robot.tick * PERIOD < 8.0
    assert np.abs(np.array(robot.states)[-1, 2:]).max() < 0.05


def test_a_payload_that_is_announced_is_no_touch() -> None:
    controller, plant = law(), Plant(ARM, PERIOD)
    state = controller.init(CENTER, np.zeros(2))
    found = [Feeling(["shoulder", "elbow"]) for _ in range(2)]
    watch = state.law_state.watch._replace(age=np.array([9.0]))
    touch = state.law_state.touch._replace(torque=np.array([3.0, 0.0]), level=np.ones(2))
    felt = state._replace(law_state=state.law_state._replace(watch=watch, touch=touch))
    told = felt._replace(law_state=controller.adaptation.expect_payload(felt.law_state))
    for feeling, one in zip(found, (felt, told), strict=True):
        feeling.feel(one, 1.0)
    assert [feeling.touched for feeling in found] == [True, False]
    assert plant.dof == 2
    with pytest.raises(InputError, match=r"memory: expected a GuardedMemory, as the law_state .* got AdaptiveState"):
        controller.adaptation.expect_payload(felt)


@pytest.mark.parametrize(("age", "torque", "touched"), [(1.9, 3.0, 0), (2.0, 3.0, 1), (2.0, -3.0, 1), (2.0, 1.0, 0)])
def test_a_touch_is_felt_after_two_seconds_beyond_its_level(age: float, torque: float, touched: int) -> None:
    state, feeling = law().init(CENTER, np.zeros(2)), Feeling(["shoulder", "elbow"])
    watch = state.law_state.watch._replace(age=np.array([age]))
    touch = state.law_state.touch._replace(torque=np.array([2.5, torque]), level=np.array([3.0, 1.0]))
    feeling.feel(state._replace(law_state=state.law_state._replace(watch=watch, touch=touch)), 1.0)
    assert feeling.touched == touched
    assert [(event.joint, event.torque) for event in feeling.events] == [("elbow", torque)] * touched


def test_a_retreat_is_smooth_and_never_before_the_start() -> None:
    for time in (0.05, 0.4, 3.0):
        way, h = Retreat(REFERENCE, time, 0.3), 1e-5
        t = np.linspace(time, way.end + 0.1, 400)
        numeric = (way(t + h).p - way(t - h).p) / (2.0 * h)
        np.testing.assert_allclose(numeric[1:], way(t).v[1:], atol=2e-4)
        np.testing.assert_allclose((way(t + h).v - way(t - h).v)[2:] / (2.0 * h), way(t).a[2:], atol=2e-2)
        np.testing.assert_allclose(way(time).v, REFERENCE(time).v, atol=1e-12)
        assert np.abs(way(way.end).v).max() < 1e-12
        gone = REFERENCE(max(0.0, time - way.back - 0.15)).p
        np.testing.assert_allclose(way(way.end).p, gone, atol=1e-9)


@pytest.mark.parametrize(
    ("reaction", "kind", "said"),
    [
        ("run", "joints", "on_touch: expected 'ignore', 'stop', 'comply', 'retract', got 'run'"),
        (None, "joints", "on_touch: expected"),
        ("comply", "task", "'comply' needs a controller whose reference is in joints"),
    ],
)
def test_reactions_that_cannot_be_are_refused(reaction: Any, kind: str, said: str) -> None:
    controller = law()
    if kind == "task":
        controller = law(TaskSpaceSlotineLi, axes=(0,), link="upper")
    robot = PushedRobot(ARM, PERIOD, CENTER)
    with pytest.raises(InputError, match=said):
        adaptctl.drive(robot, controller, REFERENCE, 3.0, on_touch=reaction)
    assert not hasattr(robot, "sent")


def test_an_observer_within_a_safety_filter_is_felt() -> None:
    robot = PushedRobot(ARM, PERIOD, CENTER)
    robot.force = (15.0, 0.0, 0.0)
    run = adaptctl.drive(robot, SafetyFilter(law()), REFERENCE, 6.0, lead_in=1.5)
    assert run.stopped.startswith("touched: ")


def test_a_touch_is_over_after_a_second_and_clamps_after_three_tenths_at_rest() -> None:
    state, feeling = law().init(CENTER, np.zeros(2)), Feeling(["shoulder", "elbow"])
    pressed: Any = SimpleNamespace(pressed=5.0, level=2.0)
    pinched = Feeling(["shoulder", "elbow"])
    pinched.feel(state, 0.0, pressed)
    assert pinched.clamps(0.0, 0.5)  # from the first moment on
    feeling.feel(state, 1.0)  # nothing
    feeling.feel(state, 2.0, pressed)
    assert [feeling.over(time) for time in (2.5, 3.0, 3.25)] == [False, False, True]
    assert [feeling.clamps(2.25, time) for time in (2.5, 2.5625)] == [False, True]
    assert not feeling.clamps(0.0, 1.25)  # since something has been felt
    feeling.feel(state, 3.0, pressed)
    assert len(feeling.events) == 1
    feeling.feel(state, 4.25, pressed)
    assert len(feeling.events) == 2


def test_a_touch_is_over_when_nothing_was_felt_for_a_while() -> None:
    feeling: Any = object.__new__(Feeling)
    feeling._last = 2.0
    assert [feeling.over(2.0 + share * CALM) for share in (0.0, 0.99, 1.01)] == [False, False, True]
