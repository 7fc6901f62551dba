"""The essential space: what it leaves out changes no torque, what it keeps is needed, and how its rank is certified."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain, random_tree
from robot_files import urdf

from adaptctl.arrays import Array
from adaptctl.description import Description, Joint, JointKind, Limits, Link, Pose
from adaptctl.description.inertia import transformed
from adaptctl.description.pose import rotation_about
from adaptctl.description.right_angles import near_right_angles, snapped
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, NonFiniteError, RankError
from adaptctl.identifiability import (
    Certificate,
    Constraints,
    EssentialSpace,
    ReducedModel,
    ResidualSingularValue,
    States,
    constrained,
    essential_space,
    fundamental_basis,
    random_states,
    states_within_limits,
)
from adaptctl.identifiability.energy_matrix import NumericalRank, energy_differences
from adaptctl.identifiability.essential_space import _sample_count
from adaptctl.identifiability.factorisation import singular_values
from adaptctl.identifiability.sampling import characteristic_length

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def space(puma: Mechanism) -> EssentialSpace:
    return essential_space(puma)


def pinocchio_regressor(mechanism: Mechanism, samples: int, seed: int) -> Array:
    """Pinocchio's torque regressor (samples r, P), on parameters in our link frames instead of its joint frames."""
    model = mechanism.to_pinocchio()
    data = model.createData()
    p, v, a = np.random.default_rng(seed).normal(size=(3, samples, mechanism.dof))
    Y = np.vstack([pinocchio.computeJointTorqueRegressor(model, data, *x).copy() for x in zip(p, v, a, strict=True)])
    to_joint = [np.column_stack([transformed(e, link.joint_to_link) for e in np.eye(10)]) for link in mechanism.links]
    blocks = Y.reshape(len(Y), -1, 10)
    return np.einsum("tij,ijk->tik", blocks, np.array(to_joint)).reshape(len(Y), -1)


def numerical_rank(matrix: Array) -> int:
    """By another way than ours: columns normalised, and a fixed threshold."""
    norms = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.maximum(norms, 1e-6 * norms.max())
    return int(np.linalg.matrix_rank(scaled, tol=1e-8 * np.linalg.norm(scaled, 2)))


def resized(mechanism: Mechanism, factor: float) -> Mechanism:
    """The same mechanism with its lengths in another unit."""
    links = tuple(
        replace(
            link,
            parent_to_joint=Pose(link.parent_to_joint.rotation, factor * link.parent_to_joint.translation),
            joint_to_link=Pose(link.joint_to_link.rotation, factor * link.joint_to_link.translation),
        )
        for link in mechanism.links
    )
    return Mechanism(replace(mechanism.description, links=links))


def planar(twist: float, links: int = 3) -> Mechanism:
    """Revolute joints in a row, each axis off the one before by a twist; gravity across."""
    chain = [
        Link(
            f"link{i}",
            i - 2,
            Joint(f"joint{i}"),
            Pose(rotation_about((1, 0, 0), twist if i > 1 else 0.0), np.array([0.3 if i > 1 else 0.0, 0.0, 0.0])),
            Pose.identity(),
            np.ones(10),
        )
        for i in range(1, links + 1)
    ]
    return Mechanism(Description("planar", tuple(chain), np.array([0.0, -9.81, 0.0])))


def single(kind: JointKind, axis: tuple[float, float, float], gravity: tuple[float, float, float]) -> Mechanism:
    link = Link("body", -1, Joint("joint", kind, np.array(axis)), Pose.identity(), Pose.identity(), np.ones(10))
    return Mechanism(Description("one link", (link,), np.array(gravity)))


@pytest.mark.parametrize("prove", [True, False])
@pytest.mark.parametrize("method", ["svd", "transfers"])
@pytest.mark.parametrize(
    ("roll", "offset", "said"),
    [
        (1.57079632679, 0.3, ("joint0 and joint1 are 4.9e-12 rad from 90 degrees",)),
        (0.0, 2e-12, ("joint1 is only 2.0e-12 m from the axis of joint0",)),
        (0.0, 0.3, ()),
    ],
)
def test_certificates_say_what_was_taken_as_exact(
    prove: bool, method: Any, roll: float, offset: float, said: tuple[str, ...]
) -> None:
    near = Pose(rotation_about(np.array([1.0, 0.0, 0.0]), roll), np.array([offset, 0.0, 0.0]))
    first, last = (
        Link(f"link{i}", i - 1, Joint(f"joint{i}"), pose, Pose(np.eye(3), np.array([float(i), 0.0, 0.0])))
        for i, pose in enumerate((Pose.identity(), near))
    )
    arm = Mechanism(Description("rounded", (first, last)))
    assert essential_space(arm, method=method, prove=prove).certificate.taken_as_exact == said


