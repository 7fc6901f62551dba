"""Mechanisms with loops: closure, Jacobian, its rate, energies and torques, against differences, dual numbers,
Lagrange multipliers and closed forms, on random loops of every kind."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import at_night
from random_loops import RECIPES, equations, gap_rates, gaps, random_loop

from adaptctl.arrays import Array
from adaptctl.compilation import compile_function
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.segment import placements
from adaptctl.errors import InputError
from adaptctl.scalars import Column, Dual, column

SEEDS = range(2)
"""As many loops of each kind as examples, so that all that is claimed is of the same ones, built and compiled once."""
seeds = st.sampled_from(SEEDS)
LONG = ("spatial weld", "two spatial loops")
"""Kinds that take half the time, of which there is a plane one and one of one loop"""


def kinds(names: Iterable[str]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", [at_night(name) if name in LONG else name for name in names])


every_kind = kinds(sorted(RECIPES))
every_closure = kinds(name for name, recipe in RECIPES.items() if not recipe.gears)


def moved(mechanism: Mechanism, q: Array, rng: np.random.Generator) -> Array:
    """Primary positions a little away, as far as the loops can go without locking."""
    start, way = q[list(mechanism.description.primary)], rng.uniform(-1.0, 1.0, mechanism.dof)
    assert mechanism.continuation is not None
    for size in (0.3, 0.1, 0.03, 0.01):
        if mechanism.continuation.progress(start + size * way[None], 0.2)[0] == 1.0:
            return start + size * way
    return start


@cache
def case(name: str, seed: int) -> tuple[Mechanism, Array, Array, Array]:
    """A mechanism, primary positions, and the closed configuration there; velocities and accelerations (4, r)."""
    mechanism, q = random_loop(seed, RECIPES[name])
    rng = np.random.default_rng(seed)
    p = moved(mechanism, q, rng)
    return mechanism, p, mechanism.configuration(p), rng.normal(size=(4, mechanism.dof))


def along(values: Array, slopes: Array) -> Column:
    """Dual numbers."""
    return Column(Dual(x, dx) for x, dx in zip(values.tolist(), slopes.tolist(), strict=True))


def slopes(entries: Column | list[object]) -> Array:
    return np.array([x.slope if isinstance(x, Dual) else 0.0 for x in entries])


def floats(entries: Column) -> Array:
    return np.array(entries.of, dtype=float)


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_closed_to_round_off_and_primary_joints_where_asked(name: str, seed: int) -> None:
    mechanism, p, q, _ = case(name, seed)
    assert np.abs(gaps(mechanism.description, q)).max() < 1e-12
    np.testing.assert_array_equal(q[list(mechanism.description.primary)], p)


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_following_there_and_back_ends_where_it_began(name: str, seed: int) -> None:
    mechanism, p, q, _ = case(name, seed)
    assert mechanism.continuation is not None
    reference = mechanism.continuation.reference
    back = mechanism.configuration(reference[list(mechanism.description.primary)], start=q)
    np.testing.assert_allclose(back, reference, rtol=0, atol=1e-11)
    np.testing.assert_allclose(mechanism.configuration(np.stack([p, p])), np.stack([q, q]), rtol=0, atol=1e-12)


def test_where_a_configuration_is_followed_from_is_checked_of_trees_too() -> None:
    arm = load("puma560_measured")
    np.testing.assert_array_equal(arm.configuration(np.ones(6), start=np.zeros(6)), np.ones(6))
    for mechanism, r in ((arm, 6), (load("semi_direct_drive"), 3)):
        for start in ("nowhere", np.zeros(4)):
            with pytest.raises(InputError, match=f"{mechanism.name}: start: expected "):
                mechanism.configuration(np.zeros(r), start=start)


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_the_constraints_jacobian_is_that_of_the_poses(name: str, seed: int) -> None:
    """Rows in the frame of the first link, of independent rows only: the same null space as all rows together."""
    mechanism, _, q, _ = case(name, seed)
    tree = placements(equations(mechanism).links, column(q))
    J = np.array([c.of for c in equations(mechanism).closing.jacobian(tree)], dtype=float).T
    expected = gap_rates(mechanism.description, q)
    null = np.linalg.svd(J)[2][len(J) :].T
    assert np.abs(expected @ null).max() < 1e-7
    assert np.linalg.matrix_rank(expected, 1e-6) == len(J)


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_velocities_are_the_slope_of_the_configuration(name: str, seed: int) -> None:
    """J v against dual numbers through Newton's steps, and against differences of U."""
    mechanism, p, q, (v, *_) = case(name, seed)
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    dual = slopes(equations(mechanism).closed(along(p, v), column(q)))
    np.testing.assert_allclose(dual, u, rtol=0, atol=1e-11 * max(1.0, np.abs(u).max()))
    h = 1e-5
    ahead, behind = (floats(equations(mechanism).closed(column(p + s * v), column(q))) for s in (h, -h))
    np.testing.assert_allclose((ahead - behind) / (2 * h), u, rtol=0, atol=1e-6 * max(1.0, np.abs(u).max()) ** 3)


