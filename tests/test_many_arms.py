"""Controllers on many arms: each as alone, whatever the law, the number of arms and their neighbours."""

from __future__ import annotations

import re
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from nightly import mostly_at_night
from random_trees import random_chain
from sampled_loops import RANGES, arm, full, gains, posture, reduced

from adaptctl.arrays import Array
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control import (
    AdaptiveComputedTorque,
    BoundedGainForgetting,
    Composite,
    CompositeLearning,
    ComputedTorque,
    ConcurrentLearning,
    ConsistentAdaptation,
    Controller,
    Natural,
    PassivityIntegral,
    PDGravity,
    ReferencePoint,
    SafetyFilter,
    SlotineLi,
    TaskSpaceSlotineLi,
    adaptation_gain,
)
from adaptctl.control.pytree import leaves, like
from adaptctl.errors import InputError, NonFiniteError

pytestmark = pytest.mark.usefixtures("optimized")

PUMA, LOOP = "puma560_arm3", "semi_direct_drive"
PERIOD = 1e-3


def gain(name: str) -> Array:
    return adaptation_gain(reduced(name), RANGES, 0.3)


def slotine_li(name: str, law: Any = None) -> SlotineLi:
    return SlotineLi(reduced(name), 8.0, gains(name).damping, gain(name) if law is None else law)


LAWS: dict[str, Callable[[str], Controller[Any]]] = {
    "gradient": slotine_li,
    "composite": lambda name: slotine_li(name, Composite(gain(name), 0.1)),
    "forgetting": lambda name: slotine_li(name, BoundedGainForgetting(gain(name))),
    "composite learning": lambda name: slotine_li(name, CompositeLearning(gain(name), 0.1, reset_power=0.5)),
    "concurrent learning": lambda name: slotine_li(
        name, ConcurrentLearning(gain(name), 0.1, stack_size=2, novelty_threshold=1e-3)
    ),
    "lift": lambda name: SlotineLi(
        reduced(name),
        8.0,
        gains(name).damping,
        ConsistentAdaptation(0.1, arm(name).inertial_parameters, 0.1),
        reduced(name).fundamental_parameters,
    ),
    "natural": lambda name: SlotineLi(
        full("puma560_measured"),
        8.0,
        gains("puma560_measured").damping,
        Natural(0.1),
        arm("puma560_measured").inertial_parameters,
    ),
    "integral": lambda name: PassivityIntegral(reduced(name), 8.0, gains(name).damping, gain(name)),
    "task space": lambda name: TaskSpaceSlotineLi(
        reduced(name), 8.0, gains(name).damping, gain(name), reference_in_joints=True, singularity=0.1
    ),
    "adaptive computed torque": lambda name: AdaptiveComputedTorque(
        reduced(name), 8.0, 1.3 * reduced(name).fundamental_parameters, 0.05 * gain(name)
    ),
    "computed torque": lambda name: ComputedTorque(arm(name), 8.0),
    "pd": lambda name: PDGravity.from_model(reduced(name), 300.0, gains(name).damping),
    "guarded": lambda name: SafetyFilter(slotine_li(name), torque_limits=40.0, rate_limits=20_000.0),
    "guarded learning": lambda name: SafetyFilter(
        slotine_li(name, CompositeLearning(gain(name), 0.1)), torque_limits=40.0, rate_limits=20_000.0
    ),
    "guarded stack": lambda name: SafetyFilter(
        slotine_li(name, ConcurrentLearning(gain(name), 0.1, stack_size=2, novelty_threshold=1e-3)), torque_limits=40.0
    ),
    "guarded lift": lambda name: SafetyFilter(LAWS["lift"](name), torque_limits=40.0),
}
ON_ONE = {
    "natural": PUMA,
    "lift": LOOP,
    "forgetting": PUMA,
    "composite learning": PUMA,
    "guarded learning": PUMA,
    "guarded stack": LOOP,
    "guarded lift": LOOP,
}
KINDS = [
    (law, name)
    for i, law in enumerate(LAWS)
    for name in ((PUMA, LOOP), (LOOP, PUMA))[i % 2]
    if ON_ONE.get(law, name) == name
]
"""Each law on both arms, on each of which every other law is the first time"""


def situations(name: str, arms: int, ticks: int = 1) -> list[tuple[Array, Array, ReferencePoint]]:
    """Arms (arms, r) near their posture that move a little from tick to tick, and where each should be."""
    rng, home = np.random.default_rng(arms), posture(arm(name))
    p, v = home + rng.uniform(-0.1, 0.1, (arms, len(home))), rng.uniform(-1.0, 1.0, (arms, len(home)))
    goal = ReferencePoint(home + rng.uniform(-0.1, 0.1, p.shape), *rng.uniform(-1.0, 1.0, (2, *p.shape)))
    return [(p + PERIOD * k * v, (1.0 - 0.01 * k) * v, goal) for k in range(ticks)]


