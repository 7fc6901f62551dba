"""Momenta: M v without gravity or friction, and equations of motion that need no accelerations."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_loops import arm, gains, plant, posture, reduced, swinging

from adaptctl.arrays import Array, stacked_rows
from adaptctl.compilation import compile_function
from adaptctl.control import SlotineLi
from adaptctl.control.adaptation import two_stage_filter
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter
from adaptctl.control.adaptation.law import Period
from adaptctl.control.adaptation.two_stage_filter import FilteredTwice
from adaptctl.dynamics import load
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, column
from adaptctl.tuning import with_friction

ARMS = ["puma560_arm3", "puma560_friction", "semi_direct_drive"]


def terms(name: str, p: Array, v: Array) -> tuple[Array, Array]:
    """The regressors (..., r, k) of momenta and forces."""
    mechanism = arm(name)
    q = mechanism.configuration(p)
    found = momentum_terms(mechanism.equations, column(q), column(v), reduced(name).columns)
    return tuple(stacked_rows(rows, p.shape[:-1]) for rows in found)  # type: ignore[return-value]


def states(name: str, samples: int) -> tuple[Array, Array, Array]:
    mechanism, rng = arm(name), np.random.default_rng(3)
    p, v, a = rng.normal(size=(3, samples, mechanism.dof))
    return posture(mechanism) + 0.2 * p, v, a


@pytest.mark.parametrize("name", ARMS)
def test_momenta_are_the_mass_matrix_times_velocities(name: str) -> None:
    p, v, _ = states(name, 20)
    momentum, _ = terms(name, p, v)
    expected = np.einsum("tij,tj->ti", arm(name).mass_matrix(p), v)
    np.testing.assert_allclose(momentum @ reduced(name).fundamental_parameters, expected, atol=1e-12 * 20)


@pytest.mark.parametrize("name", ARMS)
def test_torque_is_the_momenta_s_rate_less_the_forces(name: str) -> None:
    p, v, a = states(name, 20)
    h = 1e-5
    later, earlier = (terms(name, p + s * v + 0.5 * h * h * a, v + s * a)[0] for s in (h, -h))
    rows = (later - earlier) / (2.0 * h) - terms(name, p, v)[1]
    expected = reduced(name).torque_regressor(p, v, a)
    np.testing.assert_allclose(rows, expected, atol=1e-7 * np.abs(expected).max())


def test_friction_acts_at_the_velocity_that_is_given_for_it() -> None:
    name = "puma560_friction"
    (p, v, _), model = states(name, 20), reduced(name)
    v_f, q = v + np.array([0.3, -2.0, 0.02, 0.0, 1.0, 5.0]), arm(name).configuration(p)
    given = momentum_terms(arm(name).equations, column(q), column(v), model.columns, column(v_f))
    changed = stacked_rows(given.forces, (20,)) - terms(name, p, v)[1]
    for k, parameter in enumerate(model.names):
        joint, kind = int(parameter[len("joint")]) - 1 if parameter.startswith("joint") else 0, parameter.split(".")[-1]
        law = {"viscous": lambda x: x, "coulomb": lambda x: x / np.sqrt(x * x + 1e-4)}.get(kind)
        expected = np.zeros((20, 6))
        if law is not None:
            expected[:, joint] = law(v[:, joint]) - law(v_f[:, joint])
        np.testing.assert_allclose(changed[..., k], expected, atol=1e-12 * 20)
    assert [name for name in model.names if name.endswith("coulomb")]


def test_noise_of_velocities_does_not_turn_the_friction_that_a_filter_predicts() -> None:
    model, period, none = ReducedModel(with_friction(load("two_link"))), 1e-3, column(np.zeros(2))
    at = [model.names.index(f"{joint.name}.coulomb") for joint in model.mechanism.primary_joints]
    p = column([0.1, 0.1])
    first, second, *rest = two_stage_filter.start(model, np.zeros(2), np.zeros(2), 100.0, period)
    memory = FilteredTwice(Filtered(*map(column, first)), Filtered(*map(column, second)), *map(column, rest))
    for k in range(150):  # 15 time constants
        noise = column([0.3 * (-1.0) ** k] * 2)
        now = Period(lambda s: s, noise, noise, none, p, p + noise, period, period, none)
        found = two_stage_filter.predicted(model, now, memory, 100.0)
        rows, memory = found.rows, found.after
    friction = [float(row[k]) for row, k in zip(rows, at, strict=True)]
    np.testing.assert_allclose(friction, 0.1 / np.hypot(0.1, 0.01), rtol=0.02)  # at the noisy velocities 0


def prediction_error(name: str, period: float) -> float:
    """The largest |W beta - F[tau]| along a run under held torques, over the largest torque."""
    mechanism, model = arm(name), reduced(name)
    r, k, n = mechanism.dof, len(model.columns), mechanism.equations.num_joints
    filtered, none = TorqueFilter(20.0, period), Column.zeros(mechanism.dof)

    def predicted(q: Column, v: Column, torque: Column, rows: Column, last: Column) -> tuple[Column, ...]:
        now = Period(lambda s: s, none, none, torque, q, v, period, period, none)
        found = filtered.predicted(model, now, Filtered(rows, last))
        return (Column(x for row in found.rows for x in row), *found.after)

    size = len(filtered.start(model, mechanism.configuration(mechanism.neutral_configuration), np.zeros(r)).regressor)
    assert size < r * k  # no joint feels the links that carry it
    native = compile_function(predicted, {"q": n, "v": r, "torque": r, "rows": size, "last": r})
    reference, body = swinging(mechanism), plant(mechanism, period)
    controller = SlotineLi(model, 8.0, gains(name).damping, control_period=period, initial=model.fundamental_parameters)
    state = body.init(reference(0.0).p + 0.1, reference(0.0).v)
    memory, held, kept = controller.init(state.p, state.v), np.zeros(r), tuple(filtered.start(model, state.q, state.v))
    worst = largest = 0.0
    for t in np.arange(round(0.4 / period)) * period:
        rows, *kept = native(state.q, state.v, held, *kept)
        worst = max(worst, float(np.abs(rows.reshape(r, k) @ model.fundamental_parameters - kept[1]).max()))
        held, memory = controller.step(memory, state.p, state.v, reference(t))
        largest = max(largest, float(np.abs(held).max()))
        state = body.step(state, held)
    return worst / largest


@pytest.mark.parametrize("name", ["puma560_arm3", "semi_direct_drive"])
def test_the_filtered_torque_is_predicted_to_second_order(name: str) -> None:
    coarse, fine = prediction_error(name, 2e-3), prediction_error(name, 5e-4)
    assert coarse < 1e-3
    assert coarse / fine == pytest.approx(16.0, rel=0.3)
