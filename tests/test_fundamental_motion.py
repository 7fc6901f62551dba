"""The motion of a plant on its fundamental parameters, links' frames at their joints, is the same."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import mostly_at_night
from random_loops import RECIPES, random_loop, world_poses
from random_trees import random_chain, random_tree

from adaptctl.compilation.routine import trace
from adaptctl.description.drive import Drive
from adaptctl.description.transforms import joint_frame_parameters, with_joint_frames
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.equations import Equations
from adaptctl.errors import RankError
from adaptctl.identifiability import essential_space, fundamental_basis
from adaptctl.identifiability.constraints import Constraints, Relation, constrained
from adaptctl.scalars import Column, column
from adaptctl.simulation import period as module
from adaptctl.simulation.period import MAX_FUNDAMENTAL_LINKS, fundamental_motion

ROBOTS = (
    "puma560_friction",
    "puma560_geared",
    "puma560_measured",
    "semi_direct_drive",
    "semi_direct_drive_parallelogram",
)

QUICK = ["five-bar", "spatial point", "gears in a loop"]


def validate_the_same_motion(mechanism: Mechanism, q: np.ndarray, seed: int) -> None:
    """Accelerations, whatever the true parameters are."""
    fewer, rng, r = fundamental_motion(mechanism), np.random.default_rng(seed), mechanism.dof
    assert fewer is not None
    own = mechanism.inertial_parameters
    true = column(own * rng.uniform(0.9, 1.1) + 1e-3 * np.abs(own).max() * rng.normal(size=own.size))
    given = column(q), column(rng.normal(size=r)), column(rng.normal(size=r))
    expected = np.array([*mechanism.equations.forward_dynamics(*given, true)])
    found = np.array([*fewer.equations.forward_dynamics(*given, fewer.parameters(true))])
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 7))
def test_trees_move_alike(seed: int, links: int) -> None:
    mechanism = random_tree(seed, links)
    validate_the_same_motion(mechanism, np.random.default_rng(seed).uniform(-2.0, 2.0, links), seed)


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_move_alike(name: str) -> None:
    mechanism = load(name)
    q = mechanism.configuration(mechanism.neutral_configuration)
    validate_the_same_motion(mechanism, q, 0)


@pytest.mark.parametrize(("kind", "seed"), mostly_at_night(product(RECIPES, range(2)), *((kind, 0) for kind in QUICK)))
def test_loops_move_alike(kind: str, seed: int) -> None:
    mechanism, q = random_loop(seed, RECIPES[kind])
    if fundamental_motion(mechanism) is None:
        with pytest.raises(RankError):
            fundamental_basis(essential_space(Mechanism(with_joint_frames(mechanism.description)), as_written=True))
    else:
        validate_the_same_motion(mechanism, q, seed)


@given(st.integers(0, 10_000), st.integers(1, 6))
def test_frames_at_joints_are_those_that_the_joints_move(seed: int, links: int) -> None:
    """Torques of the same true parameters, and places of the links, whatever the frames."""
    mechanism = random_tree(seed, links)
    description = mechanism.description
    moved = Mechanism(with_joint_frames(description))
    np.testing.assert_allclose(
        moved.inertial_parameters, joint_frame_parameters(description) @ mechanism.inertial_parameters, atol=1e-12
    )
    p, v, a = np.random.default_rng(seed).normal(size=(3, links))
    expected = mechanism.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(moved.inverse_dynamics(p, v, a), expected, rtol=1e-9, atol=1e-9)
    before, after = world_poses(description, p), world_poses(moved.description, p)
    for link in description.links:
        there = after[link.name] @ link.joint_to_link
        np.testing.assert_allclose(there.translation, before[link.name].translation, atol=1e-12)
        np.testing.assert_allclose(there.rotation, before[link.name].rotation, atol=1e-12)


def test_drives_keep_their_parameters() -> None:
    tree = random_chain(0, 3).description
    links = [replace(x, joint=replace(x.joint, drive=Drive(rotor_inertia=0.1, viscous=0.2))) for x in tree.links]
    mechanism = Mechanism(replace(tree, links=tuple(links)))
    matrix = joint_frame_parameters(mechanism.description)
    np.testing.assert_array_equal(matrix[30:, 30:], np.eye(len(matrix) - 30))
    validate_the_same_motion(mechanism, np.full(3, 0.4), 1)


def test_it_takes_fewer_operations() -> None:
    puma = load("puma560_measured")
    fewer = fundamental_motion(puma)
    assert fewer is not None
    assert sum(map(bool, fewer.sums)) == 36
    sizes = {"p": 6, "v": 6, "torque": 6}

    def flops(equations: Equations, parameters: int) -> int:
        return trace(equations.forward_dynamics, {**sizes, "parameters": parameters}).operations.flops

    def regrouped(p, v, torque, parameters):  # type: ignore[no-untyped-def]
        spread = Column(x if terms else 0.0 for x, terms in zip(parameters, fewer.sums, strict=True))
        return fewer.equations.forward_dynamics(p, v, torque, spread)

    own = flops(puma.equations, 60)
    assert trace(regrouped, {**sizes, "parameters": 60}).operations.flops < 0.85 * own


def test_long_and_constrained_ones_and_uncertain_ranks_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    assert fundamental_motion(random_chain(0, MAX_FUNDAMENTAL_LINKS + 1)) is None
    arm = load("puma560_measured")
    assert fundamental_motion(constrained(arm, Constraints(relations=(Relation({"link6.m": 1.0}, 0.1),)))) is None

    def uncertain(*_: object, **__: object) -> None:
        raise RankError("no certain rank")

    monkeypatch.setattr(module, "essential_space", uncertain)
    assert fundamental_motion(arm) is None
