"""What the experiment of laws says of runs, by runs and numbers made by hand."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from adaptctl.dynamics import load
from adaptctl.errors import GainError
from adaptctl.experiments.contest import ADAPTATION_OFF, Outcome, _gravity, listed, thinning
from adaptctl.experiments.disturbed_arm import LAWS, OTHERS
from adaptctl.experiments.laws import Laws, ParameterErrors, Recovery, _drifted, _recoveries, _span, each, held_back
from adaptctl.experiments.laws_controllers import Draft, controller, deviations, friction_columns
from adaptctl.experiments.puma560_adaptive import FULL, one_controller
from adaptctl.experiments.replication.closed_loop import _answer, _answers
from adaptctl.experiments.task_space import TaskSpaceTracking
from adaptctl.identifiability import ReducedModel, essential_space, fundamental_basis
from adaptctl.recording import ControllerRun

laws = import_module("adaptctl.experiments.laws")
ARM = load("two_link")
STEP = 0.01


def run_of(error: Any, name: str = "gradient", **rollout: Any) -> ControllerRun:
    """Run of one joint, of errors in rad every 10 ms."""
    size = np.asarray(error, dtype=float)
    time = STEP * np.arange(len(size))
    off = size[:, None]
    parts = {"error": off, "p": off, "reference_p": 0.0 * off, "time": time, "sample_time": STEP, "terminated": False,
             "control_period": STEP, "estimate": np.zeros((len(size), 0)), "flags": {}, "clipped": np.zeros(len(size)),
             "interrupted": False, "duration": STEP * len(size), "every": 1}  # fmt: skip
    return ControllerRun(name, name.title(), "", SimpleNamespace(**parts | rollout))  # type: ignore[arg-type]


def test_a_law_is_back_when_two_seconds_are_below_twice_the_earlier() -> None:
    error = np.full(1000, 0.001)
    error[200:300] = 0.01  # a share x of these in 2 s has 100 x + 1 - x < 4: less than 7 samples
    found = Recovery.of(run_of(error), "drop", 0.001, 2.0, 9.0)
    assert found.time == pytest.approx(1.0 - 0.06)
    assert found.left == pytest.approx(1.0)
    (finding,) = found.findings
    assert (finding.name, finding.unit, finding.value) == ("return_after_drop.gradient", "s", found.time)
    error[500:] = 0.005
    lost = Recovery.of(run_of(error), "last drop", 0.001, 5.0, 20.0)
    assert (lost.time, lost.left) == (None, pytest.approx(5.0))
    (finding,) = lost.findings
    assert (finding.name, finding.unit) == ("not_back_after_last_drop.gradient", "1")
    assert Recovery.of(run_of(error), "drop", 0.001, 3.0, 4.9).time is None  # no whole window before the end
    assert Recovery.of(run_of(error), "drop", 0.001, 3.0, 5.0).time == pytest.approx(0.0, abs=1e-9)


def test_events_are_the_first_and_the_last_pickup_and_drop() -> None:
    of: Any = SimpleNamespace(payload_start=3.0, payload_stop=6.0, turn=10.0, payload_cycles=3)
    outcome = Outcome(ARM, (run_of(np.full(3000, 0.002)), run_of(np.full(2400, 0.002), "late")), True)
    found = [(one.run.name, one.event, one.earlier) for one in _recoveries(of, outcome)]
    events = ["pickup", "drop", "last pickup", "last drop"]
    assert found == [("gradient", event, pytest.approx(0.002)) for event in events] + [
        ("late", event, pytest.approx(0.002)) for event in events[:3]
    ]
    of.payload_cycles = 1
    assert [one.event for one in _recoveries(of, outcome)] == ["pickup", "drop"] * 2


def test_parameter_errors_are_weighed_by_torques_and_over_those_of_the_truth() -> None:
    regrouping = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 0.0]])
    model: Any = SimpleNamespace(regrouping=regrouping, fundamental_parameters=np.array([3.0, 4.0]))
    errors = ParameterErrors(model, np.array([2.0, 1.0]))
    own = np.array([[3.0, 4.0], [3.0, 0.0], [0.0, 4.0]])
    expected = np.array([0.0, 4.0, 6.0]) / np.hypot(6.0, 4.0)
    assert errors.of(run_of(np.zeros(3), estimate=own)) == pytest.approx(expected)
    every = np.array([[1.0, 4.0, 1.0], [3.0, 0.0, 0.0], [2.0, 4.0, -1.0]])  # the same by all parameters
    assert errors.of(run_of(np.zeros(3), estimate=every)) == pytest.approx(expected)
    assert errors.of(run_of(np.zeros(3))) is None


def test_drift_is_of_the_last_quarter_from_the_third_by_the_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    model: Any = SimpleNamespace(regrouping=np.eye(1), fundamental_parameters=np.array([2.0]))
    monkeypatch.setattr(ParameterErrors, "along", lambda *_: ParameterErrors(model, np.ones(1)))
    estimate = np.repeat([9.0, 9.0, 1.0, 1.5], 300)[:, None]  # 0.25 of the truth in 3 s
    runs = run_of(np.full(1200, 0.01), estimate=estimate), run_of(np.full(1200, 0.01), ADAPTATION_OFF)
    of = Laws(robot="two_link", disturbance="none", control_period=2e-3)
    told = _drifted(of, Outcome(ARM, runs, True), None)  # type: ignore[arg-type]
    found = {one.name: one.value for one in told.findings}
    assert found["drift.gradient"] == pytest.approx(0.25 * 20.0)
    assert found["true_rms_error.gradient"] == pytest.approx(0.01)
    assert found["delay"] == pytest.approx(0.5 * 2e-3)  # of a torque that is held
    assert 0.001 < found["delay_margin"] < 0.5
    assert told.answer is not None
    assert "5" in told.answer
    late = replace(of, delay=2, drive_time_constant=0.004, velocity_cutoff=10.0)
    found = {one.name: one.value for one in _drifted(late, Outcome(ARM, runs, True), None).findings}  # type: ignore[arg-type]
    assert found["delay"] == pytest.approx(2.5 * 2e-3 + 0.004 + 1.0 / (2.0 * np.pi * 10.0))


def test_a_torque_is_held_back_by_any_limit() -> None:
    flags = {"torque_limited": np.array([1.0, 0.0, 0.0, 0.0]), "other": np.ones(4)}
    run = run_of(np.zeros(4), clipped=np.array([0.0, 1.0, 0.0, 0.0]), flags=flags)
    assert held_back(run) == 0.5
    rated = run_of(np.zeros(4), flags=flags | {"rate_limited": np.array([1.0, 0.0, 1.0, 1.0])})
    assert held_back(rated) == 0.75


def test_words_on_numbers() -> None:
    assert _span([(3.0, "b"), (1.0, "a"), (2.0, "c")], "s") == "1 s (a) to 3 s (b)"
    assert _span([(3.0, "b")]) == "3 (b)"
    one, two = run_of(np.zeros(1)), run_of(np.zeros(1), "pd")
    found = each([one, two], "size", "m", "of it", lambda run: 2.0 if run is two else None)
    assert [(x.name, x.value, x.unit, x.meaning) for x in found] == [("size.pd", 2.0, "m", "Pd: of it")]
    assert listed(np.array([1.0, 0.00012345, 12345.6])) == "1, 0.0001234, 1.235e+04"
    assert _gravity(" 6.9, 0 -6.9 ") == (6.9, 0.0, -6.9)
    assert _gravity("") is None


@pytest.mark.parametrize(("samples", "every"), [(600_000, 1), (600_001, 21), (3_000_000, 100), (3_000_001, 101)])
def test_long_runs_are_thinned_to_thirty_thousand_samples(samples: int, every: int) -> None:
    assert thinning(samples) == every


@pytest.mark.parametrize("largest", [-1, 0, 7, 44])
def test_the_largest_bandwidth_is_the_last_that_is_stable(monkeypatch: pytest.MonkeyPatch, largest: int) -> None:
    tried = 0.5 * 2.0 ** (np.arange(45) / 4.0)
    assert tried[-1] == 1024.0
    stable = set(tried[: largest + 1])
    monkeypatch.setattr(laws, "_is_stable", lambda of, *_: of.bandwidth in stable)
    found = laws._largest(Laws(robot="two_link"), None, None, "gradient")
    assert found == (tried[largest] if largest >= 0 else 0.0)


@pytest.mark.parametrize(
    ("error", "over", "stable"), [(0.24, 0.0, True), (0.26, 0.0, False), (0.1, 0.009, True), (0.1, 0.011, False)]
)
def test_a_bandwidth_is_stable_by_its_last_third(
    monkeypatch: pytest.MonkeyPatch, error: float, over: float, stable: bool
) -> None:
    time = np.arange(3000)
    late = (time >= 2000)[:, None]
    torque = np.where(time[:, None] < 2000 + 1000 * over, [59.0, 25.0], [59.9, 24.9])
    runs = SimpleNamespace(time=time, v=np.where(late, error, 9.0) * np.ones(2), reference_v=np.zeros((3000, 2)),
                           torque=np.where(late, torque, 99.0))  # fmt: skip
    monkeypatch.setattr(laws, "simulate_many", lambda *_, **__: runs)
    monkeypatch.setattr(laws, "controller", lambda *_: None)
    plant, model = SimpleNamespace(torque_limits=np.array([60.0, 25.0])), SimpleNamespace(mechanism=ARM)
    assert laws._is_stable(Laws(robot="two_link"), plant, model, "gradient") is stable
    runs.v[-1] = np.nan
    assert laws._is_stable(Laws(robot="two_link"), plant, model, "gradient") is False


def test_errors_of_estimates_are_told_at_the_end_and_from_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    model: Any = SimpleNamespace(regrouping=np.eye(1), fundamental_parameters=np.array([2.0]))
    monkeypatch.setattr(ParameterErrors, "along", lambda *_: ParameterErrors(model, np.ones(1)))
    memory = np.zeros((3, 0))
    learned = run_of(np.zeros(3), estimate=np.array([[0.0], [1.0], [1.5]]), logged_state=memory)
    off = run_of(np.zeros(3), ADAPTATION_OFF, estimate=np.array([[1.2], [1.2], [1.2]]), logged_state=memory)
    told = laws._learned(
        Laws(robot="two_link"), Outcome(ARM, (learned, off), True), fundamental_basis(essential_space(ARM))
    )
    found = {one.name: one.value for one in told.findings}
    assert found == pytest.approx({"parameter_error.gradient": 0.25, f"parameter_error.{ADAPTATION_OFF}": 0.4})
    assert "parameter error is 0.25 (" in (told.answer or "")
    assert "initially 0.4." in (told.answer or "")


def test_gains_that_are_refused_are_not_stable(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> Any:
        raise GainError("too large")

    monkeypatch.setattr(laws, "controller", refused)
    model: Any = SimpleNamespace(mechanism=ARM)
    assert laws._is_stable(Laws(robot="two_link"), None, model, "gradient") is False


def test_bandwidths_are_told_of_the_softest_the_stiffest_and_rigid_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Laws, "plant_env", lambda *given: SimpleNamespace(unwrapped=SimpleNamespace(plant=given[-1])))
    monkeypatch.setattr(laws, "_largest", lambda of, plant, model, name: (plant or 9e3) / 1e3 + (name == "pd-gravity"))
    of = Laws(robot="two_link", laws=("gradient", "pd-gravity"), joint_stiffness=(5e3, 2e3, 3e3))
    told = laws._carried(of, Outcome(ARM, (run_of(np.zeros(1)),), True), fundamental_basis(essential_space(ARM)))
    found = {one.name: one.value for one in told.findings}
    assert len(found) == 3 * 4
    assert [found[f"stable_bandwidth.gradient.{key}"] for key in ("2000", "3000", "5000", "rigid")] == [2, 3, 5, 9]
    assert found["stable_bandwidth.pd-gravity.5000"] == 6.0
    assert (
        "to 9 1/s for the rigid arm, 5 1/s with a joint stiffness of 5,000 N·m/rad, and 2 1/s with 2,000" in told.answer
    )


@pytest.mark.parametrize(("motion", "length"), [("rest", 20.0), ("random", 3.0)])
def test_an_arm_at_rest_is_weighed_by_twenty_seconds_of_motion(motion: str, length: float) -> None:
    of, basis = (
        Laws(robot="two_link", motion=motion, duration=3.0, amplitude=0.4),
        fundamental_basis(essential_space(ARM)),
    )
    weights = ParameterErrors.along(of, Outcome(ARM, (), True), basis).weights
    moving = replace(of, motion="random", amplitude=0.25 if motion == "rest" else 0.4).reference(ARM)
    points = moving(np.linspace(0.0, length, 2001))
    rows = ReducedModel(ARM, basis).torque_regressor(points.p, points.v, points.a)
    assert weights == pytest.approx(np.sqrt(np.mean(rows**2, axis=(0, 1))), rel=0.01)


def test_deviations_of_a_body_are_those_of_its_size() -> None:
    model = ReducedModel.full(ARM)
    mass, offset, moment = 2.0, 0.3, 0.05
    body = [mass, mass * offset, 0.0, 0.0, 0.0, 0.0, moment + mass * offset**2, 0.0, 0.0, moment + mass * offset**2]
    found = deviations(model, np.concatenate([body, body, np.zeros(len(ARM.parameter_names) - 20)]), 0.1)
    # the second moments of mass, of which the trace is half of that of the inertia
    second = 0.5 * 2.0 * (moment + mass * offset**2)
    assert found[:10] == pytest.approx(0.1 * np.array([mass, *[np.sqrt(mass * second)] * 3, *[second] * 6]))
    friction = load("puma560_friction")
    names = friction.parameter_names
    found_columns = dict(friction_columns(ReducedModel.full(friction)))
    assert {names[k].partition(".")[0] for k in found_columns} == {joint.name for joint in friction.primary_joints}
    assert all(names[k].startswith(f"{friction.primary_joints[j].name}.") for k, j in found_columns.items())


def test_a_draft_is_as_unsure_as_the_rough_model_and_the_load() -> None:
    arm = load("puma560_friction")
    given: Any = {"laws": ("gradient",), "robot": "puma560_friction", "disturbance": "none", "parameter_error": 0.2}
    of, model = Laws(**given, gain_scale=3.0, prediction_weight=50.0), ReducedModel.full(arm)
    draft, columns = Draft(of, model), dict(friction_columns(model))
    limits, links = np.array(arm.effort_limits), [k for k in range(60) if k not in columns]
    np.testing.assert_allclose(draft.unknown[links], deviations(model, of.rough(arm), 0.2)[links])
    for k, joint in columns.items():
        assert draft.unknown[k] == pytest.approx(0.1 * limits[joint])
        assert draft.first[k] == 0.0
    ratio = draft.first[[0, 10, 20]] / arm.inertial_parameters[[0, 10, 20]]
    assert set(np.round(ratio[np.isfinite(ratio)], 9)) <= {0.8, 1.2}
    np.testing.assert_allclose(draft.gain, 3.0 * draft.unknown**2)
    gain, weight, cutoff = draft.predicting
    np.testing.assert_array_equal(gain, draft.gain)
    np.testing.assert_allclose(weight * limits**2, 50.0)
    assert cutoff == 5.0
    bounds = draft.projected(0.5)
    np.testing.assert_allclose(bounds.upper - bounds.lower, 8.0 * draft.unknown)  # four deviations each way
    natural, first = draft.natural()
    assert natural.gain == pytest.approx(3.0 * 0.2**2)
    np.testing.assert_array_equal(first, of.rough(arm))


def test_a_draft_that_loads_the_arm_expects_half_a_load() -> None:
    of = Laws(laws=("gradient",), disturbance="payload", gain_scale=2.0)
    arm = load("puma560_geared")
    draft = Draft(of, ReducedModel.full(arm))
    assert of.recovers
    natural, first = draft.natural()
    rough = of.rough(arm)
    assert first[50] - rough[50] == pytest.approx(0.5 * of.payload)
    # the mass of the last body is unsure by the file's share of it and by the load, together
    unsure = np.hypot(of.parameter_error * rough[50], of.payload)
    assert natural.gain[5] == pytest.approx(2.0 * (unsure / first[50]) ** 2)
    assert natural.gain[0] == pytest.approx(2.0 * of.parameter_error**2)
    assert draft.unknown[50] == pytest.approx(unsure)


def test_tool_errors_are_of_the_first_and_the_last_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    time = STEP * np.arange(600)
    size = np.where(time < 0.995, 0.03, np.where(time < 3.995, 0.5, 0.004))
    monkeypatch.setattr(TaskSpaceTracking, "tip", lambda *_: SimpleNamespace(at=lambda p: p))
    monkeypatch.setattr(TaskSpaceTracking, "path", lambda _, time: SimpleNamespace(p=np.ones((len(time), 3))))

    def run(name: str, share: float, count: int = 600) -> ControllerRun:
        p = 1.0 + share * size[:count, None] * np.array([2.0, -1.0, 2.0]) / 3.0  # of length one
        return run_of(size[:count], name, p=p, reference_p=1.0 + 0.0 * p)

    outcome = Outcome(ARM, (run("task-space", 1.0), run(ADAPTATION_OFF, 2.0), run("joint-space", 0.5)), True)
    told = TaskSpaceTracking.told(TaskSpaceTracking(), outcome, None)  # type: ignore[arg-type]
    found = {one.name: one.value for one in told.findings}
    assert found["first_tool_error.task-space"] == pytest.approx(30.0)
    assert found["final_tool_error.task-space"] == pytest.approx(4.0)
    assert found[f"final_tool_error.{ADAPTATION_OFF}"] == pytest.approx(8.0)
    assert told.answer is not None
    assert "2 s is 4 mm, and 8 mm without adaptation" in told.answer
    assert "is 2 mm (Joint-Space)" in told.answer
    assert told.task_error is not None
    assert told.task_error.errors["task-space"] == pytest.approx(size)
    outcome = Outcome(ARM, (run("task-space", 1.0, 30),), True)
    short = TaskSpaceTracking.told(TaskSpaceTracking(), outcome, None)  # type: ignore[arg-type]
    assert (list(short.findings), short.answer) == ([], None)


def test_an_answer_on_two_arms_compares_their_operations() -> None:
    def arm(label: str, flops: int, rank: int) -> dict[str, Any]:
        finding = {"final_tool_error.adaptive": {"value": 0.5}, "first_tool_error.adaptive": {"value": 40.0}}
        runs = {"adaptive": {"tick": {"flops": flops}}, "adaptive-full": {"tick": None}}
        return {"label": label, "links": 3, "joints": 4, "actuators": 3, "inertial_parameters": 30, "rank": rank,
                "rank_printed": 16, "regressor_flops": {"reduced": 1000, "full": 2000}, "findings": finding,
                "runs": runs, "lyapunov_max_increase": 0.0}  # fmt: skip

    arms = {"a": arm("serial arm", 1500, 15), "b": arm("loop", 4500, 23)}
    assert _answers(arms["a"])["Operations of an adaptive control step"] == "1,500"
    assert _answers(arms["a"])["Lyapunov function rises"] == "never"
    assert _answers(arms["a"])["Operations of the regressor, base and all parameters"] == "1,000, 2,000"
    assert _answers(arms["a"] | {"lyapunov_max_increase": 0.25})["Lyapunov function rises"] == "by 0.25 J"
    assert _answers(arms["a"] | {"lyapunov_max_increase": None})["Lyapunov function rises"] == "–"
    told = _answer(arms)
    assert "0.5 mm (serial arm) and 0.5 mm (loop)" in told
    assert "takes 3 times the operations, for 23 base parameters instead of 15." in told
    assert _answer({"a": arms["a"] | {"findings": {}}}) == "A run is too short for a final tip error."
    assert "times the operations" not in _answer({"a": arms["a"]})
    assert "times the operations" not in _answer(arms | {"b": arm("loop", 0, 23)})


def test_runs_of_reduced_and_of_all_parameters_are_compared_as_long_as_both_ran() -> None:
    torque = np.arange(12.0).reshape(6, 2)
    both = {
        "adaptive": run_of(np.zeros(6), torque=torque, estimate=np.zeros((6, 3))),
        FULL: run_of(np.zeros(5), torque=torque[:5] - [0.25, 0.5], estimate=np.zeros((5, 8))),
    }
    outcome: Any = SimpleNamespace(run=both)
    [finding] = one_controller(outcome, "adaptive")
    assert finding.value == 0.5
    assert "of 3 and of 8" in finding.meaning
    assert list(one_controller(SimpleNamespace(run={FULL: both[FULL]}), "adaptive")) == []  # type: ignore[arg-type]


def test_laws_get_the_bounds_rates_and_first_estimates_of_their_draft() -> None:
    """Bounds four deviations off; nothing is learned before; what leaks, leaks to the first estimate."""
    of = Laws(robot="two_link", laws=("gradient",), forgetting=1.5, leakage=0.07)
    model = ReducedModel(load("two_link"))
    draft = Draft(of, model)
    made: dict[str, Any] = {name: controller(of, name, model) for name in (*LAWS, *OTHERS, ADAPTATION_OFF)}
    bounded, leaking = made["projection"].adaptation, made["sigma-modification"].adaptation
    assert (bounded.upper - bounded.lower) / draft.unknown == pytest.approx(8.0)
    assert 0.5 * (bounded.upper + bounded.lower) == pytest.approx(draft.first)
    assert (leaking.leakage, made["e-modification"].adaptation.leakage) == (0.07, 0.5)
    for name in ("sigma-modification", "e-modification"):
        assert made[name].adaptation.prior == pytest.approx(draft.first)
    assert {made[name].adaptation.cutoff for name in ("composite", "cushioned-floor", "concurrent-learning")} == {5.0}
    assert made[ADAPTATION_OFF].adaptation is None
    weak: Any = controller(replace(of, torque_limit_scale=0.5), "gradient", model)
    assert weak.torque_limits == pytest.approx(0.5 * model.mechanism.effort_limits)
