"""The lift: rigid bodies with given base parameters, and how far the nearest are where there are none."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adaptctl.arrays import Array
from adaptctl.description.inertia import from_pseudo_inertia, is_physically_consistent, pseudo_inertia
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, MissingExtraError, PhysicalConsistencyWarning
from adaptctl.identifiability import ReducedModel, nearest_consistent


def reduced(mechanism: Mechanism) -> ReducedModel:
    return ReducedModel(mechanism)


@pytest.fixture(scope="module")
def five_bar() -> ReducedModel:
    return reduced(load("semi_direct_drive"))


@pytest.fixture(scope="module")
def measured() -> ReducedModel:
    return reduced(load("puma560_measured"))


def perturbed(parameters: Array, seed: int, size: float) -> Array:
    """Other bodies: every pseudo-inertia G G' becomes G S S' G' with S near 1."""
    rng, out = np.random.default_rng(seed), parameters.copy()
    for i in range(0, len(parameters), 10):
        root = np.linalg.cholesky(pseudo_inertia(parameters[i : i + 10]))
        root = root @ (np.eye(4) + size * rng.uniform(-1.0, 1.0, (4, 4)))
        out[i : i + 10] = from_pseudo_inertia(root @ root.T)
    return out


def divergence(parameters: Array, prior: Array) -> float:
    total = 0.0
    for i in range(0, len(prior), 10):
        ratio = np.linalg.solve(pseudo_inertia(prior[i : i + 10]), pseudo_inertia(parameters[i : i + 10]))
        total += np.trace(ratio) - np.linalg.slogdet(ratio)[1] - 4.0
    return total


def all_consistent(parameters: Array) -> bool:
    return all(is_physically_consistent(ten) for ten in parameters.reshape(-1, 10))


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**31 - 1), size=st.floats(0.01, 0.3))
def test_what_rigid_bodies_have_is_found_again(five_bar: ReducedModel, seed: int, size: float) -> None:
    true = five_bar.mechanism.inertial_parameters
    prior = perturbed(true, seed, size)
    lift = nearest_consistent(five_bar, five_bar.fundamental_parameters, prior)
    assert lift.is_feasible
    assert all_consistent(lift.parameters)
    # The true bodies have these base parameters too, so the nearest are no farther from the prior.
    assert divergence(lift.parameters, prior) <= divergence(true, prior) + 1e-6


def test_the_lift_has_the_same_torques(measured: ReducedModel) -> None:
    mechanism = measured.mechanism
    prior = perturbed(mechanism.inertial_parameters, 0, 0.2)
    lifted = nearest_consistent(measured, measured.fundamental_parameters, prior).parameters
    p, v, a = np.random.default_rng(1).normal(size=(3, 20, 6))
    torque = mechanism.inverse_dynamics(p, v, a)
    again = mechanism.with_parameters(lifted).inverse_dynamics(p, v, a)
    assert np.abs(lifted - mechanism.inertial_parameters).max() > 0.01
    assert np.abs(again - torque).max() < 1e-6 * np.abs(torque).max()


def test_the_prior_itself_is_its_own_lift(five_bar: ReducedModel) -> None:
    own = five_bar.mechanism.inertial_parameters
    lift = nearest_consistent(five_bar, five_bar.fundamental_parameters)
    assert divergence(lift.parameters, own) < 1e-6


def test_the_papers_puma_is_5_9_percent_from_realisable(measured: ReducedModel) -> None:
    with pytest.warns(PhysicalConsistencyWarning):
        paper = reduced(load("puma560"))
    lift = nearest_consistent(paper, paper.fundamental_parameters, measured.mechanism.inertial_parameters)
    assert not lift.is_feasible
    assert lift.distance == pytest.approx(0.059, abs=5e-4)
    assert all_consistent(lift.parameters)
    np.testing.assert_allclose(paper.regrouping @ lift.parameters, lift.fundamental)


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 2**31 - 1), size=st.floats(0.5, 3.0))
def test_bodies_nearest_to_what_none_have_are_consistent(five_bar: ReducedModel, seed: int, size: float) -> None:
    """Clarabel ends without a solution in one of some ten, and outside the cone by its accuracy in others."""
    own = five_bar.fundamental_parameters
    lift = nearest_consistent(five_bar, own * np.random.default_rng(seed).normal(1.0, size, own.shape))
    assert all_consistent(lift.parameters)
    assert lift.distance < 1.1
    assert nearest_consistent(five_bar, lift.fundamental).distance < 1e-5  # some have it, at the cone's edge


def test_a_prior_no_bodies_have_is_refused(measured: ReducedModel) -> None:
    prior = measured.mechanism.inertial_parameters.copy()
    prior[10] = -1.0
    with pytest.raises(InputError, match="the parameters of link2 are not physically consistent"):
        nearest_consistent(measured, measured.fundamental_parameters, prior)
    with pytest.raises(InputError, match=r"base parameters: expected shape \(36,\), got \(35,\)"):
        nearest_consistent(measured, np.zeros(35))


def test_without_the_extra_the_command_is_told(five_bar: ReducedModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'adaptctl\[consistency\]'"):
        nearest_consistent(five_bar, five_bar.fundamental_parameters)
