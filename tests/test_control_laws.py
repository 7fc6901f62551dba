"""Control laws besides Slotine and Li's: what each theorem says, on a tree and on a loop."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_loops import (
    arm,
    dissipated,
    distance,
    full,
    gains,
    integral,
    kinetic,
    loaded,
    loop,
    own_gain,
    plant,
    posture,
    reduced,
    swinging,
)

from adaptctl.arrays import Array
from adaptctl.control import (
    AdaptiveComputedTorque,
    Composite,
    ComputedTorque,
    Controller,
    Natural,
    PassivityIntegral,
    PDGravity,
    ReferencePoint,
    Sinusoids,
    SlotineLi,
    TaskSpaceSlotineLi,
    lyapunov,
)
from adaptctl.control.gains.sampling_ratio import mass_matrix_of
from adaptctl.control.pytree import leaves
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.recursion.kinematics import link_poses
from adaptctl.errors import GainError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import column

ARMS = ["puma560_arm3", "semi_direct_drive"]
BOTH = ["puma560_geared", "semi_direct_drive"]
"""Whose theorems are held."""
gain = own_gain


def rise(V: Array) -> float:
    return float(np.diff(V).max() / V[0])


def imbalance(V: Array, lost: Array) -> float:
    return float(abs(V[-1] + lost[-1] - V[0]) / V[0])


def rough(name: str) -> Array:
    return 1.3 * reduced(name).fundamental_parameters


LAWS: dict[str, Callable[[str], Controller[Any]]] = {
    "pd": lambda name: PDGravity.from_model(reduced(name), 300.0, gains(name).damping),
    "computed torque": lambda name: ComputedTorque.from_model(reduced(name), 8.0),
    "adaptive computed torque": lambda name: AdaptiveComputedTorque(reduced(name), 8.0, rough(name), 0.05 * gain(name)),
    "integral": lambda name: PassivityIntegral(reduced(name), 8.0, gains(name).damping, gain(name)),
    "task space": lambda name: TaskSpaceSlotineLi(
        reduced(name), 8.0, gains(name).damping, gain(name), reference_in_joints=True
    ),
    "task space, composite": lambda name: TaskSpaceSlotineLi(
        reduced(name),
        8.0,
        gains(name).damping,
        Composite(gain(name), 0.1),
        reference_in_joints=True,
        singularity=0.1,
    ),
}


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("law", LAWS)
def test_native_code_and_floats_act_alike(name: str, law: str) -> None:
    controller, r = LAWS[law](name), arm(name).dof
    p, v = posture(arm(name)) + 0.1, np.linspace(-1.0, 1.0, r)
    point = ReferencePoint(posture(arm(name)), np.full(r, 0.3), np.full(r, -0.5))
    _, state = controller.step(controller.init(p, v), p, v, point)
    torque, after = controller.step(state, p + 1e-3 * v, 0.99 * v, point)
    plain = controller.python_step(p + 1e-3 * v, 0.99 * v, *point, *leaves(state))
    for native, floats in zip([torque, *leaves(after)], plain, strict=True):
        np.testing.assert_allclose(native, floats, rtol=0, atol=1e-10 * max(np.abs(floats).max(initial=0.0), 1.0))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("law", [ComputedTorque, PDGravity])
def test_reduced_parameters_give_the_torques_of_all(name: str, law: Any) -> None:
    numbers = (300.0, gains(name).damping) if law is PDGravity else (8.0,)
    p, v = posture(arm(name)) + 0.1, np.linspace(-1.0, 1.0, arm(name).dof)
    point = swinging(arm(name))(1.0)
    torques = []
    for controller in (law(arm(name), *numbers), law.from_model(reduced(name), *numbers)):
        torques.append(controller.step(controller.init(p, v), p, v, point)[0])
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-10 * np.abs(torques[0]).max())
    assert (
        law.from_model(reduced(name), *numbers).kernel.operations.flops
        <= law(arm(name), *numbers).kernel.operations.flops
    )


@settings(max_examples=5, deadline=None)
@given(name=st.sampled_from(ARMS), off=st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3))
def test_pd_with_gravity_reaches_a_resting_goal(name: str, off: list[float]) -> None:
    """v'Mv/2 + e'Kp e/2 never rises."""
    mechanism, K = arm(name), gains(name).damping
    reference = swinging(mechanism, amplitude=0.0)
    run = loop(PDGravity(mechanism, 5.0 * K, K), mechanism, reference, 3.0, off=np.array(off))
    e = run.p - reference.center
    V = 0.5 * np.einsum("ti,tij,tj->t", run.v, mechanism.mass_matrix(run.p), run.v) + 0.5 * (5.0 * K * e**2).sum(axis=1)
    assert np.diff(V).max() <= 1e-4 * V[0] + 1e-12
    assert np.abs(e[-1]).max() < 1e-4 + 0.02 * np.abs(e[0]).max()


@settings(max_examples=3, deadline=None)
@given(name=st.sampled_from(BOTH), bandwidth=st.floats(3.0, 10.0), mass=st.floats(0.0, 1.0), seed=st.integers(0, 100))
def test_adaptive_computed_torque(name: str, bandwidth: float, mass: float, seed: int) -> None:
    """V = s'Ws/2 + the parameters' term falls as -s'W Lambda s."""
    mechanism = arm(name)
    law = AdaptiveComputedTorque(reduced(name), bandwidth, rough(name), gain(name, 0.02), torque_limits=np.inf)
    true = loaded(mechanism, mass)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.5, parameters=true)
    weight = np.asarray(law.prediction_weight)
    V = 0.5 * (run.s**2 * weight).sum(axis=1) + distance(law, run, true)
    assert rise(V) < 1e-5
    assert imbalance(V, integral(run, (run.s**2 * weight * law.bandwidth).sum(axis=1))) < 1e-2