@every_kind
@pytest.mark.parametrize("seed", SEEDS)
def test_every_loop_that_can_be_drawn_moves(name: str, seed: int) -> None:
    """Where it stood still, what follows would compare nothing with nothing."""
    mechanism, _, q, (v, w, *_) = case(name, seed)
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    assert np.abs(np.delete(u, mechanism.description.primary)).max() > 1e-3
    if RECIPES[name].closures:
        curving = slopes(equations(mechanism).joint_velocities(along(q, u), column(w)))
        assert np.abs(curving).max() > 1e-3


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_bias_is_the_rate_of_the_jacobian(name: str, seed: int) -> None:
    """J_dot(v) w by dual numbers along J v, for any w; symmetric in v and w."""
    mechanism, p, q, (v, w, *_) = case(name, seed)
    posture = equations(mechanism).posture(column(q))
    u, y = posture.tree(column(v)), posture.tree(column(w))
    bias = floats(posture.bias(u, y))
    expected = slopes(equations(mechanism).joint_velocities(along(q, floats(u)), column(w)))
    scale = max(1.0, np.abs(expected).max(), np.abs(floats(u)).max() * np.abs(floats(y)).max())
    np.testing.assert_allclose(bias, expected, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(bias, floats(posture.bias(y, u)), rtol=0, atol=1e-12 * scale)
    h = 1e-5
    forth, back = (
        floats(
            equations(mechanism).joint_velocities(equations(mechanism).closed(column(p + s * v), column(q)), column(w))
        )
        for s in (h, -h)
    )
    np.testing.assert_allclose((forth - back) / (2 * h), bias, rtol=0, atol=1e-5 * scale**2)


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_the_rate_of_energy_is_the_power_of_the_torques(name: str, seed: int) -> None:
    """For every parameter by itself: dE/dt = v' Y."""
    mechanism, p, q, (v, a, *_) = case(name, seed)
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    rates = slopes(equations(mechanism).energy_regressor(along(q, u), along(v, a)))
    power = v @ mechanism.torque_regressor(p, v, a)
    assert np.abs(rates - power).max() < 1e-11 * max(1.0, np.abs(power).max())


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_coriolis_is_symmetric_and_leaves_mass_rate_skew(name: str, seed: int) -> None:
    mechanism, p, q, (v, w, s, _) = case(name, seed)
    zero, D = 0.0 * v, mechanism.inertial_parameters
    gravity = mechanism.inverse_dynamics(p, zero, zero)
    forward = mechanism.slotine_li_regressor(p, v, w, zero) @ D
    backward = mechanism.slotine_li_regressor(p, w, v, zero) @ D
    assert np.abs(forward - backward).max() < 1e-11 * max(1.0, np.abs(forward).max())
    coriolis = mechanism.slotine_li_regressor(p, v, s, zero) @ D - gravity
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    rows = equations(mechanism).mass_matrix(along(q, u), column(D))
    rate = s @ np.array([slopes(row) for row in rows]) @ s
    size = max(1.0, abs(rate), np.abs(s @ mechanism.mass_matrix(p) @ s), np.abs(coriolis).max())
    assert abs(rate - 2.0 * s @ coriolis) < 1e-11 * size


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_kinetic_energy_mass_matrix_and_regressors_agree(name: str, seed: int) -> None:
    mechanism, p, q, (v, a, w, s) = case(name, seed)
    zero, D = 0.0 * v, mechanism.inertial_parameters
    M = mechanism.mass_matrix(p)
    np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-12 * np.abs(M).max())
    assert np.linalg.eigvalsh(M)[0] > 0.0
    kinetic = mechanism.energy(p, v) - mechanism.energy(p, zero)
    assert kinetic == pytest.approx(0.5 * v @ M @ v, rel=1e-10)
    torque = mechanism.inverse_dynamics(p, v, a)
    np.testing.assert_allclose(
        mechanism.torque_regressor(p, v, a) @ D, torque, rtol=0, atol=1e-11 * np.abs(torque).max()
    )
    error = np.abs(mechanism.forward_dynamics(p, v, torque) - a).max()
    assert error < 1e-11 * np.linalg.cond(M) * max(1.0, np.abs(torque).max() / np.abs(M).max())
    Y = mechanism.slotine_li_regressor(p, v, w, a)
    motion = equations(mechanism).motion(*map(column, (q, v, w, a)))
    torque, powers = (
        floats(motion.torque(column(D))),
        floats(motion.regressor_transpose_product(column(s), range(len(D)))),
    )
    np.testing.assert_allclose(torque, Y @ D, rtol=0, atol=1e-11 * np.abs(Y @ D).max())
    np.testing.assert_allclose(powers, Y.T @ s, rtol=0, atol=1e-11 * np.abs(Y).max() * np.abs(s).max())
    again = equations(mechanism).restored_motion(motion.numbers)
    assert len(motion.numbers) == len(equations(mechanism).motion_memory.sources)
    np.testing.assert_array_equal(floats(again.regressor_transpose_product(column(s), range(len(D)))), powers)


