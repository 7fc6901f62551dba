"""Known parameters and relations among them: fewer parameters, the same motion, kept to by whatever is built on top."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptationLaw,
    BoundedGainForgetting,
    Composite,
    CompositeLearning,
    ConcurrentLearning,
    CushionedFloor,
    Natural,
    ReferencePoint,
    SlotineLi,
)
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.constrained_mechanism import ConstrainedMechanism
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.errors import FileError, InputError, NotFoundError
from adaptctl.identifiability import (
    Constraints,
    EssentialSpace,
    Priority,
    ReducedModel,
    Relation,
    constrained,
    essential_space,
    fundamental_basis,
    random_states,
)
from adaptctl.scalars import column

HEAD = 'schema = "adaptctl/parameter-constraints/1"\n'


@cache
def arm(name: str) -> Mechanism:
    return load(name)


@cache
def space(name: str) -> EssentialSpace:
    return essential_space(arm(name))


def off_diagonal(mechanism: Mechanism) -> Array:
    """Rows A with A D = 0 just when all off-diagonal entries of the mass matrix vanish everywhere."""
    weightless = Mechanism(replace(mechanism.description, gravity=np.zeros(3)))
    p = random_states(mechanism, 200, np.random.default_rng(0)).p
    rows = []
    for j in range(1, mechanism.dof):
        a = 0.0 * p
        a[:, j] = 1.0
        rows += [weightless.torque_regressor(p, 0.0 * p, a)[:, i] for i in range(j)]
    _, values, right = np.linalg.svd(np.concatenate(rows), full_matrices=False)
    return right[: np.count_nonzero(values > 1e-9 * values[0])]


@pytest.mark.parametrize("seed", range(5))
def test_any_three_relations_make_26_into_23(seed: int) -> None:
    """Section 5.3 of Sheu and Walker (1991): relations among what matters take as many parameters away."""
    mechanism, whole = arm("semi_direct_drive"), space("semi_direct_drive")
    relations = np.random.default_rng(seed).normal(size=(3, 26)) @ whole.basis.T
    left = constrained(mechanism, Constraints.from_matrix(relations, mechanism.parameter_names))
    found = essential_space(left)
    assert found.rank == 23
    assert len(fundamental_basis(found).names) == 23
    assert np.abs(relations @ left.description.inertial_parameters).max() < 1e-10


@pytest.mark.parametrize(
    ("name", "relations", "rank"), [("semi_direct_drive_parallelogram", 6, 12), ("semi_direct_drive", 10, 16)]
)
def test_decoupled_arms(name: str, relations: int, rank: int) -> None:
    """Every off-diagonal inertia zero: 6 relations leave 12 of the parallelogram's 18, 10 leave 16 of 26."""
    mechanism = arm(name)
    rows = off_diagonal(mechanism)
    assert len(rows) == relations
    decoupled = constrained(mechanism, Constraints.from_matrix(rows, mechanism.parameter_names))
    assert essential_space(decoupled).rank == rank == space(name).rank - relations
    M = decoupled.mass_matrix(random_states(mechanism, 50, np.random.default_rng(1)).p)
    assert np.abs(M - M * np.eye(3)).max() < 1e-12 * np.abs(M).max()


def test_known_zeros_only_leave_columns_out() -> None:
    """Symmetric tubes have no first moment or product of inertia off their axis."""
    mechanism = arm("semi_direct_drive")
    zeros = {f"link{i}.{kind}": 0.0 for i in range(2, 6) for kind in ("mc_y", "I_xy", "I_yz")}
    known = constrained(mechanism, Constraints(zeros))
    assert set(known.parameter_names) == set(mechanism.parameter_names) - set(zeros)
    basis = fundamental_basis(essential_space(known))
    assert basis.rank < 26
    p, v, a = np.random.default_rng(0).normal(size=(3, 3)) * 0.1 + [0.0, -1.5, -3.0]
    model = ReducedModel(known, basis)
    whole = [mechanism.parameter_names.index(name) for name in basis.names]
    np.testing.assert_array_equal(model.torque_regressor(p, v, a), mechanism.torque_regressor(p, v, a, whole))
    torque = mechanism.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(model.inverse_dynamics(p, v, a), torque, rtol=0, atol=1e-10 * np.abs(torque).max())