@pytest.mark.parametrize("factors", [(1.6, 0.4), (0.6, 1.4)])
def test_adaptive_computed_torque_rejects_estimates_without_a_definite_mass_matrix(factors: list[float]) -> None:
    """With a gain too large for it, the gradient leads to indefinite ones."""
    name = "puma560_measured"
    mechanism, model, true = arm(name), reduced(name), reduced(name).fundamental_parameters
    first = np.linspace(*factors, len(true)) * true
    law = AdaptiveComputedTorque(model, 5.0, first, gain(name), torque_limits=np.inf)
    run = loop(law, mechanism, swinging(mechanism, 1), 0.5)
    smallest = [
        np.linalg.eigvalsh(mass_matrix_of(mechanism, p, model.embed(s.estimate)))[0]
        for p, s in zip(run.p, run.states, strict=True)
    ]
    assert min(smallest) > 0.0
    counts = run.states[-1].controller_state
    assert 0.0 < counts.restarts[0] < counts.rejected[0] < 250.0
    gentle = AdaptiveComputedTorque(model, 5.0, first, 0.1 * gain(name), torque_limits=np.inf)
    assert loop(gentle, mechanism, swinging(mechanism, 1), 0.2).states[-1].controller_state.rejected[0] == 0.0


def test_adaptive_computed_torque_keeps_an_invertible_model_on_rigid_bodies() -> None:
    name = "puma560_geared"
    mechanism, model = arm(name), full("puma560_geared")
    law = AdaptiveComputedTorque(model, 8.0, 1.5 * mechanism.inertial_parameters, Natural(0.05))
    run = loop(law, mechanism, swinging(mechanism), 1.0, parameters=loaded(mechanism, 2.0))
    V = 0.5 * (run.s**2 * np.asarray(law.prediction_weight)).sum(axis=1) + distance(law, run, loaded(mechanism, 2.0))
    assert rise(V) < 1e-5
    smallest = [
        np.linalg.eigvalsh(mechanism.with_parameters(D).mass_matrix(p))[0]
        for D, p in zip(run.estimate[::100], run.p[::100], strict=True)
    ]
    assert min(smallest) > 0.0


@settings(max_examples=5, deadline=None)
@given(name=st.sampled_from(BOTH), bandwidth=st.floats(3.0, 10.0), mass=st.floats(0.0, 2.0), seed=st.integers(0, 100))
def test_passivity_with_integral_action(name: str, bandwidth: float, mass: float, seed: int) -> None:
    mechanism = arm(name)
    law = PassivityIntegral(reduced(name), bandwidth, gains(name).damping, gain(name, 0.1), torque_limits=np.inf)
    true = loaded(mechanism, mass)
    run = loop(law, mechanism, swinging(mechanism, seed), 0.5, parameters=true)
    V = kinetic(mechanism.with_parameters(true), run) + distance(law, run, true)
    assert rise(V) < 1e-5
    assert imbalance(V, dissipated(run, law.damping)) < 1e-2


