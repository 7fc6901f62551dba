"""Nothing is learned from a period whose torque was clipped, and nothing that is not finite stays in a state."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.control import CushionedFloor, ReferencePoint, SafetyFilter, SlotineLi
from adaptctl.control.pytree import leaves
from adaptctl.errors import InputError, NonFiniteError
from adaptctl.identifiability import ReducedModel

ARM = random_chain(3, 3)
MODEL = ReducedModel.full(ARM)
TRUE, K = np.asarray(ARM.inertial_parameters), len(MODEL.columns)
BASE: dict[str, Any] = {"bandwidth": 6.0, "damping": [3.0, 4.0, 2.0], "initial": 0.9 * TRUE, "control_period": 1e-3}
GOAL = ReferencePoint(np.array([0.1, -0.5, 0.4]), np.array([0.2, -0.1, 0.3]), np.array([1.0, 0.5, -1.0]))
P, V = np.array([0.2, -0.4, 0.3]), np.array([0.1, 0.2, -0.3])
PAIR = ReducedModel.full(random_chain(3, 2))
TWO, SPEEDS = P[:2], V[:2]
TWO_GOAL = ReferencePoint(*(part[:2] for part in GOAL))


def law(torque_limits: Any = None) -> SlotineLi:
    return SlotineLi(MODEL, adaptation=np.full(K, 0.5), torque_limits=torque_limits, **BASE)


def two_ticks(controller: SlotineLi) -> tuple[Array, Array, Array]:
    """The first torque, and the estimates after two ticks."""
    first, state = controller.step(controller.init(P, V), P, V, GOAL)
    _, after = controller.step(state, P + 1e-3 * V, V, GOAL)
    return first, state.estimate, after.estimate


@settings(max_examples=8, deadline=None)
@given(joint=st.integers(0, 2), share=st.floats(0.01, 1.99))
def test_a_period_teaches_unless_some_joint_was_beyond_its_limit(joint: int, share: float) -> None:
    asked, before, learned = two_ticks(law())
    assert np.any(learned != before)
    limits = np.full(3, np.inf)
    limits[joint] = share * abs(asked[joint])
    torque, first, second = two_ticks(law(limits))
    np.testing.assert_array_equal(torque, asked)  # what limits it is behind the law
    np.testing.assert_array_equal(second, first if share < 1.0 else learned)


def test_at_its_limit_a_torque_is_not_clipped() -> None:
    asked, _, learned = two_ticks(law())
    np.testing.assert_array_equal(two_ticks(law(np.abs(asked)))[2], learned)


def test_what_is_remembered_is_the_torque_that_was_let_through() -> None:
    controller = law(0.5)
    asked, state = controller.step(controller.init(P, V), P, V, GOAL)
    np.testing.assert_array_equal(state.torque, np.clip(asked, -0.5, 0.5))
    np.testing.assert_array_equal(state.dt, [0.0])


def test_limits_are_the_mechanisms_own_unless_given() -> None:
    assert np.all(np.isinf(np.asarray(law().torque_limits)))
    assert np.all(np.asarray(law(7.0).torque_limits) == 7.0)
    with pytest.raises(InputError, match=r"torque_limits: expected positive numbers, got \[0\.0, 0\.0"):
        law(0.0)


@cache
def floor() -> SlotineLi:
    """A law whose operations grow with the cube of the number of parameters, on two links."""
    gain = np.linspace(0.5, 2.0, len(PAIR.columns))
    first = {"initial": 0.9 * PAIR.mechanism.inertial_parameters}
    return SlotineLi(PAIR, 6.0, [3.0, 4.0], CushionedFloor(gain, 0.3, 15.0, 1.5), **first)


@cache
def guarded_floor() -> SafetyFilter:
    return SafetyFilter(floor(), 50.0)


@pytest.mark.parametrize("size", [1e155, 1e300])
@pytest.mark.parametrize("arms", [(), (5,)])
def test_a_tick_that_overflows_is_refused_and_its_state_with_it(size: float, arms: tuple[int, ...]) -> None:
    """Information of squares beyond a double: many arms once put it into the state, in which it stayed."""
    controller, p, v = floor(), np.broadcast_to(TWO, (*arms, 2)), np.broadcast_to(SPEEDS, (*arms, 2))
    fast = v.copy()
    fast[-1:] *= size
    state = controller.init(p, v)
    with pytest.raises(NonFiniteError, match=r"SlotineLi: the (torque|state)"):
        overflowing(controller, state, p, fast)
    assert all(np.isfinite(part).all() for part in leaves(state))


def overflowing(controller: SlotineLi, state: Any, p: Array, v: Array) -> None:
    """Ticks in which what is too large reaches what is learned."""
    for _ in range(3):
        _, state = controller.step(state, p, v, TWO_GOAL)
        assert all(np.isfinite(part).all() for part in leaves(state))


@pytest.mark.parametrize("arms", [(), (5,)])
def test_a_start_that_overflows_is_refused(arms: tuple[int, ...]) -> None:
    p, v = np.broadcast_to(TWO, (*arms, 2)), np.broadcast_to(SPEEDS, (*arms, 2)).copy()
    v[-1:] = 1e308
    with pytest.raises(NonFiniteError, match="SlotineLi: the initial state is not finite"):
        floor().init(p, v)


@pytest.mark.parametrize("size", [1e100, 1e155, 1e300])
def test_a_guarded_arm_that_overflows_is_braked_and_the_others_learn_on(size: float) -> None:
    controller, p = guarded_floor(), np.broadcast_to(TWO, (4, 2))
    v = np.broadcast_to(SPEEDS, (4, 2))
    burst = v.copy()
    burst[2] *= size
    state, alone = controller.init(p, v), controller.init(p, v)
    for speed in (v, burst, v, v):
        torque, state = controller.step(state, p, speed, TWO_GOAL)
        _, alone = controller.step(alone, p, v, TWO_GOAL)
        assert all(np.isfinite(part).all() for part in (torque, *leaves(state)))
    np.testing.assert_array_equal(state.flags.stopped[:, 0], [0.0, 0.0, 1.0, 0.0])
    for here, there in zip(leaves(state), leaves(alone), strict=True):
        np.testing.assert_array_equal(np.delete(here, 2, axis=0), np.delete(there, 2, axis=0))