def case(seed: int, links: int) -> tuple[Mechanism, Constraints]:
    """A random tree, a known value and two relations that its own parameters keep."""
    mechanism, rng = random_tree(seed, links), np.random.default_rng(seed)
    names, D = mechanism.parameter_names, mechanism.inertial_parameters
    chosen = [names[i] for i in rng.permutation(len(names))[:7]]
    value = dict(zip(names, D.tolist(), strict=True))
    weights = rng.uniform(0.5, 2.0, 6).tolist()
    relations = (
        dict(zip(chosen[:3], weights[:3], strict=True)),
        dict(zip(chosen[2:6], weights[2:], strict=True)),
    )
    sums = [sum(w * value[name] for name, w in relation.items()) for relation in relations]
    pairs = zip(relations, sums, strict=True)
    return mechanism, Constraints({chosen[6]: value[chosen[6]]}, tuple(Relation(w, x) for w, x in pairs))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 5))
def test_the_same_motion_on_three_parameters_less(seed: int, links: int) -> None:
    mechanism, constraints = case(seed, links)
    left = constrained(mechanism, constraints)
    assert len(left.parameter_names) == len(mechanism.parameter_names) - 3
    np.testing.assert_allclose(left.description.inertial_parameters, mechanism.inertial_parameters, atol=1e-10)
    p, v, a, torque = np.random.default_rng(seed).normal(size=(4, 5, mechanism.dof))
    expected = mechanism.inverse_dynamics(p, v, a)
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(left.inverse_dynamics(p, v, a), expected, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(left.energy(p, v), mechanism.energy(p, v), rtol=0, atol=1e-9 * scale)
    known = left.constraint_bias_torque(p, v, a)
    by_regressor = left.torque_regressor(p, v, a) @ left.inertial_parameters + known
    np.testing.assert_allclose(by_regressor, expected, rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(left.mass_matrix(p), mechanism.mass_matrix(p), rtol=0, atol=1e-9 * scale)
    error = left.forward_dynamics(p, v, torque) - mechanism.forward_dynamics(p, v, torque)
    assert np.abs(error).max() < 1e-8 * max(1.0, np.linalg.cond(mechanism.mass_matrix(p)).max())


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 5))
def test_regressors_are_derivatives_by_what_is_left(seed: int, links: int) -> None:
    """Torques and energies are affine in the parameters, so a difference is exact at any step."""
    mechanism, constraints = case(seed, links)
    left, rng = constrained(mechanism, constraints), np.random.default_rng(seed)
    p, v, v_r, a, s = rng.normal(size=(5, mechanism.dof))
    z, way = left.inertial_parameters, rng.normal(size=len(left.parameter_names))
    e = left.equations
    columns = list(map(column, (p, v, v_r, a)))
    one, other = (np.array(e.inverse_dynamics(*columns, column(x)).of) for x in (z + way, z))
    Y = left.slotine_li_regressor(p, v, v_r, a)
    scale = max(1.0, np.abs(one).max(), np.abs(Y).max() * np.abs(way).max())
    np.testing.assert_allclose(Y @ way, one - other, rtol=0, atol=1e-10 * scale)
    motion = e.motion(*columns)
    powers = motion.regressor_transpose_product(column(s), range(len(z)))
    np.testing.assert_allclose(motion.torque(column(z)).of, other, rtol=0, atol=1e-10 * scale)
    np.testing.assert_allclose(powers.of, Y.T @ s, rtol=0, atol=1e-10 * scale * max(1.0, np.abs(s).max()))
    again = e.restored_motion(motion.numbers)
    assert len(motion.numbers) == len(e.motion_memory.sources)
    assert again.regressor_transpose_product(column(s), range(len(z))).of == powers.of
    asked = sorted(rng.permutation(len(z))[:4].tolist())
    np.testing.assert_array_equal(left.slotine_li_regressor(p, v, v_r, a, asked), Y[:, asked])
    moved = left.with_parameters(z + way)
    np.testing.assert_allclose(moved.inertial_parameters, z + way, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        moved.inverse_dynamics(p, v, a),
        left.whole.with_parameters(left.parametrisation.expanded(z + way)).inverse_dynamics(p, v, a),
        rtol=0,
        atol=1e-10 * scale,
    )


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6))
def test_a_basis_under_constraints_gives_the_whole_torque(seed: int) -> None:
    mechanism, constraints = case(seed, 3)
    left = constrained(mechanism, constraints)
    model = ReducedModel(left)
    p, v, a = np.random.default_rng(seed).normal(size=(3, 4, 3))
    expected = mechanism.inverse_dynamics(p, v, a)
    actual = model.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-8 * max(1.0, np.abs(expected).max()))


