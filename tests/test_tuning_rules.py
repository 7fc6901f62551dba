"""Judgement of tunings, searches, notes and laws by name, each against what its numbers mean."""

from __future__ import annotations

import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from two_links import ARM, AT_REST, LIMITS, changed

from adaptctl.control import GuardedLearning, PDGravity, Sinusoids
from adaptctl.description import JointKind, Limits
from adaptctl.description.drive import Drive
from adaptctl.dynamics import load
from adaptctl.identifiability import ReducedModel
from adaptctl.simulation import LinearlyImplicitEuler, SemiImplicitEuler
from adaptctl.tuning import Tuning, tune, with_friction
from adaptctl.tuning.default_gains import DefaultGains
from adaptctl.tuning.feasible_reference import FeasibleReference, _center, _costs, motion_ranges
from adaptctl.tuning.learning_rule import learning_by_rule
from adaptctl.tuning.named_laws import guarded, named_law
from adaptctl.tuning.open_parameters import open_note
from adaptctl.tuning.rotors import rotor_note, rotorless
from adaptctl.tuning.tune import _notes, _run_remarks, _searched
from adaptctl.tuning.verification import Verification, measures, scaled_links, verified


@pytest.fixture(scope="module")
def tuned() -> Tuning:
    return tune(ARM)


def run_of(error: list[np.ndarray], applied: np.ndarray | None = None) -> Any:
    """Runs (T, M, r) of 20 s at 20 Hz, as measured."""
    stacked = np.stack(error, axis=1)[:, :, None] * np.ones(2)
    torque = np.zeros_like(stacked) if applied is None else applied
    return SimpleNamespace(
        time=0.05 * np.arange(len(stacked)), error=stacked, applied=torque,
        largest_error=np.abs(stacked).max(axis=0),
    )  # fmt: skip


def test_a_run_is_judged_by_its_first_second_its_last_two_and_its_second_half() -> None:
    time = 0.05 * np.arange(400)
    falling = np.where(time < 0.999, 0.04, np.where(time < 17.94, 0.5, 0.01))
    applied = np.zeros((400, 1, 2))
    applied[:250, 0, 1] = 25.0  # the elbow's limit, in a quarter of the second half
    applied[250:, 0, 0] = 59.99
    first, last, largest, limited = measures(run_of([falling], applied), LIMITS)
    assert (first[0], last[0], largest[0], limited[0]) == pytest.approx((0.04, 0.01, 0.5, 0.25))
    lost = np.where(time < 10.0, 0.04, np.nan)
    first, last, largest, _ = measures(run_of([lost]), LIMITS)
    assert (first[0], last[0], largest[0]) == (np.inf, np.inf, np.inf)


def test_runs_with_and_without_adaptation_are_told_in_pairs() -> None:
    flat = [np.full(400, x) for x in (0.01, 0.02, 0.03, 1.5)]
    trials: Any = SimpleNamespace(plant=SimpleNamespace(mechanism=ARM, torque_limits=LIMITS))
    one, other = verified(run_of(flat[::2]), run_of(flat[1::2]), ["nominal", "late"], trials)
    assert (one.name, one.final_rms_error, one.final_rms_error_adaptation_off) == pytest.approx(("nominal", 0.01, 0.02))
    assert (other.name, other.max_error) == pytest.approx(("late", 0.03))
    assert other.final_rms_error_adaptation_off == np.inf  # an error beyond 1 rad