def test_an_arm_without_any_inertia_is_refused() -> None:
    links = tuple(
        Link(f"link{i}", i - 1, Joint(f"joint{i}"), Pose.identity(), Pose.identity(), massless=True) for i in range(2)
    )
    with pytest.raises(InputError, match="bare: no link has inertia: all are massless"):
        essential_space(Mechanism(Description("bare", links)))


def test_the_parts_fit_together(puma: Mechanism, space: EssentialSpace) -> None:
    V = np.hstack([space.basis, space.null_basis])
    np.testing.assert_allclose(V.T @ V, np.eye(60), atol=1e-13)
    H = energy_differences(puma, random_states(puma, 121, np.random.default_rng(1)))
    assert np.abs(H @ space.null_basis).max() < 1e-13 * np.abs(H).max()
    assert np.linalg.matrix_rank(H @ space.basis) == space.rank == 36
    assert space.singular_values[35] / space.singular_values[36] > 1e12
    scaled = space.scaled_null_basis.T @ space.scaled_null_basis
    np.testing.assert_allclose(scaled, np.eye(24), atol=1e-13)


def test_singular_values_and_basis_are_those_of_the_given_states(puma: Mechanism) -> None:
    states = states_within_limits(puma, 101, seed=3)
    space = essential_space(puma, states=states)
    H = energy_differences(puma, states)
    expected = np.linalg.svd(H, compute_uv=False)
    np.testing.assert_allclose(space.singular_values, expected, rtol=0, atol=1e-14 * expected[0])
    image = H @ space.basis
    np.testing.assert_allclose(image.T @ image, np.diag(space.singular_values[:36] ** 2), atol=1e-12 * (H**2).sum())
    assert np.abs(H @ space.null_basis).max() < 1e-13 * np.abs(H).max()
    assert space.states == "101 random states within the joint limits, seed 3"


def test_the_rank_does_not_depend_on_the_given_states(puma: Mechanism, space: EssentialSpace) -> None:
    """One joint moving shows little; the mechanism's own rank and null space stay."""
    few = States(np.zeros((20, 6)), np.outer(np.linspace(-1, 1, 20), np.eye(6)[0]), "one joint")
    narrow = essential_space(puma, states=few)
    assert narrow.rank == 36
    np.testing.assert_array_equal(narrow.null_basis, space.null_basis)
    assert np.count_nonzero(narrow.singular_values > 1e-12 * narrow.singular_values[0]) == 1
    np.testing.assert_allclose(narrow.basis.T @ narrow.basis, np.eye(36), atol=1e-13)


def test_projection_keeps_torques_and_is_the_shortest(puma: Mechanism, space: EssentialSpace) -> None:
    D = puma.inertial_parameters
    essential = space.project(D)
    np.testing.assert_allclose(space.project(essential), essential, atol=1e-13)
    p, v, a = np.random.default_rng(2).normal(size=(3, 200, 6))
    torque = puma.inverse_dynamics(p, v, a)
    change = puma.with_parameters(essential).inverse_dynamics(p, v, a) - torque
    assert np.abs(change).max() < 1e-12 * np.abs(torque).max()
    assert np.linalg.norm(essential) < np.linalg.norm(D)
    np.testing.assert_allclose(space.project(np.stack([D, 2 * D])), np.stack([essential, 2 * essential]), atol=1e-12)


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize(("file", "rank"), [("ur5_robot.urdf", 36), ("panda.urdf", 51), ("talos_reduced.urdf", 206)])
def test_real_robots_against_pinocchios_regressor(file: str, rank: int) -> None:
    mechanism = Mechanism.from_pinocchio(pinocchio.buildModelFromUrdf(str(urdf(file))))
    space = essential_space(mechanism)
    assert space.rank == rank
    assert space.certificate.gap > 3e9
    assert space.certificate.null_residual < 1e-10
    Y = pinocchio_regressor(mechanism, 80, seed=5)
    assert numerical_rank(Y) == rank
    assert np.abs(Y @ space.null_basis).max() < 1e-10 * np.abs(Y).max()


@settings(max_examples=25, deadline=None)
@given(seeds, st.integers(1, 7), st.booleans())
def test_every_tree_against_pinocchios_regressor(seed: int, links: int, branched: bool) -> None:
    mechanism = (random_tree if branched else random_chain)(seed, links)
    space = essential_space(mechanism)
    Y = pinocchio_regressor(mechanism, 60, seed)
    assert space.rank == numerical_rank(Y)
    assert np.abs(Y @ space.null_basis).max() < 1e-10 * np.abs(Y).max()
    assert space.certificate.null_residual < 1e-12


