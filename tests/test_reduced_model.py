"""The reduced model: the same dynamics on fewer columns, for any inertial values of one geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from robot_files import urdf

from adaptctl.arrays import Array
from adaptctl.description import Limits, Pose
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import InputError
from adaptctl.identifiability import FundamentalBasis, ReducedModel, essential_space, fundamental_basis


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_measured")


@pytest.fixture(scope="module")
def basis(puma: Mechanism) -> FundamentalBasis:
    return fundamental_basis(essential_space(puma))


@pytest.fixture(scope="module")
def model(puma: Mechanism, basis: FundamentalBasis) -> ReducedModel:
    return ReducedModel(puma, basis)


def motions(count: int) -> Array:
    return np.random.default_rng(9).normal(size=(4, count, 6))


def test_the_same_torques_on_36_columns(puma: Mechanism, model: ReducedModel) -> None:
    p, v, v_r, a = motions(1000)
    beta = model.fundamental_parameters
    expected = puma.inverse_dynamics(p, v, a)
    scale = np.abs(expected).max()
    assert model.torque_regressor(p, v, a).shape == (1000, 6, 36)
    assert np.abs(model.torque_regressor(p, v, a) @ beta - expected).max() < 1e-13 * scale
    assert np.abs(model.inverse_dynamics(p, v, a) - expected).max() < 1e-13 * scale
    slotine = puma.slotine_li_regressor(p, v, v_r, a) @ puma.inertial_parameters
    assert np.abs(model.slotine_li_regressor(p, v, v_r, a) @ beta - slotine).max() < 1e-13 * np.abs(slotine).max()


def test_columns_are_chosen_and_never_combined(puma: Mechanism, model: ReducedModel) -> None:
    p, v, v_r, a = motions(5)
    kept = list(model.columns)
    assert kept == sorted(kept)
    assert model.names == tuple(puma.parameter_names[j] for j in kept)
    np.testing.assert_array_equal(model.torque_regressor(p, v, a), puma.torque_regressor(p, v, a)[..., kept])
    both = (model.slotine_li_regressor(p, v, v_r, a), puma.slotine_li_regressor(p, v, v_r, a)[..., kept])
    np.testing.assert_array_equal(*both)


def test_any_estimate_of_the_fundamental_parameters(puma: Mechanism, model: ReducedModel) -> None:
    p, v, _, a = motions(7)
    beta = np.random.default_rng(1).normal(size=36)
    embedded = puma.with_parameters(model.embed(beta))
    np.testing.assert_allclose(model.inverse_dynamics(p, v, a, beta), embedded.inverse_dynamics(p, v, a), atol=1e-12)
    each = np.random.default_rng(2).normal(size=(7, 36))
    rows = [model.inverse_dynamics(*x) for x in zip(p, v, a, each, strict=True)]
    np.testing.assert_allclose(model.inverse_dynamics(p, v, a, each), rows, atol=1e-12)


def test_embedding_is_undone_by_regrouping(model: ReducedModel) -> None:
    beta = np.random.default_rng(3).normal(size=(2, 5, 36))
    embedded = model.embed(beta)
    assert embedded.shape == (2, 5, 60)
    np.testing.assert_array_equal(embedded @ model.regrouping.T, beta)
    assert np.count_nonzero(embedded) == beta.size


def test_the_full_model_is_treated_alike(puma: Mechanism) -> None:
    full = ReducedModel.full(puma)
    p, v, _, a = motions(4)
    assert full.columns == tuple(range(60))
    assert full.names == puma.parameter_names
    np.testing.assert_array_equal(full.regrouping, np.eye(60))
    np.testing.assert_array_equal(full.fundamental_parameters, puma.inertial_parameters)
    np.testing.assert_array_equal(full.torque_regressor(p, v, a), puma.torque_regressor(p, v, a))
    np.testing.assert_array_equal(full.embed(puma.inertial_parameters), puma.inertial_parameters)
    np.testing.assert_allclose(full.inverse_dynamics(p, v, a), puma.inverse_dynamics(p, v, a), rtol=1e-12, atol=1e-12)


@pytest.mark.filterwarnings("ignore::adaptctl.errors.PhysicalConsistencyWarning")
def test_a_basis_serves_all_arms_of_one_geometry(puma: Mechanism, basis: FundamentalBasis) -> None:
    other = load("puma560")
    assert other.description.sha256 != puma.description.sha256
    assert other.description.geometry_sha256 == puma.description.geometry_sha256
    assert ReducedModel(other, basis).columns == fundamental_basis(essential_space(other)).columns
    heavier = puma.with_parameters(2.0 * puma.inertial_parameters)
    np.testing.assert_allclose(
        ReducedModel(heavier, basis).fundamental_parameters, 2.0 * ReducedModel(puma, basis).fundamental_parameters
    )


def changed(puma: Mechanism, what: str) -> Mechanism:
    first, second, *rest = puma.links
    far = Pose(second.joint_to_link.rotation, second.joint_to_link.translation + np.array([1e-6, 0.0, 0.0]))
    links = {
        "length": (first, replace(second, joint_to_link=far), *rest),
        "name": (first, replace(second, name="upper arm"), *rest),
        "limits": (first, replace(second, joint=replace(second.joint, limits=Limits(-1.0, 1.0))), *rest),
    }.get(what, puma.links)
    gravity = np.array([0.0, 0.0, -1.62]) if what == "gravity" else puma.description.gravity
    return Mechanism(replace(puma.description, links=links, gravity=gravity))


@pytest.mark.parametrize(("what", "matters"), [("length", True), ("name", True), ("gravity", True), ("limits", False)])
def test_what_makes_another_geometry(puma: Mechanism, basis: FundamentalBasis, what: str, matters: bool) -> None:
    other = changed(puma, what)
    assert (other.description.geometry_sha256 != puma.description.geometry_sha256) == matters
    if matters:
        with pytest.raises(InputError, match="the basis is that of 'puma560_measured', whose geometry"):
            ReducedModel(other, basis)
    else:
        assert ReducedModel(other, basis).columns == basis.columns


@pytest.mark.parametrize(("off", "matters"), [(1e-15, False), (1e-6, True)])
def test_round_off_in_loops_makes_no_other_geometry(off: float, matters: bool) -> None:
    arm = load("semi_direct_drive").description
    loops = arm.loops
    assert loops is not None
    frame = loops.closures[0].first_frame
    closure = replace(loops.closures[0], first_frame=Pose(frame.rotation, frame.translation + off))
    others = (
        replace(loops, closures=(closure, *loops.closures[1:])),
        replace(loops, reference={name: q + off for name, q in loops.reference.items()}),
        replace(loops, conditions=tuple(replace(c, lower=c.lower + off) for c in loops.conditions)),
    )
    for other in (replace(arm, loops=loops) for loops in others):
        assert other.sha256 != arm.sha256
        assert (other.geometry_sha256 != arm.geometry_sha256) == matters


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
def test_a_basis_of_another_robot_is_refused(basis: FundamentalBasis) -> None:
    ur5 = Mechanism.from_pinocchio(pinocchio.buildModelFromUrdf(str(urdf("ur5_robot.urdf"))))
    with pytest.raises(InputError, match="compute the basis of 'ur5'"):
        ReducedModel(ur5, basis)


def test_wrong_shapes(model: ReducedModel) -> None:
    with pytest.raises(InputError, match=r"base parameters: expected shape \(\.\.\., 36\), got \(60,\)"):
        model.embed(np.zeros(60))
    with pytest.raises(InputError, match=r"expected shape \(\.\.\., 36\), got \(\)"):
        model.inverse_dynamics(np.zeros(6), np.zeros(6), np.zeros(6), 1.0)
    with pytest.raises(InputError, match=r"p: expected shape \(\.\.\., 6\), got \(5,\)"):
        model.torque_regressor(np.zeros(5), np.zeros(6), np.zeros(6))
