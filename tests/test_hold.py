"""What a held torque carries: the worst configuration is searched for, and 2 is where velocities grow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from figures import require
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain
from scipy.linalg import tanhm
from scipy.optimize import differential_evolution

from adaptctl.arrays import Array
from adaptctl.control import SlotineLi, Workspace, sampling_ratio, worst_conditioned_configuration
from adaptctl.control.gains.sampling_ratio import (
    MAX_SAMPLING_RATIO,
    _lightest_joint,
    sampling_ratios,
    slowest_decay,
    validate_sampling_ratio,
)
from adaptctl.control.gains.workspace import Worst, everywhere, position_range, sampled_configurations
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from benchmarks.hold_limits import BANDWIDTH, bisected
from benchmarks.stability import random_arm


def own_damping(mechanism: Mechanism, rate: float) -> Array:
    return rate * np.median(np.diagonal(everywhere(mechanism).mass_matrices, axis1=1, axis2=2), axis=0)


@pytest.mark.parametrize("seed", range(4))
def test_the_search_finds_what_a_global_one_finds(seed: int) -> None:
    arm = random_chain(seed, 5)
    damping = own_damping(arm, 100.0)
    evolved = differential_evolution(
        lambda p: -sampling_ratios(arm, p.T, damping, 1e-3),
        list(zip(*position_range(arm), strict=True)),
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(0),
        maxiter=60,
        polish=False,
    )
    found = sampling_ratio(arm, damping, 1e-3)
    assert found.value > 0.95 * -evolved.fun
    assert found.value == pytest.approx(float(sampling_ratios(arm, found.p, damping, 1e-3)), rel=1e-12)


def test_random_configurations_alone_accept_what_is_unstable() -> None:
    """The largest of 200 samples is below the limit, the truth above 2 somewhere, and there velocities grow."""
    arm = random_chain(10, 6)
    largest = float(sampling_ratios(arm, sampled_configurations(arm), own_damping(arm, 1.0), 1.0).max())
    damping = own_damping(arm, 1.0) * 1.49 / (1e-3 * largest)
    found = sampling_ratio(arm, damping, 1e-3)
    assert found.value > 2.0
    feedback = np.linalg.solve(arm.mass_matrix(found.p), np.diag(damping))
    assert np.abs(np.linalg.eigvals(np.eye(6) - 1e-3 * feedback)).max() > 1.0
    with pytest.raises(GainError, match=rf"at p = .*Joint {found.joint} would oscillate"):
        validate_sampling_ratio(arm, damping, 1e-3)


def test_the_joint_that_moves_without_inertia_does_not_depend_on_units() -> None:
    alike = np.array([[1.0, 0.9, 0.5], [0.9, 1.0, 0.2], [0.5, 0.2, 1.0]])
    for units in ((1.0, 1.0, 1.0), (100.0, 10.0, 1.0)):
        arm: Any = SimpleNamespace(mass_matrix=lambda p, units=units: alike * np.outer(units, units))
        assert _lightest_joint(arm, np.zeros(3)) == 0


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), size=st.integers(2, 5))
def test_the_number_rises_with_every_damping_and_bandwidth(seed: int, size: int) -> None:
    """At every position: so what is below accepted gains needs no search of its own."""
    rng, arm = np.random.default_rng(seed), random_chain(seed, size)
    p = rng.uniform(-3.0, 3.0, (20, size))
    damping, bandwidth = rng.uniform(0.01, 10.0, size), rng.uniform(0.0, 20.0, size)
    more = damping * rng.choice([1.0, 1.5, 30.0], size), bandwidth + rng.choice([0.0, 1.0, 100.0], size)
    below = sampling_ratios(arm, p, damping, 1e-3, bandwidth)
    assert np.all(below <= sampling_ratios(arm, p, more[0], 1e-3, more[1]) * (1.0 + 1e-9))


def test_gains_below_accepted_ones_are_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, highest = random_chain(77, 4), Workspace.maximum
    searched: list[Workspace] = []

    def counted(self: Workspace, of: Callable[[Array], Array]) -> Worst:
        searched.append(self)
        return highest(self, of)

    monkeypatch.setattr(Workspace, "maximum", counted)
    most, bandwidth = own_damping(arm, 20.0), np.array([4.0, 5.0, 6.0, 7.0])
    workspace = everywhere(arm)
    validate_sampling_ratio(arm, most, 1e-3, bandwidth, workspace)
    once = len(searched)
    for share in (0.999, 0.5, 1e-3):
        validate_sampling_ratio(arm, share * most, 1e-3, bandwidth - share, workspace)
    assert once == len(searched) > 0
    validate_sampling_ratio(arm, most * [1.0, 1.0, 1.0, 1.001], 1e-3, bandwidth, workspace)
    assert len(searched) > once
    with pytest.raises(GainError, match="too stiff"):
        validate_sampling_ratio(arm, most * [1.0, 1e3, 1.0, 1.0], 1e-3, bandwidth, workspace)
    for wrong in ((-most, bandwidth), (most, -bandwidth)):
        with pytest.raises(InputError, match="positive damping"):
            validate_sampling_ratio(arm, wrong[0], 1e-3, wrong[1], workspace)


@settings(max_examples=20, deadline=None)
@given(stiff=st.floats(0.01, 1.99), viscous=st.floats(0.0, 3.0))
def test_with_friction_the_limit_is_that_of_the_exact_hold(stiff: float, viscous: float) -> None:
    """M v' = -B v - K v_k over T: v_k+1 = (e^-x - (1 - e^-x) K/B) v_k, x = T B/M."""
    bare = random_chain(3, 1)
    inertia = float(bare.mass_matrix(np.zeros(1))[0, 0])
    arm = bare.with_drives(Drive(viscous=viscous * inertia / 1e-3))
    x = max(viscous, 1e-9)
    damping = hold_scale(arm, inertia / 1e-3, stiff)
    pole = np.exp(-x) + np.expm1(-x) * damping * 1e-3 / inertia / x
    assert sampling_ratio(arm, damping, 1e-3).value == pytest.approx(stiff, rel=1e-9)
    assert pole > -1.0
    at_limit = np.exp(-x) + np.expm1(-x) * hold_scale(arm, inertia / 1e-3, 2.0) * 1e-3 / inertia / x
    assert at_limit == pytest.approx(-1.0, abs=1e-6)