@pytest.mark.parametrize("name", ARMS)
def test_integral_action_takes_away_what_a_constant_load_leaves(name: str) -> None:
    """Without adaptation: Slotine and Li's law rests where the load bends it, integral action at the goal."""
    mechanism, K = arm(name), gains(name).damping
    reference, load = swinging(mechanism, amplitude=0.0), 0.2 * gains(name).damping
    true = reduced(name).fundamental_parameters
    left = {}
    for law in (SlotineLi, PassivityIntegral):
        run = loop(law(reduced(name), 5.0, K, initial=true), mechanism, reference, 4.0, disturbance=lambda t: load)
        left[law] = np.abs(run.p[-1] - reference.center).max()
    assert left[SlotineLi] == pytest.approx(0.2 / 5.0, rel=1e-2)
    assert left[PassivityIntegral] < 1e-6


def test_the_integral_of_the_error_is_of_second_order() -> None:
    """By the trapezium: a quarter of the miss at half the period, along a known error; a rectangle's would halve."""
    mechanism, missed = arm(SMALL), []
    rest = np.zeros(mechanism.dof)
    aim = ReferencePoint(rest, rest, rest)
    for period in (0.02, 0.01):
        law = PassivityIntegral(reduced(SMALL), 5.0, 1e-2, control_period=period)
        state = law.init(rest, rest)
        for t in np.arange(round(1.0 / period) + 1) * period:
            _, state = law.step(state, np.full(3, np.sin(2.0 * t)), rest, aim)
        missed.append(state.controller_state.integral - 0.5 * (1.0 - np.cos(2.0)))
    np.testing.assert_allclose(missed[0] / missed[1], 4.0, rtol=1e-2)
    assert np.abs(missed[1]).max() < 1e-4


def tool_path(name: str, time: Array) -> ReferencePoint:
    """Where the reference arm has its last link, by differences of its pose."""
    mechanism, h = arm(name), 1e-4
    reference = swinging(mechanism, 3)
    x = [link_poses(mechanism, reference(time + k * h).p).translations[..., -1, :] for k in (-1, 0, 1)]
    return ReferencePoint(x[1], (x[2] - x[0]) / (2.0 * h), (x[2] - 2.0 * x[1] + x[0]) / h**2)


@pytest.mark.parametrize("name", ARMS)
def test_the_tool_follows_its_path_in_the_world(name: str) -> None:
    """With true parameters the tool's error falls at the bandwidth, whichever way the path is told."""
    mechanism, true, off = arm(name), reduced(name).fundamental_parameters, 0.05
    options: dict[str, Any] = {"initial": true, "control_period": 1e-3}
    world = TaskSpaceSlotineLi(reduced(name), 8.0, gains(name).damping, **options)
    joints = TaskSpaceSlotineLi(reduced(name), 8.0, gains(name).damping, **options, reference_in_joints=True)

    class InTheWorld(Sinusoids):
        def __call__(self, t: Any, /) -> ReferencePoint:
            return ReferencePoint(*tool_path(name, np.asarray(t)))

    reference = swinging(mechanism, 3)
    told_in_joints = loop(joints, mechanism, reference, 1.0, off=off)
    body, p = plant(mechanism, 1e-3), reference(0.0).p + off
    state, memory = body.init(p, np.zeros(mechanism.dof)), world.init(p, np.zeros(mechanism.dof))
    path, positions = tool_path(name, told_in_joints.time), []
    for k in range(len(told_in_joints.time)):
        positions.append(state.p)
        torque, memory = world.step(memory, state.p, state.v, ReferencePoint(*(part[k] for part in path)))
        state = body.step(state, torque)
    np.testing.assert_allclose(positions, told_in_joints.p, atol=2e-5)
    error = np.linalg.norm(link_poses(mechanism, told_in_joints.p).translations[:, -1] - path.p, axis=1)
    assert error[0] > 1e-2
    assert error[-1] < 2e-3 * error[0] + 1e-4


