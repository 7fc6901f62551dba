"""A loop at 1 kHz by hand: controllers compiled ahead of time, references at one time, and the examples."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import adaptctl
from adaptctl.control import FadeIn, MinimumJerk, ReferencePoint, Sinusoids, Spline

RNG = np.random.default_rng(0)
REFERENCES = {
    "sinusoids": Sinusoids(RNG.normal(size=6), RNG.normal(size=(3, 6)), RNG.uniform(0.1, 1.0, (3, 6)), start_time=2.0),
    "from the start": Sinusoids(np.zeros(2), np.ones(2), np.ones(2), np.array([0.3, 0.4]), start_time=0.0),
    "minimum jerk": MinimumJerk(RNG.normal(size=(5, 4)), np.array([0.5, 1.0, 2.5, 3.0, 4.0])),
    "spline": Spline(RNG.normal(size=(9, 3)), np.sort(RNG.uniform(0.5, 4.0, 9))),
    "short spline": Spline(RNG.normal(size=(6, 1)), np.linspace(1.0, 2.0, 6)),
}
REFERENCES["faded in"] = FadeIn(REFERENCES["from the start"], np.array([1.5, -1.0]), 1.5)


@pytest.mark.parametrize("name", REFERENCES)
@settings(max_examples=50, deadline=None)
@given(t=st.floats(-1.0, 6.0))
def test_at_one_time_a_reference_is_what_it_is_at_many(name: str, t: float) -> None:
    reference: Any = REFERENCES[name]
    for found, expected in zip(reference.at(t), reference(t), strict=True):
        scale = np.abs(reference(np.linspace(0.0, 5.0, 200)).a).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * scale)


@pytest.mark.parametrize("name", REFERENCES)
def test_so_it_is_at_its_ends_and_corners(name: str) -> None:
    reference: Any = REFERENCES[name]
    for t in [*getattr(reference, "times", ()), 0.0, 2.0, float("-inf") if "times" in dir(reference) else -1.0]:
        if np.isfinite(t):
            found, expected = reference.at(float(t)), reference(float(t))
            assert isinstance(found, ReferencePoint)
            np.testing.assert_allclose(found.p, expected.p, atol=1e-11)


def cpu(function: Callable[[], object], count: int = 2000) -> float:
    """Processor time (s) of a call, the least of five rounds."""
    best = np.inf
    for _ in range(5):
        started = time.process_time()
        for _ in range(count):
            function()
        best = min(best, (time.process_time() - started) / count)
    return float(best)


def test_a_reference_is_no_dearer_than_the_law() -> None:
    arm = adaptctl.load("puma560_measured")
    model = adaptctl.ReducedModel(arm, adaptctl.fundamental_basis(adaptctl.essential_space(arm)))
    tuning = adaptctl.tune(arm)
    law = tuning.controller(model).compile()
    zero = np.zeros(6)
    state, point = law.init(zero, zero), REFERENCES["sinusoids"](0.5)
    cost = cpu(lambda: law.step(state, zero, zero, point))
    for name in ("sinusoids", "minimum jerk", "spline"):
        reference: Any = REFERENCES[name]
        assert cpu(lambda at=reference.at: at(0.7)) < 2.0 * cost + 5e-6, name


def test_what_is_compiled_ahead_takes_no_time_at_the_first_step() -> None:
    arm = adaptctl.load("docs/examples/two_link.toml")
    zero, still = np.zeros(2), ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    law = adaptctl.ComputedTorque(arm, 3.21).compile()
    state, started = law.init(zero, zero), time.process_time()
    law.step(state, zero, zero, still)
    assert time.process_time() - started < 0.05
    assert law.compile(many=True) is law
    many = np.zeros((8, 2))
    assert law.step(law.init(many, many), many, many, still)[0].shape == (8, 2)


def example(name: str) -> Any:
    """An example of the documentation, imported as a module."""
    spec = spec_from_file_location(name, Path("docs/examples") / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TWO_LINK = """
<mujoco>
  <compiler angle="degree"/>
  <option timestep="{step}" integrator="implicitfast" gravity="0 0 {gravity}"/>
  <worldbody>
    <body>
      <joint name="shoulder" axis="0 -1 0"/>
      <inertial pos="0.2 0 0" mass="2.0" diaginertia="0.002 0.028 0.028"/>
      <body pos="0.4 0 0">
        <joint name="elbow" axis="0 -1 0"/>
        <inertial pos="0.15 0 0" mass="1.2" diaginertia="0.001 0.01 0.01"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="shoulder"/>
    <motor joint="elbow"/>
  </actuator>
</mujoco>
"""
"""docs/examples/two_link.toml, written again for MuJoCo"""

STEPS = 4
"""MuJoCo's steps in a control period"""


