"""Feedback of errors under a hold: poles where they were asked for, the least cost, and true margins."""

from __future__ import annotations

import math
from typing import Any, cast

import control
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, solve_discrete_lyapunov

from adaptctl.arrays import Array
from adaptctl.control import ErrorFeedback
from adaptctl.control.gains.error_feedback import margins
from adaptctl.control.gains.gain_design import largest_with_delay
from adaptctl.errors import GainError, InputError

TEXT = cast(Any, "a")

periods = st.floats(1e-4, 1e-2)


def held_loop(feedback: ErrorFeedback, factor: float = 1.0, delay: int = 0) -> Array:
    """One period of the error under a held acceleration, `delay` periods old, from the exponential of the plant."""
    T = feedback.control_period
    whole = expm(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]) * T)
    A, B = whole[:2, :2], whole[:2, 2]
    K = factor * np.array([feedback.stiffness, feedback.rate])
    if delay == 0:
        return A - np.outer(B, K)
    loop = np.zeros((2 + delay, 2 + delay))
    loop[:2, :2], loop[:2, 2], loop[-1, :2] = A, -B, K
    loop[2:-1, 3:] = np.eye(delay - 1)
    return loop


def radius(matrix: Array) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@settings(deadline=None)
@given(st.floats(0.5, 100.0), st.floats(0.2, 3.0), periods)
def test_the_samples_are_those_of_the_continuous_poles(bandwidth: float, ratio: float, period: float) -> None:
    feedback = ErrorFeedback.from_bandwidth(bandwidth, ratio, period)
    roots = np.roots([1.0, 2.0 * ratio * bandwidth, bandwidth**2])
    poles = np.linalg.eigvals(held_loop(feedback))
    # Sums and products: equal roots themselves are known to half the digits only.
    np.testing.assert_allclose(np.sum(poles), np.sum(np.exp(roots * period)), rtol=1e-9)
    np.testing.assert_allclose(np.prod(poles), np.prod(np.exp(roots * period)), rtol=1e-9)
    np.testing.assert_allclose(np.sum(feedback.sampled_poles), np.sum(poles), rtol=1e-9)


def test_a_short_hold_gives_the_continuous_gains() -> None:
    feedback = ErrorFeedback.from_bandwidth(8.0, 0.7, 1e-5)
    assert feedback.stiffness == pytest.approx(64.0, rel=1e-3)
    assert feedback.rate == pytest.approx(11.2, rel=1e-3)
    assert feedback.bandwidth == pytest.approx(8.0, rel=1e-3)
    assert feedback.damping_ratio == pytest.approx(0.7, rel=1e-3)


@pytest.mark.parametrize("bandwidth", [1e-150, 1e-14, 1e-9, 1e-3])
@pytest.mark.parametrize("ratio", [1e-3, 0.7, 1.0, 1.0 + 1e-9, 1e3])
def test_a_slow_loop_has_the_continuous_gains(bandwidth: float, ratio: float) -> None:
    """What is far below the sampling rate does not notice it, and is not lost to round-off either."""
    feedback = ErrorFeedback.from_bandwidth(bandwidth, ratio, 1e-3)
    assert feedback.stiffness == pytest.approx(bandwidth**2, rel=2e-3 * bandwidth * max(ratio, 1.0) + 1e-12, abs=0.0)
    assert feedback.rate == pytest.approx(
        2.0 * ratio * bandwidth, rel=3e-3 * bandwidth / min(ratio, 1.0) + 2e-3, abs=0.0
    )


def test_a_period_however_short_has_the_continuous_gains() -> None:
    feedback = ErrorFeedback.from_bandwidth(8.0, 0.7, 1e-200)
    assert (feedback.stiffness, feedback.rate) == pytest.approx((64.0, 11.2), rel=1e-12)


