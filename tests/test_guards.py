"""Guards: within limits they are not there; beyond, torques are held, learning waits, and what is not finite stops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control import ComputedTorque, Controller, ReferencePoint, SafetyFilter, SlotineLi, adaptation_gain
from adaptctl.control.pytree import leaves
from adaptctl.control.safety_filter import _all_finite, _differ
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.identifiability import ReducedModel
from adaptctl.recording.trace import FLAGS
from adaptctl.scalars import Column
from adaptctl.simulation import rollout

BOUND = 0.3
DAMPING = np.array([20.0, 40.0, 15.0, 2.0, 2.0, 2.0])


@pytest.fixture(scope="module")
def puma() -> Mechanism:
    return load("puma560_geared")


@pytest.fixture(scope="module")
def law(puma: Mechanism) -> SlotineLi:
    model = ReducedModel.full(puma)
    return SlotineLi(model, 8.0, DAMPING, adaptation_gain(model), torque_limits=np.inf)


@pytest.fixture(scope="module")
def held(law: SlotineLi) -> SafetyFilter:
    return SafetyFilter(law, torque_limits=30.0, rate_limits=5e3)


def ticks(controller: Controller[Any], inputs: Array) -> tuple[Array, list[Any]]:
    """Torques and states on rows of (5, r): p, v and the reference's three."""
    state, torques, states = controller.init(*inputs[0, :2]), [], []
    for p, v, *reference in inputs:
        torque, state = controller.step(state, p, v, ReferencePoint(*reference))
        torques.append(torque)
        states.append(state)
    return np.array(torques), states


def smooth(seed: int, count: int = 20, scale: float = 0.05) -> Array:
    rng = np.random.default_rng(seed)
    return 0.3 * rng.normal(size=(5, 6)) + scale * np.cumsum(rng.normal(size=(count, 5, 6)), axis=0)