def test_the_controller_keeps_to_the_relations() -> None:
    """Slotine and Li on 23 parameters: on the true ones it gives what 26 give, and learning stays within the 23."""
    mechanism, whole = arm("semi_direct_drive"), space("semi_direct_drive")
    D = mechanism.inertial_parameters
    rows = np.random.default_rng(0).normal(size=(3, 26)) @ whole.basis.T
    left = constrained(mechanism, Constraints.from_matrix(rows, mechanism.parameter_names, rows @ D))
    models = [ReducedModel(m) for m in (mechanism, left)]
    assert [len(model.columns) for model in models] == [26, 23]
    p, v = np.array([0.1, -1.4, -3.0]), np.array([0.3, -0.2, 0.5])
    reference = ReferencePoint(p + 0.05, v - 0.1, np.array([1.0, 2.0, -1.0]))
    torques = []
    for model in models:
        gains = {"bandwidth": 10.0, "damping": 5.0, "adaptation": np.ones(len(model.columns))}
        controller = SlotineLi(model, initial=model.fundamental_parameters, **gains)
        state = controller.init(p, v)
        torque, state = controller.step(state, p, v, reference)
        later, state = controller.step(state, p, v, reference)
        assert np.isfinite(later).all()
        assert np.abs(state.estimate - model.fundamental_parameters).max() > 1e-6
        torques.append(torque)
    np.testing.assert_allclose(torques[1], torques[0], rtol=1e-9)


def test_relations_that_take_unwanted_parameters_first() -> None:
    """By the priority: of two masses that are equal, the one to be removed first goes."""
    mechanism = arm("semi_direct_drive")
    equal = Constraints(relations=(Relation({"link4.m": 1.0, "link5.m": -1.0}),))
    assert "link4.m" not in constrained(mechanism, equal).parameter_names
    reverse = Priority(("link5.m", "link4.m"))
    names = constrained(mechanism, equal, reverse).parameter_names
    assert "link5.m" not in names
    assert "link4.m" in names


def test_what_follows_from_others_is_left_out_and_what_contradicts_them_refused() -> None:
    mechanism = arm("semi_direct_drive")
    one = Relation({"link4.m": 1.0, "link5.m": -1.0}, 0.5, "fork")
    twice = Relation({"link4.m": 2.0, "link5.m": -2.0}, 1.0)
    assert len(constrained(mechanism, Constraints(relations=(one, twice))).parameter_names) == 49
    against = Relation({"link4.m": 2.0, "link5.m": -2.0}, 3.0, "spoon")
    with pytest.raises(InputError, match=r"relation 'spoon' contradicts those before it, from which its value is 1$"):
        constrained(mechanism, Constraints(relations=(one, against)))
    with pytest.raises(InputError, match=r"relation 'fork' contradicts those before it, from which its value is 1\.5$"):
        constrained(mechanism, Constraints({"link5.m": 0.5, "link4.m": 2.0}, (one,)))


