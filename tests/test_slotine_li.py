"""Slotine and Li's controller: its Lyapunov function behaves as the theorem says, on 36 parameters as on 60."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from figures import require

from adaptctl.arrays import Array
from adaptctl.compilation import compile_function, outlined
from adaptctl.control import (
    Gains,
    PriorRanges,
    ReferencePoint,
    Sinusoids,
    SlotineLi,
    adaptation_gain,
    lyapunov,
    mapped_gain,
    sliding_variable,
)
from adaptctl.control.pytree import leaves
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import GainError, InputError, NonFiniteError, PhysicalConsistencyWarning
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column, spread

REFERENCE = Sinusoids((0.0, -0.6, 0.8, 0.0, 0.5, 0.0), (0.4,) * 6, (0.5, 0.6, 0.7, 0.8, 0.9, 1.0), start_time=0.5)
START = REFERENCE(0.0).p + 0.1


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    with pytest.warns(PhysicalConsistencyWarning):
        return load("puma560")


@pytest.fixture(scope="module")
def reduced(puma: Mechanism) -> ReducedModel:
    return ReducedModel(puma)


@pytest.fixture(scope="module")
def gains() -> Gains:
    return Gains(np.full(6, 8.0), np.array([90.0, 150.0, 70.0, 20.0, 16.0, 18.0]))


def controller(model: ReducedModel, gains: Gains, **options: object) -> SlotineLi:
    return SlotineLi(model, gains.bandwidth, gains.damping, **options)  # type: ignore[arg-type]


def small_gain(model: ReducedModel) -> Array:
    return adaptation_gain(model, PriorRanges(mass=2.0, first_moment=1.0, inertia=0.3))


def run_of(rows: list[tuple[Array, ...]], times: Array) -> SimpleNamespace:
    p, v, estimate = (np.array(column) for column in zip(*rows, strict=True))
    reference = REFERENCE(times)
    return SimpleNamespace(p=p, v=v, estimate=estimate, reference_p=reference.p, reference_v=reference.v)


def exact_law(law: SlotineLi, step: float, duration: float) -> tuple[SimpleNamespace, Array]:
    """The continuous-time loop: the law evaluated inside every stage of RK4. V and the times."""
    model, mechanism = law.model, law.model.mechanism
    e, D = mechanism.equations, Column(mechanism.inertial_parameters.tolist())
    bandwidth, damping = Column(law.bandwidth.tolist()), Column(law.damping.tolist())
    gain = Column(np.asarray(law.adaptation).tolist())

    def rates(p: Column, v: Column, estimate: Column, pd: Column, vd: Column, ad: Column) -> tuple[Column, ...]:
        v_r, a_r = vd - bandwidth * (p - pd), ad - bandwidth * (v - vd)
        s = v - v_r
        motion = e.motion(p, v, v_r, a_r)
        torque = motion.torque(spread(estimate, model.columns, 60)) - damping * s
        return v, e.forward_dynamics(p, v, torque, D), -(gain * motion.regressor_transpose_product(s, model.columns))

    sizes = {"p": 6, "v": 6, "estimate": len(model.columns), "pd": 6, "vd": 6, "ad": 6}
    native = compile_function(rates, sizes)
    times = np.arange(round(duration / step) + 1) * step
    points = [REFERENCE(times + shift * step) for shift in (0.0, 0.5, 1.0)]
    y = [START, np.zeros(6), np.zeros(len(model.columns))]
    rows = []
    for k in range(len(times)):
        rows.append(tuple(y))
        a, b, c = (ReferencePoint(*(part[k] for part in point)) for point in points)
        k1 = native(*y, *a)
        k2 = native(*(x + 0.5 * step * d for x, d in zip(y, k1, strict=True)), *b)
        k3 = native(*(x + 0.5 * step * d for x, d in zip(y, k2, strict=True)), *b)
        k4 = native(*(x + step * d for x, d in zip(y, k3, strict=True)), *c)
        y = [x + step / 6 * (p + 2 * q + 2 * r + s) for x, p, q, r, s in zip(y, k1, k2, k3, k4, strict=True)]
    return run_of(rows, times), times


def imbalance(law: SlotineLi, run: SimpleNamespace, times: Array) -> float:
    """|V + integral of s'Ks - V(0)| over V(0) at the end; the integral by Simpson's rule."""
    from scipy.integrate import simpson

    V = lyapunov(law, run, law.model.mechanism)
    dissipated = (sliding_variable(law, run) ** 2 * law.damping).sum(-1)
    return float(abs(V[-1] + simpson(dissipated, x=times) - V[0]) / V[0])


def test_lyapunov_falls_by_what_is_dissipated(reduced: ReducedModel, gains: Gains) -> None:
    law = controller(reduced, gains, adaptation=small_gain(reduced))
    coarse = imbalance(law, *exact_law(law, 1e-3, 0.5))
    fine = imbalance(law, *exact_law(law, 2.5e-4, 0.5))
    require("lyapunov-balance", coarse, 1e-7, "V + integral of s'Ks - V(0) over V(0), the law within RK4 of 1 ms")
    assert fine < coarse / 100.0 or fine < 1e-12


def held(law: SlotineLi, periods: int) -> Iterator[tuple[Array, Array, Array, Array]]:
    """The sampled loop: torque held over the control period, the plant exact within it (p, v, estimate, torque)."""
    mechanism, h = law.model.mechanism, law.control_period
    dynamics = outlined(mechanism.equations.forward_dynamics)

    def period(p: Column, v: Column, torque: Column, D: Column) -> tuple[Column, Column]:
        k1 = dynamics(p, v, torque, D)
        v2 = v + (0.5 * h) * k1
        k2 = dynamics(p + (0.5 * h) * v, v2, torque, D)
        v3 = v + (0.5 * h) * k2
        k3 = dynamics(p + (0.5 * h) * v2, v3, torque, D)
        v4 = v + h * k3
        k4 = dynamics(p + h * v3, v4, torque, D)
        return p + (h / 6) * (v + 2.0 * (v2 + v3) + v4), v + (h / 6) * (k1 + 2.0 * (k2 + k3) + k4)

    native = compile_function(period, {"p": 6, "v": 6, "torque": 6, "D": 60})
    p, v, state = START, np.zeros(6), law.init(START, np.zeros(6))
    points = REFERENCE(np.arange(periods) * h)
    for k in range(periods):
        torque, state = law.step(state, p, v, ReferencePoint(*(part[k] for part in points)))
        yield p, v, state.estimate, torque
        p, v = native(p, v, torque, mechanism.inertial_parameters)


def test_a_held_torque_costs_one_order(reduced: ReducedModel, gains: Gains) -> None:
    errors = []
    for h in (1e-3, 2.5e-4):
        law = controller(reduced, gains, adaptation=small_gain(reduced), control_period=h)
        rows = [row[:3] for row in held(law, round(0.5 / h))]
        times = np.arange(len(rows)) * h
        errors.append(imbalance(law, run_of(rows, times), times))
    assert errors[0] < 1e-2
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.5)


def test_lyapunov_never_rises_in_the_sampled_loop(reduced: ReducedModel, gains: Gains) -> None:
    law = controller(reduced, gains, adaptation=small_gain(reduced))
    rows = [row[:3] for row in held(law, 1500)]
    V = lyapunov(law, run_of(rows, np.arange(1500) * 1e-3), reduced.mechanism)
    assert np.diff(V).max() < 1e-6 * V[0]
    assert V[-1] < 0.9 * V[0]


def test_36_parameters_are_the_same_controller_as_60(puma: Mechanism, reduced: ReducedModel, gains: Gains) -> None:
    full = ReducedModel.full(puma)
    gain = small_gain(full)
    torques = [
        np.array([row[3] for row in held(law, 500)])
        for law in (
            controller(full, gains, adaptation=gain),
            controller(reduced, gains, adaptation=mapped_gain(reduced, gain)),
        )
    ]
    worst = np.abs(torques[0] - torques[1]).max() / np.abs(torques[0]).max()
    require("reduced-is-full", worst, 1e-9, "torques adapting 36 parameters beside those adapting 60, relative")


def test_native_code_and_floats_take_the_same_step(reduced: ReducedModel, gains: Gains) -> None:
    law = controller(reduced, gains, adaptation=small_gain(reduced), initial=np.linspace(-1.0, 1.0, 36))
    p, v = START, np.linspace(-1.0, 1.0, 6)
    _, state = law.step(law.init(p, v), p, v, REFERENCE(0.3))
    torque, after = law.step(state, p + 0.01, 0.9 * v, REFERENCE(0.301))
    on_floats, *memory = law.python_step(p + 0.01, 0.9 * v, *REFERENCE(0.301), *leaves(state))
    np.testing.assert_allclose(torque, on_floats, rtol=0, atol=1e-12 * np.abs(torque).max())
    for native, plain in zip(leaves(after), memory, strict=True):
        np.testing.assert_allclose(native, plain, rtol=0, atol=1e-12 * max(np.abs(plain).max(), 1.0))


def test_the_true_parameters_leave_nothing_to_learn(reduced: ReducedModel, gains: Gains) -> None:
    true = reduced.fundamental_parameters
    law = controller(reduced, gains, initial=true, control_period=2.5e-4)
    *_, last = held(law, 8000)
    reference = REFERENCE(8000 * 2.5e-4)
    assert np.abs(last[0] - reference.p).max() < 5e-3
    np.testing.assert_array_equal(last[2], true)


def test_the_first_tick_learns_nothing(reduced: ReducedModel, gains: Gains) -> None:
    law = controller(reduced, gains, adaptation=small_gain(reduced), initial=np.ones(36))
    _, state = law.step(law.init(START, np.zeros(6)), START, np.zeros(6), REFERENCE(0.0))
    np.testing.assert_array_equal(state.estimate, np.ones(36))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"initial": np.zeros(35)}, r"initial estimate: expected shape \(36,\), got \(35,\)"),
        ({"adaptation": np.zeros(36)}, "positive"),
        ({"adaptation": -np.eye(36)}, "positive definite"),
        ({"adaptation": np.full(36, np.nan)}, "adaptation gain: expected finite"),
        ({"adaptation": 0.01}, r"adaptation gain: expected numbers \(k,\).* got shape \(\)"),
        ({"control_period": -1.0}, "control period"),
        ({"prior": "a"}, "prior: expected numbers"),
        ({"prior": np.ones(35)}, r"prior: expected shape \(36,\), got \(35,\)"),
    ],
)
def test_bad_settings_are_refused(reduced: ReducedModel, gains: Gains, options: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        controller(reduced, gains, **options)


def test_a_damping_the_period_cannot_carry_is_refused_with_what_it_can(reduced: ReducedModel, gains: Gains) -> None:
    with pytest.raises(GainError, match=r"at most .* times this damping or a period of at most"):
        SlotineLi(reduced, gains.bandwidth, 1e3 * gains.damping)


@pytest.mark.parametrize("what", ["p", "v", "reference"])
def test_nothing_that_is_not_finite_passes(reduced: ReducedModel, gains: Gains, what: str) -> None:
    law = controller(reduced, gains)
    bad = np.array([0.0, np.nan, 0.0, 0.0, 0.0, 0.0])
    p, v, reference = START, np.zeros(6), REFERENCE(0.0)
    state = law.init(p, v)
    if what == "reference":
        reference = reference._replace(a=bad)
    with pytest.raises(NonFiniteError, match=what):
        law.step(state, bad if what == "p" else p, bad if what == "v" else v, reference)
