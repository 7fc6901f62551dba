"""Ranks on exact geometry: the numbers they are made of, and an oracle that shares none of their equations."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from nightly import mostly_at_night
from random_loops import RECIPES, random_loop, two_arms
from random_trees import random_chain, random_inertia, random_tree
from robot_files import urdf

from adaptctl.description import ClosureKind, Description, Joint, JointKind, Link, Pose
from adaptctl.description.drive import Drive
from adaptctl.description.pose import rotation_about
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError, RankError
from adaptctl.identifiability import Constraints, Priority, Relation, constrained, essential_space, fundamental_basis
from adaptctl.identifiability.chosen_columns import _kept_against_the_order
from adaptctl.identifiability.proof import arithmetic
from adaptctl.identifiability.proof.arithmetic import (
    BITS,
    PRIME,
    Digits,
    digits,
    floats,
    modular,
    samples_of,
    scaled,
)
from adaptctl.identifiability.proof.exact_energies import ExactEnergies
from adaptctl.identifiability.proof.exact_geometry import ExactGeometry, Reading
from adaptctl.identifiability.proof.joint_frames import AS_GIVEN, AS_MEANT, simplest_rational, turn, turns_of
from adaptctl.identifiability.sampling import characteristic_length
from adaptctl.scalars import Column, Mat, column, cos, sin
from benchmarks.rank_oracle import Case, bent, five_bar, independent, tree

seeds = st.integers(0, 2**32 - 1)
fractions = st.fractions(-1000, 1000, max_denominator=10**6)


@given(fractions, fractions)
def test_digits_reckon_like_fractions(x: Fraction, y: Fraction) -> None:
    a, b = Digits(np.array([scaled(x)], dtype=object)), Digits(scaled(y))
    results = [
        (a + b, x + y),
        (a - b, x - y),
        (a * b, x * y),
        (-a, -x),
        (0.5 - a, Fraction(1, 2) - x),
        (a / 4.0, x / 4),
    ]
    if abs(y) > Fraction(1, 1000):
        results += [(a / b, x / y)]
    for found, meant in results:
        assert abs(Fraction(int(found.scaled[0]), 2**BITS) - meant) < Fraction(1, 10**50)
    assert [digits(Fraction(n)) for n in (-1, 0, 1)] == [-1.0, 0.0, 1.0]  # floats, which cost nothing


def test_sines_of_sixty_digits() -> None:
    x = samples_of([0.0, 0.3, -2.5, 6.1])
    c, s = cos(x), sin(x)
    np.testing.assert_allclose(floats(c.scaled), np.cos([0.0, 0.3, -2.5, 6.1]), atol=1e-15)
    np.testing.assert_allclose(floats(s.scaled), np.sin([0.0, 0.3, -2.5, 6.1]), atol=1e-15)
    assert max(abs(int(rest)) for rest in (c * c + s * s - 1.0).scaled) < 2**BITS // 10**55


@given(st.integers(-9999, 9999), st.integers(1, 999), st.floats(-1.0, 1.0))
def test_floats_stand_for_simple_fractions(n: int, d: int, noise: float) -> None:
    meant = Fraction(n, d)
    x = float(meant) * (1.0 + 1e-16 * noise)
    found = simplest_rational(x, max(abs(x), 1e-3))
    assert abs(float(found) - x) <= 1e-12 * max(abs(x), 1e-3)
    assert found.denominator <= d or meant == 0
    assert simplest_rational(1e-13) == 0 != simplest_rational(1e-9)


@given(st.floats(-7.0, 7.0))
def test_turns_are_on_the_circle_and_near(angle: float) -> None:
    c, s = turn(angle).cosine_and_sine
    assert c * c + s * s == 1
    assert math.hypot(float(c) - math.cos(angle), float(s) - math.sin(angle)) < 1e-11
    for quarters in range(-4, 5):
        assert (
            turn(quarters * math.pi / 2 + 5e-12).half_tangent == 0 != turn(quarters * math.pi / 2 + 2e-11).half_tangent
        )


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(-2, 2) | st.floats(-7.0, 7.0)), min_size=1, max_size=3))
def test_turns_keep_the_zeros_of_rotations(turns: list[tuple[int, float]]) -> None:
    """Whole numbers are quarter turns."""
    angles = [x * math.pi / 2 if isinstance(x, int) else x for _, x in turns]
    rotation, found = np.eye(3), np.eye(3)
    for (axis, _), angle in zip(turns, angles, strict=True):
        rotation = rotation @ rotation_about(np.eye(3)[axis], angle)
    told = turns_of(Mat.of(rotation.tolist()), AS_GIVEN)
    for axis, angle in told:
        found = found @ rotation_about(np.eye(3)[axis], angle)
    np.testing.assert_allclose(found, rotation, atol=1e-10)
    entries = [entry for row in Reading(modular, 1.0).rotation(told) for entry in row]
    assert all(entries[i] == 0.0 for i in np.flatnonzero(np.abs(rotation) < 1e-12))


@settings(max_examples=15, deadline=None)
@given(seeds, st.integers(1, 9), st.integers(1, 9), st.integers(0, 9))
def test_ranks_and_first_columns_of_known_matrices(seed: int, m: int, n: int, rank: int) -> None:
    rng, rank = np.random.default_rng(seed), min(rank, m, n)
    small = (rng.integers(-5, 6, (m, rank)) @ rng.integers(-5, 6, (rank, n))).astype(np.int64)
    expected: list[int] = []
    order = rng.permutation(n).tolist()
    for j in order:
        if np.linalg.matrix_rank(small[:, [*expected, j]]) > len(expected):
            expected.append(j)
    assert list(arithmetic.independent_columns(small % PRIME, order)) == expected
    assert arithmetic.rank(small % PRIME) == len(expected)
    assert arithmetic.ranks(np.stack([small % PRIME, 0 * small])) == (len(expected), 0)
    many = small.astype(object) << BITS
    assert list(arithmetic.independent_columns(many, order, arithmetic.ZERO_TOLERANCE)) == expected
    assert arithmetic.rank(many, arithmetic.ZERO_TOLERANCE) == len(expected)


@settings(max_examples=15, deadline=None)
@given(seeds, st.integers(1, 6), st.booleans())
def test_canonical_links_move_like_the_files(seed: int, links: int, branched: bool) -> None:
    """Energies of each link's own ten are the same, whatever frames joints are told in."""
    mechanism = (random_tree if branched else random_chain)(seed, links)
    strength = float(np.linalg.norm(mechanism.description.gravity))
    geometry = exact_in_floats(mechanism)
    p, v = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, links))
    turns = [link.turns for link in geometry.links]
    shifted = p + np.where(turns, geometry.shifts, 0.0)
    tree_equations = replace(mechanism.equations, segments=geometry.links, gravity=strength * geometry.gravity)  # type: ignore[type-var]
    E = [
        np.array([*equations.energy_regressor(Column(q.tolist()), Column(v.tolist()))])
        for equations, q in ((mechanism.equations, p), (tree_equations, shifted))
    ]
    # The world's origin and the first foot along its axis move heights by a constant, which is mass's alone.
    still = [
        np.array([*equations.energy_regressor(Column(q.tolist()), Column.zeros(links))])
        for equations, q in ((mechanism.equations, 0.0 * p), (tree_equations, shifted - p))
    ]
    np.testing.assert_allclose(E[0] - still[0], E[1] - still[1], atol=1e-9 * max(np.abs(E[0]).max(), 1.0))