class MujocoArm:
    """An arm as a driver shows it, moved by MuJoCo; one that adds its own gravity's torque has none."""

    def __init__(self, p: Any, period: float, *, weightless: bool = True) -> None:
        text = TWO_LINK.format(gravity=0.0 if weightless else -9.81, step=period / STEPS)
        self.model, self.period = mujoco.MjModel.from_xml_string(text), period
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = p
        self.stopped = False

    def moved(self, torque: Any) -> bool:
        self.data.ctrl[:] = torque
        mujoco.mj_step(self.model, self.data, STEPS)
        return True

    def getActualQ(self) -> list[float]:
        return self.data.qpos.tolist()

    def getActualQd(self) -> list[float]:
        return self.data.qvel.tolist()

    def initPeriod(self) -> None: ...

    def waitPeriod(self, tick: None) -> None: ...

    def directTorque(self, torque: list[float]) -> bool:
        return self.moved(torque)

    def stopScript(self) -> None:
        self.stopped = True

    def start_torque_control(self) -> MujocoArm:
        return self

    def readOnce(self) -> tuple[Any, Any]:
        seen = SimpleNamespace(q=self.getActualQ(), dq=self.getActualQd())
        return seen, SimpleNamespace(to_sec=lambda: self.period)

    def writeOnce(self, command: Any) -> None:
        self.moved(command.torques)

    def stop(self) -> None:
        self.stopped = True


def test_the_arm_of_mujoco_is_the_same_arm(two_link: adaptctl.Mechanism) -> None:
    arm, p, v = MujocoArm([0.3, -0.7], 1e-3, weightless=False), np.array([0.3, -0.7]), np.array([1.0, -2.0])
    arm.data.qvel[:], arm.data.ctrl[:] = v, [3.0, -1.0]
    mujoco.mj_forward(arm.model, arm.data)
    np.testing.assert_allclose(arm.data.qacc, two_link.forward_dynamics(p, v, [3.0, -1.0]), rtol=2e-4)


@pytest.fixture(scope="module")
def two_link() -> adaptctl.Mechanism:
    return adaptctl.load("docs/examples/two_link.toml")


def learnt(run: adaptctl.Rollout) -> bool:
    """Whether the last second's error is half of the worst second's, or less."""
    second = round(1.0 / run.control_period)
    seconds = [run.error[k : k + second] for k in range(0, len(run.error) - second + 1, second)]
    errors = [float(np.sqrt(np.mean(part**2))) for part in seconds]
    return errors[-1] < 0.5 * max(errors)


def validate_no_lunge(run: adaptctl.Rollout) -> None:
    """It begins where the arm stands, at rest and without torque, and moves no faster than its reference."""
    np.testing.assert_array_equal(run.error[0], 0.0)
    np.testing.assert_array_equal(run.reference_v[0], 0.0)
    np.testing.assert_array_equal(run.torque[0], 0.0)
    assert np.abs(run.v).max() < np.abs(run.reference_v).max() + 0.05 < 1.0
    assert np.abs(run.error).max() < 0.01


AWAY = (0.05, 1.0)
"""rad from the reference at which the arm stands"""


@pytest.mark.parametrize("away", AWAY)
def test_the_ur_loop_starts_where_the_arm_stands_and_learns(two_link: adaptctl.Mechanism, away: float) -> None:
    module = example("ur_rtde_loop")
    module.LATE = 10**6  # however busy the machine is
    controller, reference = module.prepared(two_link)
    arm = MujocoArm(reference.at(0.0).p + away, module.PERIOD)
    log = adaptctl.RunLogger(2, module.PERIOD, estimates=len(controller.inner.model.names))
    module.control(arm, arm, controller, reference, 8.0, log)
    validate_no_lunge(log.rollout())
    assert learnt(log.rollout())
    assert arm.stopped
    arm.stopped, arm.directTorque = False, lambda torque: False  # type: ignore[method-assign]
    with pytest.raises(RuntimeError, match="the arm refuses torques"):
        module.control(arm, arm, controller, reference, 5.0, log)
    assert arm.stopped


@pytest.mark.parametrize("name", ["ur_rtde_loop", "franka_loop"])
def test_an_arm_that_compensates_its_weight_is_told_of_none(two_link: adaptctl.Mechanism, name: str) -> None:
    """At rest on its reference, with the arm's own parameters as the estimate: no torque."""
    guarded = example(name).prepared(two_link)[0]
    law = replace(guarded.inner, initial=guarded.inner.model.fundamental_parameters)
    p, zero = np.array([0.3, 0.2]), np.zeros(2)
    torque, _ = law.step(law.init(p, zero), p, zero, ReferencePoint(p, zero, zero))
    np.testing.assert_allclose(torque, 0.0, atol=1e-12)