def hold_scale(arm: Mechanism, damping: float, wanted: float) -> float:
    """The damping with a given sampling ratio, which is proportional to it."""
    return damping * wanted / sampling_ratio(arm, damping, 1e-3).value


@pytest.mark.parametrize("seed", [0, 5])
def test_what_is_accepted_is_at_least_seven_tenths_of_what_rings(seed: int) -> None:
    """Closed loops simulated from a small velocity, their damping raised by bisection until they ring somewhere."""
    arm = random_arm(np.random.default_rng(1000 + seed))
    shape = own_damping(arm, 1.0)
    free = sampling_ratio(arm, shape, 1e-3)
    accepted = shape * (MAX_SAMPLING_RATIO - 1e-3 * BANDWIDTH) / free.value
    rings = bisected(arm, accepted, np.vstack([free.p, sampled_configurations(arm, 5, seed=seed)]), rounds=7)
    assert rings > 1.0
    require("accepted-hold", 1.0 / rings, 0.7, "accepted damping over that at which a loop rings", at_least=True)


def test_the_estimate_is_a_velocity_feedback_too() -> None:
    arm = load("puma560_measured")
    damping, p = own_damping(arm, 50.0), np.zeros(6)
    M = arm.mass_matrix(p)
    for estimate in (arm.inertial_parameters, 3.0 * arm.inertial_parameters):
        share = estimate[0] / arm.inertial_parameters[0]
        wanted = 1e-3 * np.linalg.eigvals(np.linalg.solve(M, np.diag(damping))).real.max() + 8e-3 * share
        assert float(sampling_ratios(arm, p, damping, 1e-3, 8.0, estimate=estimate)) == pytest.approx(wanted, rel=1e-9)
    drives = sampling_ratios(arm, p, damping, 1e-3, 8.0, estimate=-10.0 * arm.inertial_parameters)
    assert np.isinf(drives)


