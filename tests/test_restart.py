"""Guarded learning whose estimate leaves its bound: it starts anew from the prior, with a mark."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_loops import arm, gains, own_gain, reduced, swinging

from adaptctl import Plant, SlotineLi
from adaptctl.arrays import Array
from adaptctl.control import GuardedLearning, mapped_gain
from adaptctl.control.adaptation.doubt import RESTARTED, UNKNOWN, named
from adaptctl.control.adaptation.restart import bounded, stepped
from adaptctl.control.pytree import leaves
from adaptctl.errors import AdaptctlError, InputError
from adaptctl.scalars import column
from adaptctl.tuning.default_gains import prior_ranges
from adaptctl.tuning.learning_rule import learning_by_rule

ARM = "puma560_arm3"
TRUE = reduced(ARM).fundamental_parameters
FAR = 100.0


def learner(bound: float) -> SlotineLi:
    law = GuardedLearning(own_gain(ARM), 1.0 / (3.3e-3 * gains(ARM).damping) ** 2, bound=bound)
    return SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, law, 0.5 * TRUE, torque_limits=np.inf)


def columns(state: Any) -> Any:
    parts = (columns(part) if hasattr(part, "_fields") else column(np.array(part)) for part in state)
    return type(state)(*parts)


def numbers(state: Any) -> Array:
    return np.concatenate([np.array(part.of, dtype=float) for part in leaves(state)])


@given(distance=st.floats(0.0, 1e6), bound=st.floats(1e-3, 1e3), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_within_the_bound_nothing_changes_and_beyond_it_all_is_new(distance: float, bound: float, seed: int) -> None:
    rng, memory = np.random.default_rng(seed), learner(FAR).init(np.zeros(3), np.zeros(3)).law_state
    direction = rng.normal(size=len(TRUE))
    scale = rng.uniform(0.1, 10.0, len(TRUE))
    estimate = memory.prior + distance * scale * direction / np.linalg.norm(direction)
    watch = memory.watch._replace(trusted=estimate, noise=np.ones(3), age=np.array([9.0]), alarm=np.ones(1))
    before: Any = columns(memory._replace(watch=watch))
    after, kept = bounded(bound, column(scale), column(estimate), before, 0.0)
    if distance < 0.999 * bound:
        np.testing.assert_array_equal(after.of, estimate)
        np.testing.assert_array_equal(numbers(kept), numbers(before))
    elif distance > 1.001 * bound:
        np.testing.assert_array_equal([after.of, kept.watch.trusted.of], [memory.prior] * 2)
        emptied = (*kept.stored.valid, *kept.watch.noise, *kept.watch.age, *kept.watch.alarm)
        assert (set(emptied), kept.watch.decision[0]) == ({0.0}, RESTARTED)


@given(size=st.floats(1e-3, 1e3), r=st.integers(1, 7), k=st.integers(1, 40), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_an_update_changes_no_torque_by_more_than_is_stated(size: float, r: int, k: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, most, before = rng.normal(size=(r, k)), rng.uniform(0.1, 9.0, r), rng.normal(size=k)
    after = before + size * rng.normal(size=k)
    found = np.array(stepped(column(before), column(after), [column(row) for row in rows], column(most)).of)
    share = np.max(np.abs(rows @ (after - before)) / most)
    if share < 0.999:
        np.testing.assert_array_equal(found, after)
    elif share > 1.001:
        assert np.max(np.abs(rows @ (found - before)) / most) == pytest.approx(1.0)
        np.testing.assert_allclose(found - before, (after - before) / share, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("step", [0.0, [1.0, -1.0, 1.0], np.nan])
def test_steps_that_are_none_are_refused(step: Any) -> None:
    with pytest.raises(AdaptctlError, match="torque_step"):
        GuardedLearning(own_gain(ARM), torque_step=step)
    with pytest.raises(InputError, match="torque_step"):
        SlotineLi(reduced(ARM), 8.0, gains(ARM).damping, GuardedLearning(own_gain(ARM), torque_step=[1.0, 1.0]))


def test_an_estimate_that_is_lost_is_learned_anew() -> None:
    controller, reference = learner(FAR), swinging(arm(ARM), amplitude=0.4)
    law: Any = controller.adaptation_law
    plant = Plant(arm(ARM), 1e-3, torque_limits=np.full(3, np.inf))
    moving = plant.init(reference(np.zeros(1)).p[0], np.zeros(3))
    state, said, lost = controller.init(moving.p, moving.v), [], 500
    for k in range(3500):
        if k == lost:
            state = state._replace(estimate=state.estimate + 2.0 * FAR * np.sqrt(law.gain))
        torque, state = controller.step(state, moving.p, moving.v, reference(1e-3 * k))
        if k == lost:
            np.testing.assert_array_equal(state.estimate, controller.initial)
            np.testing.assert_allclose(law.covariance(state.law_state), np.diag(law.gain), rtol=1e-12)
        moving = plant.step(moving, torque)
        said.append(law.decision(state.law_state))
    assert "restarted" not in said[:lost]
    assert set(said[lost : lost + 1900]) == {"restarted"}
    assert said[-1] == "model"
    assert np.abs(moving.p - reference(3.5).p).max() < 0.01


def test_what_is_missed_after_a_restart_is_not_called_one() -> None:
    assert named(0.0, 0.0, RESTARTED) == UNKNOWN


def test_the_rule_takes_ten_prior_ranges_and_half_of_the_limits() -> None:
    model, gain, limits = reduced(ARM), np.diag(own_gain(ARM)), np.array([97.6, 186.4, 89.4])
    law = learning_by_rule(model, gain, limits, gains(ARM).damping, 1e-3, swinging(arm(ARM)))
    reach = np.sqrt(np.diag(mapped_gain(model, prior_ranges(arm(ARM)) ** 2)))
    assert law.bound == pytest.approx(np.linalg.norm(10.0 * reach / np.sqrt(law.gain)))
    assert law.torque_step == pytest.approx(0.5 * limits)
    assert np.linalg.norm(TRUE / np.sqrt(law.gain)) < 0.3 * law.bound


@pytest.mark.parametrize("bound", [0.0, -1.0, np.nan])
def test_bounds_that_are_none_are_refused(bound: float) -> None:
    with pytest.raises(InputError, match="bound"):
        learner(bound)
