"""The fundamental basis: enough parameters, exactly regrouped, and the same after saving and loading."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest
import scipy.spatial.transform
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain, random_inertia, random_tree
from robot_files import urdf

from adaptctl.arrays import Array
from adaptctl.description import JointKind, Pose, with_floating_base
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import FileError, InputError, NonFiniteError, RankError
from adaptctl.identifiability import EssentialSpace, FundamentalBasis, Priority, essential_space, fundamental_basis
from adaptctl.identifiability.reduced_model import validate_energies
from adaptctl.identifiability.regrouping import regrouping_equations, removable
from benchmarks import ranks
from benchmarks.rank_oracle import independent


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def space(puma: Mechanism) -> EssentialSpace:
    return essential_space(puma)


@pytest.fixture(scope="module")
def basis(space: EssentialSpace) -> FundamentalBasis:
    return fundamental_basis(space)


def validate_same_torques(mechanism: Mechanism, basis: FundamentalBasis, bound: float) -> None:
    """Pinocchio's torque, and ours from the kept columns alone."""
    model = mechanism.to_pinocchio()
    data = model.createData()
    p, v, a = np.random.default_rng(0).normal(size=(3, 100, mechanism.dof))
    expected = np.array([pinocchio.rnea(model, data, *x) for x in zip(p, v, a, strict=True)])
    beta = basis.fundamental_parameters(mechanism.inertial_parameters)
    reduced = mechanism.torque_regressor(p, v, a, basis.columns) @ beta
    assert np.abs(reduced - expected).max() < bound * max(1.0, np.abs(beta).max()) * np.abs(expected).max()


def test_the_regrouping_is_exact(space: EssentialSpace, basis: FundamentalBasis) -> None:
    K = basis.regrouping
    assert K.shape == (36, 60)
    np.testing.assert_array_equal(K[:, basis.columns], np.eye(36))
    assert np.abs(K @ space.null_basis).max() < 1e-13
    # Every coefficient of this arm is made of its lengths and of ones: none is round-off.
    assert np.abs(K[K != 0.0]).min() > 1e-4


def test_lengths_come_out_to_the_last_digits(basis: FundamentalBasis) -> None:
    place = {name: i for i, name in enumerate(basis.parameter_names)}
    row = basis.regrouping[basis.names.index("link2.I_yy")]
    np.testing.assert_allclose(row[[place[f"link{i}.m"] for i in range(2, 7)]], -(0.4318**2), rtol=1e-13)
    assert row[place["link2.I_xx"]] == pytest.approx(-1.0, abs=1e-14)
    assert np.count_nonzero(row) == 7


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize("file", ["ur5_robot.urdf", "panda.urdf", "talos_reduced.urdf"])
def test_real_robots(file: str) -> None:
    driven = Mechanism.from_pinocchio(pinocchio.buildModelFromUrdf(str(urdf(file))))
    mechanism = driven.with_drives(Drive())  # Pinocchio's torques are without friction
    basis = fundamental_basis(essential_space(mechanism))
    assert basis.scaled_condition < 20.0
    validate_same_torques(mechanism, basis, 1e-12)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.booleans())
def test_the_condition_is_that_of_the_removed_rows(seed: int, links: int, floating: bool) -> None:
    """It is found from the regrouping, by what the null vectors have to be; here from the null vectors themselves.

    On a floating base every parameter changes energies, so that no coefficient's column is zero, as on the ground.
    """
    mechanism = random_tree(seed, links)
    if floating:
        inertia = random_inertia(np.random.default_rng(seed))
        mechanism = Mechanism(with_floating_base(mechanism.description, "base", inertia))
    space = essential_space(mechanism)
    basis = fundamental_basis(space, tolerance=0.03)
    removed = [j for j in range(len(space.parameter_names)) if j not in basis.columns]
    assert not floating or np.abs(np.delete(basis.regrouping, basis.columns, axis=1)).max(axis=0).min() > 1e-3
    for found, vectors in (
        (basis.condition, space.null_basis),
        (basis.scaled_condition, space.scaled_null_basis),
    ):
        assert found == pytest.approx(np.linalg.cond(vectors[removed]), rel=1e-6)


