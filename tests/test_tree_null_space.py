"""The null space of trees, joint by joint, against singular values, Pinocchio and published counts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio
import pytest
import scipy.linalg
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from nightly import at_night
from random_trees import random_chain, random_inertia, random_pose, random_tree
from robot_files import urdf

from adaptctl.arrays import Array
from adaptctl.description import Description, Joint, JointKind, Link, Pose, with_floating_base
from adaptctl.description.drive import Drive
from adaptctl.description.inertia import inertia_tensor, pseudo_inertia, transformed
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability import (
    Constraints,
    EssentialSpace,
    Priority,
    constrained,
    essential_space,
    fundamental_basis,
)
from adaptctl.identifiability.certificate import Method
from adaptctl.identifiability.inertial_transfers import (
    frame_change_rates,
    frame_changes,
    functionals,
    inertial_transfers,
    twist_entries,
    twist_matrices,
)
from adaptctl.identifiability.tree_null_space import _residual, tree_regrouping

seeds = st.integers(0, 2**32 - 1)
UP, ACROSS = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)


def arm(*axes: tuple[float, float, float], gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)) -> Mechanism:
    """Revolute joints in a row, 0.3 m apart."""
    frames = [Pose(np.eye(3), np.array([0.3 if i else 0.0, 0.0, 0.0])) for i in range(len(axes))]
    links = [
        Link(f"link{i}", i - 1, Joint(f"joint{i}", axis=np.array(axis)), frame, Pose.identity(), np.ones(10))
        for i, (axis, frame) in enumerate(zip(axes, frames, strict=True))
    ]
    return Mechanism(Description("arm", tuple(links), np.array(gravity)))


def varied(seed: int, links: int) -> Mechanism:
    """Any tree or chain; often on a floating body, without mass in some links, with rotors, along or without gravity,
    with axes that are parallel or meet."""
    rng = np.random.default_rng(seed)
    mechanism = (random_tree if rng.random() < 0.5 else random_chain)(seed, links)
    description = mechanism.description
    if rng.random() < 0.4:
        plain = [Pose.identity(), Pose(np.eye(3), np.array([0.3, 0.0, 0.0])), random_pose(rng)]
        parts = [(plain[rng.integers(3)], plain[rng.integers(3)]) for _ in description.links]
        pairs = zip(description.links, parts, strict=True)
        description = replace(
            description, links=tuple(replace(k, parent_to_joint=a, joint_to_link=b) for k, (a, b) in pairs)
        )
    if rng.random() < 0.3:
        kept = [replace(k, massless=True, inertia=np.zeros(10)) if rng.random() < 0.4 else k for k in description.links]
        description = replace(description, links=(*kept[:-1], description.links[-1]))
    if rng.random() < 0.3:
        description = description.with_drives(
            [Drive(rotor_inertia=0.1) if rng.random() < 0.6 else Drive() for _ in description.links]
        )
    gravity = [np.zeros(3), np.array([0.0, 0.0, -9.81]), rng.normal(size=3)][rng.integers(3)]
    if rng.random() < 0.3:
        description = with_floating_base(description, "base", random_inertia(rng))
    return Mechanism(replace(description, gravity=gravity))


def largest_angle(one: Array, other: Array) -> float:
    return float(scipy.linalg.subspace_angles(one, other).max(initial=0.0))


def both(mechanism: Mechanism) -> tuple[EssentialSpace, EssentialSpace]:
    return essential_space(mechanism, method="svd"), essential_space(mechanism, method="transfers")


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 8))
def test_the_null_space_is_that_of_singular_values(seed: int, links: int) -> None:
    by_svd, by_transfers = both(varied(seed, links))
    assert by_transfers.rank == by_svd.rank
    assert largest_angle(by_transfers.null_basis, by_svd.null_basis) < 1e-8
    assert by_transfers.certificate.rank_geometry == by_svd.rank
    assert by_transfers.certificate.null_residual < 1e-12


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 6), st.booleans())
def test_the_same_parameters_are_kept(seed: int, links: int, shuffled: bool) -> None:
    """Walking null vectors' rows by priority, all at once, and link by link from the leaves."""
    mechanism = varied(seed, links)
    by_svd, by_transfers = both(mechanism)
    names = np.array(by_svd.parameter_names)
    order = Priority(tuple(np.random.default_rng(seed).permutation(names).tolist()) if shuffled else ())
    indices = order.indices(by_svd.parameter_names)
    one, other = (space.null_space.regrouping(indices, 1e-6) for space in (by_svd, by_transfers))
    assume(one.condition < 1e4)  # what is nearly dependent may be told otherwise, and is refused
    assert other.kept == one.kept
    K = [found.matrix(space.scales) for found, space in zip((one, other), (by_svd, by_transfers), strict=True)]
    np.testing.assert_allclose(*K, atol=1e-9 * np.abs(K[0]).max())


