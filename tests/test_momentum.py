"""Momenta: M v without gravity or friction, and equations of motion that need no accelerations."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_loops import arm, gains, plant, posture, reduced, swinging

from adaptctl.arrays import Array, stacked_rows
from adaptctl.compilation import compile_function
from adaptctl.control import SlotineLi
from adaptctl.control.adaptation.composite import Filtered, TorqueFilter
from adaptctl.control.adaptation.law import Period
from adaptctl.dynamics.recursion.energy import momentum_terms
from adaptctl.scalars import Column, column

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