@pytest.mark.parametrize("ratio", [1e8, 1e200])
def test_a_slow_pole_far_from_the_fast_one_is_not_lost(ratio: float) -> None:
    """Its root is 1/(2 zeta) of the bandwidth; the fast one is gone within a period."""
    feedback = ErrorFeedback.from_bandwidth(1.0, ratio, 1e-3)
    assert feedback.rate == pytest.approx(1e3, rel=1e-7)
    assert feedback.stiffness == pytest.approx(1e3 / (2.0 * ratio), rel=1e-7, abs=0.0)


def test_a_loop_far_faster_than_the_samples_is_at_rest_after_two() -> None:
    feedback = ErrorFeedback.from_bandwidth(1e200, 0.5, 1e-3)
    assert (feedback.stiffness, feedback.rate) == pytest.approx((1e6, 1.5e3), rel=1e-12)
    assert feedback.sampled_poles == (0.0, 0.0)
    assert feedback.poles == pytest.approx([1e3 * math.log(np.finfo(float).tiny)] * 2, rel=1e-12)


@pytest.mark.parametrize(("bandwidth", "ratio"), [(1e-320, 1.0), (1e308, 1e4), (1e-200, 1e200), (1.0, 1e-200)])
def test_a_bandwidth_whose_gains_are_lost_to_round_off_is_named(bandwidth: float, ratio: float) -> None:
    with pytest.raises(InputError) as raised:
        ErrorFeedback.from_bandwidth(bandwidth, ratio, 1e-3)
    told = str(raised.value)
    assert told.startswith(f"bandwidth of {bandwidth:g} rad/s and damping ratio of {ratio:g}: ")
    assert "poles" not in told
    assert "\n" not in told


@settings(max_examples=20, deadline=None)
@given(st.floats(1.0, 1e6), st.floats(0.0, 1e3), st.floats(0.1, 10.0), periods)
def test_lqr_is_least_among_its_neighbours(position: float, velocity: float, effort: float, period: float) -> None:
    """The cost from two starts, by the Lyapunov equation of the closed loop."""
    best = ErrorFeedback.from_lqr(position, velocity, effort, period)

    def cost(feedback: ErrorFeedback) -> float:
        K = np.array([[feedback.stiffness, feedback.rate]])
        Q = np.diag([position, velocity]) + effort * K.T @ K
        return float(np.trace(solve_discrete_lyapunov(held_loop(feedback).T, Q, method="direct")))

    for stiffer, quicker in ((1.02, 1.0), (0.98, 1.0), (1.0, 1.02), (1.0, 0.98)):
        other = ErrorFeedback(best.stiffness * stiffer, best.rate * quicker, period)
        assert cost(best) < cost(other)


@settings(deadline=None)
@given(st.floats(1.0, 60.0), st.floats(1.0, 3.0), periods)
def test_a_cascade_of_two_lags_has_the_gains(bandwidth: float, ratio: float, period: float) -> None:
    """Slotine and Li: e'' = -(Lambda + K/M) e' - Lambda K/M e; equal poles to the hold's own rounding."""
    feedback = ErrorFeedback.from_bandwidth(bandwidth, ratio, period)
    slow, fast = feedback.cascaded
    assert slow <= fast
    assert slow + fast == pytest.approx(feedback.rate, rel=1e-12)
    assert slow * fast == pytest.approx(feedback.stiffness, rel=0.03 + bandwidth * period)


@settings(max_examples=20, deadline=None)
@given(st.floats(2.0, 100.0), st.floats(0.4, 2.0), periods, st.integers(0, 3))
def test_margins_are_where_the_loop_becomes_unstable(bandwidth: float, ratio: float, period: float, delay: int) -> None:
    feedback = ErrorFeedback.from_bandwidth(bandwidth, ratio, period)
    assume(radius(held_loop(feedback, 1.0, delay)) < 0.999999)
    found = margins(feedback.loop(delay))
    assert found.gain_reduction == 0.0
    assert radius(held_loop(feedback, 0.999 * found.gain, delay)) < 1.0
    assert radius(held_loop(feedback, 1.001 * found.gain, delay)) > 1.0
    ticks = found.delay / period
    if ticks < 200.0:
        assert radius(held_loop(feedback, 1.0, delay + math.floor(ticks * 0.9999))) < 1.0 + 1e-9
        assert radius(held_loop(feedback, 1.0, delay + math.floor(ticks) + 1)) > 1.0