@settings(max_examples=5, deadline=None)
@given(
    name=st.sampled_from(["puma560_measured", *ARMS]),
    mass=st.floats(0.0, 1.0),
    singularity=st.floats(0.0, 0.3),
    seed=st.integers(0, 99),
)
def test_task_space_adaptation(name: str, mass: float, singularity: float, seed: int) -> None:
    """V falls as -s'Ks whatever the Jacobian, so the wanted acceleration is the wanted velocity's derivative.

    Six joints swing through places where the tool's Jacobian is singular; its inverse, undamped, is infinite there.
    """
    mechanism = arm(name)
    if name == "puma560_measured":
        singularity = max(singularity, 0.2)
    law = TaskSpaceSlotineLi(
        reduced(name),
        6.0,
        gains(name).damping,
        gain(name, 0.1),
        reference_in_joints=True,
        singularity=singularity,
        torque_limits=np.inf,
        tool=np.array([0.02, 0.0, 0.1]),
    )
    true = loaded(mechanism, mass)
    run = loop(law, mechanism, swinging(mechanism, seed, 0.2), 0.4, parameters=true, off=0.05)
    V = kinetic(mechanism.with_parameters(true), run) + distance(law, run, true)
    assert rise(V) < 1e-4
    assert imbalance(V, dissipated(run, law.damping)) < 2e-2


@pytest.mark.parametrize("options", [{}, {"singularity": 0.2}, {"axes": (0, 2)}, {"link": "link4"}])
def test_the_wanted_acceleration_is_the_wanted_velocity_s_derivative(options: dict[str, Any]) -> None:
    """Along a motion, by central differences; six joints, so that some motion is free."""
    mechanism = arm("puma560")
    law = TaskSpaceSlotineLi(reduced("puma560"), 8.0, gains("puma560").damping, **options, reference_in_joints=True)
    actual, reference = swinging(mechanism, 1), swinging(mechanism, 2)

    def wanted(t: float) -> tuple[Array, Array]:
        memory, now = law.init(actual(t).p, actual(t).v), actual(t)
        p, aim = column(now.p), ReferencePoint(*map(column, reference(t)))
        v_r, a_r, _ = law.reference_velocity(p, p, column(now.v), aim, memory)
        return np.array(v_r.of), np.array(a_r.of)

    for t in (0.5, 1.3):
        h = 1e-5
        slope = (wanted(t + h)[0] - wanted(t - h)[0]) / (2.0 * h)
        np.testing.assert_allclose(wanted(t)[1], slope, atol=1e-6 * np.abs(slope).max())