def by_projection(mechanism: Mechanism, q: Array, v: Array, torque: Array) -> Array:
    """Tree accelerations from Pinocchio's mass matrix and bias forces, projected onto the motions that the poses
    leave free, where multipliers do no work. The constraints' Jacobian and second rate are differences of poses."""
    model, h = mechanism.to_pinocchio(), 1e-3
    data = model.createData()
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    M = pinocchio.crba(model, data, q).copy()
    M = np.triu(M) + np.triu(M, 1).T
    J = gap_rates(mechanism.description, q)
    weights = zip((-1 / 12, 4 / 3, -5 / 2, 4 / 3, -1 / 12), (-2, -1, 0, 1, 2), strict=True)
    curvature = sum(weight * gaps(mechanism.description, q + s * h * u) for weight, s in weights) / (h * h)
    drift = -np.linalg.pinv(J, rcond=1e-6) @ curvature
    free = np.linalg.svd(J)[2][len(q) - mechanism.dof :].T
    driven = np.zeros(len(q))
    driven[list(mechanism.description.primary)] = torque
    force = driven - pinocchio.nonLinearEffects(model, data, q, u) - M @ drift
    return drift + free @ np.linalg.solve(free.T @ M @ free, free.T @ force)


@every_kind
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_accelerations_are_those_of_constrained_motion(name: str, seed: int) -> None:
    """To 1e-6 of the accelerations and of the velocities' squares, which is what differences allow."""
    mechanism, p, q, (v, torque, *_) = case(name, seed)
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    a = mechanism.forward_dynamics(p, v, torque)
    expected = by_projection(mechanism, q, v, torque)
    scale = max(1.0, np.abs(expected).max(), np.abs(u).max() ** 2)
    assert np.abs(a - expected[list(mechanism.description.primary)]).max() < 1e-6 * scale