def test_a_zero_of_either_sign_is_the_same_geometry() -> None:
    one = constrained(arm("semi_direct_drive"), Constraints({"link5.m": 1.0}))
    given = one.parametrisation
    matrix, known = (np.where(values == 0.0, -0.0, values) for values in (given.matrix, given.known))
    other = ConstrainedMechanism(one.whole, replace(given, matrix=matrix, known=known))
    assert one.geometry_sha256 == other.geometry_sha256


def test_nothing_known_changes_nothing() -> None:
    mechanism = arm("semi_direct_drive")
    same = constrained(mechanism, Constraints())
    assert same.parameter_names == mechanism.parameter_names
    assert essential_space(same).rank == 26


def test_a_basis_belongs_to_its_constraints() -> None:
    mechanism = arm("semi_direct_drive")
    left = constrained(mechanism, Constraints({"link5.m": 1.0}))
    with pytest.raises(InputError, match="the basis is that of 'semi_direct_drive'"):
        ReducedModel(left, fundamental_basis(space("semi_direct_drive")))
    other = constrained(mechanism, Constraints({"link5.m": 2.0}))
    assert len({m.geometry_sha256 for m in (mechanism, left, other)}) == 3
    with pytest.raises(InputError, match="is constrained already; give all relations in one call"):
        constrained(left, Constraints({"link4.m": 1.0}))


def test_momenta_need_to_know_no_offset() -> None:
    mechanism = arm("semi_direct_drive")
    q = mechanism.configuration([0.0, -1.5, -3.0])
    for value in (0.0, 1.0):
        left = constrained(mechanism, Constraints({"link5.m": value}))
        columns = range(len(left.parameter_names))
        if value:
            with pytest.raises(InputError, match="needs constraints that set parameters to zero"):
                momentum_terms(left.equations, column(q), column(np.ones(3)), columns)
        else:
            terms = momentum_terms(left.equations, column(q), column(np.ones(3)), columns)
            momentum = np.array([row.of for row in terms.momentum], dtype=float) @ left.inertial_parameters
            np.testing.assert_allclose(momentum, left.mass_matrix([0.0, -1.5, -3.0]) @ np.ones(3), rtol=1e-10)


def constrained_at(name: str, value: float) -> ReducedModel:
    return ReducedModel.full(constrained(arm("puma560_geared"), Constraints({name: value})))


@pytest.mark.parametrize(
    ("kind", "called"),
    [
        (Composite, "composite"),
        (BoundedGainForgetting, "bounded-gain forgetting"),
        (CushionedFloor, "cushioned floor"),
        (CompositeLearning, "composite learning"),
        (ConcurrentLearning, "concurrent learning"),
    ],
)
def test_a_law_that_predicts_torques_names_the_values_that_it_cannot_know(
    kind: Callable[[Array], AdaptationLaw], called: str
) -> None:
    """Filtered torques have no column for what constraints fix at another value than zero."""
    zero, known = (constrained_at("link2.mc_z", value) for value in (0.0, 0.5))
    law, none = kind(np.ones(len(zero.columns))), np.zeros(len(zero.columns))
    law.validate(zero, none, 1e-3)
    with pytest.raises(
        InputError, match=rf"^{called}: puma560_geared: constraints fix .*: link2.mc_z \(0\.5\)\. Remove"
    ):
        law.validate(known, none, 1e-3)


def test_natural_adaptation_needs_all_ten_parameters_of_every_link() -> None:
    model = constrained_at("link2.mc_z", 0.0)
    with pytest.raises(InputError, match=r"^natural adaptation: adapts .* remove link2\.mc_z: remove"):
        Natural(0.1).validate(model, model.mechanism.inertial_parameters, 1e-3)
    model = constrained_at("joint1.rotor_inertia", 0.2)
    Natural(0.1).validate(model, model.mechanism.inertial_parameters, 1e-3)


def reading(folder: Path, text: str) -> Constraints:
    (folder / "c.toml").write_text(text)
    return Constraints.read(folder / "c.toml")


