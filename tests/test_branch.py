"""Sampling mechanisms with loops: on the reference's branch, within limits and conditions, away from singularity."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from nightly import at_night, mostly_at_night
from random_loops import RECIPES, gaps, random_loop

from adaptctl.description import Condition, Description, Limits
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability import essential_space, random_states, states_within_limits
from adaptctl.identifiability.sampling import MIN_SINGULAR_VALUE_SHARE, _within_conditions
from adaptctl.scalars import Column

WIDE = dict.fromkeys(RECIPES, 1) | {
    "gears in a loop": 2,
    "spatial hinge": 0,
    "spatial point": 2,
    "spatial weld": 9,
    "two spatial loops": 5,
}
"""Seeds of loops that move far enough for each parameter to tell in energies."""
QUICK = ["gears in a loop", "planar weld", "spatial point"]


@pytest.mark.parametrize("name", mostly_at_night(sorted(RECIPES), *QUICK))
def test_ranks_of_random_loops_are_certified_and_do_not_depend_on_the_samples(name: str) -> None:
    mechanism, _ = random_loop(WIDE[name], RECIPES[name])
    one, other = (essential_space(mechanism, seed=seed) for seed in (0, 7))
    assert one.rank == other.rank
    assert min(one.certificate.gap, other.certificate.gap) > 1e9


def test_a_loop_that_hardly_moves_has_no_certified_rank() -> None:
    """Its parameters tell less and less, down to round-off, with no gap between those that do and those that do not."""
    mechanism, _ = random_loop(1, RECIPES["spatial hinge"])
    told = r"spatial: the rank cannot be certified: the gap at .*; the loops turn joint3 by 0\.\d+ rad, joint6 by"
    with pytest.raises(RankError, match=told):
        essential_space(mechanism)


@pytest.mark.parametrize("name", mostly_at_night(sorted(RECIPES), *QUICK))
def test_random_states_are_regular_and_spread(name: str) -> None:
    mechanism, q = random_loop(2, RECIPES[name])
    states = random_states(mechanism, 200, np.random.default_rng(0))
    assert mechanism.continuation is not None
    reached = mechanism.configuration(states.p)
    assert mechanism.continuation.regularity(reached).min() > 0.9 * MIN_SINGULAR_VALUE_SHARE
    spread = states.p - q[list(mechanism.description.primary)]
    assert (np.abs(spread).max(axis=0) > 0.02).all()
    assert states.origin == "random states on the branch of the reference"


@pytest.mark.parametrize("proven", [False, at_night(True)])
def test_every_random_state_is_reached_though_loops_turn_fast_on_the_way(proven: bool) -> None:
    """Dependent joints run ten times as fast as primary ones: from 0.05 rad away Newton's steps leave 4e-8 open."""
    mechanism, _ = random_loop(9, RECIPES["two spatial loops"])
    states = random_states(mechanism, 400, np.random.default_rng(0))
    assert np.abs(gaps(mechanism.description, mechanism.configuration(states.p)[127])).max() < 1e-12
    assert not proven or essential_space(mechanism, prove=True).certificate.rank_exact is not None


def test_joints_outside_loops_go_all_around_and_those_in_loops_keep_their_condition() -> None:
    arm = load("semi_direct_drive")
    p = random_states(arm, 500, np.random.default_rng(0)).p
    assert p[:, 0].min() < -3.0
    assert p[:, 0].max() > 3.0
    assert arm.description.within_conditions(p).all()
    assert p[:, 1].min() >= -3.927
    assert p[:, 1].max() <= 0.785
    assert np.ptp(p[:, 1] - p[:, 2]) > 1.5


def test_ways_are_gone_to_the_last_point_that_keeps_a_condition() -> None:
    """Of 65 points on each way: all before it keep it, and the next one breaks it, unless it is the end."""
    mechanism = load("semi_direct_drive")
    wanted = mechanism.neutral_configuration + np.random.default_rng(0).uniform(-3.0, 3.0, (200, mechanism.dof))
    found = _within_conditions(mechanism, mechanism.neutral_configuration, wanted)
    shares = np.linspace(0.0, 1.0, 65)
    for share, to in zip(found, wanted, strict=True):
        kept = [
            bool(
                mechanism.description.within_conditions(
                    mechanism.neutral_configuration + x * (to - mechanism.neutral_configuration)
                )
            )
            for x in shares
        ]
        first = kept.index(False) if False in kept else len(kept)
        assert share == shares[first - 1]
    assert found.min() < 0.5
    assert found.max() == 1.0


def test_a_reference_that_breaks_a_condition_is_refused() -> None:
    arm = load("semi_direct_drive").description
    assert arm.loops is not None
    never = Condition("never", {"joint1": 1.0}, 1.0, 2.0)
    wrong = Mechanism(replace(arm, loops=replace(arm.loops, conditions=(never,))))
    with pytest.raises(InputError, match=r"the reference configuration, p = \[0\.0, -1\.57.*\], violates a condition"):
        random_states(wrong, 10, np.random.default_rng(0))