def one_by_one(controller: Controller[Any], cases: list[Any]) -> tuple[list[Array], Any]:
    """Torques of each tick and the last states, arm after arm."""
    p, v, _ = cases[0]
    states, torques = [controller.init(p[k], v[k]) for k in range(len(p))], []
    for p, v, goal in cases:
        results = [
            controller.step(states[k], p[k], v[k], ReferencePoint(*(part[k] for part in goal))) for k in range(len(p))
        ]
        torques.append(np.array([torque for torque, _ in results]))
        states = [state for _, state in results]
    return torques, states


@pytest.mark.parametrize(
    ("law", "name"), mostly_at_night(KINDS, *[*{law: (law, name) for law, name in KINDS[::-1]}.values()][::3])
)
def test_many_arms_are_as_each_alone(law: str, name: str) -> None:
    controller = LAWS[law](name)
    cases = situations("puma560_measured" if law == "natural" else name, 3, ticks=3)
    alone, states = one_by_one(controller, cases)
    state = controller.init(*cases[0][:2])
    assert type(state) is type(states[0])
    for (p, v, goal), expected in zip(cases, alone, strict=True):
        torque, state = controller.step(state, p, v, goal)
        np.testing.assert_allclose(torque, expected, rtol=1e-11, atol=1e-11 * np.abs(expected).max())
    for many, *each in zip(leaves(state), *map(leaves, states), strict=True):
        np.testing.assert_allclose(many, np.array(each), rtol=1e-10, atol=1e-10 * np.abs(many).max(initial=1e-3))


@pytest.fixture(scope="module")
def controller() -> SlotineLi:
    return slotine_li(PUMA)


@pytest.mark.parametrize("arms", [1, 7, 8, 17, 300])
def test_any_number_of_arms(controller: SlotineLi, arms: int) -> None:
    ((p, v, goal),) = cases = situations(PUMA, arms)
    torque, state = controller.step(controller.init(p, v), p, v, goal)
    np.testing.assert_allclose(torque, one_by_one(controller, cases)[0][0], rtol=1e-11, atol=1e-11)
    assert state.estimate.shape == (arms, len(controller.model.columns))


def test_leading_axes_are_arms_and_a_reference_may_be_for_all(controller: SlotineLi) -> None:
    p, v, goal = situations(PUMA, 6)[0]
    shared = ReferencePoint(*(part[0] for part in goal))
    flat, _ = controller.step(controller.init(p, v), p, v, shared)
    grid = p.reshape(2, 3, 3), v.reshape(2, 3, 3)
    torque, state = controller.step(controller.init(*grid), *grid, shared)
    np.testing.assert_array_equal(torque, flat.reshape(2, 3, 3))
    assert state.estimate.shape == (2, 3, len(controller.model.columns))
    again, _ = controller.step(state._replace(dt=np.zeros(1)), *grid, shared)
    np.testing.assert_allclose(again, torque, rtol=1e-12)


def test_nothing_given_is_changed_and_what_is_returned_stays(controller: SlotineLi) -> None:
    (p, v, goal), (p1, v1, _) = situations(PUMA, 5, ticks=2)
    _, state = controller.step(controller.init(p, v), p, v, goal)
    before = [leaf.copy() for leaf in leaves(state)]
    torque, after = controller.step(state, p1, v1, goal)
    kept = torque.copy(), [leaf.copy() for leaf in leaves(after)]
    controller.step(after, p, v, goal)
    controller.step(controller.init(p[:3], v[:3]), p[:3], v[:3], ReferencePoint(*(part[:3] for part in goal)))
    for now, then in zip([*leaves(state), torque, *leaves(after)], [*before, kept[0], *kept[1]], strict=True):
        np.testing.assert_array_equal(now, then)


def test_fleets_take_turns(controller: SlotineLi) -> None:
    """What the last tick left in the lanes is another fleet's, or was replaced."""
    cases = situations(PUMA, 11, ticks=4)
    turned = [(p[::-1], v[::-1], ReferencePoint(*(part[::-1] for part in goal))) for p, v, goal in cases]
    one, other = (controller.init(*case[0][:2]) for case in (cases, turned))
    for (p, v, goal), mirrored in zip(cases, turned, strict=True):
        torque, one = controller.step(one, p, v, goal)
        torque_turned, other = controller.step(other, *mirrored)
        np.testing.assert_array_equal(torque_turned, torque[::-1])
        one, other = (state._replace(estimate=1.01 * state.estimate) for state in (one, other))
    np.testing.assert_array_equal(one.estimate, other.estimate[::-1])
    last, _ = controller.step(one, p, v, goal)
    fresh, _ = controller.step(like(one, map(np.array, leaves(one))), p, v, goal)
    np.testing.assert_array_equal(last, fresh)
    after = controller.step(one, p, v, goal)[1]
    with pytest.raises(ValueError, match="read-only"):
        after.estimate[0] = 7.0


def test_threads_share_a_controller(controller: SlotineLi) -> None:
    cases = situations(PUMA, 64, ticks=40)
    start = controller.init(*cases[0][:2])
    expected = [controller.step(start, *case)[0] for case in cases]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda case: controller.step(start, *case)[0], cases))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", [PUMA, LOOP])