@pytest.mark.parametrize(
    ("numbers", "bounded", "learning", "told"),
    [
        ((0.06, 0.0199, 0.06, 0.99, 0.05), True, True, "60 to 19.9 mrad; without adaptation 60 mrad"),
        ((0.06, 0.0201, 0.1, 0.1, 0.0), True, False, "60 to 20.1 mrad"),
        ((0.1, 0.0201, 0.06, 0.1, 0.0), True, False, "without adaptation 60 mrad"),
        ((0.06, 0.001, np.inf, 0.1, 0.0), True, True, "without adaptation unstable"),
        ((0.06, 0.001, 0.06, 1.0, 0.0), False, False, "failed, tracking error 1"),
        ((0.06, 0.001, 0.06, 0.1, 0.06), False, False, "failed, 6% at a torque limit"),
    ],
)
def test_learning_is_a_third_of_both_errors(
    numbers: tuple[float, ...], bounded: bool, learning: bool, told: str
) -> None:
    found = Verification("nominal", *numbers)
    assert (found.is_bounded, found.is_learning) == (bounded, learning)
    assert told in str(found)


@pytest.mark.parametrize(
    ("last", "largest", "limited", "best"),
    [
        ([3.0, 3.0, 1.0, 4.0, 2.0, 2.0], [0.9] * 6, 0, 2),  # by the worse of two
        ([3.0, 3.0, 1.0, 4.0, 2.0, 2.0], [0.9] * 4 + [1.0, 0.9], 0, 0),  # the third fails in one run
        ([3.0, 3.0, 2.0, 2.0, 4.0, 1.0], [0.9] * 6, 11, 0),  # the second is at a limit for 5.5 % of the second half
        ([3.0, 3.0, 2.0, 2.0, 4.0, 1.0], [0.9] * 6, 10, 1),
    ],
)
def test_a_search_takes_the_best_of_the_worse_of_two_runs(
    last: list[float], largest: list[float], limited: int, best: int
) -> None:
    asked: list[tuple[Any, ...]] = []

    def proposed(*given: Any) -> Any:
        asked.append(given)
        gains = SimpleNamespace(bandwidth=np.ones(2), damping=np.ones(2))
        return SimpleNamespace(feasible=SimpleNamespace(gains=gains), gain=len(asked))

    def run(settings: list[Any], duration: float) -> Any:
        assert [one.delayed for one in settings] == [False, True] * 3
        assert [one.gain for one in settings] == [0, 0, 1, 1, 2, 2]
        own = ARM.inertial_parameters
        for k, one in enumerate(settings):
            np.testing.assert_array_equal(one.parameters, scaled_links(ARM, 0.3, (9, 10)[k % 2]))
        shares = {round(float(one.parameters[k] / own[k]), 9) for one in settings for k in (0, 10)}
        assert shares == {0.7, 1.3}
        found = run_of([1e-3 * np.full(400, x) for x in last])
        found.largest_error = np.array(largest)[:, None] * np.ones(2)
        found.applied[200 : 200 + limited, 2, 1] = 25.0
        return found

    rule: Any = SimpleNamespace(proposed=proposed)
    trials: Any = SimpleNamespace(plant=SimpleNamespace(mechanism=ARM, torque_limits=LIMITS), run=run)
    first = proposed()
    asked.clear()
    first.gain = 0
    assert _searched(trials, rule, first, 2, 8).gain == best
    assert len(set(asked)) == 2
    assert {kind for *_, kind in asked} <= {"mixed", "links", "parameters"}


def test_a_search_without_end_tries_each_setting_once() -> None:
    asked: list[tuple[Any, ...]] = []
    rule: Any = SimpleNamespace(proposed=lambda *given: asked.append(given))
    from adaptctl.tuning.tune import _drawn

    assert len(_drawn(rule, 1000, 0)) == len(set(asked)) == 48


