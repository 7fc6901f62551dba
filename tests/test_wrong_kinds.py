"""Texts and other things where lists of names, of pairs or of drives belong: refused, not taken letter by letter."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

from adaptctl.control import (
    AdaptiveComputedTorque,
    ComputedTorque,
    Gains,
    MinimumJerk,
    PDGravity,
    Projection,
    SafetyFilter,
    Sinusoids,
    SlotineLi,
    StoppedReference,
    Workspace,
    adaptation_gain,
    lyapunov,
    monitor_stability,
    persistent_excitation,
    sampling_ratio,
    typical_inertia,
    worst_conditioned_configuration,
)
from adaptctl.description import Closure, Description, Joint, Link, Loops, Pose
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError
from adaptctl.identifiability import (
    Constraints,
    Priority,
    ReducedModel,
    constrained,
    essential_space,
    fundamental_basis,
    random_states,
    reduce,
    states_within_limits,
)
from adaptctl.identification import identify
from adaptctl.recording import Live, compared_runs
from adaptctl.simulation import ClosedLoop, Plant, Rollout, rollout, simulate, simulate_many
from adaptctl.tuning import tune
from adaptctl.tuning.verification import scaled_links


@cache
def arm() -> Mechanism:
    return load("two_link")


@cache
def law() -> SlotineLi:
    return SlotineLi(ReducedModel.full(arm()), 5.0, np.full(2, 5.0), np.ones(20))


def env() -> TrackingEnv:
    return TrackingEnv(arm(), 1, duration=0.05)


@cache
def run() -> Rollout:
    return simulate(env(), law(), seed=0)


@pytest.mark.parametrize("wrong", ["lower.m", 3, None])
def test_a_priority_is_a_list_of_names(wrong: Any) -> None:
    for name in ("order", "keep"):
        with pytest.raises(InputError, match=f"priority: {name}: expected names of parameters, got {wrong!r}"):
            Priority(**{name: wrong})
    assert Priority(["lower.m"], keep=iter(["upper.m"])) == Priority(("lower.m",), ("upper.m",))  # type: ignore[arg-type]


def test_primary_joints_are_a_list_of_names() -> None:
    closure = Closure("c", "a", "b", Pose.identity(), Pose.identity())
    with pytest.raises(InputError, match="loops: primary: expected a sequence of joint names, got 'abc'"):
        Loops("abc", (closure,))  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", ["abc", 3.0, None, [("a", 1.0, 2.0)], [1.0], [("a", "b")], [(1, 1.0)], ["ab"]])
def test_a_shaft_turns_with_pairs_of_names_and_ratios(wrong: Any) -> None:
    with pytest.raises(InputError, match="turns_with: "):
        Drive(turns_with=wrong)


@pytest.mark.parametrize("wrong", [3.0, None, [1.0, 2.0], [None, None], "ab"])
def test_drives_are_drives(wrong: Any) -> None:
    with pytest.raises(InputError, match="two_link: drives: expected Drive objects, got"):
        arm().with_drives(wrong)


@pytest.mark.parametrize("wrong", ["revolute", None, 0])
def test_a_joint_has_a_kind(wrong: Any) -> None:
    with pytest.raises(InputError, match=f"joint 'a': kind: expected a JointKind, such as REVOLUTE, got {wrong!r}"):
        Joint("a", wrong)


def test_sinusoids_have_amplitudes_and_frequencies() -> None:
    for given in ((None, np.ones(2)), (np.ones(2), None)):
        with pytest.raises(InputError, match=r"(amplitude|frequency): expected"):
            Sinusoids(np.zeros(2), *given)  # type: ignore[arg-type]
    assert np.all(Sinusoids(np.zeros(2), np.ones(2), np.ones(2), None)(0.0).p == 0.0)


@pytest.mark.parametrize("wrong", [0, -1, 1.5, "a", None, True])
def test_samples_are_watched_by_whole_numbers(wrong: Any) -> None:
    with pytest.raises(InputError, match="monitor_stability: every: expected a whole number of at least 1, got"):
        monitor_stability(law(), run(), arm(), wrong)


@pytest.mark.parametrize("wrong", ["a", None, [1.0], np.inf, np.nan])
def test_a_window_is_a_time(wrong: Any) -> None:
    with pytest.raises(InputError, match=r"window: expected a (time|number)"):
        persistent_excitation(law().model, run(), wrong)


@pytest.mark.parametrize("wrong", [1, 1.0, object()])
def test_columns_are_a_sequence(wrong: Any) -> None:
    still = np.zeros(2)
    with pytest.raises(InputError, match="two_link: columns: expected whole numbers from 0 to 19, got"):
        arm().torque_regressor(still, still, still, columns=wrong)


def test_any_length_of_a_runs_end_is_kept() -> None:
    for make in (simulate, rollout):
        np.testing.assert_array_equal(make(env(), law(), seed=0, keep_last=1e300).p, make(env(), law(), seed=0).p)


KINDS: dict[str, tuple[Callable[[Any], object], str]] = {
    "essential space": (essential_space, "Mechanism"),
    "fundamental basis": (fundamental_basis, "EssentialSpace"),
    "tune": (tune, "Mechanism"),
    "plant": (lambda x: Plant(x, 1e-3), "Mechanism"),
    "model": (ReducedModel.full, "Mechanism"),
    "constrained": (lambda x: constrained(x, Constraints()), "Mechanism"),
    "constraints": (lambda x: constrained(arm(), x), "Constraints"),
    "random states": (lambda x: random_states(x, 10, np.random.default_rng(0)), "Mechanism"),
    "states within limits": (lambda x: states_within_limits(x, 10), "Mechanism"),
    "computed torque": (lambda x: ComputedTorque(x, 5.0), "Mechanism"),
    "gravity compensation": (lambda x: PDGravity(x, 5.0, 1.0), "Mechanism"),
    "Slotine and Li": (lambda x: SlotineLi(x, 5.0, 5.0), "ReducedModel"),
    "adaptive computed torque": (lambda x: AdaptiveComputedTorque(x, 5.0, np.ones(1)), "ReducedModel"),
    "gains": (lambda x: Gains.from_bandwidth(x, 1.0), "Mechanism"),
    "sampling ratio": (lambda x: sampling_ratio(x, 1.0, 1e-3), "Mechanism"),
    "typical inertia": (typical_inertia, "Mechanism"),
    "guarded": (SafetyFilter, "Controller"),
    "projected": (lambda x: Projection(x, -np.ones(2), np.ones(2)), "AdaptationLaw"),
    "live view": (Live, "Mechanism"),
    "controller of a run": (lambda x: simulate(env(), x), "Controller"),
    "environment of a run": (lambda x: rollout(x, law()), "Env"),
    "plant of a loop": (lambda x: ClosedLoop(x, law()), "Plant"),
    "controller of a loop": (lambda x: ClosedLoop(Plant(arm(), 1e-3), x), "Controller"),
    "plant of many": (lambda x: simulate_many(x, law(), Sinusoids(*np.ones((3, 2))), duration=0.01), "Plant"),
}


@pytest.mark.parametrize("wrong", ["puma560", None, 3.0, Pose.identity()])
@pytest.mark.parametrize("taker", KINDS)
def test_a_name_is_no_mechanism_and_a_mechanism_no_model(taker: str, wrong: Any) -> None:
    take, kind = KINDS[taker]
    with pytest.raises(InputError, match=f": expected an? {kind}, as .*, got"):
        take(wrong)


def test_a_mechanism_is_no_model() -> None:
    with pytest.raises(InputError, match=r"SlotineLi: expected a ReducedModel, .* got <Mechanism 'two_link'"):
        SlotineLi(arm(), 5.0, 5.0)  # type: ignore[arg-type]


def test_runs_are_runs_of_the_same_arm() -> None:
    with pytest.raises(InputError, match=r"run 'a': expected a Rollout, as simulate\(...\) gives one, got 3"):
        compared_runs(arm(), {"a": 3})  # type: ignore[dict-item]
    other = ReducedModel.full(load("semi_direct_drive"))
    with pytest.raises(InputError, match="run: expected 3 joints, as semi_direct_drive has, got 2"):
        persistent_excitation(other, run(), 0.03)
    with pytest.raises(InputError, match="logs: expected files, got 3"):
        identify(3, arm())  # type: ignore[arg-type]


def test_a_lyapunov_function_is_of_the_controllers_own_parameters() -> None:
    rough = arm().with_parameters(1.1 * arm().inertial_parameters)
    assert lyapunov(law(), run(), rough).shape == (len(run().time),)
    with pytest.raises(InputError, match=r"lyapunov: the 22 parameters of two_link are not those of .* two_link \(20"):
        lyapunov(law(), run(), arm().with_drives(Drive(0.1)))
    with pytest.raises(InputError, match="run: expected 2 joints, like the controller, got 3"):
        lyapunov(law(), Rollout.from_arrays(*np.zeros((3, 5, 3)), control_period=1e-3), arm())
    with pytest.raises(InputError, match=r"run: expected a Rollout, as simulate\(...\) gives one, got None"):
        lyapunov(law(), None, arm())  # type: ignore[arg-type]


def test_gains_are_found_under_constraints_too() -> None:
    """Links that are off are off in what is left free."""
    slim = constrained(arm(), Constraints({"lower.mc_y": 0.0}))
    rough = scaled_links(slim, 0.3, 1)
    plain = dict(zip(arm().parameter_names, scaled_links(arm(), 0.3, 1).tolist(), strict=True))
    assert rough.tolist() == [plain[name] for name in slim.parameter_names]
    assert all(run.is_learning for run in tune(slim).verified)


def test_a_workspace_has_the_masses_of_the_mechanism_that_is_judged() -> None:
    """One made for an arm as described, and a model of it twice as heavy: half the sampling ratio."""
    heavy = arm().with_parameters(2.0 * arm().inertial_parameters)
    found = [
        sampling_ratio(own, 5.0, 1e-3, workspace=Workspace.within_limits(made, 50)).value
        for own, made in ((arm(), arm()), (heavy, arm()), (heavy, heavy))
    ]
    assert found[1] == found[2] == pytest.approx(0.5 * found[0], rel=1e-9)
    other = Workspace.within_limits(load("semi_direct_drive"), 20)
    with pytest.raises(InputError, match="workspace: expected one of 2 joints, as two_link has, got 3"):
        SlotineLi(ReducedModel.full(arm()), 5.0, np.full(2, 5.0), workspace=other)
    for wrong in (3, "all", [1.0]):
        with pytest.raises(InputError, match=r"workspace: expected a Workspace, as .*, got"):
            worst_conditioned_configuration(arm(), arm().inertial_parameters, wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", ["puma560", None, 3])
def test_a_mechanism_is_made_of_a_description(wrong: Any) -> None:
    with pytest.raises(InputError, match=r"mechanism: expected a Description, .* load\(...\) gives mechanisms, got"):
        Mechanism(wrong)
    with pytest.raises(InputError, match=r"x: links: expected a Link, as .* got 'a'"):
        Description("x", "ab")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="link 'a': parent: expected a whole number of at least -1, got 'ground'"):
        Link("a", "ground", Joint("j"), Pose.identity(), Pose.identity())  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", ["a", None, [1.0, 2.0], np.nan, -1.0])
def test_a_damping_ratio_and_a_margin_are_numbers(wrong: Any) -> None:
    with pytest.raises(InputError, match="damping ratio: expected a positive number, got"):
        ComputedTorque(arm(), 5.0, wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="workspace: margin: expected"):
        Workspace.along(arm(), np.zeros(2), wrong)
    with pytest.raises(InputError, match="stopped reference: expected a reference, a function of time, got"):
        StoppedReference(wrong, 1.0)


def test_switches_and_ranges_are_what_they_are() -> None:
    with pytest.raises(InputError, match="freeze: expected True or False, got 'no'"):
        SafetyFilter(law(), 10.0, freeze="no")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"adaptation gain: ranges: expected a PriorRanges, as .*, got 3"):
        adaptation_gain(law().model, 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"adaptation gain: gains: expected a Gains, as .*, got 3"):
        adaptation_gain(law().model, gains=3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"reduce: expected an? EssentialSpace, as .*, got <Mechanism"):
        reduce(arm(), arm(), components=2)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", ["a", {}, [[1.0], [1.0, 2.0]]])
def test_references_are_asked_for_times(wrong: Any) -> None:
    moving = Sinusoids(np.zeros(2), np.ones(2), np.ones(2))
    for reference in (moving, MinimumJerk(np.eye(2), np.arange(2.0)), StoppedReference(moving, 1.0)):
        with pytest.raises(InputError, match="reference: time: expected numbers, got"):
            reference(wrong)