def test_the_ur_loop_gives_up_when_it_cannot_keep_the_clock(two_link: adaptctl.Mechanism) -> None:
    module = example("ur_rtde_loop")
    controller, reference = module.prepared(two_link)
    arm = MujocoArm(reference.at(0.0).p, module.PERIOD)
    arm.waitPeriod = lambda tick: time.sleep(3 * module.PERIOD)  # type: ignore[method-assign]
    log = adaptctl.RunLogger(2, module.PERIOD, estimates=len(controller.inner.model.names))
    with pytest.raises(RuntimeError, match="more than 5 periods came late"):
        module.control(arm, arm, controller, reference, 5.0, log)
    assert arm.stopped


@pytest.mark.parametrize("away", AWAY)
def test_the_franka_loop_starts_where_the_arm_stands_learns_and_stops_the_robot_when_it_fails(
    two_link: adaptctl.Mechanism, away: float
) -> None:
    module = example("franka_loop")
    light = module.weightless(two_link)
    assert light.description.gravity.tolist() == [0.0, 0.0, 0.0]
    controller, reference = module.prepared(two_link)
    arm = MujocoArm(reference.at(0.0).p + away, module.PERIOD)
    log = adaptctl.RunLogger(2, module.PERIOD, estimates=len(controller.inner.model.names))

    def torques(numbers: list[float]) -> SimpleNamespace:
        return SimpleNamespace(torques=numbers, motion_finished=False)

    module.control(arm, torques, controller, reference, 8.0, log)
    run = log.rollout()
    validate_no_lunge(run)
    assert np.abs(np.diff(run.torque, axis=0, prepend=0.0)).max() <= 950.0 * module.PERIOD
    assert learnt(run)
    assert not arm.stopped
    with pytest.raises(TypeError):
        module.control(arm, None, controller, reference, 5.0, log)
    assert arm.stopped


def test_the_ros_node_sends_efforts_while_it_hears_of_the_joints(two_link: adaptctl.Mechanism) -> None:
    module, reference = example("ros2_node"), REFERENCES["from the start"]
    law = adaptctl.ComputedTorque(two_link, 8.0)
    node = module.Tracking([joint.name for joint in two_link.primary_joints], law, reference)
    assert node.efforts(0.0) is None
    names = [joint.name for joint in two_link.primary_joints][::-1]
    node.receive(10.0, ["gripper", *names], [9.0, 0.2, 0.1], [9.0, 0.0, 0.5])
    p, zero = np.array([0.1, 0.2]), np.zeros(2)
    expected, _ = law.step(law.init(p, zero), p, [0.5, 0.0], ReferencePoint(p, zero, zero))
    np.testing.assert_allclose(node.efforts(10.0), expected, rtol=1e-12)
    assert node.efforts(10.2) is None


OTHERS = {
    "a gripper": (["gripper"], [0.1], [0.0]),
    "no velocities": (["joint1", "joint2"], [0.1, 0.2], []),
    "one joint": (["joint2", "gripper"], [0.2, 0.1], [0.0, 0.0]),
    "not finite": (["joint1", "joint2"], [0.1, float("nan")], [0.0, 0.0]),
    "nothing": ([], [], []),
    "fewer positions": (["joint1", "joint2"], [0.1], [0.0, 0.0]),
}


@pytest.mark.parametrize("other", OTHERS)
def test_the_ros_node_passes_over_others_messages(other: str) -> None:
    """A gripper publishes joint states too, and joint_state_publisher has no velocities; what is stale stays stale."""

    class Law:
        def compile(self) -> Law:
            return self

    node = example("ros2_node").Tracking(["joint1", "joint2"], Law(), None)
    node.receive(0.0, *OTHERS[other])
    assert node.efforts(0.0) is None
    node.receive(1.0, ("joint2", "joint1"), (0.2, 0.1), (0.0, 0.0))
    node.receive(2.0, *OTHERS[other])
    assert node.measured[0] == 1.0
    assert node.efforts(2.0) is None


def test_the_ros_node_holds_the_arm_from_the_first_effort_and_leads_it_in(two_link: adaptctl.Mechanism) -> None:
    module = example("ros2_node")
    controller, reference = module.prepared(two_link)
    node = module.Tracking([joint.name for joint in two_link.primary_joints], controller, reference)
    arm = MujocoArm(reference.at(0.0).p + 1.0, module.PERIOD, weightless=False)
    for k in range(3000):
        node.receive(k * module.PERIOD, node.joints[::-1], arm.getActualQ()[::-1], arm.getActualQd()[::-1])
        arm.moved(node.efforts(k * module.PERIOD))
        assert np.abs(arm.data.qvel).max() < 1.0
        assert np.abs(arm.data.qpos - node.followed.at((k + 1) * module.PERIOD).p).max() < 1e-3


def test_the_mujoco_loop_learns() -> None:
    assert learnt(example("mujoco_loop").track("docs/examples/scene.xml", "stand", 4.0))
