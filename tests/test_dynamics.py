"""The equations of motion: Pinocchio as oracle, and the laws they must obey on any tree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from figures import require
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain, random_tree
from robot_files import urdf

from adaptctl.arrays import Array
from adaptctl.compilation import trace
from adaptctl.description import Pose
from adaptctl.description.drive import Drive, DriveParameter
from adaptctl.dynamics import Mechanism, load, tree_equations
from adaptctl.dynamics.equations import Equations
from adaptctl.dynamics.recursion.articulated_bodies import ArticulatedBody
from adaptctl.dynamics.recursion.drive import COULOMB_SMOOTHING_SPEED
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.scalars import Column, Dual, column

SAMPLES = 1000
seeds = st.integers(0, 2**32 - 1)
FILES = {"ur5": "ur5_robot.urdf", "panda": "panda.urdf", "talos": "talos_reduced.urdf"}


def robot(name: str) -> Mechanism:
    if name in FILES:
        return Mechanism.from_pinocchio(pinocchio.buildModelFromUrdf(str(urdf(FILES[name]))))
    return load(name)


def states(mechanism: Mechanism, count: int, seed: int = 0) -> list[Array]:
    return list(np.random.default_rng(seed).normal(size=(4, count, mechanism.dof)))


def friction(mechanism: Mechanism, v: Array) -> Array:
    """Of the joints' drives: Pinocchio's inverse dynamics leaves it out."""
    drives = [link.joint.drive for link in mechanism.links]
    viscous, coulomb = (np.array([d.value(kind) or 0.0 for d in drives]) for kind in list(DriveParameter)[1:3])
    return viscous * v + coulomb * v / np.sqrt(v**2 + COULOMB_SMOOTHING_SPEED**2)


def relative(actual: Array, expected: Array) -> float:
    """The greatest deviation of any sample over that sample's own size."""
    axes = tuple(range(1, expected.ndim))
    return float((np.abs(actual - expected).max(axes) / np.abs(expected).max(axes)).max())


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
@pytest.mark.parametrize("name", ["puma560_measured", "puma560_friction", *FILES])
def test_torques_energies_and_accelerations_are_pinocchios(name: str) -> None:
    mechanism = robot(name)
    model = mechanism.to_pinocchio()
    data = model.createData()
    p, v, v_r, a = states(mechanism, SAMPLES if mechanism.dof < 16 else 100)
    rubbing = friction(mechanism, v)
    torque = np.array([pinocchio.rnea(model, data, *x) for x in zip(p, v, a, strict=True)]) + rubbing
    coriolis = [pinocchio.computeCoriolisMatrix(model, data, *x).copy() for x in zip(p, v, strict=True)]
    mass = np.array([pinocchio.crba(model, data, x).copy() for x in p])
    mass = np.triu(mass) + np.swapaxes(np.triu(mass, 1), 1, 2)
    gravity = np.array([pinocchio.computeGeneralizedGravity(model, data, x).copy() for x in p])
    slotine = (
        np.einsum("tij,tj->ti", mass, a) + np.einsum("tij,tj->ti", coriolis, v_r) + gravity + friction(mechanism, v_r)
    )
    kinetic = np.array([pinocchio.computeKineticEnergy(model, data, *x) for x in zip(p, v, strict=True)])
    potential = np.array([pinocchio.computePotentialEnergy(model, data, x) for x in p])
    D = mechanism.inertial_parameters
    assert relative(mechanism.torque_regressor(p, v, a) @ D, torque) < 1e-12
    worst = relative(mechanism.inverse_dynamics(p, v, a), torque)
    require("inverse-dynamics", worst, 1e-12, "torques beside Pinocchio's, relative to the largest")
    assert relative(mechanism.slotine_li_regressor(p, v, v_r, a) @ D, slotine) < 1e-12
    scale = np.abs(kinetic).max() + np.abs(potential).max()
    worst = np.abs(mechanism.energy(p, v) - kinetic - potential).max() / scale
    require("energy", worst, 1e-11, "energy beside Pinocchio's, relative to the largest")
    assert relative(mechanism.mass_matrix(p), mass) < 1e-12
    conditions = np.linalg.cond(mass)
    errors = np.abs(mechanism.forward_dynamics(p, v, torque) - a).max(1) / np.abs(a).max(1)
    assert (errors / conditions).max() < 1e-12