def notes(static: float = 0.5, asked: float = 0.6, reduced: float = 1.0, rate: float = 4.0, stiff: bool = False) -> str:
    """Notes on the first joint of two."""
    numbers = (np.array([x, y]) for x, y in ((static, 0.0), (asked, 0.0), (reduced, 1.0)))
    carried: Any = SimpleNamespace(gains=SimpleNamespace(bandwidth=np.array([rate, 4.0]), damping=LIMITS))
    plant: Any = SimpleNamespace(integrator=LinearlyImplicitEuler() if stiff else SemiImplicitEuler(), substeps=7)
    return "; ".join(_notes(ARM, FeasibleReference(AT_REST, *numbers), carried, plant))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, ""),
        ({"static": 0.951}, "shoulder: gravity and friction need 95% of the torque limit: it can only move slowly"),
        ({"static": 0.95, "asked": 0.97}, ""),
        ({"static": 0.1, "asked": 0.61}, "shoulder: the reference needs 61% of the torque limit"),
        ({"static": 0.5, "asked": 0.75}, ""),  # halfway from rest to the limit
        ({"static": 0.5, "asked": 0.76}, "shoulder: the reference needs 76% of the torque limit"),
        ({"reduced": 0.49}, "shoulder: amplitude reduced to 49 % of its motion limits to respect the torque limit"),
        ({"reduced": 0.5}, ""),
        ({"rate": 0.9}, "shoulder: the torque limit allows a bandwidth of only 0.9 1/s: adaptation takes minutes"),
        ({"rate": 1.0}, ""),
        ({"stiff": True}, "friction is too stiff for 8 explicit steps per period: 7 implicit steps are used"),
    ],
)
def test_notes_begin_at_their_bounds(given: dict[str, Any], told: str) -> None:
    assert notes(**given) == told


def test_parameters_that_a_reference_hardly_shows_are_named() -> None:
    """Of a shoulder that stands still, those that turn with it; all at rest, of which six names are told."""
    model, limits = ReducedModel(with_friction(ARM)), np.array(ARM.effort_limits)

    def told(*amplitude: float) -> str:
        return open_note(model, Sinusoids([0.3, 0.6], amplitude, [0.2, 0.3]), limits)

    some, first_six = ("upper.mc_x, upper.mc_y, upper.I_zz, " + more for more in ("shoulder", "lower.mc_x, "))
    assert told(0.5, 0.4) == ""
    assert told(0.0, 0.5).startswith(f"in 20 s this reference hardly shows 5 of 10 parameters: {some}")
    assert f"10 of 10 parameters: {first_six}lower.mc_y, lower.I_zz, ...; their" in told(0.0, 0.0)


def test_models_too_large_to_learn_or_to_compile_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    rule, model = DefaultGains.for_mechanism(ARM), ReducedModel(ARM)
    assert list(_run_remarks(None, rule)) == ["too many links to compile: the gains were neither searched nor verified"]
    assert list(_run_remarks(model, rule)) == []
    monkeypatch.setattr(sys.modules[_run_remarks.__module__], "MAX_LEARNED", 5)
    assert "these 6 are adapted by the gradient" in next(_run_remarks(model, rule))


def test_rotors_are_missing_where_a_driven_joint_turns_and_has_a_limit() -> None:
    assert rotorless(ARM) == ["shoulder", "elbow"]
    assert rotorless(ARM.with_drives([Drive(rotor_inertia=0.1), Drive()])) == ["elbow"]
    assert rotorless(changed(lambda joint: replace(joint, kind=JointKind.PRISMATIC), 0)) == ["elbow"]
    assert rotorless(changed(lambda joint: replace(joint, limits=Limits()), 1)) == ["shoulder"]
    assert rotor_note(ARM) == ""  # a description of our own could have them
    assert rotor_note(changed(lambda joint: joint, source="URDF file arm.urdf")).startswith("shoulder, elbow: URDF has")


