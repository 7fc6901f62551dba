"""A loop at 1 kHz by hand: controllers compiled ahead of time, references at one time, and the examples."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import nightly

import adaptctl
from adaptctl.control import FadeIn, MinimumJerk, ReferencePoint, Sinusoids, Spline
from adaptctl.hardware import MuJoCoRobot, motion_about

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


@nightly
def test_a_reference_is_no_dearer_than_the_law() -> None:
    arm = adaptctl.load("puma560_measured")
    model = adaptctl.ReducedModel(arm)
    tuning = adaptctl.tune(arm)
    law = tuning.controller(model).compile()
    zero = np.zeros(6)
    state, point = law.init(zero, zero), REFERENCES["sinusoids"](0.5)
    cost = cpu(lambda: law.step(state, zero, zero, point))
    for name in ("sinusoids", "minimum jerk", "spline"):
        reference: Any = REFERENCES[name]
        assert cpu(lambda at=reference.at: at(0.7)) < 2.0 * cost + 5e-6, name


def test_what_is_compiled_ahead_takes_no_time_at_the_first_step() -> None:
    arm = adaptctl.load("two_link")
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


OTHERS = {
    "a gripper": (["gripper"], [0.1], [0.0]),
    "no velocities": (["shoulder", "elbow"], [0.1, 0.2], []),
    "one joint": (["elbow", "gripper"], [0.2, 0.1], [0.0, 0.0]),
    "not finite": (["shoulder", "elbow"], [0.1, float("nan")], [0.0, 0.0]),
    "nothing": ([], [], []),
    "fewer positions": (["shoulder", "elbow"], [0.1], [0.0, 0.0]),
}


@pytest.fixture(scope="module")
def two_link() -> adaptctl.Mechanism:
    return adaptctl.load("two_link")


@pytest.mark.parametrize("other", OTHERS)
def test_the_ros_node_passes_over_others_messages(two_link: adaptctl.Mechanism, other: str) -> None:
    """A gripper publishes joint states too, and joint_state_publisher has no velocities."""
    node = example("ros2_node").JointStates(two_link, 1e-3, lambda wait: None, list)
    node._spin_once = lambda wait: node.receive(1.0, *OTHERS[other])
    assert node.read() is None
    node._spin_once = lambda wait: node.receive(1.0, ("elbow", "gripper", "shoulder"), (0.2, 9.0, 0.1), (0.0, 9.0, 0.5))
    stamp, p, v, torque = node.read()
    assert (stamp, p.tolist(), v.tolist(), torque) == (1.0, [0.1, 0.2], [0.5, 0.0], None)


def test_the_ros_node_is_driven_as_a_robot(two_link: adaptctl.Mechanism) -> None:
    """From the file's parameters, which hold the arm from the first effort on."""
    period, start = 4e-3, np.array([0.3, 0.5])
    arm = MuJoCoRobot(two_link, period, start)
    arm.start(two_link.inverse_dynamics(start, np.zeros(2), np.zeros(2)))
    node = example("ros2_node").JointStates(two_link, period, lambda wait: None, lambda efforts: arm.write(efforts))

    def spin(wait: float) -> None:
        stamp, p, v, _ = arm.read()
        node.receive(stamp, ["elbow", "shoulder", "gripper"], [p[1], p[0], 7.0], [v[1], v[0], 7.0])

    node._spin_once = spin
    law = adaptctl.ComputedTorque(two_link, 8.0)
    run = adaptctl.drive(node, law, motion_about(start, node.limits), 4.0)
    assert (run.stopped, run.by_robot) == ("", False)
    assert run.first_error < 1e-3
    assert run.final_rms_error.max() < 2e-3


class VendorsArm(MuJoCoRobot):
    """Arm that compensates its weight, with the tool it was told of, as Franka's and UR's do."""

    tool = np.zeros(10)


@pytest.mark.parametrize("name", ["franka_loop", "ur_rtde_loop"])
def test_vendors_loops_start_where_the_arm_stands(
    two_link: adaptctl.Mechanism, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm, module = VendorsArm(two_link, 4e-3, [0.3, 0.5], compensates_gravity=True), example(name)
    law = adaptctl.ComputedTorque(two_link, 8.0)
    monkeypatch.setattr(module, "ready_controller", lambda *given, delay: law if delay == 1 else None)
    run = module.track(arm, two_link, 4.0, str(tmp_path / "run.parquet"))
    assert (run.stopped, run.compensates_gravity) == ("", True)
    assert np.abs(run.rollout.error[0]).max() < 1e-9
    assert run.final_rms_error.max() < 2e-3
    assert adaptctl.Rollout.load(tmp_path / "run.parquet").reached_end


def test_the_mujoco_loop_learns() -> None:
    run = example("mujoco_loop").track("scene", "stand", 2.8)
    assert run.stopped == ""
    assert run.final_rms_error.max() < 1e-3
    assert np.abs(run.rollout.estimate[-1] - run.rollout.estimate[0]).max() > 1e-4