def test_the_puma(puma: Mechanism, basis: FundamentalBasis) -> None:
    assert basis.condition == pytest.approx(4.449, abs=1e-3)
    assert basis.gap > 1e13
    validate_same_torques(puma, basis, 1e-14)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.booleans())
def test_every_tree(seed: int, links: int, branched: bool) -> None:
    """Axes and frames at random leave everything between 0 and 1, so a tolerance that keeps the condition low."""
    mechanism = (random_tree if branched else random_chain)(seed, links)
    basis = fundamental_basis(essential_space(mechanism), tolerance=0.03)
    validate_same_torques(mechanism, basis, 1e-10)


@settings(max_examples=25, deadline=None)
@given(st.permutations(range(60)))
def test_any_priority_gives_a_basis(permutation: list[int]) -> None:
    puma = load("puma560_measured")
    order = tuple(puma.parameter_names[i] for i in permutation)
    basis = fundamental_basis(essential_space(puma), Priority(order), tolerance=0.03)
    assert basis.rank == 36
    validate_same_torques(puma, basis, 1e-12)


def test_a_parameter_stays_only_if_those_before_it_determine_it(space: EssentialSpace) -> None:
    """By definition of the walk, against ranks found by singular values."""
    order = Priority().indices(space.parameter_names)
    removed = set(removable(space.scaled_null_basis, order, 1e-3))
    before: list[int] = []
    for j in order:
        rank = np.linalg.matrix_rank(space.scaled_null_basis[[*before, j]], tol=1e-3)
        assert (j in removed) == (rank == len(before) + 1)
        before += [j] if j in removed else []


def test_a_tolerance_too_large_to_finish_is_refused(space: EssentialSpace) -> None:
    for bad in (0.0, -1.0, 0.13, np.nan):
        with pytest.raises(InputError, match=r"tolerance: expected a number between 0 and 0\.13"):
            fundamental_basis(space, tolerance=bad)


def test_nearly_dependent_choices_are_refused_by_name(puma: Mechanism) -> None:
    """Of 40 random orders a few remove parameters that nearly determine each other; floats alone cannot tell."""
    space = essential_space(puma, prove=False)
    rng, refusals = np.random.default_rng(2), []
    names = np.array(space.parameter_names)
    for _ in range(40):
        order = Priority(tuple(names[rng.permutation(60)].tolist()))
        try:
            assert fundamental_basis(space, order).scaled_condition <= 1e4
        except RankError as error:
            refusals.append(str(error))
            assert fundamental_basis(space, order, tolerance=0.03).scaled_condition < 1e4
    assert 0 < len(refusals) < 5
    assert all(re.search(r"removes link\d\.\w+ and link\d\.\w+, which .*limit 1e\+04\)", x) for x in refusals)


def test_random_orders_are_kept_exactly(puma: Mechanism, space: EssentialSpace) -> None:
    """Where exact arithmetic tells what nearly dependent parameters do; floats alone keep others."""
    rng, names = np.random.default_rng(2), np.array(space.parameter_names)
    alone, others = essential_space(puma, prove=False), 0
    for _ in range(40):
        order = Priority(tuple(names[rng.permutation(60)].tolist()))
        basis = fundamental_basis(space, order)
        assert space.proof is not None
        assert basis.columns == space.proof.kept(order.indices(space.parameter_names))
        assert basis.kept_despite_priority == ()
        assert np.abs(basis.regrouping @ space.null_basis).max() < 1e-11 * np.abs(basis.regrouping).max()
        others += basis.columns != alone.null_space.regrouping(order.indices(space.parameter_names), 1e-3).kept
    assert others > 0


