"""Model reduction: its percentages are those of the energies it leaves out, on states it was not fitted to."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import turn_by_turn

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identifiability import EssentialSpace, States, essential_space, reduce, states_within_limits
from adaptctl.identifiability.energy_matrix import energy_differences


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def states(puma: Mechanism) -> States:
    return states_within_limits(puma, 150, seed=4)


@pytest.fixture(scope="module")
def space(puma: Mechanism, states: States) -> EssentialSpace:
    return essential_space(puma, states=states)


@pytest.mark.parametrize("count", [0, 1, 7, 20, 30, 35, 36])
def test_percent_errors_are_those_of_the_energies(
    puma: Mechanism, space: EssentialSpace, states: States, count: int
) -> None:
    """Equation 23 against equation 22, which takes the energies themselves."""
    H = energy_differences(puma, states)
    e = H @ puma.inertial_parameters
    reduction = reduce(space, puma, components=count, states=states)
    direct = 100.0 * np.linalg.norm(e - H @ reduction.parameters()) / np.linalg.norm(e)
    assert reduction.percent_error == pytest.approx(direct, rel=1e-6, abs=1e-10)
    assert reduction.states == states.origin


@functools.cache
def judged(robot: str) -> tuple[Mechanism, EssentialSpace, Array]:
    """A robot, its space from few states, and the energies of others."""
    arm = load(robot)
    few = 2 * arm.num_energy_parameters + 1
    H = energy_differences(arm, states_within_limits(arm, 10_000, seed=5))
    return arm, essential_space(arm, states=states_within_limits(arm, few)), H


@pytest.mark.parametrize(
    ("robot", "energy_error"),
    turn_by_turn(["puma560_measured", "puma560_arm3", "semi_direct_drive"], [10.0, 5.0, 1.0]),
)
@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_the_stated_error_is_that_of_new_states(robot: str, energy_error: float) -> None:
    arm, space, H = judged(robot)
    reduction = reduce(space, arm, energy_error=energy_error)
    left_out = H @ (reduction.parameters() - arm.inertial_parameters[: H.shape[1]])
    error = 100.0 * np.linalg.norm(left_out) / np.linalg.norm(H @ reduction.parameters(len(reduction.weights)))
    assert reduction.percent_error == pytest.approx(error, rel=0.05)


def test_states_judge_by_their_origin(puma: Mechanism, states: States) -> None:
    """Random ones by others of their kind; of recorded ones, which have none, it is said."""
    random = reduce(essential_space(puma), puma, components=10)
    assert random.states == "20000 other random states over the full circle"
    assert reduce(essential_space(puma, states=states), puma, components=10).states.startswith("20000 other random")
    recorded = essential_space(puma, states=States(states.p, states.v, "a motion"))
    own = reduce(recorded, puma, components=10)
    assert own.states == "a motion, to which the components were fitted"
    assert 1.2 * own.percent_error < random.percent_error


def test_all_components_are_the_essential_parameters(puma: Mechanism, space: EssentialSpace, states: States) -> None:
    reduction = reduce(space, puma, components=36)
    np.testing.assert_allclose(reduction.parameters(), space.project(puma.inertial_parameters), atol=1e-12)
    assert reduction.percent_errors[0] == 100.0
    assert reduction.percent_errors[-1] == 0.0
    assert np.all(np.diff(reduce(space, puma, components=36, states=states).percent_errors) <= 0.0)
    assert np.all(np.diff(np.abs(reduction.weights)) <= 0.0)
    assert sorted(reduction.order) == list(range(36))


@settings(max_examples=8, deadline=None)
@given(st.floats(0.0, 150.0))
def test_the_fewest_components_that_suffice(energy_error: float) -> None:
    puma = load("puma560_measured")
    reduction = reduce(essential_space(puma), puma, energy_error=energy_error)
    assert reduction.percent_error <= energy_error
    assert reduction.num_components == 0 or reduction.percent_errors[reduction.num_components - 1] > energy_error


def test_weights_depend_on_the_motion(puma: Mechanism, space: EssentialSpace) -> None:
    """Moving slowly, gravity's two components carry nearly all the energy."""
    slow = states_within_limits(puma, 150)
    quiet = essential_space(puma, states=States(slow.p, 1e-3 * slow.v, "slow"))
    assert (
        reduce(quiet, puma, energy_error=1.0).num_components < reduce(space, puma, energy_error=1.0).num_components / 3
    )


def test_fewer_components_can_be_asked_for(puma: Mechanism, space: EssentialSpace) -> None:
    reduction = reduce(space, puma.inertial_parameters, energy_error=1.0)
    np.testing.assert_array_equal(reduction.parameters(5), reduction.components[:5].sum(axis=0))
    np.testing.assert_array_equal(reduction.parameters(0), np.zeros(60))
    with pytest.raises(InputError, match=r"components: expected 0\.\.36, got 37"):
        reduction.parameters(37)


def test_bad_input(puma: Mechanism, space: EssentialSpace) -> None:
    with pytest.raises(InputError, match="give either energy_error"):
        reduce(space, puma)
    with pytest.raises(InputError, match="give either energy_error"):
        reduce(space, puma, energy_error=1.0, components=3)
    with pytest.raises(InputError, match=r"components: expected 0\.\.36, got -1"):
        reduce(space, puma, components=-1)
    for bad in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="energy_error: expected a finite number"):
            reduce(space, puma, energy_error=bad)
    with pytest.raises(InputError, match=r"parameters: expected shape \(60,\), got \(36,\)"):
        reduce(space, np.zeros(36), energy_error=1.0)
    with pytest.raises(InputError, match="no energy in any of the states"):
        reduce(space, np.zeros(60), energy_error=1.0)