def pinocchios(mechanism: Mechanism, q: Array, u: Array, torque: Array) -> Array:
    """Tree accelerations by Pinocchio's own constrained dynamics, which finds its own Jacobian and drift."""
    model, models = mechanism.to_pinocchio(), pinocchio.StdVec_RigidConstraintModel()
    models.extend(mechanism.to_pinocchio_constraints())
    datas = pinocchio.StdVec_RigidConstraintData()
    datas.extend([m.createData() for m in models])
    data, driven = model.createData(), np.zeros(model.nv)
    driven[list(mechanism.description.primary)] = torque
    pinocchio.initConstraintDynamics(model, data, models, datas)
    proximal = pinocchio.ProximalSettings(1e-15, 1e-9, 200)
    return pinocchio.constraintDynamics(model, data, q, u, driven, models, datas, proximal)


@every_closure
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_accelerations_are_pinocchios(name: str, seed: int) -> None:
    """To 1e-7: where constraints depend on each other its proximal method stops there."""
    mechanism, p, q, (v, torque, *_) = case(name, seed)
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    expected = pinocchios(mechanism, q, u, torque)
    a = mechanism.forward_dynamics(p, v, torque)
    primary = list(mechanism.description.primary)
    assert np.abs(a - expected[primary]).max() < 1e-7 * max(1.0, np.abs(expected).max())


@every_closure
@settings(max_examples=2, deadline=None)
@given(seed=seeds)
def test_pinocchios_constraints_have_the_same_jacobian(name: str, seed: int) -> None:
    mechanism, _, q, (v, *_) = case(name, seed)
    model = mechanism.to_pinocchio()
    data = model.createData()
    pinocchio.computeJointJacobians(model, data, q)
    rows = []
    for constraint in mechanism.to_pinocchio_constraints():
        memory = constraint.createData()
        constraint.calc(model, data, memory)
        assert np.abs((memory.oMc1.inverse() * memory.oMc2).translation).max() < 1e-12
        rows.append(pinocchio.getConstraintJacobian(model, data, constraint, memory).copy())
    J = np.vstack(rows)
    u = floats(equations(mechanism).joint_velocities(column(q), column(v)))
    assert np.abs(J @ u).max() < 1e-11 * max(1.0, np.abs(u).max())
    assert np.linalg.matrix_rank(J, 1e-6) == len(q) - mechanism.dof


def test_pinocchio_has_no_constraint_for_gears() -> None:
    mechanism, _ = random_loop(0, RECIPES["gears alone"])
    refusal = "joint couplings are not supported by Pinocchio's constraint models: gear0, gear1"
    with pytest.raises(InputError, match=refusal):
        mechanism.to_pinocchio_constraints()
    assert load("puma560_measured").to_pinocchio_constraints() == []


@every_kind
@settings(max_examples=1, deadline=None)
@given(seed=seeds)
def test_native_code_says_what_floats_say(name: str, seed: int) -> None:
    mechanism, p, q, (v, w, a, _) = case(name, seed)
    e, D = equations(mechanism), mechanism.inertial_parameters
    n, r = len(q), mechanism.dof

    def everything(p: Column, q: Column, v: Column, w: Column, a: Column, D: Column) -> tuple[Column, ...]:
        closed = e.closed(p, q)
        return (
            closed,
            e.joint_velocities(closed, v),
            e.inverse_dynamics(closed, v, w, a, D),
            e.forward_dynamics(closed, v, a, D),
        )

    native = compile_function(everything, {"p": r, "q": n, "v": r, "w": r, "a": r, "D": len(D)})
    plain = everything(*map(column, (p, q, v, w, a, D)))
    condition = np.linalg.cond(mechanism.mass_matrix(p))
    for one, other in zip(native(p, q, v, w, a, D), plain, strict=True):
        assert np.abs(one - floats(other)).max() < 1e-12 * condition * max(1.0, np.abs(one).max())