def test_a_saved_basis_says_what_its_priority_did_not_get(basis: FundamentalBasis, tmp_path: Path) -> None:
    told = replace(basis, kept_despite_priority=(basis.names[3],))
    told.save(tmp_path / "told.json")
    assert FundamentalBasis.load(tmp_path / "told.json").kept_despite_priority == (basis.names[3],)
    basis.save(tmp_path / "plain.json")
    assert "kept_despite_priority" not in (tmp_path / "plain.json").read_text()


def value(expression: str, D: dict[str, float]) -> float:
    """A printed right-hand side with numbers for names; what it says, not how it was made."""
    return float(
        eval(re.sub(r"(\d) (?=\(|[A-Za-z])", r"\1 * ", re.sub(r"[A-Za-z_]\w*\.\w+", r"D['\g<0>']", expression)))
    )


@pytest.mark.parametrize("seed", range(3))
def test_equations_say_what_the_matrix_does(seed: int) -> None:
    mechanism = random_tree(seed, 5)
    basis = fundamental_basis(essential_space(mechanism), tolerance=0.03)
    D = mechanism.inertial_parameters
    by_name = dict(zip(basis.parameter_names, D.tolist(), strict=True))
    sizes = np.abs(basis.regrouping) @ np.abs(D)
    rows = zip(basis.equations(), basis.names, basis.fundamental_parameters(D), sizes, strict=True)
    for equation, name, beta, size in rows:
        left, right = equation.split(" = ")
        assert left == f"{name}*"
        assert value(right, by_name) == pytest.approx(beta, abs=1e-5 * size)


def test_equations_are_written_as_a_person_would() -> None:
    K = np.array([[1.0, 0.5, -1.0, -0.5, 0.5, 0.0], [0.0, 2e-10, 0.0, -3.0, 0.0, 1.0]])
    assert regrouping_equations(K, (0, 5), ("a", "b", "c", "d", "e", "f")) == (
        "a* = a - c + 0.5 (b - d + e)",
        "f* = f - 3 d",
    )


def test_saving_and_loading(basis: FundamentalBasis, tmp_path: Path) -> None:
    basis.save(tmp_path / "basis.json")
    again = FundamentalBasis.load(tmp_path / "basis.json")
    np.testing.assert_array_equal(again.regrouping, basis.regrouping)
    for field in (
        "mechanism_name",
        "geometry_sha256",
        "parameter_names",
        "columns",
        "condition",
        "gap",
        "rank",
        "names",
    ):
        assert getattr(again, field) == getattr(basis, field)
    assert again.equations() == basis.equations()
    content = json.loads((tmp_path / "basis.json").read_text())
    assert content["schema"] == "adaptctl/fundamental-basis/2"
    assert content["regrouping"]["link6.I_yy"] == {"link6.I_xx": pytest.approx(-1.0)}