def test_a_file_says_what_python_says(tmp_path: Path) -> None:
    text = """
[known]
link2.mc_z = 0.5
"link3.mc_z" = -0.25

[[relations]]
name = "forks"
weights = { link4.m = 1.0, "link5.m" = -1.0, link4.I_zz = 2.0 }
value = 0.1

[[relations]]
weights = { link1.m = 1.0 }
"""
    constraints = reading(tmp_path, HEAD + text)
    assert dict(constraints.known) == {"link2.mc_z": 0.5, "link3.mc_z": -0.25}
    forks, alone = constraints.relations
    assert dict(forks.weights) == {"link4.m": 1.0, "link4.I_zz": 2.0, "link5.m": -1.0}
    assert (forks.name, forks.value, alone.value) == ("forks", 0.1, 0.0)
    assert len(constrained(arm("semi_direct_drive"), constraints).parameter_names) == 46


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"`schema` is missing"),
        (HEAD + "konwn = {}", "unknown field `konwn`; expected one of schema, known, relations"),
        (HEAD + "known = { a.m = 'x' }", "expected a number, got text"),
        (HEAD + "known = { a.m = nan }", r"expected a finite number, got nan - at `\$.known.a.m`"),
        (HEAD + "relations = [{ value = 1 }]", r"`weights` is missing - at `\$.relations\[0\]`"),
        (HEAD + "relations = [{ name = 'x', weights = {} }]", "relation 'x': expected finite weights, not all zero"),
        (HEAD + "relations = [{ weights = { a.m = 0 } }]", r"relation 0 a\.m = 0: expected finite weights"),
        (HEAD + "[[relations]]\nweights = { a.m = 1 }\n" * 1001, "length <= 1000"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=r"c\.toml: (?s:.*)" + message):
        reading(tmp_path, text)


def test_wrong_constraints() -> None:
    mechanism = arm("semi_direct_drive")
    with pytest.raises(NotFoundError, match=r"unknown inertial parameter 'link2\.mcz'; did you mean 'link2\.mc_.'"):
        constrained(mechanism, Constraints({"link2.mcz": 0.0}))
    with pytest.raises(NotFoundError, match=r"relation 1 elbow = 0: .* 'elbow'; known names: link1\.m, link1\.mc_x"):
        constrained(mechanism, Constraints(relations=(Relation({"elbow": 1.0}),)))
    with pytest.raises(InputError, match=r"expected a matrix \(m, 50\) and values \(m,\), got \(3, 49\)"):
        Constraints.from_matrix(np.ones((3, 49)), mechanism.parameter_names)
    with pytest.raises(InputError, match="relation 1 a = inf: expected finite weights"):
        Relation({"a": 1.0}, np.inf)
    for known in ("a", None, [1.0]):
        with pytest.raises(InputError, match=r"known: 'link1\.m': expected a number, got "):
            Constraints({"link1.m": known})  # type: ignore[dict-item]
    with pytest.raises(InputError, match="relations: expected Relations, got 'link1'"):
        Constraints(relations=("link1",))  # type: ignore[arg-type]


def test_a_relation_is_with_zero_unless_a_value_is_given() -> None:
    """Nothing is known then, and no torque stems from it."""
    mechanism, weights = arm("semi_direct_drive"), {"link2.mc_x": 1.0, "link3.mc_x": -2.0}
    p, v, a = mechanism.neutral_configuration, np.zeros(3), np.ones(3)
    for relation, known in ((Relation(weights), False), (Relation(weights, value=1.0), True)):
        left = constrained(mechanism, Constraints(relations=(relation,)))
        assert left.constraint_bias_torque(p, v, a).any() == known


def test_a_dict_of_known_values_is_no_constraints() -> None:
    with pytest.raises(
        InputError, match=r"expected a Constraints, as Constraints\(\{\.\.\.\}\) is one, got \{'link3.m': 2.0\}"
    ):
        constrained(load("puma560_measured"), {"link3.m": 2.0})  # type: ignore[arg-type]