@pytest.mark.parametrize(("limits", "period", "rate"), [(LIMITS, 1e-3, 10.0), (1e9 * LIMITS, 0.1, 5.0)])
def test_the_learning_rule_weighs_torques_by_their_errors(limits: np.ndarray, period: float, rate: float) -> None:
    damping = np.array([40.0, 4.0])
    swing = Sinusoids(np.zeros(2), np.array([0.5, 0.05]), np.full(2, 0.25))
    rubbing = ARM.with_drives([Drive(viscous=0.0, coulomb=0.1), Drive(viscous=0.0, coulomb=7.0)])
    model, gain = ReducedModel(rubbing), np.diag(np.arange(1.0, 11.0))
    found: GuardedLearning = learning_by_rule(model, gain, limits, damping, period, swing)
    # 0.3 % of the limit, or what the damping makes of 3.3 mrad/s if that is less; friction is known within 3 % at best
    errors = np.maximum(np.minimum(3e-3 * limits, 3.3e-3 * damping), [0.003, 0.21])
    assert found.prediction_weight == pytest.approx(errors**-2)
    assert found.gain == pytest.approx(np.arange(1.0, 11.0))
    assert (found.cutoff, found.recall) == (rate, rate)
    assert found.min_speed == pytest.approx([0.05, 0.15 * 0.05 * 2.0 * np.pi * 0.25], rel=1e-3)


@pytest.mark.parametrize(("kind", "least"), [(JointKind.REVOLUTE, 0.05), (JointKind.PRISMATIC, 0.15 * 0.0157)])
def test_turning_joints_that_hardly_move_are_not_learned_from_the_noise_of_their_speed(
    kind: JointKind, least: float
) -> None:
    arm = changed(lambda joint: replace(joint, kind=kind), 1)
    swing = Sinusoids(np.zeros(2), np.array([0.5, 0.01]), np.full(2, 0.25))
    model = ReducedModel(arm)
    found = learning_by_rule(model, np.eye(len(model.columns)), LIMITS, np.array([40.0, 4.0]), 1e-3, swing)
    assert found.min_speed == pytest.approx([0.05, least], rel=1e-2)


def test_named_laws_have_the_gains_of_the_tuning(tuned: Tuning) -> None:
    model, gains = ReducedModel(ARM), tuned.gains
    laws: dict[str, Any] = {name: named_law(name, tuned, model) for name in ("pd-gravity", "slotine-li-composite")}
    assert isinstance(laws["pd-gravity"], PDGravity)
    assert laws["pd-gravity"].stiffness == pytest.approx(gains.bandwidth * gains.damping)
    composite = laws["slotine-li-composite"].adaptation
    assert 1.0 / np.sqrt(composite.prediction_weight) == pytest.approx(0.01 * LIMITS)
    fixed: Any = named_law("slotine-li-fixed", tuned, model)
    assert fixed.init(np.zeros(2), np.zeros(2)).estimate == pytest.approx(model.fundamental_parameters)
    assert fixed.adaptation is None


def test_a_filter_has_the_speeds_of_the_joints_or_half_more_than_is_asked(tuned: Tuning) -> None:
    fast = Sinusoids(np.zeros(2), np.array([1.0, 0.1]), np.array([0.5, 0.5]))
    free = changed(lambda joint: replace(joint, limits=replace(joint.limits, velocity=np.inf)))
    law = tuned.controller(ReducedModel(ARM), False)
    found: Any = guarded(law, replace(tuned, mechanism=free, reference=fast))
    assert found.velocity_limits == pytest.approx([1.5 * np.pi, 2.0], rel=1e-3)
    named: Any = guarded(law, tuned)
    assert named.velocity_limits.tolist() == [6.0, 6.0]
    assert named.position_limits == pytest.approx(np.deg2rad([[-170, -150], [170, 150]]))


def test_the_center_of_an_arm_with_loops_is_near_its_home_and_cheaper() -> None:
    arm = load("semi_direct_drive")
    lower, upper = motion_ranges(arm)
    home, half, limits = arm.neutral_configuration, 0.5 * (upper - lower), np.full(arm.dof, 50.0)
    center = _center(arm, limits, np.random.default_rng(0))
    costs = _costs(arm, limits, np.stack((center, home)), 0.5 * (lower + upper), half)
    assert costs[0] < costs[1]
    assert np.all(np.abs(center - home) <= 0.3 * 0.8 * half)
