"""Friction: its place in the control law by the theorem, and steps in time that it cannot make unstable."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nightly import turn_by_turn

from adaptctl.arrays import Array
from adaptctl.control import ComputedTorque, Sinusoids, SlotineLi
from adaptctl.description import builtin_file
from adaptctl.description.drive import Drive
from adaptctl.dynamics import Mechanism, load
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import column
from adaptctl.simulation import Integrator, LinearlyImplicitEuler, Plant, RungeKutta4, simulate_many
from adaptctl.simulation.effects import Friction
from adaptctl.simulation.integrator import integration
from tests.random_trees import random_tree
from tests.robot_files import urdf

PERIOD = 1e-3
RUBBING = Drive(viscous=3.0, coulomb=5.0)
FIVE_BAR = load("semi_direct_drive")
TWO_LINK = builtin_file("two_link")


def rows(matrix: list[list[float]]) -> Array:
    return np.array(matrix)


def states(mechanism: Mechanism, seed: int) -> Array:
    """p near home, and v, v_r, a_r (4, r)."""
    given = np.random.default_rng(seed).normal(size=(4, mechanism.dof))
    given[0] = mechanism.neutral_configuration + 0.1 * np.clip(given[0], -1.0, 1.0)
    return given


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["tree", "loop"]))
def test_the_lyapunov_function_falls_by_the_friction_besides(seed: int, kind: str) -> None:
    """With the true parameters V' = s'(M (a - a_r) + C s) = -s'Ks - s'(f(v) - f(v_r)), and the last is at most 0."""
    smooth = random_tree(seed % 1000, 4) if kind == "tree" else FIVE_BAR
    rubbing = smooth.with_drives(RUBBING)
    p, v, v_r, a_r = states(smooth, seed)
    s, K = v - v_r, 2.0 + np.arange(smooth.dof)
    regressor = rubbing.slotine_li_regressor(p, v, v_r, a_r)
    torque = regressor @ rubbing.inertial_parameters - K * s
    a = rubbing.forward_dynamics(p, v, torque)
    inertial = smooth.slotine_li_regressor(p, v, v_r, a_r) @ smooth.inertial_parameters
    rate = s @ (smooth.inverse_dynamics(p, v, a) - inertial)
    of = [rubbing.inverse_dynamics(p, u, 0.0 * u) - smooth.inverse_dynamics(p, u, 0.0 * u) for u in (v, v_r)]
    besides = s @ (of[0] - of[1])
    scale = np.abs(s) @ np.abs(torque) + 1.0
    assert besides >= -1e-12 * scale
    assert rate == pytest.approx(-s @ (K * s) - besides, abs=1e-8 * scale)


@pytest.mark.parametrize("mechanism", [random_tree(3, 5), FIVE_BAR], ids=["tree", "loop"])
def test_damping_times_velocity_is_the_friction(mechanism: Mechanism) -> None:
    """And neither a rotor nor an offset, which is a torque whatever the speed, damps anything."""
    mechanism = mechanism.with_drives(Drive(0.1, offset=0.7))
    rubbing = mechanism.with_drives(Drive(0.1, 3.0, 5.0, offset=0.7))
    p, v, *_ = states(mechanism, 1)
    q, D = column(rubbing.configuration(p)), column(rubbing.inertial_parameters)
    B = rows(rubbing.equations.damping(q, column(v), D))
    still = 0.0 * v
    friction = rubbing.inverse_dynamics(p, v, still) - mechanism.inverse_dynamics(p, v, still)
    np.testing.assert_allclose(B @ v, friction, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(B, B.T, atol=1e-12)
    assert np.linalg.eigvalsh(B).min() >= -1e-12
    smooth = rows(mechanism.equations.damping(q, column(v), column(mechanism.inertial_parameters)))
    np.testing.assert_array_equal(smooth, np.zeros((mechanism.dof, mechanism.dof)))


@pytest.mark.filterwarnings("ignore::adaptctl.errors.RoundedAnglesWarning")
@pytest.mark.parametrize("name", ["xarm7.urdf", "z1.urdf", "hextilt_flying_arm_5.urdf"])
def test_stiff_friction_is_not_refused(name: str) -> None:
    assert integration(load(urdf(name)), (), PERIOD) == (4, LinearlyImplicitEuler())


def tracked(mechanism: Mechanism, steps: int, integrator: Integrator, effects: tuple[Friction, ...] = ()) -> Array:
    """Positions over a second of tracking by computed torque, with a start off the reference."""
    plant = Plant(mechanism, PERIOD, steps, integrator, torque_limits=1e9, effects=effects)
    rows = np.full(mechanism.dof, 0.2)
    reference = Sinusoids(mechanism.neutral_configuration, rows, np.linspace(0.5, 0.7, mechanism.dof), start_time=0.2)
    off = mechanism.neutral_configuration + 0.05
    smooth = np.where([name.endswith("coulomb") for name in mechanism.parameter_names], 0.0, 1.0)
    law = ComputedTorque(mechanism, np.array(8.0), parameters=smooth * mechanism.inertial_parameters)
    return simulate_many(plant, law, reference, duration=1.0, p=off).p[:, 0]


@pytest.mark.parametrize(
    ("mechanism", "where"), turn_by_turn([load("puma560_measured"), FIVE_BAR], ["drives", "effects"])
)
def test_four_implicit_steps_go_where_many_explicit_ones_go(mechanism: Mechanism, where: str) -> None:
    """Friction that no law compensates: the arm stops and starts, and four steps are within 0.1 mrad."""
    heavy, coulomb = mechanism.with_drives(Drive(0.2)), 60.0
    rubbing = mechanism.with_drives(Drive(0.2, coulomb=coulomb)) if where == "drives" else heavy
    effects = () if where == "drives" else (Friction(coulomb=coulomb),)
    exact = tracked(rubbing, 40, RungeKutta4(), effects)
    errors = [np.abs(tracked(rubbing, n, LinearlyImplicitEuler(), effects) - exact).max() for n in (4, 16)]
    assert errors[0] < 1e-4
    assert errors[1] < 0.4 * errors[0]


def test_however_stiff_friction_does_not_reverse_a_velocity() -> None:
    light = random_tree(1, 1).with_drives(Drive(0.01, 50.0, 1e4))
    plant = Plant(light, PERIOD, 4, LinearlyImplicitEuler())
    hold = light.inverse_dynamics(np.zeros(1), np.zeros(1), np.zeros(1))
    state, speeds = plant.init([0.0], [2.0]), [2.0]
    for _ in range(50):
        state = plant.step(state, hold)
        speeds.append(float(state.v[0]))
    assert np.all(np.diff(np.abs(speeds)) <= 1e-8)
    assert min(speeds) > -1e-3
    assert abs(speeds[-1]) < 1e-3


def test_learning_friction_far_too_large_stays_stable() -> None:
    """The estimate of viscous friction is ten times the truth, and T B^/M is 5: at v this would be unstable at once."""
    tree = random_tree(2, 2)
    inertia = float(np.linalg.eigvalsh(tree.mass_matrix(np.zeros(2))).min())
    viscous = 0.5 * inertia / PERIOD
    rubbing = tree.with_drives(Drive(viscous=viscous))
    model = ReducedModel.full(rubbing)
    first = np.where([name.endswith("viscous") for name in model.names], 10.0, 1.0) * rubbing.inertial_parameters
    law = SlotineLi(model, 4.0, 0.1 * inertia / PERIOD, None, first, PERIOD)
    reference = Sinusoids(np.zeros(2), np.full(2, 0.3), np.array([0.2, 0.25]))
    plant = Plant(rubbing, PERIOD, 2, torque_limits=1e9)
    run = simulate_many(plant, law, reference, duration=3.0)
    assert run.finite.all()
    assert float(run.largest_error.max()) < 0.5


@pytest.mark.parametrize("v", [-1.3, -0.1, -1e-3, 0.0, 2e-3, 0.1, 0.7])
def test_drives_and_the_effect_have_the_same_curve(v: float) -> None:
    """The formula of Armstrong-Helouvry, Dupont and Canudas de Wit (1994); at rest, and by its parameters, one by
    one."""
    sign = v / np.sqrt(v**2 + 0.01**2)
    expected = 0.5 * v + (1.5 + 0.7 / (1.0 + (v / 0.1) ** 2)) * sign
    (torque,) = Friction(0.5, 1.5, 0.7).torque(column([v]), column([0.0])).of
    assert torque == pytest.approx(expected, rel=1e-14)
    drives = Drive(viscous=0.5, coulomb=1.5, stribeck=0.7)
    robot = load("puma560_measured")
    rest, moving = np.zeros(6), v * np.eye(6)[2]
    with_them, without = (arm.inverse_dynamics(rest, moving, rest) for arm in (robot.with_drives(drives), robot))
    np.testing.assert_allclose((with_them - without)[2], expected, rtol=1e-9, atol=1e-12)
    slower = Friction(stribeck=0.7, stribeck_speed=0.05).torque(column([v]), column([0.0])).of[0]
    assert slower == pytest.approx(0.7 / (1.0 + (v / 0.05) ** 2) * sign, rel=1e-14)


CURVES: dict[str, Callable[[float], float]] = {
    "viscous": lambda v: v,
    "coulomb": lambda v: v / math.hypot(v, 0.01),
    "stribeck": lambda v: v / math.hypot(v, 0.01) / (1.0 + (v / 0.1) ** 2),
    "square_root": lambda v: v / math.hypot(v, 0.01) ** 0.5,
    "offset": lambda v: 1.0,
}
"""Torque per unit of each parameter at a speed in rad/s: sign(v) is v/sqrt(v^2 + 0.01^2), |v| the root itself."""


@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("v", [-0.7, -0.02, 0.0, 0.005, 0.1, 4.0])
def test_each_parameter_of_a_drive_has_its_own_curve(kind: str, v: float) -> None:
    """And what damps is the torque over the speed, the curve's secant, but for an offset, which damps nothing."""
    plain = load(TWO_LINK).with_drives(Drive())
    rubbing = plain.with_drives(Drive(**{kind: 1.7}))
    still, moving = np.zeros(2), np.array([0.0, v])
    torque = rubbing.inverse_dynamics(still, moving, still) - plain.inverse_dynamics(still, moving, still)
    at_rest = 0.0 if kind != "offset" else 1.7
    np.testing.assert_allclose(torque, [at_rest, 1.7 * CURVES[kind](v)], rtol=1e-12, atol=1e-12)
    B = rows(rubbing.equations.damping(column(still), column(moving), column(rubbing.inertial_parameters)))
    if kind == "offset":
        assert not B.any()
    else:
        secant = CURVES[kind](v or 1e-12) / (v or 1e-12)
        assert B[1, 1] == pytest.approx(1.7 * secant, rel=1e-12)