def test_without_delay_the_gain_margin_is_that_of_the_hold() -> None:
    """At half the sampling rate the held double integrator with k, c is -cT/2: the limit T_c K/M < 2."""
    feedback = ErrorFeedback.from_bandwidth(30.0, 1.0, 2e-3)
    found = margins(feedback.loop())
    assert found.gain == pytest.approx(2.0 / (feedback.rate * 2e-3), rel=1e-12)
    assert found.phase == pytest.approx(found.delay * found.crossover, rel=1e-9)


@pytest.mark.parametrize("delay", range(4))
def test_what_a_delayed_hold_carries(delay: int) -> None:
    """z^(d+1) - z^d + g: three quarters of the largest stable g, 2 without delay and 1 with a delay of one."""
    limit = largest_with_delay(delay) / 0.75

    def loop(g: float) -> float:
        return float(np.abs(np.roots([1.0, -1.0, *[0.0] * (delay - 1), g] if delay else [1.0, g - 1.0])).max())

    assert limit == pytest.approx([2.0, 1.0, 0.618034, 0.445042][delay], rel=1e-5)
    assert loop(0.999 * limit) < 1.0 < loop(1.001 * limit)


@given(st.floats(1.0, 50.0), st.floats(0.3, 3.0), st.floats(0.2, 5.0))
def test_faster_poles_are_farther_out(bandwidth: float, ratio: float, factor: float) -> None:
    feedback = ErrorFeedback.from_bandwidth(bandwidth, ratio, 1e-3).with_bandwidth_factor(factor)
    expected = ErrorFeedback.from_bandwidth(factor * bandwidth, ratio, 1e-3)
    assert feedback.stiffness == pytest.approx(expected.stiffness, rel=1e-5)
    assert feedback.rate == pytest.approx(expected.rate, rel=1e-5)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: ErrorFeedback(1.0, 3000.0, 1e-3), GainError, "are unstable at a control period of 0.001 s. The rate"),
        (lambda: ErrorFeedback(-1.0, 1.0, 1e-3), InputError, "gains: expected positive numbers"),
        (lambda: ErrorFeedback(1.0, 1.0, 0.0), InputError, "control period: expected a positive time"),
        (lambda: ErrorFeedback.from_bandwidth(0.0, 1.0, 1e-3), InputError, "expected a positive bandwidth and damping"),
        (lambda: ErrorFeedback.from_bandwidth(8.0, math.nan, 1e-3), InputError, "expected a positive bandwidth"),
        (lambda: ErrorFeedback.from_poles([-1.0], 1e-3), InputError, "poles: expected two in the left half-plane"),
        (lambda: ErrorFeedback.from_poles([-1.0, 2.0], 1e-3), InputError, "poles: expected two in the left"),
        (lambda: ErrorFeedback.from_poles([-1 + 1j, -1 + 1j], 1e-3), InputError, "real or conjugate"),
        (lambda: ErrorFeedback.from_poles([-1 + 1j, -2 - 1j], 1e-3), InputError, "real or conjugate"),
        (lambda: ErrorFeedback.from_poles(TEXT, 1e-3), InputError, "poles: expected two in the left .*, got 'a'"),
        (lambda: ErrorFeedback.from_poles([TEXT, TEXT], 1e-3), InputError, r"poles: .*, got \['a', 'a'\]"),
        (lambda: ErrorFeedback.from_poles(cast(Any, None), 1e-3), InputError, "poles: .*, got None"),
        (lambda: ErrorFeedback.from_poles([-(10**400), -1], 1e-3), InputError, "poles: expected two in the left"),
        (lambda: ErrorFeedback.from_poles([-1.0, -2.0], TEXT), InputError, "control period: .* in s .*, got 'a'"),
        (lambda: ErrorFeedback.from_bandwidth(TEXT, 1.0, 1e-3), InputError, "bandwidth: expected a number, got 'a'"),
        (lambda: ErrorFeedback.from_bandwidth(8.0, TEXT, 1e-3), InputError, "damping ratio: expected a number, got"),
        (
            lambda: ErrorFeedback.from_lqr(TEXT, 0.0, 1.0, 1e-3),
            InputError,
            "weights: position: expected a positive number",
        ),
        (lambda: ErrorFeedback(TEXT, 1.0, 1e-3), InputError, "gains: stiffness: expected a number, got 'a'"),
        (lambda: ErrorFeedback.from_lqr(1.0, -1.0, 1.0, 1e-3), InputError, "velocity: expected a finite number"),
        (
            lambda: ErrorFeedback.from_lqr(1.0, 0.0, 1e30, 1e-3),
            InputError,
            "weights: too different in size for a control",
        ),
        (lambda: ErrorFeedback.from_bandwidth(8.0, 0.7, 1e-3).cascaded, InputError, "need a ratio of at least 1"),
    ],
)
def test_gains_that_cannot_be_are_refused(make: object, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("factor", [math.nan, math.inf, 0.0, -1.0, "a", None])
def test_poles_are_not_made_faster_by_what_is_no_factor(factor: Any) -> None:
    with pytest.raises(InputError, match=f"^factor: expected a positive finite number, got {factor!r}$"):
        ErrorFeedback.from_bandwidth(8.0, 1.0, 1e-3).with_bandwidth_factor(factor)


def test_a_factor_that_leaves_no_gains_is_named() -> None:
    with pytest.raises(InputError, match=r"^factor: 1e-300 gives gains that exceed double precision"):
        ErrorFeedback.from_bandwidth(8.0, 1.0, 1e-3).with_bandwidth_factor(1e-300)


@pytest.mark.parametrize(("gain", "more", "less"), [(-0.5, 2.0, 0.0), (-1.0, math.inf, 1.0), (-4.0, math.inf, 0.25)])
def test_a_loop_without_memory_turns_at_minus_one(gain: float, more: float, less: float) -> None:
    """Its response crosses no axis at any frequency: it lies on one."""
    found = margins(control.ss([], [], [], [[gain]], 0.01))
    assert (found.gain, found.gain_reduction) == (more, less)


@pytest.mark.parametrize("period", [0, None, True])
def test_a_loop_without_a_sampling_time_has_no_margins_in_seconds(period: float | None) -> None:
    with pytest.raises(InputError, match="margins: expected a sampled loop with its sampling time in s, got dt ="):
        margins(control.ss([[-0.5]], [[1.0]], [[1.0]], [[0.0]], period))


@pytest.mark.parametrize(("inputs", "outputs"), [(2, 2), (1, 2), (2, 1)])
def test_a_loop_of_several_signals_has_no_margins(inputs: int, outputs: int) -> None:
    loop = control.ss([[0.5]], np.ones((1, inputs)), np.ones((outputs, 1)), np.zeros((outputs, inputs)), 0.01)
    with pytest.raises(InputError, match=f"margins: expected one input and one output, got {inputs} and {outputs}"):
        margins(loop)


@pytest.mark.parametrize(("delay", "last"), [(3, 1.0), (5, 1.0), (48, 47.5 / 48.5)])
def test_of_many_crossings_the_last_counts_that_comes_before_half_the_sampling_rate(delay: int, last: float) -> None:
    """A late difference, g z^-d (1 - z^-1), is 2 g sin(x/2) at an angle x and turns by (d + 1/2) x - pi/2: it grows
    up to half the sampling rate, which it meets at -1 for odd d."""
    shifts = np.eye(delay + 1, k=-1)
    late = control.ss(
        shifts, np.eye(delay + 1, 1), 0.2 * (np.eye(delay + 1)[-2:-1] - np.eye(delay + 1)[-1:]), 0.0, 0.01
    )
    found = margins(late)
    assert found.gain == pytest.approx(2.5 / math.sin(0.5 * math.pi * last), rel=1e-9)
    assert found.gain_reduction == 0.0
