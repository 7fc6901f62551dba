"""The search for the worst of a workspace, against greatest values that are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from random_trees import random_chain

from adaptctl.arrays import Array
from adaptctl.control import Workspace
from adaptctl.control.gains.workspace import SEARCH_STARTS, Worst, position_range, sampled_configurations
from adaptctl.description import Description, JointKind, Limits
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError

LOW, HIGH = np.array([0.2, 0.2, 0.2]), np.array([0.9, 0.8, 0.9])


def peak(p: Array, at: Array, height: float) -> Array:
    """A cone about a position, zero from 0.3 on."""
    return height * np.maximum(0.0, 1.0 - np.linalg.norm(p - at, axis=-1) / 0.3)


def two_peaks(size: float) -> tuple[Workspace, Worst]:
    """A workspace of this size, all but two of whose samples lie on the lower of two peaks; and the greatest found."""
    rng = np.random.default_rng(0)
    about = LOW + 0.02 * rng.normal(size=(10 * SEARCH_STARTS, 3))
    samples = size * np.vstack((about, [[0.9, 0.95, 0.9], [0.0, 0.0, 0.0]]))
    workspace = Workspace(random_chain(0, 3), samples, np.zeros_like(samples), np.full_like(samples, size))
    return workspace, workspace.maximum(lambda p: peak(p / size, LOW, 1.0) + peak(p / size, HIGH, 2.0))


@pytest.mark.parametrize("size", [2.0**-10, 1.0, 2.0**10])
def test_a_higher_peak_is_found_past_all_the_best_samples_in_any_unit(size: float) -> None:
    workspace, worst = two_peaks(size)
    assert np.linalg.norm(worst.p / size - HIGH) < 0.01
    assert 1.95 < worst.value <= 2.0
    assert np.all((workspace.lower[0] <= worst.p) & (worst.p <= workspace.upper[0]))


def test_the_worst_position_scales_with_the_unit_of_the_joints() -> None:
    (_, one), (_, other) = two_peaks(1.0), two_peaks(2.0**-10)
    np.testing.assert_array_equal(other.p, 2.0**-10 * one.p)
    assert other.value == one.value


@pytest.mark.parametrize(("size", "value"), [(1.0, np.inf), (0.0, 3.0)])
def test_nothing_is_searched_where_nothing_is_greater_or_there_is_no_room(size: float, value: float) -> None:
    """An infinite value at a sample, or bounds of no width: the values of the samples are all that is looked at."""
    looked: list[int] = []

    def valued(p: Array) -> Array:
        looked.append(len(p))
        return np.full(len(p), value)

    samples = np.full((9, 3), 0.5 * size)
    workspace = Workspace(random_chain(0, 3), samples, np.zeros_like(samples), np.full_like(samples, size))
    assert workspace.maximum(valued).value == value
    assert looked == [9]


def test_a_workspace_of_all_limits_has_the_samples_that_any_search_has() -> None:
    mechanism = random_chain(0, 3)
    found = Workspace.within_limits(mechanism)
    np.testing.assert_array_equal(found.samples, sampled_configurations(mechanism))


def one_joint(lower: float, upper: float, kind: JointKind = JointKind.REVOLUTE) -> Mechanism:
    """A link behind one joint with these limits."""
    (link,) = random_chain(1, 1).links
    joint = replace(link.joint, kind=kind, limits=Limits(lower, upper))
    return Mechanism(Description("one", (replace(link, joint=joint),)))


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (-2.0 * np.pi, 2.0 * np.pi, (-2.0 * np.pi, 2.0 * np.pi)),
        (-2.1 * np.pi, 2.0 * np.pi, (-np.pi, np.pi)),
        (-np.inf, 1.0, (-np.pi, 1.0)),
        (-4.0, np.inf, (-4.0, np.pi)),
        (-np.inf, -4.0, (-4.0 - np.pi, -4.0)),
        (4.0, np.inf, (4.0, 4.0 + np.pi)),
    ],
)
def test_limits_of_two_turns_are_kept_and_those_farther_apart_are_none(
    lower: float, upper: float, expected: tuple[float, float]
) -> None:
    """Many an arm may turn twice around; some files state limits of thousands of turns where there are none."""
    np.testing.assert_array_equal(np.concatenate(position_range(one_joint(lower, upper))), expected)


@pytest.mark.parametrize(
    ("lower", "upper", "kind", "expected"),
    [
        (-2.0, 1.0, JointKind.REVOLUTE, (-2.0, 1.0)),
        (-np.inf, np.inf, JointKind.REVOLUTE, (-2.0 * np.pi, 2.0 * np.pi)),
        (-9.0 * np.pi, 9.0 * np.pi, JointKind.REVOLUTE, (-2.0 * np.pi, 2.0 * np.pi)),
        (-1.0, np.inf, JointKind.REVOLUTE, (-1.0, 2.0 * np.pi)),
        (-np.inf, 1.0, JointKind.REVOLUTE, (-2.0 * np.pi, 1.0)),
        (-0.5, np.inf, JointKind.PRISMATIC, (-0.5, 1.0)),
    ],
)
def test_a_search_goes_a_half_turn_farther_where_there_is_no_limit_and_never_past_one(
    lower: float, upper: float, kind: JointKind, expected: tuple[float, float]
) -> None:
    workspace = Workspace.within_limits(one_joint(lower, upper, kind), 3)
    assert workspace.lower.ravel().tolist() == [expected[0]] * 3
    assert workspace.upper.ravel().tolist() == [expected[1]] * 3


@pytest.mark.parametrize("wrong", [0, -1, 1.5, np.nan, "a", None])
def test_a_workspace_has_a_whole_number_of_samples_and_at_least_one(wrong: Any) -> None:
    with pytest.raises(InputError, match="workspace: samples: expected a whole number from 1"):
        Workspace.within_limits(random_chain(0, 3), wrong)


@pytest.mark.parametrize("wrong", [-1, 1.5, "a"])
def test_samples_of_a_workspace_are_drawn_by_a_whole_seed(wrong: Any) -> None:
    with pytest.raises(InputError, match="workspace: seed: expected a whole number from 0"):
        Workspace.within_limits(random_chain(0, 3), 5, wrong)