def exact_in_floats(mechanism: Mechanism) -> ExactGeometry:
    frames = ExactEnergies(mechanism).frames
    return ExactGeometry.by_axes(mechanism.description, frames, Reading(float, characteristic_length(mechanism)))


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
@pytest.mark.parametrize(
    ("name", "rank", "method"),
    [
        ("puma560", 36, "a prime field"),
        ("puma560_arm3", 15, "a prime field"),
        ("puma560_geared", 40, "a prime field"),
        ("semi_direct_drive", 26, "60 digits"),
        ("semi_direct_drive_parallelogram", 18, "60 digits"),
    ],
)
def test_the_built_in_arms(name: str, rank: int, method: str) -> None:
    space = essential_space(load(name), prove=True)
    assert (space.rank, space.certificate.rank_exact, space.certificate.proof_method) == (rank, rank, method)
    assert str(space.certificate).endswith(f"; confirmed exactly, over {method}")
    assert fundamental_basis(space, prove=True).columns == fundamental_basis(space).columns


@settings(max_examples=15, deadline=None)
@given(seeds, st.integers(1, 7), st.booleans(), st.booleans())
@example(834, 6, True, True)  # an axis of a skew link frame lies across the common normal of two joints
@example(976, 6, False, True)  # the same, with joints that slide
def test_trees_against_the_oracle(seed: int, links: int, branched: bool, shuffled: bool) -> None:
    """Ranks and kept parameters, by both methods, of trees whose axes are parallel, askew, meeting, or not."""
    rng = np.random.default_rng(seed)
    case = tree(rng, links, branched)
    case.scale = Fraction(1, 1000) if seed % 3 == 0 else Fraction(1)
    H, mechanism = case.differences(seed), case.mechanism()
    names = np.array(mechanism.parameter_names)
    priority = Priority(tuple(rng.permutation(names).tolist()) if shuffled else ())
    order = priority.indices(mechanism.parameter_names)
    kept = tuple(sorted(independent(H, order[::-1])))
    for method in ("svd", "transfers"):
        space = essential_space(mechanism, method=method)  # type: ignore[arg-type]
        assert space.rank == space.certificate.rank_exact == len(kept)
        assert space.proof is not None
        assert space.proof.keeps(kept, order)
        found = space.null_space.regrouping(order, 1e-3)
        assert found.kept_despite_priority or found.kept == kept