@settings(max_examples=15, deadline=None)
@given(seeds, st.integers(1, 8))
def test_every_tree_agrees_with_pinocchio(seed: int, links: int) -> None:
    mechanism = random_tree(seed, links)
    model = mechanism.to_pinocchio()
    p, v, _, a = (x[0] for x in states(mechanism, 1, seed))
    expected = pinocchio.rnea(model, model.createData(), p, v, a)
    assert np.abs(mechanism.inverse_dynamics(p, v, a) - expected).max() < 1e-12 * max(np.abs(expected).max(), 1.0)


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 9), st.booleans(), st.booleans())
def test_articulated_bodies_are_the_mass_matrix_solved(seed: int, links: int, driven: bool, square: bool) -> None:
    """On every tree, whatever its joints, frames and drives, though only long ones are solved so."""
    mechanism = with_square_links(random_tree(seed, links)) if square else random_tree(seed, links)
    if driven:
        mechanism = mechanism.with_drives(Drive(rotor_inertia=0.1, viscous=0.3, coulomb=0.2))
    p, v, torque, _ = (Column(x[0].tolist()) for x in states(mechanism, 1, seed))
    D, equations = Column(mechanism.inertial_parameters.tolist()), mechanism.equations
    solved = np.array(Equations.forward_dynamics(equations, p, v, torque, D).of)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tree_equations, "MIN_ARTICULATED_DEPTH", 0.0)
        articulated = np.array(equations.forward_dynamics(p, v, torque, D).of)
    condition = np.linalg.cond(np.array(equations.mass_matrix(p, D)))
    assert np.abs(articulated - solved).max() < 1e-13 * condition * max(np.abs(solved).max(), 1.0)


def with_square_links(mechanism: Mechanism) -> Mechanism:
    """The same with joints along coordinate axes, each third one's link frame at its joint, where zeros are known."""
    turned, links = np.eye(3)[[1, 2, 0]], []
    for i, link in enumerate(mechanism.description.links):
        far = Pose.identity() if i % 3 == 0 else Pose(turned, link.joint_to_link.translation)
        links.append(replace(link, joint=replace(link.joint, axis=np.eye(3)[i % 3]), joint_to_link=far))
    return Mechanism(replace(mechanism.description, links=tuple(links)))


@pytest.mark.filterwarnings("ignore::adaptctl.errors.SimplificationWarning")
def test_a_floating_humanoid_is_solved_by_articulated_bodies() -> None:
    robot = load(urdf("talos_reduced.urdf"), floating_base=True)
    p, v, _, a = states(robot, 3)
    condition = np.linalg.cond(robot.mass_matrix(p)).max()
    assert relative(robot.forward_dynamics(p, v, robot.inverse_dynamics(p, v, a)), a) < 1e-14 * condition
    assert flops(robot) < flops(robot, articulated=False)


def flops(mechanism: Mechanism, *, articulated: bool = True) -> int:
    """Of forward dynamics, one way or the other."""
    given, r = mechanism.equations, mechanism.dof
    solve = type(given).forward_dynamics if articulated else Equations.forward_dynamics
    sizes = {"p": r, "v": r, "torque": r, "parameters": len(mechanism.parameter_names)}
    return trace(lambda **columns: solve(given, *columns.values()), sizes).operations.flops