def test_arms_can_start_anew(name: str) -> None:
    law = slotine_li(name, Composite(gain(name), 0.1))
    (p, v, goal), (p1, v1, _) = situations(name, 5, ticks=2)
    again = np.array([False, True, False, True, False])
    _, state = law.step(law.init(p, v), p, v, goal)
    restarted = law.reset(state, again, p1, v1)
    for leaf, old, new in zip(*map(leaves, (restarted, state, law.init(p1, v1))), strict=True):
        np.testing.assert_array_equal(leaf[again], new[again])
        np.testing.assert_array_equal(leaf[~again], old[~again])
    assert law.reset(state, ~(again | True), p1, v1) is state
    for mask, p, v in ((np.array([1, 3]), p1, v1), (again, p1, v1[:3]), (again & False, p1[:, :1], v1)):
        got = f"got p {p.shape}, v {v.shape} and a mask of {mask.dtype} {mask.shape}"
        with pytest.raises(InputError, match=re.escape(got)):
            law.reset(state, mask, p, v)


def test_one_bad_arm_is_named_and_the_state_given_is_kept(controller: SlotineLi) -> None:
    p, v, goal = situations(PUMA, 5)[0]
    state, spoilt = controller.init(p, v), p.copy()
    spoilt[3, 1] = np.nan
    with pytest.raises(NonFiniteError, match=r"SlotineLi: p: expected finite numbers, got nan at index \(3, 1\)"):
        controller.step(state, spoilt, v, goal)
    far = goal.a.copy()
    far[2, 0] = np.inf
    with pytest.raises(NonFiniteError, match=r"reference\.a: expected finite numbers, got inf at index \(2, 0\)"):
        controller.step(state, p, v, goal._replace(a=far))
    unknown = state.estimate.copy()
    unknown[4] = np.nan
    with pytest.raises(NonFiniteError, match="the torque of arm 4 is not finite for finite arguments"):
        controller.step(state._replace(estimate=unknown), p, v, goal)
    assert np.isfinite(controller.step(state, p, v, goal)[0]).all()


def test_a_guarded_arm_brakes_alone() -> None:
    law = slotine_li(PUMA)
    guarded = SafetyFilter(law)
    p, v, goal = situations(PUMA, 9)[0]
    spoilt = p.copy()
    spoilt[4] = np.nan
    sound, _ = guarded.step(guarded.init(p, v), p, v, goal)
    torque, state = guarded.step(guarded.init(p, v), spoilt, v, goal)
    others = np.arange(9) != 4
    np.testing.assert_array_equal(torque[others], sound[others])
    np.testing.assert_allclose(torque[4], -np.asarray(guarded.stop_damping) * v[4])
    np.testing.assert_array_equal(state.flags.stopped[:, 0], ~others)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"p": np.zeros((5, 4))}, r"p: expected shape \(5, 3\) or \(3,\), got \(5, 4\)"),
        ({"v": np.zeros((4, 3))}, r"v: expected shape \(5, 3\) or \(3,\), got \(4, 3\)"),
        ({"v": [["fast"] * 3] * 5}, "v: expected numbers, got"),
        (
            {"goal": ReferencePoint(*np.zeros((3, 1, 3)))},
            r"reference_p: expected shape \(5, 3\) or \(3,\), got \(1, 3\)",
        ),
    ],
)
def test_arms_that_do_not_fit_are_refused(controller: SlotineLi, change: dict[str, Any], message: str) -> None:
    p, v, goal = situations(PUMA, 5)[0]
    given = {"p": p, "v": v, "goal": goal} | change
    with pytest.raises(InputError, match=message):
        controller.step(controller.init(p, v), *given.values())


def test_states_of_other_arms_are_refused(controller: SlotineLi) -> None:
    p, v, goal = situations(PUMA, 5)[0]
    with pytest.raises(InputError, match=r"state: expected shape \(5, \d+\) or \(\d+,\), got \(4, \d+\)"):
        controller.step(controller.init(p[:4], v[:4]), p, v, goal)
    state = controller.init(p[0], v[0])._replace(dt=np.zeros(2))
    with pytest.raises(InputError, match=r"SlotineLi: argument 'state\.dt': expected shape \(1,\), got \(2,\)"):
        controller.step(state, p[0], v[0], ReferencePoint(*(part[0] for part in goal)))


def test_mechanisms_too_long_to_compile_have_many_arms_too() -> None:
    mechanism = random_chain(0, MAX_COMPILED_LINKS + 1)
    controller = PDGravity(mechanism, 10.0, 1.0)
    rng = np.random.default_rng(0)
    p, v = rng.uniform(-0.5, 0.5, (2, 3, mechanism.dof))
    goal = ReferencePoint(*rng.uniform(-0.5, 0.5, (3, mechanism.dof)))
    torque, state = controller.step(controller.init(p, v), p, v, goal)
    each = [controller.step(controller.init(p[k], v[k]), p[k], v[k], goal)[0] for k in range(3)]
    np.testing.assert_allclose(torque, each, rtol=1e-11, atol=1e-11)
    assert state.q.shape == (3, mechanism.dof)
