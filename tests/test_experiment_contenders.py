"""What experiments make their controllers and references of, by numbers that are written out."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.control import typical_inertia
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, PhysicalConsistencyWarning
from adaptctl.experiments import adaptive, contact, identify_then_adapt
from adaptctl.experiments.adaptive import AdaptiveTracking
from adaptctl.experiments.contact import Contact
from adaptctl.experiments.contest import ADAPTATION_OFF, FULL, Contender
from adaptctl.experiments.identify_then_adapt import IdentifyThenAdapt, _parameters
from adaptctl.experiments.laws_controllers import deviations
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.experiments.replication.closed_loop import ArmOnPath
from adaptctl.experiments.task_space import TaskSpaceTracking
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis

SMALL = load("two_link")


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    with pytest.warns(PhysicalConsistencyWarning):
        return load("puma560_arm3")


@pytest.fixture(scope="module")
def basis(puma: Mechanism) -> FundamentalBasis:
    return fundamental_basis(essential_space(puma))


def made(contenders: list[Contender]) -> dict[str, Any]:
    return {one.name: one.controller for one in contenders}


def test_laws_of_a_tool_have_one_gain_and_weights_over_squared_limits(puma: Mechanism, basis: FundamentalBasis) -> None:
    of = TaskSpaceTracking(prediction_weight=50.0, bandwidth=6.0, damping_scale=2.5, singularity=0.3)
    found, model = made(of.contenders(puma, basis)), ReducedModel(puma, basis)
    gain = of.adaptation(model)
    assert np.ptp(gain) > 0.0
    for name in ("task-space", "task-space-damped", "task-space-composite", "joint-space"):
        np.testing.assert_allclose(found[name].adaptation_law.gain, gain)
        np.testing.assert_allclose(found[name].damping, 2.5 * 6.0 * typical_inertia(puma))
    weight = found["task-space-composite"].adaptation_law.prediction_weight
    np.testing.assert_allclose(weight * np.square(puma.effort_limits), 50.0)
    assert found[ADAPTATION_OFF].adaptation_law is None
    assert {name: law.singularity for name, law in found.items() if hasattr(law, "singularity")} == {
        "task-space": 0.0, ADAPTATION_OFF: 0.0, "task-space-composite": 0.0, "task-space-damped": 0.3,
    }  # fmt: skip


def test_joints_follow_the_tools_path_until_a_second_after_the_run(puma: Mechanism) -> None:
    of = TaskSpaceTracking(duration=1.0)
    joints, tip = of.reference(puma), of.tip(puma)
    times = np.linspace(0.0, 2.0, 41)  # knots and the middles between them
    np.testing.assert_allclose(tip.at(joints(times).p), of.path(times).p, atol=1e-6)
    np.testing.assert_array_equal(of.path(0.0).v, np.zeros(3))
    start, later = of.path(np.array([0.0, 2.0])).p  # where the path is all there
    assert np.linalg.norm(later - start) > 0.05
    np.testing.assert_allclose(of.path(7.0).p, of.path(2.0).p, atol=1e-5)  # 0.4 and 0.2 Hz repeat in 5 s


def test_tips_of_both_arms_begin_as_far_off_their_path(puma: Mechanism, basis: FundamentalBasis) -> None:
    of = ArmOnPath(duration=1.0)
    episode = of.environment(puma).unwrapped.episode(seed=0)
    tip, first = of.tip(puma), of.reference(puma)(0.0).p
    off = tip.at(episode.state.p) - tip.at(first)
    np.testing.assert_allclose(off, [0.05, 0.05, -0.05], atol=1e-6)
    found = made(of.contenders(puma, basis))
    assert [found[name].model.regrouping.shape[0] for name in ("adaptive", FULL)] == [15, 30]
    assert found[ADAPTATION_OFF].adaptation_law is None


def test_estimates_from_a_log_a_file_and_zero_share_a_gain(puma: Mechanism, monkeypatch: pytest.MonkeyPatch) -> None:
    own, shares = SMALL.inertial_parameters, list[float]()

    def identified(name: str, share: float) -> Any:
        shares.append(share)
        return SMALL.with_parameters(share * own)

    monkeypatch.setattr(identify_then_adapt, "identified_from", identified)
    monkeypatch.setattr(identify_then_adapt, "robot_file", lambda name: SMALL.with_parameters(3.0 * own))
    of = IdentifyThenAdapt(training_share=0.7, gain_scale=20.0, parameter_error=0.4, bandwidth=5.0, damping_scale=3.0)
    basis = fundamental_basis(essential_space(SMALL))
    found, model = made(of.contenders(SMALL, basis)), ReducedModel(SMALL, basis)
    first = {"adaptive": 0.7, ADAPTATION_OFF: 0.7, "from-urdf": 3.0, "from-zero": 0.0}
    assert set(found) == set(first)
    for name, share in first.items():
        np.testing.assert_allclose(found[name].initial, share * model.regrouping @ own)
        np.testing.assert_allclose(found[name].damping, 3.0 * 5.0 * typical_inertia(SMALL))
        if name != ADAPTATION_OFF:
            gain = 20.0 * deviations(model, own, 0.4) ** 2
            np.testing.assert_allclose(found[name].adaptation_law.gain, gain)
    assert found[ADAPTATION_OFF].adaptation_law is None
    of.mechanism()
    assert shares == [0.7, 1.0]
    np.testing.assert_array_equal(_parameters(puma, SMALL), np.zeros(30))


@pytest.mark.parametrize(
    ("of", "names"),
    [
        (Contact, ("push",)),
        (IdentifyThenAdapt, ("center", "amplitude", "frequency")),
        (Puma560Adaptive, ("damping", "center", "amplitude", "frequency")),
        (TaskSpaceTracking, ("center", "amplitude", "frequency", "phase")),
    ],
)
def test_settings_have_a_number_for_each_joint_or_axis(of: Any, names: tuple[str, ...]) -> None:
    for name in names:
        usual = getattr(of(), name)
        for given in (usual[1:], (*usual, usual[0])):
            with pytest.raises(InputError, match=f"^{name}: expected {len(usual)} numbers, .*, got {len(given)}$"):
                of(**{name: given})


def test_errors_from_a_log_and_from_zero_are_of_the_first_two_seconds() -> None:
    asked: list[Any] = []

    def run(name: str, error: float | None) -> Any:
        return SimpleNamespace(name=name, rms_error=lambda stop: asked.append(stop) or error)

    def told(*runs: Any) -> Any:
        return IdentifyThenAdapt().told(SimpleNamespace(runs=runs), None)  # type: ignore[arg-type]

    runs = run("adaptive", 0.002), run("from-urdf", 0.003), run("from-zero", 0.008)
    found = told(*runs)
    assert {one.name: one.value for one in found.findings} == {
        "first_error.adaptive": 0.002, "first_error.from-urdf": 0.003, "first_error.from-zero": 0.008,
        "zero_over_identified": pytest.approx(4.0),
    }  # fmt: skip
    assert "of the first 2 s is 2 mrad from the identified estimate, 3 mrad from the URDF and 8 mrad" in found.answer
    assert set(asked) == {2.0}
    assert told(runs[0], runs[1], run("from-zero", None)).answer is None
    assert [one.name for one in told(runs[2], run("adaptive", 0.0)).findings][2:] == []


def test_a_soft_tool_moves_at_five_centimeters_a_second_against_ten_newtons(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only along what it presses on; it is free along the surface, and its turns are."""
    given: dict[str, Any] = {}
    monkeypatch.setattr(contact, "TaskImpedance", lambda *_, **named: given.update(named))
    for scene, axis in (("table", 2), ("wall", 0)):
        Contact(scene=scene, force=10.0)._impedance(None, None, None, np.zeros(0))  # type: ignore[arg-type]
        into = np.arange(3) == axis
        np.testing.assert_array_less(given["most_force"][into], given["most_force"][~into].min())
        damping, force = given["tool_damping"], np.abs(given["most_force"][into])
        np.testing.assert_allclose(force / damping[:3][into], 0.05)
        np.testing.assert_array_less(damping[:3][~into], damping[:3][into].min())
        assert not damping[3:].any()
        assert not np.any(given["tool_stiffness"][3:])


@pytest.mark.parametrize("text", ["6.9,0", "1 2 3 4", "up"])
def test_a_gravity_that_is_none_is_refused_before_anything_is_tuned(text: str) -> None:
    with pytest.raises(InputError, match="gravity: expected three numbers"):
        AdaptiveTracking(gravity=text)


@pytest.mark.parametrize("asked", [-0.05, 0.02, 0.9])
def test_an_arm_begins_as_far_off_as_asked_and_a_tenth_of_its_ranges_at_most(
    asked: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[str, Any] = {}
    monkeypatch.setattr(adaptive, "tune", lambda mechanism, **chosen: given.update(chosen))
    monkeypatch.setattr(adaptive, "motion_ranges", lambda mechanism: (np.array([-1.0, 0.0]), np.array([1.0, 0.3])))
    adaptive._tuned.__wrapped__(AdaptiveTracking(robot="two_link", initial_error=asked), SMALL)
    np.testing.assert_allclose(given["initial_error"], np.clip(asked, [-0.2, -0.03], [0.2, 0.03]))
