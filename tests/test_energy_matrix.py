"""Energy differences accumulated as a triangle: the same singular values, and memory that samples do not fill."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism, load
from adaptctl.identifiability import States, essential_space, random_states
from adaptctl.identifiability.energy_matrix import (
    EnergyFactor,
    ScaledRegressor,
    energies,
    energy_blocks,
    energy_differences,
    torque_rows,
)
from adaptctl.identifiability.factorisation import singular_values, triangle_by_joint
from adaptctl.identifiability.sampling import random_halves


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.mark.parametrize("samples", [1, 5, 50])
def test_the_triangle_by_joint_has_the_squares_of_all_rows(samples: int) -> None:
    rows = np.random.default_rng(0).normal(size=(samples, 3, 9)) * np.kron(np.triu(np.ones((3, 3))), np.ones(3))
    R, rows = triangle_by_joint(rows), rows.reshape(-1, 9)
    assert R.shape == (min(9, 3 * samples), 9)
    np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-12 * samples)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 40), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
def test_any_blocks_give_the_triangle_of_the_whole(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    E = rng.normal(size=(sum(sizes) + 1, 12)) * np.logspace(0, -9, 12)
    factor = EnergyFactor.of(np.split(E, np.cumsum([1, *sizes])[:-1]))
    H = np.diff(E, axis=0)
    expected = singular_values(H)
    np.testing.assert_allclose(singular_values(factor.triangle), expected, rtol=0, atol=1e-14 * expected[0])
    # Column by column it is as accurate as the columns are large, so that it may be scaled afterwards.
    scales = np.logspace(0, 9, 12)
    found, wanted = singular_values(factor.triangle * scales), singular_values(H * scales)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * wanted[0])
    np.testing.assert_allclose(factor.square_sums, np.square(E).sum(axis=0), rtol=1e-13)


def test_many_states_give_the_singular_values_of_the_whole(puma: Mechanism) -> None:
    """6,050 states are six blocks."""
    states = random_states(puma, 6050, np.random.default_rng(0))
    found = essential_space(puma, states=states).singular_values
    expected = np.linalg.svd(energy_differences(puma, states), compute_uv=False)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * expected[0])


def peak(mechanism: Mechanism, samples: int) -> int:
    """Bytes at most allocated while the energies of that many random states are factored."""
    tracemalloc.start()
    try:
        some, _ = random_halves(mechanism, samples, np.random.default_rng(0))
        factor = EnergyFactor.of(energy_blocks(mechanism, some))
        assert ScaledRegressor.of_energies(mechanism, factor).rank == 36
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_does_not_grow_with_the_samples(puma: Mechanism) -> None:
    some, many = peak(puma, 2_048), peak(puma, 102_400)
    assert many < 1.2 * some
    assert many < 102_400 * 60 * 8 / 5


def test_a_large_number_of_samples_is_only_slow(puma: Mechanism) -> None:
    space = essential_space(puma, samples=20_000)
    assert space.rank == 36
    assert space.certificate.gap > 1e12
    assert space.certificate.samples == 20_000


@pytest.mark.parametrize(("samples", "most"), [(2, 5), (5, 5), (6, 5), (7, 5), (11, 5), (12, 5)])
def test_states_in_parts(samples: int, most: int) -> None:
    p: Array = np.arange(2.0 * samples).reshape(samples, 2)
    parts = list(States(p, -p, "here").split(most))
    np.testing.assert_array_equal(np.concatenate([part.p for part in parts]), p)
    np.testing.assert_array_equal(np.concatenate([part.v for part in parts]), -p)
    assert all(2 <= len(part) <= most + 1 and part.origin == "here" for part in parts)


def test_halves_are_drawn_one_after_the_other(puma: Mechanism) -> None:
    """Few are the halves of one draw; many come as they are used, the same for a seed."""
    first, second = (list(half) for half in random_halves(puma, 50, np.random.default_rng(0)))
    both = random_states(puma, 100, np.random.default_rng(0))
    np.testing.assert_array_equal(np.vstack([first[0].p, second[0].p]), both.p)
    once, again = (
        [energies(puma, s) for half in random_halves(puma, 5000, np.random.default_rng(1)) for s in half] for _ in "12"
    )
    assert sum(map(len, once)) == 10_000
    np.testing.assert_array_equal(np.vstack(once), np.vstack(again))


def test_energies_have_zeros_of_one_sign(puma: Mechanism) -> None:
    E = energies(puma, random_states(puma, 3, np.random.default_rng(0)))
    zeros = E[E == 0.0]
    assert len(zeros)
    assert not np.signbit(zeros).any()


@pytest.mark.parametrize("links", [1, 2, 3])
def test_torques_are_at_least_twice_as_many_as_parameters(links: int) -> None:
    mechanism = random_chain(0, links)
    rows = torque_rows(mechanism, np.random.default_rng(0))
    assert rows.shape[1] == 10 * links
    assert 20 * links <= len(rows) < 20 * links + mechanism.dof