@pytest.mark.parametrize("seed", [13, 42, 55, 81])
def test_what_nearly_depends_on_each_other_is_seen_when_all_is_looked_at(seed: int) -> None:
    """Of these trees the choices made link by link alone have conditions above 1e4; an exact choice may reach 1e5."""
    _, space = both(varied(seed, 6))
    order = Priority().indices(space.parameter_names)
    assert not tree_regrouping(space.null_space.transfers, order, 1e-3).determined
    basis = fundamental_basis(space)
    assert basis.scaled_condition < 1e5
    states = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, 200, space.mechanism.dof))
    Y = space.mechanism.torque_regressor(*states).reshape(-1, len(space.parameter_names))
    np.testing.assert_allclose(Y[:, basis.columns] @ basis.regrouping, Y, atol=1e-8 * np.abs(Y).max())


@pytest.mark.parametrize(
    ("mechanism", "rank"),
    [
        (arm(*[ACROSS] * 8), 24),
        (arm(*[ACROSS] * 8, gravity=(0.0, -9.81, 0.0)), 22),
        (arm(*[UP] * 5, *[ACROSS] * 3), 34),
        (arm(UP, *[ACROSS] * 7), 50),
    ],
    ids=["planar", "planar, lying", "SCARA and a wrist", "upright"],
)
def test_what_moves_little_before_a_joint_hides_more(mechanism: Mechanism, rank: int) -> None:
    """Eight joints that could move anyhow before the last would have 50, or 52 with gravity across the first."""
    assert essential_space(mechanism, method="transfers").rank == essential_space(mechanism, method="svd").rank == rank


@pytest.mark.parametrize("links", [3, 12, 40])
def test_published_counts(links: int) -> None:
    """Mayeda, Yoshida and Osuka (1990): 7N - 4 with gravity across the first axis, 7N - 6 along it; floating, 10 and 7
    a joint."""
    rng = np.random.default_rng(links)
    chain = [
        replace(link, joint=replace(link.joint, kind=JointKind.REVOLUTE)) for link in random_chain(links, links).links
    ]
    first = chain[0].parent_to_joint.rotation @ chain[0].joint.axis
    for gravity, expected in ((rng.normal(size=3), 7 * links - 4), (9.81 * first, 7 * links - 6)):
        assert (
            essential_space(Mechanism(Description("chain", tuple(chain), gravity)), method="transfers").rank == expected
        )
    floating = with_floating_base(Description("chain", tuple(chain)), "base", np.ones(10))
    assert essential_space(Mechanism(floating), method="transfers").rank == 10 + 7 * links


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize(
    ("name", "floating"),
    [
        at_night(("talos_reduced.urdf", True)),
        ("solo12.urdf", True),
        ("anymal-kinova.urdf", False),
        ("ur5_robot.urdf", False),
    ],
)
def test_real_robots(name: str, floating: bool) -> None:
    by_svd, by_transfers = both(load(urdf(name), floating_base=floating))
    assert by_transfers.rank == by_svd.rank
    assert largest_angle(by_transfers.null_basis, by_svd.null_basis) < 1e-8
    assert by_transfers.certificate.gap > 1e9


@pytest.mark.parametrize("length", [24, at_night(64)])
def test_long_chains_keep_their_torques(length: int) -> None:
    """Pinocchio's torques from the kept columns' share alone, of a tree as long as singular values cannot take."""
    links = [
        Link(f"link{i}", i - 1, Joint(f"joint{i}", axis=np.eye(3)[i % 3]), near, Pose.identity(), random_inertia(rng))
        for rng in [np.random.default_rng(0)]
        for i in range(length)
        for near in [Pose(np.eye(3), rng.uniform(-0.1, 0.1, 3))]
    ]
    mechanism = Mechanism(Description("snake", tuple(links)))
    space = essential_space(mechanism)
    assert space.certificate.rank_geometry == space.rank == 7 * length - 4
    basis = fundamental_basis(space)
    beta = basis.fundamental_parameters(mechanism.inertial_parameters)
    p, v, a = np.random.default_rng(1).normal(size=(3, mechanism.dof))
    model = mechanism.to_pinocchio()
    expected = pinocchio.rnea(model, model.createData(), p, v, a)
    reduced = mechanism.torque_regressor(p, v, a, basis.columns) @ beta
    np.testing.assert_allclose(reduced, expected, atol=1e-10 * np.abs(expected).max())


def test_masses_on_an_axis_belong_to_either_link() -> None:
    """What lies on a freely moved turning joint's axis is unobservable: a mass, a pair, a massless rod."""
    found = inertial_transfers(Mechanism(with_floating_base(arm(ACROSS, UP).description, "base", np.ones(10))))
    for i, axis in ((6, ACROSS), (7, UP)):
        a, e = np.append(axis, 0.0), np.eye(4)[3]
        on_axis = [np.outer(e, e), np.outer(a, e) + np.outer(e, a), np.outer(a, a)]
        for body in found.unobservable[i][:, :10]:
            left = np.linalg.lstsq(np.array([m.ravel() for m in on_axis]).T, pseudo_inertia(body).ravel(), rcond=None)
            assert left[1].item() < 1e-24
        assert len(found.unobservable[i]) == 3 + 1  # and a rotor that is not there


def test_singular_values_are_those_of_energies() -> None:
    one, other = both(random_tree(3, 5))
    np.testing.assert_allclose(other.singular_values, one.singular_values, atol=1e-12 * one.singular_values[0])
    assert largest_angle(one.basis, other.basis) < 1e-8
    assert other.states == one.states