def damaged(content: dict[str, Any], *path: str, value: Any = None) -> dict[str, Any]:
    """The content with one element replaced, or removed."""
    inner = content
    for step in path[:-1]:
        inner = inner[step]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return content


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["schema"], "adaptctl/fundamental-basis/1", r"\$.schema`; expected one of 'adaptctl/fundamental-basis/2'"),
        (["robot", "geometry_sha256"], None, "`geometry_sha256` is missing"),
        (["rank"], 35, r"`\$.rank` is 35, but `\$.regrouping` keeps 36 parameters"),
        (["rank"], "many", r"got text - at `\$.rank`"),
        (["parameters", -1], "link1.m", r"\$.parameters`: a name is given more than once"),
        (["parameters", -1], "link7.m", r"\$.regrouping.link6.I_zz`: 'link6.I_zz' is not in `\$.parameters`"),
        (["regrouping", "link6.I_yy", "elbow"], 1.0, r"\$.regrouping.link6.I_yy`: 'elbow' is not in"),
        (
            ["regrouping", "link6.I_yy", "link6.I_zz"],
            1.0,
            r"\$.regrouping.link6.I_yy`: kept parameters cannot be regrouped",
        ),
        (
            ["regrouping", "link6.I_yy", "link6.I_yy"],
            2.0,
            r"\$.regrouping.link6.I_yy`: kept parameters cannot be regrouped",
        ),
        (["regrouping", "link6.I_yy"], "x", "expected a table, got text"),
        (["remark"], "mine", "unknown field `remark`; expected one of schema, robot, rank"),
        (["kept_despite_priority"], ["link1.m"], r"\$.kept_despite_priority`: 'link1.m' is not kept"),
        (["gap"], 1e9, r'the basis was changed; to accept it, write "sha256": "[0-9a-f]{64}"'),
        (["regrouping", "link6.I_yy", "link6.I_xx"], -1.0000001, "the basis was changed"),
        (["sha256"], None, "the basis was changed"),
        (["gap"], float("nan"), r"expected a finite number, got nan - at `\$.gap`"),
    ],
)
def test_damaged_files(basis: FundamentalBasis, tmp_path: Path, path: list[Any], value: Any, message: str) -> None:
    basis.save(tmp_path / "basis.json")
    content = json.loads((tmp_path / "basis.json").read_text())
    (tmp_path / "basis.json").write_text(json.dumps(damaged(content, *path, value=value)))
    with pytest.raises(FileError, match=r"basis\.json: .*" + message):
        FundamentalBasis.load(tmp_path / "basis.json")


def test_a_basis_that_was_changed_is_accepted_by_the_line_that_is_told(basis: FundamentalBasis, tmp_path: Path) -> None:
    basis.save(tmp_path / "basis.json")
    content = json.loads((tmp_path / "basis.json").read_text())
    content["regrouping"]["link6.I_yy"]["link6.I_xx"] = -1.5
    (tmp_path / "basis.json").write_text(json.dumps(content))
    with pytest.raises(FileError) as refused:
        FundamentalBasis.load(tmp_path / "basis.json")
    content["sha256"] = str(refused.value).split('"')[-2]
    (tmp_path / "basis.json").write_text(json.dumps(content))
    changed = FundamentalBasis.load(tmp_path / "basis.json")
    assert np.abs(changed.regrouping - basis.regrouping).max() == pytest.approx(0.5)


def test_flipped_files_are_refused_or_say_the_same(basis: FundamentalBasis, tmp_path: Path) -> None:
    basis.save(tmp_path / "basis.json")
    good, rng = (tmp_path / "basis.json").read_bytes(), np.random.default_rng(3)
    digits = np.flatnonzero([chr(byte).isdigit() for byte in good])
    refused = 0
    for place in rng.choice(digits, 60):
        flipped = bytearray(good)
        flipped[place] ^= 1 << rng.integers(3)  # most digits stay digits
        (tmp_path / "basis.json").write_bytes(flipped)
        try:
            assert FundamentalBasis.load(tmp_path / "basis.json").equations() == basis.equations()
        except FileError:
            refused += 1
    assert refused >= 55


def test_files_that_are_no_basis(basis: FundamentalBasis, tmp_path: Path) -> None:
    basis.save(tmp_path / "basis.json")
    half = (tmp_path / "basis.json").read_bytes()[:2000]
    for data in (b"", b"\xff\xfe", b"[]", half):
        (tmp_path / "broken.json").write_bytes(data)
        with pytest.raises(FileError, match=r"broken\.json"):
            FundamentalBasis.load(tmp_path / "broken.json")
    with pytest.raises(FileError, match="cannot be read"):
        FundamentalBasis.load(tmp_path / "none.json")
    with pytest.raises(FileError, match=r"the folder .* does not exist"):
        basis.save(tmp_path / "none" / "basis.json")