@pytest.mark.parametrize("unit", [1e3, 1e-3, 1e-6])
def test_units_of_length_change_nothing(puma: Mechanism, space: EssentialSpace, unit: float) -> None:
    """Lengths of micrometres or kilometres spread the unscaled singular values over many decades."""
    other = essential_space(resized(puma, unit))
    assert other.rank == 36
    assert other.certificate.gap == pytest.approx(space.certificate.gap, rel=1e-6)
    assert other.certificate.null_residual < 1e-14
    assert fundamental_basis(other).columns == fundamental_basis(space).columns


@pytest.mark.parametrize(
    ("kind", "axis", "gravity", "rank"),
    [
        (JointKind.REVOLUTE, (0, 1, 0), (0, 0, -9.81), 3),
        (JointKind.CONTINUOUS, (0, 0, 1), (0, 0, -9.81), 1),
        (JointKind.REVOLUTE, (0, 1, 0), (0, 0, 0), 1),
        (JointKind.PRISMATIC, (0, 0, 1), (0, 0, -9.81), 1),
    ],
)
def test_one_link(kind: JointKind, axis: tuple[float, ...], gravity: tuple[float, ...], rank: int) -> None:
    """A pendulum has two first moments and an inertia; without gravity about its axis only the inertia."""
    space = essential_space(single(kind, axis, gravity))  # type: ignore[arg-type]
    assert space.rank == rank
    assert space.null_basis.shape == (10, 10 - rank)


def test_planar_arms() -> None:
    """Two first moments and an inertia a link; each mass is carried by the first moment before it."""
    for links in (1, 2, 3, 5):
        mechanism = planar(0.0, links)
        assert essential_space(mechanism).rank == numerical_rank(pinocchio_regressor(mechanism, 60, 0)) == 3 * links


def test_seeds_choose_samples_and_nothing_else(puma: Mechanism, space: EssentialSpace) -> None:
    again, other = essential_space(puma), essential_space(puma, seed=7)
    np.testing.assert_array_equal(again.basis, space.basis)
    assert not np.array_equal(other.singular_values, space.singular_values)
    assert other.rank == space.rank
    projections = [x.null_basis @ x.null_basis.T for x in (space, other)]
    np.testing.assert_allclose(*projections, atol=1e-12)
    assert "seed 7" in other.states


def test_what_is_found_cannot_be_written(space: EssentialSpace) -> None:
    for array in (space.basis, space.null_basis, space.singular_values, space.scaled_null_basis):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_the_certificate_says_how_sure_it_is(space: EssentialSpace) -> None:
    certificate = space.certificate
    assert (certificate.rank_energy, certificate.rank_torque, certificate.rank_doubled) == (36, 36, 36)
    assert certificate.gap > 1e13
    assert certificate.relative_smallest > 0.05
    assert certificate.samples == 121
    assert certificate.null_residual < 1e-14
    assert certificate.failures == certificate.warnings == ()
    assert str(certificate).startswith("rank 36 by the energies of 121 and of 242 states and by torques; gap 7")


@pytest.mark.parametrize("twist", [1e-10, 1e-9, 1e-8, 1e-6, 1e-4])
def test_a_tiny_twist_is_refused_with_both_ranks(twist: float) -> None:
    angle = rf"joint1 and joint2 are {twist:.1e} rad from 0 degrees"
    both = "planar: the rank is 17 for the geometry as given, but 9 if nearly special values are made exact"
    with pytest.raises(RankError, match=rf"{both}: {angle}.*as_written=True \(--as-written\)"):
        essential_space(planar(twist))
    assert essential_space(Mechanism(snapped(planar(twist).description))).rank == 9


def test_a_tiny_twist_as_it_is_needs_digits_enough() -> None:
    """Floats see 1e-4 rad; of 1e-8 rad they see a part, and would say 13."""
    seen = essential_space(planar(1e-4), as_written=True).certificate
    assert (seen.rank, seen.rank_exact) == (17, 17)
    assert "joint1 and joint2 are 1.0e-04 rad from 0 degrees" in seen.warnings[0]
    with pytest.raises(RankError, match="energies 13, exact over a prime field 17"):
        essential_space(planar(1e-8), as_written=True)
    unproved = essential_space(planar(1e-8), prove=False).certificate
    assert (unproved.rank, unproved.rank_exact) == (13, None)
    with pytest.raises(InputError, match="as_written: expected True or False, got 'snap'"):
        essential_space(planar(0.0), as_written="snap")  # type: ignore[arg-type]