def test_a_twist_between_length_and_round_off_is_refused() -> None:
    """By geometry it counts as none or as one; energies must agree."""
    bent = (0.0, 1.0, 1e-7)
    with pytest.raises(
        RankError, match=r"arm: .* energies \d+, geometry \d+, .*joint0 and joint1 are .* rad from 0 degrees"
    ):
        essential_space(arm(ACROSS, bent, ACROSS), method="transfers", prove=False)
    with pytest.raises(RankError, match="arm: the rank is 17 for the geometry as given, but 9 if"):
        essential_space(arm(ACROSS, bent, ACROSS), method="transfers")


@pytest.mark.parametrize("method", ["svd", "transfers"])
def test_a_certificate_names_the_proof_that_was_asked_for(method: Method) -> None:
    mechanism = arm(UP, ACROSS, ACROSS)
    proved = essential_space(mechanism, method=method, prove=True).certificate
    assert (proved.rank_exact, proved.proof_method) == (proved.rank, "a prime field")
    alone = essential_space(mechanism, method=method, prove=False).certificate
    assert (alone.rank_exact, alone.proof_method) == (None, "")


def test_left_to_itself_it_takes_what_certifies() -> None:
    long = arm(*[ACROSS] * 10)
    assert essential_space(long).certificate.rank_geometry == 30
    assert essential_space(arm(*[ACROSS] * 9)).certificate.rank_geometry is None
    bent = arm(*[ACROSS] * 9, (0.0, 1.0, 1e-9))
    with pytest.raises(RankError):
        essential_space(bent, method="transfers", prove=False)
    assert essential_space(bent, prove=False).certificate.rank_torque is not None


def test_only_trees_have_transfers() -> None:
    with pytest.raises(InputError, match=r"method: transfers are for trees, but .* has loops; use method='svd'"):
        essential_space(load("semi_direct_drive"), method="transfers")
    slim = constrained(arm(UP, ACROSS), Constraints({"link1.mc_y": 0.0}))
    with pytest.raises(InputError, match="arm has constraints on its parameters"):
        essential_space(slim, method="transfers")
    with pytest.raises(InputError, match="method: expected one of automatic, svd, transfers, got 'qr'"):
        essential_space(arm(UP), method="qr")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="tolerance: expected a number between 0 and"):
        fundamental_basis(essential_space(arm(UP), method="transfers"), tolerance=0.0)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_frames_and_functionals(seed: int) -> None:
    """Against the ten in another frame, and against w'Iw/2 + m v.v/2 + v.(w x mc)."""
    rng = np.random.default_rng(seed)
    pose, ten, twist = random_pose(rng), random_inertia(rng), rng.normal(size=6)
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = pose.rotation, pose.translation
    np.testing.assert_allclose(frame_changes(frame) @ ten, transformed(ten, pose), atol=1e-12)
    X, h = twist_matrices(twist), 1e-6
    np.testing.assert_array_equal(twist_entries(X), twist)
    step = scipy.linalg.expm(h * X), scipy.linalg.expm(-h * X)
    slope = (frame_changes(step[0]) - frame_changes(step[1])) / (2 * h)
    np.testing.assert_allclose(frame_change_rates(X), slope, atol=1e-8)
    w, v = twist[:3], twist[3:]
    expected = 0.5 * w @ inertia_tensor(ten) @ w + 0.5 * ten[0] * v @ v + v @ np.cross(w, ten[1:4])
    assert functionals(0.5 * X.T @ X) @ ten == pytest.approx(expected)


def test_bodies_are_ten_numbers_and_a_rotor() -> None:
    """Each joint's observable functionals and unobservable bodies make up a space of eleven dimensions."""
    chain = random_chain(4, 4).with_drives([Drive(rotor_inertia=0.1), Drive(), Drive(), Drive(rotor_inertia=0.2)])
    transfers = inertial_transfers(chain)
    for own, seen, unseen in zip(transfers.own, transfers.observable, transfers.unobservable, strict=True):
        both = np.vstack([seen, unseen])
        np.testing.assert_allclose(both @ both.T, np.eye(11), atol=1e-12)
        assert own.bodies.shape == (11, len(own.indices))
        assert own.bodies[10, -1] == float(len(own.indices) == 11)


def test_the_residual_is_what_unobservable_bodies_change_in_units_of_their_parts() -> None:
    """However small energies are: of two bodies, the second changes those of the second link by a fifth."""
    changes = 1e-3 * np.stack([np.eye(10), np.diag(np.arange(10.0))])
    bodies = np.eye(10)[8:] * [[1.0], [1e-4]]
    found: Any = SimpleNamespace(observable=[np.eye(10)[:8]] * 2, unobservable=[np.zeros((2, 10)), bodies])
    assert _residual(found, changes) == pytest.approx(1.0)
    blind = changes.copy()
    blind[1, 8:] = 0.0
    blind[1, 0, 8] = 2e-3 * 0.8
    assert _residual(found, blind) == pytest.approx(1.6e-3 / 7e-3)
