"""Feasible references, initial errors and gains, each against what its numbers mean."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from two_links import ARM, AT_REST, LIMITS, changed

from adaptctl.control import Gains, Sinusoids
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.control.gains.workspace import MAX_RANGE
from adaptctl.description import JointKind, Limits
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.tuning import tune, with_friction
from adaptctl.tuning.default_gains import DefaultGains, _groups, prior_ranges
from adaptctl.tuning.feasible_gains import (
    FeasibleGains,
    _validate_inertia,
    _Worst,
    assumed_limits,
    feasible_gains,
    limitations,
    recoverable_error,
    yielding_note,
)
from adaptctl.tuning.feasible_reference import (
    _costs,
    _loads,
    feasible_reference,
    judged_reference,
    motion_range,
)


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (-0.3, 0.5, (-0.3, 0.5)),
        (-np.inf, np.inf, (-1.0, 1.0)),
        (0.5, np.inf, (0.5, 2.5)),
        (-np.inf, 0.5, (-1.5, 0.5)),
        (-1e16, 1e16, (-1.0, 1.0)),  # a number for none
        (0.5, 1e16, (0.5, 2.5)),
        (-0.5, MAX_RANGE, (-0.5, 1.5)),
        (-0.5, 0.9 * MAX_RANGE, (-0.5, 0.9 * MAX_RANGE)),
    ],
)
def test_a_joint_without_limits_moves_a_radian_about_zero(
    lower: float, upper: float, expected: tuple[float, float]
) -> None:
    joint = replace(ARM.primary_joints[0], limits=Limits(lower, upper))
    assert motion_range(joint) == pytest.approx(expected)


def test_an_initial_error_is_what_torques_correct_at_one_per_second() -> None:
    down = Sinusoids(np.array([-0.5 * np.pi, 0.0]), np.zeros(2), np.ones(2))  # hanging, without gravity's torque
    inertia = np.diagonal(ARM.mass_matrix(np.array([-0.5 * np.pi, 0.0])))
    assert recoverable_error(ARM, 1e3 * LIMITS, down) == pytest.approx([0.1, 0.1])
    weak = 0.01 * inertia / 0.3  # 0.3 of it accelerates as a hundredth does at 1/s
    still = changed(lambda joint: joint, gravity=np.zeros(3))
    assert recoverable_error(still, weak, down) == pytest.approx([0.01, 0.01])
    narrow = changed(lambda joint: replace(joint, limits=replace(joint.limits, lower=-0.1, upper=0.1)), 1)
    assert recoverable_error(narrow, 1e3 * LIMITS, down) == pytest.approx([0.1, 0.02])  # a tenth of the range
    tight = 0.9 * np.abs(ARM.inverse_dynamics(down(0.0).p + 0.1, np.zeros(2), np.zeros(2))) / 0.4
    found = recoverable_error(ARM, tight, down)
    load_there = np.abs(ARM.inverse_dynamics(down(0.0).p + found, np.zeros(2), np.zeros(2))) / tight
    assert found == pytest.approx(np.full(2, 0.08))  # a fifth less, where gravity is a ninth more than it may be
    assert 0.3 < load_there.max() <= 0.4


@pytest.mark.parametrize(("effort", "slow"), [(1e4, False), (0.1, True)])
def test_the_bandwidth_is_what_a_third_of_the_torque_corrects(effort: float, slow: bool) -> None:
    p, off, limits = np.zeros((1, 2)), np.full(2, 0.1), np.full(2, effort)
    found = feasible_gains(ARM, limits, p, off, 1e-3, 4.0, 0.5)
    M = ARM.mass_matrix(p)[0]
    rates = np.sqrt(0.3 * effort / (np.diagonal(M) * 0.1))
    assert found.gains.bandwidth == pytest.approx(rates if slow else [4.0, 4.0])
    assert found.limited_by_torque.tolist() == [slow, slow]
    assert found.limited_by_sampling.tolist() == [not slow, not slow]
    assert found.free_inertia == pytest.approx(1.0 / np.diagonal(np.linalg.inv(M)))
    if slow:
        assert found.gains.damping * rates * 0.1 == pytest.approx(np.full(2, 0.5 * effort))
    else:
        ratio = 1e-3 * np.linalg.eigvals(np.linalg.solve(M, np.diag(found.gains.damping))).max()
        assert 0.45 < ratio <= 0.5 + 1e-12


def test_viscous_friction_is_inertia_and_coulomb_friction_is_none() -> None:
    rubbing = ARM.with_drives([Drive(viscous=300.0, coulomb=5.0), Drive(viscous=50.0)])
    p, limits = np.zeros((2, 2)), np.full(2, 1e6)
    found = feasible_gains(rubbing, limits, p, np.full(2, 0.1), 1e-3, 4.0, 0.5)
    M, B = ARM.mass_matrix(p)[0], np.diag([300.0, 50.0])
    decay = expm(-1e-3 * np.linalg.solve(M, B))
    # A held torque u takes v to decay v + (1 - decay) B^-1 u, which turns over where K is the following.
    turns_over = B @ np.linalg.solve(np.eye(2) - decay, np.eye(2) + decay)
    assert found.free_inertia == pytest.approx(1.0 / np.diagonal(np.linalg.inv(0.5e-3 * turns_over)))


def test_what_limits_gains_is_told_in_the_units_of_the_joint() -> None:
    mixed = changed(lambda joint: replace(joint, kind=JointKind.PRISMATIC), 1)

    def told(sampled: bool, weak: bool) -> list[str]:
        both = np.ones(2, bool)
        given = FeasibleGains(AT_REST, both & sampled, np.array([0.2, 0.5]), both & weak)  # type: ignore[arg-type]
        return list(limitations(mixed, given))

    turn, slide = told(True, True)
    assert "adding 0.6 kg m² of reflected rotor inertia would allow 4× the damping" in turn  # 3 times the free inertia
    assert "adding 2 kg of drive mass" in slide
    assert told(False, True) == ["Λ and K are limited by the torque limit"] * 2
    assert told(False, False) == ["K is limited by the torque limit"] * 2


def test_joints_that_a_small_push_moves_far_are_told() -> None:
    """Stiffness is bandwidth times damping; the bandwidth is 4, and 5 % of a limit is the push."""

    def told(yields: list[float], mechanism: Mechanism = ARM) -> str:
        limits = np.array([joint.limits.effort for joint in ARM.primary_joints])
        return yielding_note(mechanism, Gains(np.full(2, 4.0), 0.05 * limits / (4.0 * np.array(yields))))

    assert told([0.99, 0.99]) == ""
    assert told([0.9, 1.1]).startswith("elbow: a push of 5% of the torque limit moves it by more than 1 rad")
    assert told([1.1, 1.1]).startswith("shoulder, elbow: ")
    assert told([9.0, 9.0], changed(lambda joint: replace(joint, limits=Limits()), 0)).startswith("elbow: ")


def test_limits_that_are_assumed_are_told() -> None:
    without = changed(lambda joint: replace(joint, limits=Limits()), 1)
    limit = finite_torque_limits(without)[1]
    told = f"elbow: no torque limits are given; {limit:.3g} N m (N) are assumed, 4 times what moves the arm"
    assert assumed_limits(ARM) == ""
    assert assumed_limits(without).startswith(told)
    notes = tune(without, control_period=4e-3, nominal_only=True).notes
    assert assumed_limits(without) in notes


def test_gains_hold_without_the_friction_of_the_file() -> None:
    """Stable is below 2."""
    stiff = ARM.with_drives([Drive(viscous=1e5), Drive(viscous=1e5)])
    p, limits = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2)), np.full(2, 1e9)
    damping = feasible_gains(stiff, limits, p, np.full(2, 0.1), 1e-3, 4.0, 0.5).gains.damping
    root = np.sqrt(damping)
    free = np.linalg.eigvalsh(1e-3 * root[:, None] * np.linalg.inv(ARM.mass_matrix(p)) * root)[:, -1].max()
    assert free == pytest.approx(1.0, rel=1e-6)


def test_shares_at_rest_are_of_gravity_and_coulomb_friction() -> None:
    level = Sinusoids(np.zeros(2), np.zeros(2), np.ones(2))
    # lever arms of the two centres of mass are 0.2 and 0.55 m, and 0.15 m about the elbow
    gravity = 9.81 * np.array([2.0 * 0.2 + 1.2 * 0.55, 1.2 * 0.15])
    found = judged_reference(ARM.with_drives([Drive(coulomb=3.0), Drive()]), LIMITS, level)
    assert found.static == pytest.approx((gravity + np.array([3.0, 0.0])) / LIMITS, rel=2e-3)
    assert found.reduced.tolist() == [1.0, 1.0]
    swing: Any = Sinusoids(np.zeros(2), np.array([0.5, 0.0]), np.full(2, 0.5))
    points = swing(np.linspace(0.0, 20.0, 4001))
    peak = np.abs(ARM.inverse_dynamics(points.p, points.v, points.a)).max(axis=0) / LIMITS
    assert judged_reference(ARM, LIMITS, swing).asked == pytest.approx(peak, rel=0.01)


@pytest.mark.parametrize("share", [0.1, 0.25, 1.0])
def test_amplitudes_fall_until_torques_fit(share: float) -> None:
    limits = share * LIMITS
    found, free = feasible_reference(ARM, limits, 1), feasible_reference(ARM, 1e3 * LIMITS, 1)
    mine: Any = found.reference
    points = mine(np.linspace(0.0, 20.0, 801))
    asked = np.abs(ARM.inverse_dynamics(points.p, points.v, points.a)).max(axis=0) / limits
    assert (asked <= np.clip(0.5 + 0.5 * found.static, 0.6, 0.95) + 0.01).all()
    assert (found.reduced.min() < 1.0) == (share == 0.1)
    assert free.reduced.tolist() == [1.0, 1.0]
    given: Any = free.reference
    room = 0.8 * (np.deg2rad([170, 150]) - np.abs(given.center))
    assert (given.amplitude <= np.minimum(0.5, room)).all()
    assert ((given.frequency >= 0.1) & (given.frequency <= 0.25)).all()
    narrow = changed(lambda joint: replace(joint, limits=replace(joint.limits, lower=0.1, upper=0.3)), 1)
    drawn: Any = feasible_reference(narrow, 1e3 * LIMITS, 1).reference
    room = min(drawn.center.flat[1] - 0.1, 0.3 - drawn.center.flat[1])
    assert 0.5 * 0.8 * room <= drawn.amplitude.flat[1] <= 0.8 * room


def test_a_centre_is_rounded_to_thousandths_of_half_its_range() -> None:
    """What a descent ends with differs in late digits from one machine to another."""
    mine: Any = feasible_reference(ARM, LIMITS, 1).reference
    thousandths = 1e3 * mine.center / np.deg2rad([170, 150])
    assert thousandths == pytest.approx(np.rint(thousandths), abs=1e-9)
    assert (np.rint(thousandths) % 10 != 0).any()


def test_the_worst_posture_is_told_with_each_joints_part_in_it() -> None:
    inverses = np.array([np.diag([1.0, 3.0, 2.0]), np.diag([1.0, 2.0, 4.0]), np.diag([5.0, 1.0, 2.0])])
    number, shares = _Worst(inverses, 0.5).of(np.array([1.0, 4.0, 2.0]))
    assert (number, shares.tolist()) == (pytest.approx(6.0), pytest.approx([0.0, 1.0, 0.0]))


def test_the_worst_posture_is_found_again_after_each_change_of_damping() -> None:
    rng = np.random.default_rng(0)
    roots, damping, found = rng.normal(size=(50, 3, 3)), np.ones(3), set[int]()
    inverses = roots @ roots.swapaxes(1, 2)
    worst = _Worst(inverses, 0.5)
    for _ in range(200):
        damping = damping * rng.uniform(0.8, 1.2, 3)
        numbers = np.linalg.eigvals(0.5 * inverses * damping).real.max(axis=1)
        assert worst.of(damping)[0] == pytest.approx(numbers.max(), rel=1e-12)
        found.add(int(numbers.argmax()))
    assert len(found) > 1


def test_prior_ranges_are_of_a_body_that_the_joint_can_move() -> None:
    named = dict(zip(ARM.parameter_names, prior_ranges(ARM), strict=True))
    for link in ("upper", "lower"):
        assert named[f"{link}.mc_x"] ** 2 == pytest.approx(named[f"{link}.m"] * named[f"{link}.I_zz"])
        assert 0.0 < named[f"{link}.m"] <= 5.0
    assert named["upper.I_zz"] > named["lower.I_zz"]
    free = dict(zip(ARM.parameter_names, prior_ranges(ARM, 1e9), strict=True))
    assert free["lower.m"] * (0.3 / 3.0) ** 2 == pytest.approx(free["lower.I_zz"])  # at a third of what is behind it
    light = dict(zip(ARM.parameter_names, prior_ranges(ARM, 0.1), strict=True))
    assert light["lower.m"] == 0.1


def test_the_cost_of_a_posture_is_of_gravity_distance_and_coupling() -> None:
    middle, half = np.zeros(2), np.deg2rad([170.0, 150.0])
    hanging, level = np.array([[-0.5 * np.pi, 0.0]]), np.zeros((1, 2))
    given = ARM, LIMITS
    away = 0.5 * (0.5 * np.pi / half[0]) ** 2
    assert _loads(*given, hanging, middle, half) == pytest.approx(0.1 * away, abs=1e-9)  # no gravity
    shares = np.abs(ARM.inverse_dynamics(level, level, level))[0] / LIMITS
    found = float(_loads(*given, level, middle, half)[0]) - 0.1 * np.sqrt(np.mean(shares**2))
    assert shares.max() < found < 1.01 * shares.max()  # nearly the largest
    M = ARM.mass_matrix(level)[0]
    alone = 1.0 - M[0, 1] / np.sqrt(M[0, 0] * M[1, 1])  # least eigenvalue of a matrix of two, scaled
    coupling = _costs(*given, level, middle, half) - _loads(*given, level, middle, half)
    assert coupling == pytest.approx(-0.03 * np.log10(alone))


def test_loops_that_do_not_close_take_any_torque() -> None:
    arm = load("semi_direct_drive")
    home, limits = arm.neutral_configuration, np.full(3, 100.0)
    small, large = (Sinusoids(home, np.array([0.0, 0.0, x]), np.full(3, 0.2)) for x in (0.05, 3.0))
    assert np.isfinite(judged_reference(arm, limits, small).asked).all()
    assert np.isinf(judged_reference(arm, limits, large).asked).all()


@pytest.mark.parametrize("scale", [1e-7, 1.0, 1e7])
def test_small_and_large_arms_have_gains_and_massless_links_do_not(scale: float) -> None:
    arm = ARM.with_parameters(scale * ARM.inertial_parameters)
    p, off = np.zeros((3, 2)), np.full(2, 0.1)
    found = feasible_gains(arm, 1e9 * scale * LIMITS, p, off, 1e-3, 4.0, 0.5).gains
    own = feasible_gains(ARM, 1e9 * LIMITS, p, off, 1e-3, 4.0, 0.5).gains
    assert found.damping == pytest.approx(scale * own.damping)
    massless = arm.inertial_parameters.copy()
    massless[10:] = 0.0
    with pytest.raises(InputError, match="two_link: elbow: moves no inertia"):
        feasible_gains(ARM.with_parameters(massless), LIMITS, p, off, 1e-3, 4.0, 0.5)
    wrong = arm.inertial_parameters.copy()
    wrong[11] *= -9.0  # a first moment that no mass of this inertia has
    with pytest.raises(InputError, match="the mass matrix is not positive definite"):
        feasible_gains(ARM.with_parameters(wrong), LIMITS, p, off, 1e-3, 4.0, 0.5)


def test_gains_of_parameters_have_one_effect_in_a_group_of_a_link_or_its_friction() -> None:
    arm = with_friction(ARM)
    assert arm.inertial_parameters[20:].tolist() == [0.0] * 4  # what the description does not have
    groups = _groups(arm)
    assert sorted(k for group in groups for k in group) == list(range(24))
    names = [{arm.parameter_names[k].partition(".")[0] for k in group} for group in groups]
    assert names == [{"upper"}, {"lower"}, {"shoulder"}, {"elbow"}]
    rule = DefaultGains.for_mechanism(arm)
    found = rule.proposed(4.0, 0.5, 0.3, "parameters")
    rates, points = found.feasible.gains.bandwidth, rule.reference_points
    v_r, a_r = points.v - rates * rule.errors, points.a + rates**2 * rule.errors
    Y = arm.slotine_li_regressor(points.p + rule.errors, points.v, v_r, a_r)
    effect = found.gain * (Y**2 / found.feasible.gains.damping[:, None]).sum(axis=1).max(axis=0)
    for group in groups:
        assert effect[group].max() == pytest.approx(effect.max())
        assert ((effect[group] < 1.0001 * effect.max()) & (found.gain[group] > 0.0)).all()
    assert np.abs(rule.errors) == pytest.approx(np.full(rule.errors.shape, 0.1))
    assert (rule.errors.min(axis=0) < 0.0).all()
    assert (rule.errors.max(axis=0) > 0.0).all()
    assert 0.15 < np.abs(rule.postures - points.p).max() <= 0.2


@pytest.mark.parametrize(
    ("diagonal", "product", "told"),
    [
        ((1.0, 0.5e-12), 0.0, "moves no inertia"),
        ((1.0, 2.0e-12), 0.0, ""),
        ((1.0, 1.0), 1.0 - 0.5e-10, "is not positive definite"),
        ((1.0, 1.0), 1.0 - 1.5e-10, ""),
    ],
)
def test_inertias_count_beyond_round_off(diagonal: tuple[float, float], product: float, told: str) -> None:
    M = np.diag(diagonal) + product * (1.0 - np.eye(2))
    with pytest.raises(InputError, match=told) if told else nullcontext():
        _validate_inertia(ARM, M[None])