def test_what_a_free_joint_does_not_feel_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A twentieth of the operations at least, where joints turn about coordinate axes and have no rotors."""
    chain = with_square_links(random_chain(0, 24))
    spared = flops(chain)
    monkeypatch.setattr(ArticulatedBody, "free_along", lambda self, _: self)
    assert spared < 0.95 * flops(chain)


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 7))
def test_coriolis_is_symmetric_in_its_two_velocities(seed: int, links: int) -> None:
    mechanism = random_tree(seed, links)
    p, v, w, _ = states(mechanism, 5, seed)
    zero = np.zeros_like(p)
    D = mechanism.inertial_parameters
    forward = mechanism.slotine_li_regressor(p, v, w, zero) @ D
    backward = mechanism.slotine_li_regressor(p, w, v, zero) @ D
    worst = np.abs(forward - backward).max() / max(np.abs(forward).max(), 1.0)
    require("coriolis-symmetry", worst, 1e-11, "C(v) w - C(w) v, relative to the largest")


def mass_rate(mechanism: Mechanism, p: Array, v: Array) -> Array:
    """dM/dt along v, by dual numbers."""
    q = Column(Dual(x, dx) for x, dx in zip(p.tolist(), v.tolist(), strict=True))
    rows = mechanism.equations.mass_matrix(q, Column(mechanism.inertial_parameters.tolist()))
    return np.array([[x.slope if isinstance(x, Dual) else 0.0 for x in row] for row in rows])


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 7))
def test_mass_rate_less_twice_coriolis_is_skew(seed: int, links: int) -> None:
    mechanism = random_tree(seed, links)
    p, v, s, _ = (x[0] for x in states(mechanism, 1, seed))
    zero = np.zeros_like(p)
    D = mechanism.inertial_parameters
    gravity = mechanism.inverse_dynamics(p, zero, zero)
    coriolis = mechanism.slotine_li_regressor(p, v, s, zero) @ D - gravity
    rate = s @ mass_rate(mechanism, p, v) @ s
    assert abs(rate - 2.0 * s @ coriolis) < 1e-11 * max(np.abs(s @ mechanism.mass_matrix(p) @ s), abs(rate), 1.0)


def test_mass_rate_less_twice_coriolis_is_skew_by_differences() -> None:
    mechanism = load("puma560_measured")
    p, v, s, _ = (x[0] for x in states(mechanism, 1))
    h, zero = 1e-5, np.zeros(6)
    rate = (mechanism.mass_matrix(p + h * v) - mechanism.mass_matrix(p - h * v)) / (2.0 * h)
    coriolis = mechanism.slotine_li_regressor(p, v, s, zero) @ mechanism.inertial_parameters
    coriolis -= mechanism.inverse_dynamics(p, zero, zero)
    assert s @ rate @ s == pytest.approx(2.0 * s @ coriolis, rel=1e-7)


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 7))
def test_the_rate_of_energy_is_the_power_of_the_torques(seed: int, links: int) -> None:
    mechanism = random_tree(seed, links)
    p, v, _, a = (x[0] for x in states(mechanism, 1, seed))
    moving = Column(Dual(x, dx) for x, dx in zip(p.tolist(), v.tolist(), strict=True))
    speeding = Column(Dual(x, dx) for x, dx in zip(v.tolist(), a.tolist(), strict=True))
    row = mechanism.equations.energy_regressor(moving, speeding)
    power = v @ mechanism.torque_regressor(p, v, a)
    rates = np.array([x.slope if isinstance(x, Dual) else 0.0 for x in row])
    worst = np.abs(rates - power).max() / max(np.abs(power).max(), 1.0)
    require("power", worst, 1e-11, "rate of energy less power of the torques, relative to the largest")


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 7), st.data())
def test_asked_columns_are_the_regressors_columns(seed: int, links: int, data: st.DataObject) -> None:
    mechanism = random_tree(seed, links)
    columns = data.draw(st.lists(st.integers(0, 10 * links - 1), min_size=1, unique=True))
    p, v, v_r, a_r = states(mechanism, 3, seed)
    whole = mechanism.slotine_li_regressor(p, v, v_r, a_r)
    np.testing.assert_array_equal(mechanism.slotine_li_regressor(p, v, v_r, a_r, columns), whole[..., columns])


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(1, 7))
def test_torques_and_powers_are_the_regressor_never_formed(seed: int, links: int) -> None:
    mechanism = random_tree(seed, links)
    p, v, v_r, a_r = (x[0] for x in states(mechanism, 1, seed))
    s = np.random.default_rng(seed).normal(size=links)
    Y, D = mechanism.slotine_li_regressor(p, v, v_r, a_r), mechanism.inertial_parameters
    motion = mechanism.equations.motion(*map(column, (p, v, v_r, a_r)))
    scale = max(np.abs(Y).max(), 1.0)
    torque, powers = motion.torque(column(D)), motion.regressor_transpose_product(column(s), range(10 * links))
    np.testing.assert_allclose(torque.of, Y @ D, rtol=0, atol=1e-12 * np.abs(Y @ D).max())
    np.testing.assert_allclose(powers.of, Y.T @ s, rtol=0, atol=1e-12 * scale * np.abs(s).max())


def test_the_same_energy_and_torque_in_any_frame_of_the_links() -> None:
    """Moving every link frame moves the parameters, and nothing that can be measured."""
    mechanism = random_tree(5, 6)
    joints_only = Mechanism.from_pinocchio(mechanism.to_pinocchio())
    p, v, _, a = states(mechanism, 20)
    np.testing.assert_allclose(joints_only.inverse_dynamics(p, v, a), mechanism.inverse_dynamics(p, v, a), rtol=1e-10)
    np.testing.assert_allclose(joints_only.energy(p, v), mechanism.energy(p, v), rtol=1e-10)


def test_wrong_shapes_say_what_was_expected_and_what_came() -> None:
    mechanism = load("puma560_measured")
    six, five = np.zeros(6), np.zeros(5)
    with pytest.raises(InputError, match=r"puma560_measured: v: expected shape \(\.\.\., 6\), got \(5,\)"):
        mechanism.torque_regressor(six, five, six)
    with pytest.raises(InputError, match="sample axes do not fit together"):
        mechanism.inverse_dynamics(np.zeros((3, 6)), np.zeros((4, 6)), six)
    with pytest.raises(InputError, match="expected numbers"):
        mechanism.energy("here", six)
    with pytest.raises(InputError, match=r"columns: expected whole numbers from 0 to 59, got 60"):
        mechanism.torque_regressor(six, six, six, columns=[0, 60])


@pytest.mark.parametrize("given", [0.3, np.float64(0.3), np.array(0.3)])
def test_a_number_is_no_vector_of_one(given: float | Array) -> None:
    """Of a mechanism with one joint too: shapes (..., 1) have a last axis."""
    pendulum, one = random_tree(0, 1), np.array([0.3])
    asked = [
        (pendulum.configuration, 1),
        (pendulum.mass_matrix, 1),
        (pendulum.energy_regressor, 2),
        (pendulum.energy, 2),
        (pendulum.torque_regressor, 3),
        (pendulum.inverse_dynamics, 3),
        (pendulum.forward_dynamics, 3),
        (pendulum.constraint_bias_torque, 3),
        (pendulum.slotine_li_regressor, 4),
    ]
    for method, count in asked:
        method(*[one] * count)
        for place in range(count):
            arguments = [given if i == place else one for i in range(count)]
            with pytest.raises(InputError, match=r"expected shape \(\.\.\., 1\), got \(\)"):
                method(*arguments)


def test_nan_is_refused_by_name_and_place() -> None:
    bad = np.zeros((2, 6))
    bad[1, 4] = np.nan
    with pytest.raises(NonFiniteError, match=r"puma560_measured: torque: .* nan at index \(1, 4\)"):
        load("puma560_measured").forward_dynamics(np.zeros(6), np.zeros(6), bad)


def test_leading_axes_are_samples() -> None:
    mechanism = load("puma560_measured")
    p, v, v_r, a = (x.reshape(2, 3, 6) for x in states(mechanism, 6))
    assert mechanism.energy_regressor(p, v).shape == (2, 3, 60)
    assert mechanism.slotine_li_regressor(p, v, v_r, a).shape == (2, 3, 6, 60)
    assert mechanism.forward_dynamics(p, v, np.zeros(6)).shape == (2, 3, 6)
    one = mechanism.slotine_li_regressor(p[1, 2], v[1, 2], v_r[1, 2], a[1, 2])
    np.testing.assert_allclose(mechanism.slotine_li_regressor(p, v, v_r, a)[1, 2], one, rtol=1e-13, atol=1e-13)
