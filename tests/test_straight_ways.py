"""Loops followed in native code: the configurations, and the refusals, of the way that looks at every step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night
from random_loops import RECIPES, random_loop

from adaptctl.arrays import Array
from adaptctl.dynamics import Mechanism, load
from adaptctl.dynamics.array_equations import COMPILE_AFTER_CALLS
from adaptctl.dynamics.loops.continuation import Continuation
from adaptctl.errors import InputError, NonFiniteError, SingularityError

ARMS = ("semi_direct_drive", "semi_direct_drive_parallelogram")


def continuations(mechanism: Mechanism) -> tuple[Continuation, Continuation]:
    """One that looks at every step, and one that follows in native code."""
    slow, fast = (mechanism.continuation, Mechanism(mechanism.description).continuation)
    assert slow is not None
    assert fast is not None
    slow._ways.work, fast._ways.work = -1e9, 1.0
    return slow, fast


def ends(continuation: Continuation, p: Array) -> list[Any]:
    """The configuration at each position, or the words of the refusal."""
    found: list[Any] = []
    for row in p:
        try:
            found.append(continuation.follow(row))
        except SingularityError as error:
            found.append(str(error))
    return found


def assert_same(one: list[Any], other: list[Any]) -> None:
    """Round-off apart, a step being taken after fused multiplications in one and the other."""
    for a, b in zip(one, other, strict=True):
        if isinstance(a, str):
            assert a == b
        else:
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_arms_are_followed_as_they_are_step_by_step(name: str) -> None:
    slow, fast = continuations(load(name))
    p = slow._start + np.random.default_rng(0).uniform(-2.5, 2.5, (60, 3)) * [2.0, 1.0, 1.0]
    expected = ends(slow, p)
    assert any(isinstance(end, str) for end in expected) == (name != "semi_direct_drive"), "which turns all round"
    assert_same(ends(fast, p), expected)
    within = p[[not isinstance(end, str) for end in expected]]
    alone = [fast.follow_alone(row) for row in within]
    assert sum(one is None for one in alone) < 5
    whole = fast.follow(within)
    assert_same([row if one is None else one for one, row in zip(alone, whole, strict=True)], list(slow.follow(within)))
    if len(within) < len(p):
        with pytest.raises(SingularityError):
            fast.follow(p)
    q, begin = (np.tile(x, (2, 1)) for x in (fast.reference, fast._start))
    assert fast._ways.followed(q, begin, np.full((2, 3), 0.01), np.array([1, 3]))[1].all(), "all are sure"


@pytest.mark.parametrize("name", mostly_at_night(sorted(RECIPES), "gears in a loop", "planar weld", "spatial hinge"))
def test_random_loops_are_followed_as_they_are_step_by_step(name: str) -> None:
    mechanism, _ = random_loop(3, RECIPES[name])
    slow, fast = continuations(mechanism)
    p = slow._start + np.random.default_rng(1).uniform(-0.6, 0.6, (6, mechanism.dof))
    expected = ends(slow, p)
    assert_same(ends(fast, p), expected)
    for row, end in zip(p, expected, strict=True):
        alone = fast.follow_alone(row)
        assert alone is None or not isinstance(end, str)
        assert alone is None or np.abs(alone - end).max() < 1e-12


def test_ways_from_elsewhere_and_no_way_at_all() -> None:
    slow, fast = continuations(load("semi_direct_drive"))
    start = slow.follow(slow._start + np.array([[0.5, 0.2, -0.1], [3.0, 0.0, 0.3]]))
    p = start[:, slow.primary] + 0.4
    np.testing.assert_allclose(fast.follow(p, start), slow.follow(p, start), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(fast.follow(slow._start), slow.follow(slow._start))
    assert fast.follow(np.empty((0, 3))).shape == (0, 5)


def test_a_very_long_way_is_left_to_code_that_hears_an_interruption() -> None:
    _, fast = continuations(load("semi_direct_drive"))
    far = fast._start + np.array([0.0, 600.0, 600.0])
    assert fast.follow_alone(far) is None
    assert not fast._ways.pays(fast._steps(far[None] - fast._start))
    near = fast._start + np.array([1e9, 1.0, 0.0])
    np.testing.assert_allclose(
        fast.follow_alone(near)[1:], fast.follow(fast._start + np.array([0.0, 1.0, 0.0]))[1:], atol=1e-12
    )


@pytest.mark.parametrize("bad", [[np.nan, 0.0, 0.0], [0.0, -np.inf, 0.0], [0.0, 0.0], [[0.0] * 2] * 3, ["a", 0.0, 0.0]])
def test_an_arm_with_loops_refuses_alike_before_and_after_its_code_is_native(bad: Any) -> None:
    arm = Mechanism(load("semi_direct_drive").description)
    fine = np.array(arm.neutral_configuration) + 0.1
    said: list[list[str]] = []
    for _ in range(2):
        said.append([])
        for call in (lambda p: arm.configuration(p), lambda p: arm.inverse_dynamics(p, fine, fine)):
            with pytest.raises((InputError, NonFiniteError)) as raised:
                call(bad if isinstance(bad[0], str) else np.array(bad))
            said[-1].append(str(raised.value))
        with pytest.raises(InputError) as raised:
            arm.inverse_dynamics(fine, fine, np.array(bad, dtype=object) if isinstance(bad[0], str) else np.array(bad))
        said[-1].append(str(raised.value))
        for _ in range(2 * COMPILE_AFTER_CALLS):
            arm.inverse_dynamics(fine, fine, fine)
    assert arm.continuation is not None
    assert arm.continuation._ways.ready
    assert said[0] == said[1]


def test_calls_of_an_arm_with_loops_are_those_of_its_batches() -> None:
    arm = Mechanism(load("semi_direct_drive").description)
    p, v, a = np.random.default_rng(2).uniform(-0.4, 0.4, (3, 20, 3))
    p += arm.neutral_configuration
    first = [arm.inverse_dynamics(*state) for state in zip(p, v, a, strict=True)]
    for _ in range(COMPILE_AFTER_CALLS):
        arm.inverse_dynamics(p[0], v[0], a[0])
    later = [arm.inverse_dynamics(*state) for state in zip(p, v, a, strict=True)]
    np.testing.assert_allclose(later, first, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(arm.inverse_dynamics(p, v, a), first, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(
        arm.inverse_dynamics(p[0], v, a[0]), arm.inverse_dynamics(np.tile(p[0], (20, 1)), v, a[0])
    )