def test_a_workspace_along_the_reference_accepts_more() -> None:
    """A wrist folded straight is light; a reference that keeps away from there may have more damping."""
    arm = load("puma560_measured")
    damping = own_damping(arm, 100.0)
    reference = 0.1 * np.sin(np.linspace(0.0, 6.0, 50))[:, None] + np.array([0.0, -0.6, 0.8, 0.0, 1.2, 0.0])
    along = sampling_ratio(arm, damping, 1e-3, workspace=Workspace.along(arm, reference))
    assert along.value < 0.9 * sampling_ratio(arm, damping, 1e-3).value
    factor = 1.49 / along.value
    model = ReducedModel.full(arm)
    with pytest.raises(GainError):
        SlotineLi(model, 0.1, factor * damping)
    assert SlotineLi(model, 0.1, factor * damping, workspace=Workspace.along(arm, reference)).dof == 6


def test_a_mass_matrix_that_is_indefinite_somewhere_is_found() -> None:
    arm = load("puma560_measured")
    assert worst_conditioned_configuration(arm, arm.inertial_parameters).value > 1e-4
    D = arm.inertial_parameters.copy()
    D[arm.parameter_names.index("link6.I_zz")] = -1e-4
    found = worst_conditioned_configuration(arm, D)
    assert found.value < 0.0
    M = arm.with_parameters(D).mass_matrix(found.p)
    assert np.linalg.eigvalsh(M)[0] < 0.0


def test_a_joint_that_moves_nothing_is_named() -> None:
    arm = load("puma560_measured")
    D = arm.inertial_parameters.copy()
    D[50:] = 0.0
    with pytest.raises(GainError, match=r"joint joint6 moves no inertia: give it a link with inertia, or a rotor"):
        validate_sampling_ratio(arm.with_parameters(D), 1.0, 1e-3)


def test_links_that_no_body_can_be_are_named() -> None:
    arm = load("puma560_measured")
    D = arm.inertial_parameters.copy()
    D[arm.parameter_names.index("link6.I_zz")] = -1.0
    with pytest.raises(GainError, match="inconsistent links: give link6 physically consistent parameters"):
        validate_sampling_ratio(arm.with_parameters(D), 1.0, 1e-3)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_a_period_is_a_positive_time(period: float) -> None:
    with pytest.raises(InputError, match="control period: expected a positive time in s"):
        sampling_ratio(load("puma560_measured"), 1.0, period)


def test_the_slowest_decay_is_below_all_met() -> None:
    arm = load("puma560_measured")
    damping = own_damping(arm, 50.0)
    M = arm.mass_matrix(sampled_configurations(arm, 500, seed=3))
    met = np.linalg.eigvals(np.linalg.solve(M, np.diag(damping))).real.min()
    assert 0.5 * met < slowest_decay(arm, damping) <= met


def test_loops_are_searched_where_they_close() -> None:
    arm = load("semi_direct_drive")
    found = sampling_ratio(arm, 60.0, 1e-3)
    assert found.value >= float(sampling_ratios(arm, everywhere(arm).samples, 60.0, 1e-3).max())


def test_friction_in_joints_that_move_each_other_weighs_as_the_exact_hold_has_it() -> None:
    """A held torque moves M (X/2) coth(X/2), X = T_c M^-1 B, where viscous friction B acts beside it."""
    period, viscous = 0.05, np.array([90.0, 40.0, 90.0, 10.0, 8.0, 9.0])
    arm = load("puma560_geared").with_drives(
        [replace(link.joint.drive, viscous=b) for link, b in zip(load("puma560_geared").links, viscous, strict=True)]
    )
    K, p = np.full(6, 20.0), np.array([0.3, -0.9, 1.2, 0.4, 0.8, -0.5])
    M = arm.mass_matrix(p)
    half = 0.5 * period * np.linalg.solve(M, np.diag(viscous))
    carrying = M @ half @ np.linalg.inv(tanhm(half))
    expected = period * np.linalg.eigvals(np.linalg.solve(carrying, np.diag(K))).real.max()
    assert expected < 0.95 * period * np.linalg.eigvals(np.linalg.solve(M, np.diag(K))).real.max()
    assert sampling_ratios(arm, p, K, period) == pytest.approx(expected, rel=1e-9)
    assert sampling_ratios(arm, np.stack([-p, p]), K, period)[1] == pytest.approx(expected, rel=1e-9)
