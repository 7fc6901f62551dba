"""Vector environments' bad input: refused with the arm and the joint, and nothing has moved."""

from __future__ import annotations

from collections import deque
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from random_trees import random_chain
from sampled_loops import arm
from vector_envs import (
    ANY,
    LOOP,
    PUMA,
    vector,
)

import adaptctl.envs
from adaptctl.arrays import Array
from adaptctl.compilation.routine import MAX_COMPILED_LINKS
from adaptctl.control import Sinusoids
from adaptctl.envs import VectorTrackingEnv
from adaptctl.errors import InputError, NonFiniteError, NotFoundError


@pytest.fixture
def three() -> VectorTrackingEnv:
    return vector(PUMA, 3)


@pytest.mark.parametrize(
    ("action", "error", "message"),
    [
        (np.zeros((3, 5)), InputError, r"action: expected shape \(3, 6\), got \(3, 5\)"),
        (np.zeros(6), InputError, r"action: expected shape \(3, 6\), got \(6,\)"),
        ("left", InputError, r"action: expected numbers of shape \(3, 6\), got 'left'"),
        (np.zeros((3, 6)) + 1j, InputError, r"action: expected numbers of shape \(3, 6\), got array"),
        (np.diag([1.0, np.nan, 1.0, 1.0, 1.0, 1.0])[:3], NonFiniteError, "got nan for joint 1 of arm 1"),
        (np.full((3, 6), -np.inf), NonFiniteError, "got -inf for joint 0 of arm 0"),
    ],
)
def test_bad_actions_are_refused_and_nothing_has_moved(
    three: VectorTrackingEnv, action: Any, error: type[Exception], message: str
) -> None:
    three.reset(seed=0)
    with pytest.raises(error, match=message):
        three.step(action)
    told = three.step(np.ones((3, 6)))[0]
    three.reset(seed=0)
    np.testing.assert_array_equal(told, three.step(np.ones((3, 6)))[0])


def test_actions_of_arms_that_begin_again_do_not_matter() -> None:
    ours = vector(PUMA, 2, duration=1e-3)
    ours.reset(seed=0)
    assert ours.step(np.zeros((2, 6)))[3].all()
    told, reward, terminated, truncated, _ = ours.step(np.full((2, 6), np.nan))
    np.testing.assert_array_equal(told, ours.reset(seed=0)[0])
    np.testing.assert_array_equal([reward, terminated, truncated], 0.0)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"paylod": 1.0}, NotFoundError, "'paylod'; options: payload, trajectory, initial_error, parameters"),
        ({"payload": [1.0, 2.0]}, InputError, "payload: expected one, or one for each of 3 arms, got 2"),
        ({"payload": [1.0, -2.0, 1.0]}, InputError, "arm 1: payload: expected a mass of at least 0 kg, got -2.0"),
        ({"payload": [1.0, 1.0, np.nan]}, InputError, "arm 2: payload: expected a mass of at least 0 kg, got nan"),
        ({"payload": [1.0, {"mas": 1.0}, 1.0]}, NotFoundError, "arm 1: payload: unknown entry 'mas'"),
        ({"trajectory": ["random"] * 4}, InputError, "trajectory: expected one, or one for each of 3 arms, got 4"),
        ({"trajectory": "fast"}, InputError, "expected a Reference, a seed of at least 0, or 'random', got 'fast'"),
        ({"trajectory": Sinusoids([0.0], [1.0], [1.0])}, InputError, "reference: expected 6 joints, got 1 for arm 0"),
        ({"initial_error": np.zeros((2, 6))}, InputError, r"or \(3, 6\) for the arms, got shape \(2, 6\)"),
        ({"initial_error": [[0.0] * 6, [np.nan] * 6, [0.0] * 6]}, NonFiniteError, "got nan for arm 1"),
        ({"parameters": np.zeros(59)}, InputError, r"expected a number or shape \(60,\), or \(3, 60\)"),
        ({"parameters": "heavy"}, InputError, "parameters: expected numbers, got 'heavy'"),
        ({"parameters": np.zeros(60) + 1j}, InputError, "parameters: expected numbers, got array"),
        ({"reset_mask": np.ones(3, dtype=bool)}, InputError, "for autoreset_mode=AutoresetMode.DISABLED"),
    ],
)
def test_bad_options_are_refused(
    three: VectorTrackingEnv, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        three.reset(options=options)


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        (-1, "at least 0, got -1 for arm 0"),
        ([3, 1.5, 3], "got 1.5 for arm 1"),
        (2.0, "got 2.0"),
        ("abc", "got 'a' for arm 0"),
        ([1, 2], "expected a number, or one for each of 3 arms, got 2"),
    ],
)
def test_bad_seeds_are_refused_at_once(three: VectorTrackingEnv, seed: Any, message: str) -> None:
    """Not when the arm first draws."""
    with pytest.raises(InputError, match=f"seed: .*{message}"):
        three.reset(seed=seed)