def test_guards_that_never_act_change_nothing(law: SlotineLi) -> None:
    bare, states = ticks(law, smooth(0))
    torques, guarded = ticks(SafetyFilter(law, 1e9, 1e12, estimate_bounds=(-1e9, 1e9)), smooth(0))
    np.testing.assert_allclose(torques, bare, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(guarded[-1].estimate, states[-1].estimate, rtol=1e-12, atol=1e-15)
    assert all(mark[0] == 0.0 for state in guarded for mark in state.flags)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_torques_are_the_nearest_within_limits_and_reach(law: SlotineLi, held: SafetyFilter, seed: int) -> None:
    torques, states = ticks(held, smooth(seed))
    asked = np.array([law.step(law.init(x[0], x[1]), x[0], x[1], ReferencePoint(*x[2:]))[0] for x in smooth(seed)[:1]])
    np.testing.assert_allclose(torques[0], np.clip(asked[0], -5.0, 5.0), rtol=1e-9, atol=1e-9)
    assert np.abs(torques).max() <= 30.0
    assert np.abs(np.diff(torques, axis=0, prepend=0.0)).max() <= 5.0 * (1.0 + 1e-12)
    for torque, state in zip(torques, states, strict=True):
        np.testing.assert_array_equal(state.torque, torque)
        np.testing.assert_array_equal(state.inner.torque, torque)  # composite laws predict from what was applied
        frozen = max(state.flags.torque_limited[0], state.flags.rate_limited[0])
        assert state.flags.frozen[0] == frozen
        assert state.inner.dt[0] == (0.0 if frozen else law.control_period)


@pytest.mark.parametrize("applied", [None, np.full(6, 7.0), -2.5 * np.arange(6)])
def test_the_first_torque_is_within_reach_of_the_one_applied(held: SafetyFilter, applied: Array | None) -> None:
    """In native code, on floats, and of many arms at once; an arm stands under zero torque unless told otherwise."""
    p, v, goal = np.full(6, 0.5), np.zeros(6), ReferencePoint(*np.zeros((3, 6)))
    before = np.zeros(6) if applied is None else applied
    asked = np.clip(held.inner.step(held.inner.init(p, v), p, v, goal)[0], -30.0, 30.0)
    assert np.abs(asked - before).max() > 10.0
    expected = before + np.clip(asked - before, -5.0, 5.0)
    state = held.init(p, v, torque=applied)
    np.testing.assert_array_equal(state.torque, before)
    torque, after = held.step(state, p, v, goal)
    np.testing.assert_allclose(torque, expected, rtol=1e-12, atol=1e-12)
    assert after.flags.rate_limited[0] == after.flags.frozen[0] == 1.0
    np.testing.assert_allclose(held.python_step(p, v, *goal, *leaves(state))[0], expected, rtol=1e-12, atol=1e-12)
    many = held.init(np.tile(p, (3, 1)), np.tile(v, (3, 1)), torque=applied)
    np.testing.assert_allclose(held.step(many, np.tile(p, (3, 1)), v, goal)[0], [expected] * 3, rtol=1e-12, atol=1e-12)


def test_each_of_many_arms_may_be_held_by_its_own_torque(held: SafetyFilter) -> None:
    each = np.arange(18.0).reshape(3, 6)
    state = held.init(np.zeros((3, 6)), np.zeros((3, 6)), torque=each)
    np.testing.assert_array_equal(state.torque, each)
    again = held.reset(state, np.array([False, True, False]), np.zeros((3, 6)), np.zeros((3, 6)))
    np.testing.assert_array_equal(again.torque, each * [[1.0], [0.0], [1.0]])


def test_guards_within_guards_all_know_the_torque_applied(law: SlotineLi, held: SafetyFilter) -> None:
    outer = SafetyFilter(held, rate_limits=2e3, stop_damping=1.0)
    state = outer.init(np.zeros(6), np.zeros(6), torque=np.full(6, 9.0))
    np.testing.assert_array_equal([state.torque, state.inner.torque, state.inner.inner.torque], np.full((3, 6), 9.0))
    torque, _ = outer.step(state, np.full(6, 0.5), np.zeros(6), ReferencePoint(*np.zeros((3, 6))))
    assert np.abs(torque - 9.0).max() <= 2.0 * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("torque", "error", "message"),
    [
        (np.zeros(5), InputError, r"SafetyFilter: torque: expected shape \(\.\.\., 6\), got \(5,\)"),
        (np.zeros((2, 6)), InputError, r"torque: expected shape \(6,\) or \(6,\), got \(2, 6\)"),
        (np.full(6, np.nan), NonFiniteError, "SafetyFilter: torque: expected finite numbers"),
    ],
)
def test_an_applied_torque_that_cannot_be(
    held: SafetyFilter, torque: Array, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        held.init(np.zeros(6), np.zeros(6), torque=torque)


@pytest.mark.parametrize("limits", [{"torque_limits": 1e-3}, {"rate_limits": 1e-3}], ids=["torques", "rates"])
def test_nothing_is_learned_from_a_period_with_another_torque(law: SlotineLi, limits: dict[str, float]) -> None:
    inputs = smooth(1)
    _, waiting = ticks(SafetyFilter(law, **limits), inputs)
    np.testing.assert_array_equal(waiting[-1].estimate, law.initial)
    only = ("torque_limited", "rate_limited") if "torque_limits" in limits else ("rate_limited", "torque_limited")
    flags = waiting[-1].flags._asdict()
    assert [float(flags[name][0]) for name in (*only, "frozen")] == [1.0, 0.0, 1.0]
    _, learning = ticks(SafetyFilter(law, **limits, freeze=False), inputs)
    assert np.abs(learning[-1].estimate).max() > 0.0
    assert all(state.flags.frozen[0] == 0.0 for state in learning)


@pytest.mark.parametrize("what", range(5))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_brakes_from_then_on(held: SafetyFilter, law: SlotineLi, what: int, bad: float) -> None:
    inputs = smooth(2, scale=1e-3)
    inputs[7, what, 3] = bad
    torques, states = ticks(held, inputs)
    stopped = np.array([state.flags.stopped[0] for state in states])
    np.testing.assert_array_equal(stopped, np.arange(20) >= 7)
    braking = -DAMPING * np.where(np.isfinite(inputs[:, 1]), inputs[:, 1], 0.0)
    np.testing.assert_allclose(torques[15:], braking[15:], rtol=1e-12)  # within reach by then
    assert np.isfinite(torques).all()
    for state in states[7:]:
        np.testing.assert_array_equal(state.estimate, states[6].estimate)
    again, fresh = ticks(held, smooth(2, scale=1e-3))
    np.testing.assert_array_equal(again[:7], torques[:7])
    assert fresh[-1].flags.stopped[0] == 0.0


def test_a_law_that_overflows_is_stopped_too(held: SafetyFilter) -> None:
    inputs = smooth(3)
    inputs[4, 1] = 1e308  # finite, but what the damping makes of it is not
    _, states = ticks(held, inputs)
    assert [float(state.flags.stopped[0]) for state in states] == [0.0] * 4 + [1.0] * 16
    assert all(np.isfinite(state.estimate).all() for state in states)


def test_a_start_must_be_finite(held: SafetyFilter) -> None:
    with pytest.raises(NonFiniteError, match="SafetyFilter: p: expected finite numbers"):
        held.init(np.full(6, np.nan), np.zeros(6))


@pytest.fixture(scope="module")
def bounded(law: SlotineLi) -> SafetyFilter:
    return SafetyFilter(law, estimate_bounds=(-BOUND, BOUND))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_estimates_stay_within_their_bounds(law: SlotineLi, bounded: SafetyFilter, seed: int) -> None:
    _, states = ticks(bounded, smooth(seed))
    _, free = ticks(law, smooth(seed))
    estimates = np.array([state.estimate for state in states])
    assert np.abs(estimates).max() <= BOUND
    marked = any(state.flags.bounded[0] for state in states)
    assert marked == bool(max(np.abs(state.estimate).max() for state in free) > BOUND)


def test_a_rollout_has_the_marks(puma: Mechanism, law: SlotineLi) -> None:
    env = TrackingEnv(puma, 1, duration=0.2, initial_error=0.1)
    run = rollout(env, SafetyFilter(law, torque_limits=np.full(6, 40.0), rate_limits=1e4), seed=0)
    assert tuple(run.flags) == ("torque_limited", "rate_limited", "frozen", "bounded", "ringing", "stopped")
    assert set(run.flags) <= set(FLAGS)
    assert 0.0 < run.flags["frozen"].mean() < 1.0
    held = np.isclose(np.abs(run.torque), 40.0).any(axis=1)
    assert np.all(run.flags["torque_limited"][held] == 1.0)
    still = np.abs(np.diff(run.estimate, axis=0)).max(axis=1) == 0.0
    np.testing.assert_array_equal(still, run.flags["frozen"][:-1] == 1.0)


def test_loops_and_laws_that_estimate_nothing_can_be_guarded() -> None:
    arm = load("semi_direct_drive")
    guarded = SafetyFilter(ComputedTorque(arm, 5.0), torque_limits=1.0, stop_damping=2.0)
    p, v = arm.neutral_configuration, np.array([0.1, -0.2, 0.3])
    state = guarded.init(p, v)
    torque, state = guarded.step(state, p, v, ReferencePoint(p + 1.0, v, v))
    assert np.abs(torque).max() == 1.0
    torque, state = guarded.step(state, p, np.full(3, np.nan), ReferencePoint(p, v, v))
    np.testing.assert_array_equal(torque, 0.0)
    torque, state = guarded.step(state, p, v, ReferencePoint(p, v, v))
    np.testing.assert_allclose(torque, -2.0 * v)
    assert not hasattr(state, "estimate")


def test_long_mechanisms_are_guarded_in_python() -> None:
    chain = random_chain(0, MAX_COMPILED_LINKS + 1)
    guarded = SafetyFilter(ComputedTorque(chain, 5.0), stop_damping=1.0)
    n = chain.dof
    state = guarded.init(np.zeros(n), np.ones(n))
    spoilt = ReferencePoint(np.full(n, np.inf), np.zeros(n), np.zeros(n))
    torque, state = guarded.step(state, np.zeros(n), np.ones(n), spoilt)
    np.testing.assert_array_equal(torque, -1.0)
    assert state.flags.stopped[0] == 1.0


def test_the_law_runs_on_arrays_of_samples(held: SafetyFilter) -> None:
    """The guards branch by `where` alone: a batch is the ticks side by side."""
    inputs = [smooth(seed)[0] for seed in range(4)]
    inputs[2][0, 0] = np.nan
    start = held.init(np.zeros(6), np.zeros(6))
    from adaptctl.control.pytree import like

    batch = [Column(np.array([x[i] for x in inputs]).T) for i in range(5)]
    memory = like(start, [Column(np.tile(part[:, None], 4)) for part in leaves(start)])
    torque, after = held.law(batch[0], batch[1], ReferencePoint(*batch[2:]), memory)
    for k, x in enumerate(inputs):
        one, state = held.step(start, x[0], x[1], ReferencePoint(*x[2:]))
        np.testing.assert_allclose([np.broadcast_to(entry, 4)[k] for entry in torque], one, rtol=1e-9, atol=1e-9)
        assert np.broadcast_to(after.flags.stopped[0], 4)[k] == state.flags.stopped[0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"torque_limits": 0.0}, "torque_limits: expected positive numbers, got .0.0, 0.0"),
        ({"torque_limits": [1.0, 2.0]}, r"torque_limits: expected a number or 6 of them, got shape \(2,\)"),
        ({"rate_limits": np.nan}, "rate_limits: expected numbers, got"),
        ({"stop_damping": -1.0}, "stop_damping: expected finite numbers of at least 0"),
        ({"estimate_bounds": (1.0, 2.0)}, r"initial estimate of parameter 0 is 0, outside \[1, 2\]: start within"),
        ({"estimate_bounds": (1.0, -1.0)}, "estimate_bounds: expected lower < upper"),
        ({"estimate_bounds": (-np.ones(3), 1.0)}, "estimate_bounds: expected a number or 66 of them, got shape"),
        ({"estimate_bounds": (-np.ones(1), 1.0)}, "estimate_bounds: expected a number or 66 of them, got shape"),
        ({"estimate_bounds": (-1.0, np.ones((2, 66)))}, "estimate_bounds: expected a number or 66 of them, got shape"),
        ({"estimate_bounds": (np.nan, 1.0)}, "estimate_bounds: expected numbers, got nan"),
        ({"estimate_bounds": ("a", 1.0)}, "estimate_bounds: expected numbers"),
        ({"estimate_bounds": (-1.0,)}, "estimate_bounds: expected two bounds, lower and upper"),
        ({"estimate_bounds": 1.0}, "estimate_bounds: expected two bounds, lower and upper"),
        ({"position_limits": 1.0}, "position_limits: expected two bounds, lower and upper"),
    ],
)
def test_guards_that_cannot_be_are_refused(law: SlotineLi, settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SafetyFilter(law, **settings)


def test_what_a_law_does_not_know_must_be_given(puma: Mechanism) -> None:
    law = ComputedTorque(puma, 5.0)
    with pytest.raises(InputError, match="stop_damping: ComputedTorque has no damping for braking"):
        SafetyFilter(law)
    with pytest.raises(InputError, match="period: ComputedTorque has no control period"):
        SafetyFilter(law, rate_limits=1.0, stop_damping=1.0)
    with pytest.raises(InputError, match="estimate_bounds: ComputedTorque has no estimate"):
        SafetyFilter(law, estimate_bounds=(-1.0, 1.0), stop_damping=1.0)
    assert SafetyFilter(law, rate_limits=1.0, stop_damping=1.0, control_period=1e-3).control_period == 1e-3


@pytest.mark.parametrize("period", [-1.0, 0.0, np.nan])
def test_a_period_is_a_positive_time(law: SlotineLi, period: float) -> None:
    with pytest.raises(InputError, match="control period: expected a positive time in s"):
        SafetyFilter(law, rate_limits=1e3, control_period=period)


@pytest.mark.parametrize(
    "limits", [{"position_limits": (-0.5, 0.5)}, {"velocity_limits": 0.8}, {"velocity_limits": np.full(6, 0.8)}]
)
def test_beyond_limits_of_motion_it_brakes_from_then_on(law: SlotineLi, limits: dict[str, Any]) -> None:
    inputs = np.zeros((12, 5, 6))
    what = 0 if "position_limits" in limits else 1
    inputs[5, what, 2] = -0.9
    inputs[6:, 1] = 0.1
    torques, states = ticks(SafetyFilter(law, **limits), inputs)
    np.testing.assert_array_equal([state.flags.stopped[0] for state in states], np.arange(12) >= 5)
    np.testing.assert_allclose(torques[6:], -DAMPING * 0.1 * np.ones((6, 6)))


def rung(law: Controller[Any], factor: float, count: int = 200) -> list[Any]:
    """States while velocities are multiplied by a factor from tick to tick."""
    inputs = np.zeros((count, 5, 6))
    inputs[:, 1, 4] = 0.5 * factor ** np.arange(count)
    return ticks(law, inputs)[1]


def test_a_joint_that_rings_is_told_and_braked(law: SlotineLi) -> None:
    """A free loop of sampling ratio h has rho = 1 - h."""
    quiet = rung(SafetyFilter(law), -0.3)
    assert not any(state.flags.ringing[0] or state.flags.stopped[0] for state in quiet)
    told = rung(SafetyFilter(law), -0.99, 60)
    assert told[-1].flags.ringing[0] == 1.0
    assert [state.flags.stopped[0] for state in told].index(1.0) < 40
    warned = rung(SafetyFilter(law), -0.7, 60)
    assert warned[-1].flags.ringing[0] == 1.0
    assert not any(state.flags.stopped[0] for state in warned)


def test_a_jump_is_no_ringing(law: SlotineLi) -> None:
    """A reference that jumps turns the sign of s once."""
    inputs = np.zeros((100, 5, 6))
    inputs[:50, 2], inputs[50:, 2] = 0.05, -0.05
    _, states = ticks(SafetyFilter(law), inputs)
    assert not any(state.flags.ringing[0] or state.flags.stopped[0] for state in states)


def test_a_sliding_variable_beyond_measure_leaves_the_state_finite(law: SlotineLi) -> None:
    inputs = np.zeros((4, 5, 6))
    inputs[2, 1] = 1e200
    _, states = ticks(SafetyFilter(law, torque_limits=10.0), inputs)
    for state in states:
        assert all(np.isfinite(part).all() for part in leaves(state))


@pytest.mark.parametrize(("change", "told"), [(0.0, 0.0), (1e-9, 1.0), (-1e-9, 1.0)])
@pytest.mark.parametrize("joint", range(3))
def test_a_torque_that_is_another_by_however_little_is_told(joint: int, change: float, told: float) -> None:
    given = [0.5, -2.0, 30.0]
    asked = [x + change * (j == joint) for j, x in enumerate(given)]
    assert _differ(Column(asked), Column(given)) == told


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", range(5))
def test_one_number_that_is_not_finite_is_found_wherever_it_is(place: int, bad: float) -> None:
    numbers = [1.0, -2.0, 3.0, -4.0, 5.0]
    assert _all_finite((Column(numbers[:2]), Column(numbers[2:])))
    numbers[place] = bad
    assert not _all_finite((Column(numbers[:2]), Column(numbers[2:])))