def test_columns_must_rise(basis: FundamentalBasis) -> None:
    content: dict[str, Any] = {
        "mechanism_name": "arm",
        "geometry_sha256": "",
        "parameter_names": ("a", "b"),
        "regrouping": np.eye(2),
        "scales": np.ones(2),
        "gap": 1e9,
    }
    for columns in ((1, 0), (0, 2), (-1, 0), (0, 0)):
        with pytest.raises(InputError, match=r"columns: expected ascending indices in 0\.\.1"):
            FundamentalBasis(columns=columns, **content)


def test_wrong_shapes(basis: FundamentalBasis) -> None:
    with pytest.raises(InputError, match=r"expected shape \(\.\.\., 60\), got \(36,\)"):
        basis.fundamental_parameters(np.zeros(36))
    with pytest.raises(InputError, match=r"expected shape \(\.\.\., 60\), got \(\)"):
        basis.fundamental_parameters(1.0)
    with pytest.raises(NonFiniteError, match=r"parameters: expected finite numbers, got nan at index \(3,\)"):
        basis.fundamental_parameters(np.where(np.arange(60) == 3, np.nan, 1.0))
    many: Array = basis.fundamental_parameters(np.ones((2, 3, 60)))
    assert many.shape == (2, 3, 36)


def test_round_off_in_the_energies_of_a_turned_world_is_no_damage(puma: Mechanism) -> None:
    """Joint 1 along a gravity that no axis is along: the energy of link 1's mass is constant but for round-off."""
    turn = Pose(scipy.spatial.transform.Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix(), np.zeros(3))
    first, *rest = puma.description.links
    links = (replace(first, parent_to_joint=turn @ first.parent_to_joint), *rest)
    turned = Mechanism(replace(puma.description, links=links, gravity=turn.rotation @ puma.description.gravity))
    found = fundamental_basis(essential_space(turned))
    validate_energies(turned, found)
    others = found.regrouping.copy()
    others[:, list(found.columns)] = 0.0
    row, column = np.argwhere(others)[0]
    damaged = found.regrouping.copy()
    damaged[row, column] += 0.1
    with pytest.raises(InputError, match="is wrong or damaged"):
        validate_energies(turned, replace(found, regrouping=damaged))


@pytest.mark.parametrize("seed", [20573, 20953])
def test_a_choice_within_round_off_of_another_is_named(seed: int) -> None:
    """Chains that miss a special geometry by 1e-10 and 3e-9: floats keep what exact arithmetic removes."""
    case = ranks.drawn(seed)
    H, mechanism = case.differences(seed), case.mechanism()
    names = mechanism.parameter_names
    priority = Priority(tuple(names[i] for i in np.random.default_rng(seed).permutation(H.shape[1]).tolist()))
    exact = independent(H, priority.indices(names)[::-1])
    basis = fundamental_basis(essential_space(mechanism), priority)
    kept = {names[j] for j in basis.columns} - {names[j] for j in exact}
    assert kept
    assert kept <= set(basis.kept_despite_priority)


def test_a_basis_keeps_a_copy_that_cannot_be_written(basis: FundamentalBasis) -> None:
    given = np.array(basis.regrouping)
    own = replace(basis, regrouping=given)
    given[0, 0] += 1.0
    np.testing.assert_array_equal(own.regrouping, basis.regrouping)
    assert not own.regrouping.flags.writeable


def test_a_default_order_gives_way_where_it_removes_parameters_that_nearly_depend() -> None:
    """An axis 0.1 deg off its link's frame; a tighter tolerance keeps to the order, a wider one is refused."""
    chain = random_chain(52, 3)
    links = [replace(link, joint=replace(link.joint, kind=JointKind.REVOLUTE)) for link in chain.links]
    space = essential_space(Mechanism(replace(chain.description, links=tuple(links), gravity=np.array([0, 0, -9.81]))))
    basis = fundamental_basis(space)
    assert basis.rank == space.rank
    assert basis.condition < 10.0
    assert fundamental_basis(space, tolerance=9e-4).kept_despite_priority == ()
    with pytest.raises(RankError, match="almost depend on each other"):
        fundamental_basis(space, tolerance=1.1e-3)
