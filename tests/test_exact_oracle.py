"""Ranks and kept parameters of random trees, couplings, shared shafts and loops, against the exact oracle."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from nightly import at_night

from adaptctl.identifiability import Priority, essential_space, fundamental_basis
from benchmarks.rank_gears import draw_gears, draw_shafts
from benchmarks.rank_oracle import Case, independent, tree, twist
from benchmarks.ranks import drawn as random_case
from benchmarks.ranks import judged


def drawn(seed: int, followers: bool) -> Case:
    """A tree with rotors, on shafts of their own or shared, and perhaps with joints that follow others."""
    rng = np.random.default_rng(seed)
    case = tree(rng, int(rng.integers(2, 6)), True)
    case.shafts = draw_shafts(rng, len(case.links))
    if followers:
        case.gears = draw_gears(rng, [link.turns for link in case.links], lambda: twist(rng))
    return case


@pytest.mark.parametrize("followers", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_shared_shafts_and_couplings(seed: int, followers: bool) -> None:
    """Rank, and the parameters that any order keeps."""
    case = drawn(seed, followers)
    H, mechanism = case.differences(seed), case.mechanism()
    order = np.random.default_rng(seed).permutation(H.shape[1]).tolist()
    kept = tuple(sorted(independent(H, order[::-1])))
    space = essential_space(mechanism, method="svd")
    assert space.rank == space.certificate.rank_exact == len(kept)
    basis = fundamental_basis(space, Priority(tuple(space.parameter_names[j] for j in order)))
    assert basis.columns == kept or basis.kept_despite_priority


# Frames at right angles that the proof's reading loses, and an order that leaves a condition number of 2.3e5.
@pytest.mark.parametrize("seed", [200231, 200548])
def test_orders_that_floats_can_follow_are_followed_without_a_word(seed: int) -> None:
    case = random_case(seed)
    H = case.differences(seed)
    order = np.random.default_rng([seed, 11]).permutation(H.shape[1]).tolist()
    space = essential_space(case.mechanism(), method="svd")
    basis = fundamental_basis(space, Priority(tuple(space.parameter_names[j] for j in order)))
    assert basis.columns == tuple(sorted(independent(H, order[::-1])))
    assert basis.kept_despite_priority == ()


def test_energies_whose_singular_vectors_divide_and_conquer_does_not_find() -> None:
    case = random_case(70704)
    space = essential_space(case.mechanism(), method="svd")
    assert space.rank == len(independent(case.differences(0), range(len(space.parameter_names))))


@pytest.mark.parametrize("first", [at_night(n) for n in range(0, 1000, 100)])
def test_a_hundred_random_mechanisms(first: int) -> None:
    """None wrong, and of those that are not nearly special one in fifty refused at most."""
    counted = Counter(what for seed in range(first, first + 100) for what in judged(seed))
    wrong = ("svd WRONG", "transfers WRONG", "ANOTHER", "NOTHING")
    assert not [what for what in counted if what.endswith(wrong)]
    refused = sum(n for what, n in counted.items() if what.endswith(" refused") and not what.startswith("near"))
    assert refused <= 2