def test_states_within_limits_keep_the_limits_of_joints_that_follow() -> None:
    arm = load("semi_direct_drive").description
    follower = replace(arm.links[3].joint, limits=Limits(1.0, 1.6))
    links = tuple(replace(x, joint=follower) if x.name == "link4" else x for x in arm.links)
    bounded = Mechanism(replace(arm, links=links))
    q = bounded.configuration(states_within_limits(bounded, 100).p)
    assert q[:, 3].min() >= 1.0
    assert q[:, 3].max() <= 1.6
    free = Mechanism(arm).configuration(states_within_limits(Mechanism(arm), 100).p)
    assert np.ptp(free[:, 3]) > 1.0


def test_limits_that_nothing_can_keep_are_refused() -> None:
    arm = load("semi_direct_drive").description
    follower = replace(arm.links[3].joint, limits=Limits(50.0, 51.0))
    links = tuple(replace(x, joint=follower) if x.name == "link4" else x for x in arm.links)
    with pytest.raises(InputError, match=r"semi_direct_drive: of \d+ positions within the limits .* only 0"):
        states_within_limits(Mechanism(replace(arm, links=links)), 2)


def test_each_sample_is_followed_as_if_it_were_alone() -> None:
    """In as many steps as its own way needs, whatever the others need."""
    arm = load("semi_direct_drive")
    assert arm.continuation is not None
    p = random_states(arm, 30, np.random.default_rng(0)).p
    together = arm.configuration(p)
    np.testing.assert_allclose(together, [arm.configuration(x) for x in p], atol=1e-13)
    np.testing.assert_allclose(arm.configuration(p.reshape(5, 6, 3)), together.reshape(5, 6, -1), atol=1e-13)
    assert arm.configuration(p[:0]).shape == (0, 5)


@pytest.mark.parametrize(("name", "seed"), [("four-bar", 2), ("planar weld", 2), ("two spatial loops", 5)])
def test_each_way_is_gone_as_far_as_if_it_were_alone(name: str, seed: int) -> None:
    mechanism, _ = random_loop(seed, RECIPES[name])
    assert mechanism.continuation is not None
    start = mechanism.continuation.reference[mechanism.continuation.primary]
    p = start + np.random.default_rng(0).uniform(-4.0, 4.0, (12, mechanism.dof))
    progress = mechanism.continuation.progress(p)
    np.testing.assert_array_equal(progress, [mechanism.continuation.progress(x[None])[0] for x in p])
    assert 0.0 < progress.min() < 1.0 == progress.max()


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_a_way_to_no_position_is_not_gone(wrong: float) -> None:
    """Warnings are errors here."""
    arm = load("semi_direct_drive")
    assert arm.continuation is not None
    p = np.tile(arm.neutral_configuration, (3, 1))
    p[1, 1] = wrong
    assert arm.continuation.progress(p).tolist() == [1.0, 0.0, 1.0]
    assert arm.continuation.reachable(p).tolist() == [True, False, True]


@pytest.mark.parametrize("name", ["four-bar", "planar weld", "spatial point"])
def test_a_loop_that_is_open_is_off_the_branch(name: str) -> None:
    """Open by more than 1e-9 m or rad is lost, however regular; round-off is not."""
    mechanism, _ = random_loop(1, RECIPES[name])
    continuation = mechanism.continuation
    assert continuation is not None
    dependent = list(continuation.equations.closing.dependent)
    block = np.array([c.of for c in continuation.equations.dependent_block(Column(continuation.reference.tolist()))])
    way = np.linalg.solve(block.T, np.eye(len(dependent))[0])
    for gap, open_loop in ((1e-12, False), (2e-9, True), (1e-7, True), (1e-5, True), (1e-3, True)):
        q = continuation.reference.copy()
        q[dependent] += gap * way
        residual = continuation.equations.residual(Column(q.tolist()))
        assert max(map(abs, residual)) == pytest.approx(gap, rel=0.5, abs=1e-13)
        assert bool(continuation.regularity(q) == 0.0) is open_loop
        assert bool(continuation.surely_regular(Column(q.tolist()))) is not open_loop


@pytest.mark.parametrize("name", ["four-bar", "spatial point"])
def test_the_regularity_is_a_ratio_of_smallest_singular_values(name: str) -> None:
    """Against NumPy's of the dependent block at the reference and a step along the branch, of two joints and more."""
    mechanism, _ = random_loop(1, RECIPES[name])
    continuation = mechanism.continuation
    assert continuation is not None
    start = continuation.reference[continuation.primary]
    q = continuation.follow(start + 0.02)
    blocks = (continuation.equations.dependent_block(Column(at.tolist())) for at in (q, continuation.reference))
    here, there = (np.linalg.svd(np.array([c.of for c in block]), compute_uv=False)[-1] for block in blocks)
    assert continuation.regularity(q) == pytest.approx(here / there, rel=1e-9)
    assert continuation.regularity(np.stack([q, continuation.reference])) == pytest.approx(
        [here / there, 1.0], rel=1e-9
    )


def test_a_condition_holds_strictly_within_its_bounds() -> None:
    condition = SimpleNamespace(weights={"a": 1.0, "b": -1.0}, lower=0.0, upper=1.0)
    arm: Any = SimpleNamespace(
        loops=SimpleNamespace(conditions=[condition]), joint_names=("a", "c", "b"), primary=(0, 2)
    )
    p = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.5, 1.0]])
    assert Description.within_conditions(arm, p).tolist() == [False, True, False, True]