SMALL = "puma560_arm3"


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: PDGravity(arm(SMALL), -1.0, 1.0), "stiffness: expected positive"),
        (lambda: PDGravity(arm(SMALL), 1.0, np.ones(2)), r"damping: expected a number or 3 of them, got shape \(2,\)"),
        (lambda: PDGravity(arm(SMALL), 1.0, 1.0, np.ones(3)), r"parameters: expected shape \(30,\), got \(3,\)"),
        (
            lambda: ComputedTorque.from_model(reduced(SMALL), 8.0, parameters=np.ones(30)),
            r"shape \(\.\.\., 15\), got \(30,\)",
        ),
        (lambda: AdaptiveComputedTorque(reduced(SMALL), 8.0, None), "positive definite everywhere"),
        (lambda: AdaptiveComputedTorque(reduced(SMALL), 8.0, -rough(SMALL)), "use SlotineLi"),
        (
            lambda: AdaptiveComputedTorque(reduced(SMALL), 8.0, rough(SMALL), prediction_weight=-1.0),
            "weight: expected positive",
        ),
        (lambda: PassivityIntegral(reduced(SMALL), 8.0, 50.0, control_period=np.nan), "control period"),
        (lambda: TaskSpaceSlotineLi(reduced(SMALL), 8.0, 50.0, axes=(0, 3)), "axes: expected some of 0, 1, 2"),
        (lambda: TaskSpaceSlotineLi(reduced(SMALL), np.ones(2), 50.0), "bandwidth: expected a number or 3 of them"),
        (
            lambda: TaskSpaceSlotineLi(reduced(SMALL), 8.0, 50.0, link="hand"),
            "unknown link 'hand'; links: link1, link2",
        ),
        (lambda: TaskSpaceSlotineLi(reduced(SMALL), 8.0, 50.0, link="link2"), "point of link2 along fewer than 3 axes"),
        (
            lambda: TaskSpaceSlotineLi(reduced(SMALL), 8.0, 50.0, singularity=-1.0),
            "singularity: expected a finite",
        ),
        (lambda: TaskSpaceSlotineLi(reduced(SMALL), 8.0, 50.0, tool=np.ones(2)), "tool"),
    ],
)
def test_what_cannot_be_is_refused(make: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()


@pytest.mark.parametrize("law", [PassivityIntegral, TaskSpaceSlotineLi])
def test_a_damping_the_period_cannot_carry_is_refused(law: Any) -> None:
    with pytest.raises(GainError, match="at most"):
        law(reduced(SMALL), 8.0, 1e4)
    with pytest.raises(GainError, match="use at most 750 1/s"):
        AdaptiveComputedTorque(reduced(SMALL), 1e4, rough(SMALL))


def test_the_sliding_variable_of_relatives_is_not_taken_for_slotine_and_lis() -> None:
    """Theirs depends on an integral or on a path in space, which a run does not keep."""
    mechanism, law = arm(SMALL), PassivityIntegral(reduced(SMALL), 5.0, gains(SMALL).damping)
    p = posture(mechanism)[None]
    run = SimpleNamespace(p=p, v=0.0 * p, reference_p=p, reference_v=0.0 * p, estimate=np.zeros((1, len(gain(SMALL)))))
    with pytest.raises(InputError, match="sliding variable: that of PassivityIntegral needs more"):
        lyapunov(law, run, mechanism)


def test_constant_loads_leave_an_error_in_motion_and_while_adapting() -> None:
    """What integral action promises at rest without adaptation, and no more."""
    name, mechanism = ARMS[0], arm(ARMS[0])
    K, true = gains(name).damping, reduced(name).fundamental_parameters
    left = {}
    for what, amplitude, adaptation in (("still", 0.0, None), ("moving, learning", 0.3, gain(name))):
        law = PassivityIntegral(reduced(name), 5.0, K, adaptation, initial=true)
        reference = swinging(mechanism, amplitude=amplitude)
        run = loop(law, mechanism, reference, 6.0, disturbance=lambda t: 0.2 * K)
        left[what] = np.abs((run.p - reference(run.time).p)[-1000:]).max()
    assert left["still"] < 1e-5
    assert left["moving, learning"] > 1e-4


def test_the_undamped_task_space_law_passes_a_singularity() -> None:
    """The arm stretched out: J J' is singular there, and v_r and a_r are finite all the same."""
    mechanism = load("two_link")
    model = ReducedModel.full(mechanism)
    law = TaskSpaceSlotineLi(model, 5.0, own_damping(mechanism), axes=(0, 2))
    aim = ReferencePoint(np.array([0.1, 0.2]), np.array([0.1, -0.2]), np.zeros(2))
    for bend in (0.0, 1e-12, 1e-6, 1e-3, 0.1, 1.0):
        p, v = np.array([0.3, bend]), np.array([0.5, -0.7])
        point = ReferencePoint(*map(column, aim))
        v_r, a_r, _ = law.reference_velocity(column(p), column(p), column(v), point, law.initial_state(p, v))
        assert np.abs(v_r.of).max() < 300.0
        assert np.isfinite(a_r.of).all()


def test_the_guard_leaves_regular_places_alone() -> None:
    """There, with a small error, v_r is the one of the inverse: J v_r is what the task asks."""
    mechanism = load("two_link")
    law = TaskSpaceSlotineLi(ReducedModel.full(mechanism), 5.0, own_damping(mechanism), axes=(0, 2))
    p = np.array([0.3, 1.0])
    near = np.array(law.point(column(p))[0].of) + 1e-6
    aim = ReferencePoint(near, np.array([0.1, -0.2]), np.zeros(2))
    v_r, _, _ = law.reference_velocity(
        column(p), column(p), column(np.zeros(2)), ReferencePoint(*map(column, aim)), law.initial_state(p, p)
    )
    x, rows = law.point(column(p))
    asked = aim.v - 5.0 * (np.array(x.of) - aim.p)
    np.testing.assert_allclose([row @ v_r for row in rows], asked, rtol=1e-9)


def own_damping(mechanism: Mechanism) -> Array:
    return 20.0 * np.diag(mechanism.mass_matrix(np.zeros(mechanism.dof)))