def test_a_nearly_special_angle_that_does_not_matter_is_only_a_remark(puma: Mechanism) -> None:
    wrist = puma.links[4]
    off = replace(wrist, parent_to_joint=wrist.parent_to_joint @ Pose(rotation_about((1, 0, 0), 1e-6), np.zeros(3)))
    links = (*puma.links[:4], off, *puma.links[5:])
    found = essential_space(Mechanism(replace(puma.description, links=links))).certificate
    assert (found.rank, found.rank_exact) == (36, 36)
    assert any("1.0e-06 rad from 90 degrees" in remark for remark in found.warnings)


def test_a_long_spectrum_is_shown_about_its_gap() -> None:
    with pytest.raises(RankError, match=r"\(from the 1?\dth\)") as refusal:
        essential_space(planar(1e-6, links=10), as_written=True)
    assert len(refusal.value.singular_values) == 100
    assert len(str(refusal.value)) < 8000


@pytest.mark.parametrize("degrees", [0, 90, 180])
@pytest.mark.parametrize(("miss", "near"), [(5e-12, False), (1e-10, True), (9e-4, True), (2e-3, False)])
def test_almost_right_angles(degrees: int, miss: float, near: bool) -> None:
    found = near_right_angles(planar(np.radians(degrees) + miss, links=2).description)
    assert [pair.degrees for pair in found] == ([degrees] if near else [])
    # Beyond 180 degrees the angle between the axes falls again.
    assert all(abs(pair.deviation) == pytest.approx(miss, rel=1e-5, abs=1e-15) for pair in found)


def cart_and_rod(nothing: float = 1e-6) -> Mechanism:
    """Standard Denavit-Hartenberg: a cart with a = 1e-6 m, then a rod with a = 0.25 m, frames at the far ends."""
    ends = [(JointKind.PRISMATIC, nothing, np.pi / 2), (JointKind.REVOLUTE, 0.25, 0.0)]
    links = [
        Link(
            f"link{i}",
            i - 1,
            Joint(f"joint{i}", kind),
            Pose.identity(),
            Pose(rotation_about((1, 0, 0), twist), np.array([a, 0, 0])),
        )
        for i, (kind, a, twist) in enumerate(ends)
    ]
    return Mechanism(Description("cart and rod", tuple(links)))


def test_a_far_frame_counts_however_near_the_joints_are() -> None:
    found = essential_space(cart_and_rod())
    assert (found.rank, found.certificate.rank_exact) == (4, 4)
    assert characteristic_length(cart_and_rod()) == 0.25
    assert essential_space(cart_and_rod(0.0)).rank == 4


def test_nothing_to_know_is_rank_zero(puma: Mechanism) -> None:
    """Of a link on a vertical axis at rest in space all but I_zz changes no energy; what is known is no question."""
    everything = dict.fromkeys(puma.parameter_names, 0.0)
    none = essential_space(constrained(puma, Constraints(everything)))
    assert (none.rank, none.certificate.rank_exact, none.null_basis.shape) == (0, 0, (0, 0))
    upright = single(JointKind.REVOLUTE, (0, 0, 1), (0, 0, -9.81))
    slim = constrained(upright, Constraints({"body.I_zz": 1.0, "body.m": 2.0}))
    space = essential_space(slim)
    assert (space.rank, space.certificate.rank_torque, space.certificate.failures) == (0, 0, ())
    basis = fundamental_basis(space, prove=True)
    assert (basis.columns, basis.regrouping.shape) == ((), (0, 8))
    model = ReducedModel(slim, basis)
    p, v, a = np.random.default_rng(0).normal(size=(3, 5, 1))
    np.testing.assert_allclose(
        model.inverse_dynamics(p, v, a),
        upright.with_parameters(np.array([2.0, 0, 0, 0, 0, 0, 0, 0, 0, 1.0])).inverse_dynamics(p, v, a),
        atol=1e-15,
    )


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"gap": 9e5}, "the gap at 5 is 9.0e+05"),
        ({"relative_smallest": 9e-10}, "sigma_k/sigma_1 is 9.0e-10"),
        ({"rank_torque": 4}, "energies 5, torques 4, twice as many samples 5"),
        ({"rank_doubled": 6}, "energies 5, torques 5, twice as many samples 6"),
        ({"rank_exact": 6, "proof_method": "a prime field"}, "exact over a prime field 6"),
        (
            {"residual_singular_values": (ResidualSingularValue(2.5e-8, ("link1.m",)),)},
            "beyond the gap, a singular value is 2.5e-08 of sigma_1",
        ),
    ],
)
def test_every_ground_for_refusal(change: dict[str, Any], fault: str) -> None:
    sound = Certificate(5, 5, rank_torque=5, gap=1e6, relative_smallest=1e-9, samples=20, seed=0, null_residual=0.0)
    spectrum = np.logspace(0, -9, 10)
    sound.validate_accepted("arm", spectrum)
    with pytest.raises(RankError) as refusal:
        replace(sound, **change).validate_accepted("arm", spectrum)
    assert fault in str(refusal.value)
    assert refusal.value.singular_values == tuple(spectrum)