@pytest.mark.parametrize("mask", [np.zeros(3, dtype=bool), np.ones(2, dtype=bool), np.ones(3)])
def test_bad_masks_are_refused(mask: Array) -> None:
    ours = vector(PUMA, 3, autoreset_mode="Disabled")
    with pytest.raises(InputError, match="reset_mask: expected 3 bools, not all False"):
        ours.reset(options={"reset_mask": mask})
    with pytest.raises(ResetNeeded, match="reset all arms first"):
        ours.reset(options={"reset_mask": np.array([True, False, True])})


def test_the_order_of_calls_is_kept(three: VectorTrackingEnv) -> None:
    for call in (lambda: three.step(np.zeros((3, 6))), three.render):
        with pytest.raises(ResetNeeded, match=r"call env\.reset"):
            call()
    with pytest.raises(InputError, match="seed: expected a number, or one for each of 3 arms, got 2"):
        three.reset(seed=[1, 2])


def test_an_arm_that_runs_away_is_named() -> None:
    mechanism = arm("puma560_measured")
    ours = vector(PUMA, 3, robot=mechanism, error_bound=np.inf)
    parameters = np.tile(mechanism.inertial_parameters, (3, 1))
    parameters[1] *= -1e-3
    ours.reset(options={"parameters": parameters})
    with pytest.raises(NonFiniteError, match="puma560_measured: the motion of arm 1 diverged after"):
        deque((ours.step(np.full((3, 6), 5.0)) for _ in range(2000)), maxlen=0)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"num_envs": 0}, InputError, "num_envs: expected a whole number of at least 1, got 0"),
        ({"num_envs": float("nan")}, InputError, "num_envs: expected a whole number of at least 1, got nan"),
        ({"autoreset_mode": "Sometimes"}, InputError, "expected one of NextStep, SameStep, Disabled, got 'Sometimes'"),
        ({"reset_options": {"paylod": 1.0}}, NotFoundError, "unknown option 'paylod'"),
        ({"robot": "puma650"}, NotFoundError, "puma560"),
        ({"duration": 0.0}, InputError, "duration: expected at least one control period"),
        ({"robot": random_chain(0, MAX_COMPILED_LINKS + 1)}, InputError, "use vectorization_mode='sync'"),
    ],
)
def test_environments_that_cannot_be_are_refused(
    settings: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        VectorTrackingEnv(**settings)


@pytest.mark.parametrize("section", ["## Action space", "## Observation space", "## Beginning again", "Parameters"])
def test_the_docstring_is_the_card(section: str) -> None:
    assert f"    {section}\n" in (VectorTrackingEnv.__doc__ or "")


def test_the_card_tells_how_long_mechanisms_may_be() -> None:
    assert f"at most {MAX_COMPILED_LINKS} links" in str(VectorTrackingEnv.__doc__)


def test_the_module_registers_all() -> None:
    for name in (PUMA, LOOP, ANY):
        assert gymnasium.spec(name).vector_entry_point is not None
    assert adaptctl.envs.VectorTrackingEnv is VectorTrackingEnv