@settings(max_examples=3, deadline=None)
@given(seeds)
def test_five_bars_against_the_oracle(seed: int) -> None:
    case = five_bar(np.random.default_rng(seed))
    exact = ExactEnergies(case.mechanism())
    H = case.differences(seed)
    assert exact.rank == len(independent(H, range(H.shape[1])))
    order = np.random.default_rng(seed).permutation(H.shape[1]).tolist()
    assert exact.keeps(tuple(sorted(independent(H, order[::-1]))), order)


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_what_is_nearly_special_is_right_or_refused(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = bent(rng, int(rng.integers(2, 6)))
    rank = len(independent(case.differences(seed), range(10 * len(case.links))))
    for as_written in (False, True):
        assert right_or_refused(case, rank, as_written)


def right_or_refused(case: Case, rank: int, as_written: bool) -> bool:
    try:
        return essential_space(case.mechanism(), as_written=as_written).rank == rank
    except RankError:
        return True


@pytest.mark.parametrize("miss", [1e-9, 1e-7, 1e-5])
def test_nearly_a_parallelogram_is_refused_by_its_lengths(miss: float) -> None:
    seed = next(s for s in range(100) if five_bar(np.random.default_rng(s)).loop.parallel)  # type: ignore[union-attr]
    case = five_bar(np.random.default_rng(seed))
    assert case.loop is not None
    rank = ExactEnergies(case.mechanism()).rank
    case.loop.lengths = (*case.loop.lengths[:3], case.loop.lengths[3] + Fraction(miss))
    case.loop.parallel = False
    loose = len(independent(case.differences(0), range(10 * len(case.links))))
    assert loose > rank
    with pytest.raises(
        RankError, match=rf"the rank is {loose} for the geometry as given, but {rank} if .*lengths .* nearly equal"
    ):
        essential_space(case.mechanism())


@pytest.mark.parametrize(
    ("recipe", "seed"),
    mostly_at_night(
        [
            ("spatial point", 1),
            ("spatial hinge", 2),
            ("two spatial loops", 2),
            ("gears in a loop", 1),
            ("gears alone", 1),
        ],
        *(("spatial point", 1), ("gears in a loop", 1), ("gears alone", 1)),
    ),
)
def test_spatial_loops_and_gears(recipe: str, seed: int) -> None:
    mechanism, _ = random_loop(seed, RECIPES[recipe])
    assert essential_space(mechanism, prove=True).certificate.rank_exact == ExactEnergies(mechanism, seed=1).rank


@pytest.mark.parametrize("kind", mostly_at_night(ClosureKind, ClosureKind.POINT))
def test_loops_that_move(kind: ClosureKind) -> None:
    certificate = essential_space(two_arms(3, kind), prove=True).certificate
    assert certificate.rank_exact == certificate.rank


def test_relations_among_parameters() -> None:
    """In digits where loops are closed, else over the field; a third is 0.333... in floats."""
    arm = load("semi_direct_drive")
    slim = constrained(arm, Constraints(dict.fromkeys(fundamental_basis(essential_space(arm)).names[:3], 0.1)))
    known = essential_space(slim, prove=True)
    assert known.rank == known.certificate.rank_exact < 26
    puma = load("puma560_measured")
    related = Constraints(relations=(Relation({"link4.I_zz": 3.0, "link5.I_yy": -1.0}), Relation({"link6.mc_x": 1.0})))
    space = essential_space(constrained(puma, related))
    assert space.rank == space.certificate.rank_exact < 36
    assert fundamental_basis(space, prove=True).kept_despite_priority == ()


def test_the_proof_is_made_where_it_is_cheap_or_asked_for() -> None:
    arm, loop = load("puma560_measured"), load("semi_direct_drive")
    assert essential_space(arm).certificate.rank_exact == 36
    assert essential_space(arm, prove=False).certificate.rank_exact is None
    assert essential_space(loop).certificate.rank_exact is None
    with pytest.raises(
        InputError, match=r"semi_direct_drive: to prove the basis, prove the essential space \(prove=True\)"
    ):
        fundamental_basis(essential_space(loop), prove=True)


def test_offsets_of_skew_joints_keep_their_zeros() -> None:
    """A joint stands straight along x of a link before, its axis askew: told from axis to axis, y and z are not zero
    but only to round-off, and another parameter would be kept."""
    rng = np.random.default_rng(87)
    case = tree(rng, 4, False)
    case.scale = Fraction(1, 1000)
    mechanism = case.mechanism()
    order = Priority(tuple(rng.permutation(np.array(mechanism.parameter_names)).tolist())).indices(
        mechanism.parameter_names
    )
    kept = tuple(sorted(independent(case.differences(87), order[::-1])))
    exact = ExactEnergies(mechanism)
    assert exact.kept(order) != kept == replace(exact, by_frames=True).kept(order)
    assert exact.keeps(kept, order)


def test_coarser_reading_only_makes_ranks_smaller() -> None:
    for seed in range(10):
        mechanism = random_tree(seed, 5)
        assert ExactEnergies(mechanism, AS_MEANT).rank <= ExactEnergies(mechanism, AS_GIVEN).rank


def test_a_skew_frame_hides_no_parallel_axes() -> None:
    """Joints of a planar arm told in frames of any rotation: floats are parallel to round-off alone."""
    rng = np.random.default_rng(4)

    def skew() -> Pose:
        axis = rng.normal(size=3)
        return Pose(rotation_about(axis / np.linalg.norm(axis), rng.uniform(-3, 3)), rng.normal(size=3))

    plain = planar_arm(rng)
    frames = [skew() for _ in plain]
    links = [
        replace(
            link,
            parent_to_joint=(Pose.identity() if i == 0 else frames[i - 1].inverse) @ link.parent_to_joint,
            joint_to_link=link.joint_to_link @ frames[i],
        )
        for i, link in enumerate(plain)
    ]
    mechanism = Mechanism(Description("skew", tuple(links), np.array([0.0, -9.81, 0.0])))
    assert ExactEnergies(mechanism).rank == essential_space(mechanism).rank == 15


def planar_arm(rng: np.random.Generator) -> list[Link]:
    near = [Pose(np.eye(3), np.array([0.1 + 0.1 * i, 0.05, 0.2])) for i in range(5)]
    return [
        Link(f"link{i}", i - 1, Joint(f"joint{i}"), near[i], Pose.identity(), random_inertia(rng)) for i in range(5)
    ]


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_right_angles_of_eleven_digits_are_right_ones() -> None:
    """TIAGo's wrist is turned by several angles of 1.57079632679, whose misses add up."""
    basis = fundamental_basis(essential_space(load(urdf("tiago.urdf"))), prove=True)
    assert (basis.rank, basis.kept_despite_priority) == (310, ())


@settings(max_examples=15, deadline=None)
@given(seeds, st.integers(1, 5), st.booleans())
def test_links_described_from_frame_to_frame_move_like_the_files(seed: int, links: int, branched: bool) -> None:
    mechanism = (random_tree if branched else random_chain)(seed, links)
    reading = Reading(float, characteristic_length(mechanism))
    geometry = ExactGeometry.by_frames(mechanism.description, reading)
    again = replace(mechanism.equations, segments=geometry.links, gravity=geometry.gravity)  # type: ignore[type-var]
    p, v = np.random.default_rng(seed).uniform(-1.0, 1.0, (2, links))
    q = p + np.array(geometry.shifts)
    E = np.array([*mechanism.equations.energy_regressor(column(p), column(v))])
    same = np.array([*again.energy_regressor(column(q), column(v))])
    np.testing.assert_allclose(same, E, atol=1e-9 * max(np.abs(E).max(), 1.0))


def test_two_slides_with_a_shaft_in_common() -> None:
    """The span of both squares of rates, their product and one potential."""
    slides = random_chain(3, 2)
    links = tuple(replace(link, joint=replace(link.joint, kind=JointKind.PRISMATIC)) for link in slides.links)
    arm = Mechanism(Description("slides", links, np.array([0.0, 0.0, -9.81])))
    shared = [Drive(rotor_inertia=0.1, turns_with=(("joint1", -1.0),)), Drive(rotor_inertia=0.1)]
    geared = arm.with_drives(shared)
    assert essential_space(geared, prove=True).rank == essential_space(geared, prove=False).rank == 4


def test_what_floats_keep_and_exact_geometry_removes_is_told_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the proof of another arm, and with a choice that the order does not make; looked at wherever there is a
    proof."""
    monkeypatch.setenv("ADAPTCTL_CACHE", "off")  # what such a mixture keeps is nobody else's
    plain = planar_arm(np.random.default_rng(4))[:3]
    tilted = Pose(np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]]), np.array([0.1, 0.05, 0.2]))
    arms = [Description("arm", tuple(links), np.array([0.0, -9.81, 0.0])) for links in (plain, bend(plain, tilted))]
    planar, bent = map(Mechanism, arms)
    space, order = essential_space(bent, prove=True), Priority().indices(bent.parameter_names)
    mixed = replace(space, search=replace(space.search))
    vars(mixed.search)["found"] = space.search.found._replace(proof=ExactEnergies(planar))
    both = (fundamental_basis(essential_space(arm)).columns for arm in (bent, planar))
    expected = set.difference(*map(set, both))
    for prove in (True, False):
        found = fundamental_basis(mixed, prove=prove)
        assert set(found.kept_despite_priority) == {bent.parameter_names[j] for j in expected}
    backward = space.null_space.regrouping(order[::-1], 1e-6)
    with pytest.raises(RankError, match=r"arm: in exact arithmetic, over a prime field, this priority removes link"):
        _kept_against_the_order(space, backward, order, False, 1e-6)


def bend(links: list[Link], near: Pose) -> list[Link]:
    return [links[0], *(replace(link, parent_to_joint=near) for link in links[1:])]