def test_the_rank_is_at_the_largest_gap() -> None:
    assert NumericalRank.from_singular_values([4.0, 2.0, 4e-9, 1e-9]) == NumericalRank(
        2, pytest.approx(5e8), pytest.approx(0.5)
    )  # type: ignore[arg-type]
    # Ratios within the round-off say nothing, and full rank is possible.
    assert NumericalRank.from_singular_values([1.0, 1e-10, 1e-17, 1e-30]).rank == 1
    assert NumericalRank.from_singular_values([1.0, 0.5]) == NumericalRank(2, pytest.approx(5e14), 0.5)  # type: ignore[arg-type]
    assert (
        NumericalRank.from_singular_values([0.0, 0.0]).rank
        == NumericalRank.from_singular_values([]).rank
        == NumericalRank.from_singular_values([1e-15, 1e-17]).rank
        == 0
    )
    np.testing.assert_array_equal(singular_values(np.array([[3.0, 0.0, 0.0]])), [3.0, 0.0, 0.0])


@pytest.mark.parametrize(("parameters", "states"), [(0, 3), (1, 3), (10, 21)])
def test_unless_asked_for_there_is_one_state_more_than_twice_the_parameters(parameters: int, states: int) -> None:
    assert _sample_count(None, parameters) == states
    assert _sample_count(2 * parameters, parameters) == 2 * parameters


def test_the_length_is_the_largest_between_joints(puma: Mechanism) -> None:
    assert characteristic_length(puma) == pytest.approx(np.hypot(0.4318, 0.14909))
    assert characteristic_length(resized(puma, 1e-3)) == pytest.approx(1e-3 * np.hypot(0.4318, 0.14909))
    assert characteristic_length(single(JointKind.REVOLUTE, (0, 1, 0), (0, 0, -9.81))) == 1.0
    far = replace(planar(0.0, 1).links[0], joint_to_link=Pose(np.eye(3), np.array([0.0, 0.2, 0.0])))
    assert characteristic_length(Mechanism(Description("far", (far,)))) == pytest.approx(0.2)


def test_states_keep_within_limits() -> None:
    limits = [Limits(-1.0, 2.0, 3.0), Limits(), Limits(lower=1.0, velocity=0.5)]
    links = [
        replace(link, joint=replace(link.joint, limits=bound))
        for link, bound in zip(planar(0.0).links, limits, strict=True)
    ]
    mechanism = Mechanism(Description("limited", tuple(links)))
    states = states_within_limits(mechanism, 500)
    assert len(states) == 500
    low, high, fastest = states.p.min(axis=0), states.p.max(axis=0), np.abs(states.v).max(axis=0)
    np.testing.assert_allclose(low, [-1.0, -np.pi, 1.0], atol=0.1)
    np.testing.assert_allclose(high, [2.0, np.pi, 1.0 + 2 * np.pi], atol=0.1)
    np.testing.assert_allclose(fastest, [3.0, np.sqrt(9.81 / 0.3), 0.5], rtol=0.03)


def test_bad_input(puma: Mechanism, space: EssentialSpace) -> None:
    with pytest.raises(InputError, match="at least twice the 60 parameters, got 119"):
        essential_space(puma, samples=119)
    assert essential_space(puma, samples=120).certificate.samples == 120
    with pytest.raises(InputError, match=r"states: expected p and v .* got \(5, 6\) and \(4, 6\)"):
        States(np.zeros((5, 6)), np.zeros((4, 6)), "mine")
    with pytest.raises(InputError, match=r"expected shape \(\.\.\., 6\), got \(5, 7\)"):
        essential_space(puma, states=States(np.zeros((5, 7)), np.zeros((5, 7)), "mine"))
    with pytest.raises(NonFiniteError):
        essential_space(puma, states=States(np.full((5, 6), np.nan), np.zeros((5, 6)), "mine"))
    with pytest.raises(InputError, match=r"parameters: expected shape \(\.\.\., 60\), got \(10,\)"):
        space.project(np.zeros(10))
