"""What the environments draw and choose where nothing is given: references, previews and limits of torques."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_tree
from robot_files import urdf

from adaptctl.control import Sinusoids
from adaptctl.control.gains.gains import finite_torque_limits
from adaptctl.description import Limits
from adaptctl.dynamics import Mechanism, load
from adaptctl.envs import TrackingEnv, random_sinusoids
from adaptctl.envs.built_in import FIVE_BAR_REFERENCE, PUMA560_REFERENCE
from adaptctl.envs.random_reference import _within_limits
from adaptctl.errors import InputError
from adaptctl.experiments.puma560_adaptive import Puma560Adaptive
from adaptctl.experiments.semi_direct_drive_adaptive import SemiDirectDriveAdaptive
from adaptctl.simulation.references import BLOCK, Preview


@pytest.fixture(scope="module")
def measured() -> Mechanism:
    return load("puma560_measured")


@pytest.mark.parametrize(
    ("reference", "experiment"),
    [(PUMA560_REFERENCE, Puma560Adaptive()), (FIVE_BAR_REFERENCE, SemiDirectDriveAdaptive())],
)
def test_environments_of_arms_follow_what_their_experiments_do(
    reference: Sinusoids, experiment: Puma560Adaptive
) -> None:
    for name in ("center", "amplitude", "frequency", "start_time"):
        np.testing.assert_allclose(np.ravel(getattr(reference, name)), getattr(experiment, name), atol=1e-5)


def test_a_preview_is_the_reference_at_every_period(measured: Mechanism) -> None:
    reference = random_sinusoids(measured, np.random.default_rng(0))
    preview = Preview(reference, 6, 1e-3, np.array([0.05]))
    for step in (0, BLOCK - 1, BLOCK, 5000, 5001, 3):
        point = reference(1e-3 * step)
        expected = np.concatenate((point.p, point.v, point.a, reference(1e-3 * step + 0.05).p))
        np.testing.assert_allclose(preview.row(step), expected, atol=1e-15)


@cache
def robot_of(kind: str) -> Mechanism:
    return random_tree(5, 6) if kind == "tree" else load(urdf(kind) if kind.endswith(".urdf") else kind)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["puma560_measured", "ur5_robot.urdf", "tree"]))
def test_random_references_keep_the_limits(seed: int, robot: str) -> None:
    mechanism = robot_of(robot)
    p, v, _ = random_sinusoids(mechanism, np.random.default_rng(seed))(np.linspace(0.0, 30.0, 1500))
    limits = [link.joint.limits for link in mechanism.links]
    assert np.all(p >= [limit.lower for limit in limits])
    assert np.all(p <= [limit.upper for limit in limits])
    assert np.all(np.abs(v) <= [limit.velocity for limit in limits])
    assert np.all(np.ptp(p, axis=0) > 0.0)


@pytest.mark.parametrize("kind", ["ranges", "speeds"])
def test_random_references_use_four_fifths_of_narrow_limits_at_most(measured: Mechanism, kind: str) -> None:
    """Where little is allowed, all of it counts: the centre's distance from the middle, and the speed of the fade."""
    narrow = {"lower": -0.3, "upper": 0.5} if kind == "ranges" else {"velocity": 0.05}
    links = tuple(
        replace(link, joint=replace(link.joint, limits=replace(link.joint.limits, **narrow)))
        for link in measured.description.links
    )
    mechanism = Mechanism(replace(measured.description, links=links))
    time = np.linspace(0.0, 12.0, 1200)
    paths = [random_sinusoids(mechanism, np.random.default_rng(seed))(time) for seed in range(60)]
    if kind == "ranges":
        p = np.array([path.p for path in paths])
        assert np.abs(p - 0.1).max() <= 0.8 * 0.4 + 1e-12
        assert np.abs(p - 0.1).max() > 0.7 * 0.4
    else:
        v = np.array([path.v for path in paths])
        assert np.abs(v).max() <= 0.8 * 0.05
        assert np.abs(v).max() > 0.4 * 0.05


@pytest.mark.parametrize("seed", range(6))
def test_references_of_an_arm_with_loops_shrink_towards_its_home_until_they_close(seed: int) -> None:
    """By a power of four fifths; all joints together, since what each may do depends on the others."""
    arm = robot_of("semi_direct_drive_parallelogram")
    free, drawn = _within_limits(arm, np.random.default_rng(seed)), random_sinusoids(arm, np.random.default_rng(seed))
    steps = np.log(drawn.amplitude / free.amplitude) / np.log(0.8)
    assert steps == pytest.approx(np.full(steps.shape, np.rint(steps.flat[0])))
    home, share = arm.neutral_configuration, 0.8 ** steps.flat[0]
    assert np.abs(home).max() > 1.0
    np.testing.assert_allclose(drawn.center - home, share * (free.center - home), atol=1e-12)
    np.testing.assert_array_equal(drawn.frequency, free.frequency)
    p, v, _ = drawn(np.linspace(0.0, 30.0, 300))
    assert np.isfinite(arm.inverse_dynamics(p, v, 0.0 * v)).all()  # which closes the loops, or raises


def test_a_seed_means_the_same_reference_for_ever(measured: Mechanism) -> None:
    """Frequencies, shares of the amplitudes and centres, in this order, from least to greatest."""
    rng, drawn = np.random.default_rng(5), random_sinusoids(measured, np.random.default_rng(5))
    frequency, share, place = rng.uniform(0.1, 0.25, 6), rng.uniform(0.5, 1.0, 6), rng.uniform(-1.0, 1.0, 6)
    lower, upper = np.array([[x.limits.lower, x.limits.upper] for x in measured.primary_joints]).T
    fastest = [joint.limits.velocity for joint in measured.primary_joints]
    reach = 0.4 * (upper - lower)
    slope = 2.0 * np.pi * frequency + 1.875 / 2.0
    amplitude = share * np.min([np.full(6, 0.5), reach, 0.8 * np.array(fastest) / slope], axis=0)
    np.testing.assert_array_equal(drawn.frequency.ravel(), frequency)
    np.testing.assert_allclose(drawn.amplitude.ravel(), amplitude)
    np.testing.assert_allclose(drawn.center, 0.5 * (lower + upper) + (reach - amplitude) * place)


def with_limits(mechanism: Mechanism, **limits: float) -> Mechanism:
    """A mechanism all of whose joints have these limits, and no others."""
    own = Limits(**limits)
    links = tuple(replace(link, joint=replace(link.joint, limits=own)) for link in mechanism.description.links)
    return Mechanism(replace(mechanism.description, links=links))


@pytest.mark.parametrize(
    ("limits", "lower", "upper"),
    [
        ({}, -1.0, 1.0),
        ({"lower": 0.5}, 0.5, 2.5),
        ({"upper": 0.5}, -1.5, 0.5),
        ({"lower": -0.2, "upper": 4.0}, -0.2, 4.0),
        ({"lower": -1e4, "upper": 1e4}, -1.0, 1.0),
    ],
    ids=["none", "lower", "upper", "both", "turns without end"],
)
def test_random_references_are_drawn_from_the_whole_of_what_is_stated(
    measured: Mechanism, limits: dict[str, float], lower: float, upper: float
) -> None:
    """0.1 to 0.25 Hz, amplitudes from half to the whole of 0.5 rad or of two fifths of the range, faded in over 2 s,
    about any centre from which four fifths of the range are kept."""
    mechanism = with_limits(measured, **limits)
    drawn = [random_sinusoids(mechanism, np.random.default_rng(seed)) for seed in range(100)]
    reach = 0.4 * (upper - lower)
    most = min(0.5, reach)
    away = reach - 0.5 * most
    for values, low, high in (
        ([one.frequency[0] for one in drawn], 0.1, 0.25),
        ([one.amplitude[0] for one in drawn], 0.5 * most, most),
        ([one.center - 0.5 * (lower + upper) for one in drawn], -away, away),
    ):
        near = 0.1 * (high - low)
        assert low - 1e-12 <= np.min(values) <= low + near
        assert high - near <= np.max(values) <= high + 1e-12
    assert {one.start_time for one in drawn} == {2.0}


def test_torques_without_limits_get_generous_ones(measured: Mechanism) -> None:
    np.testing.assert_array_equal(finite_torque_limits(measured), measured.effort_limits)
    tree = robot_of("tree")
    assert np.isinf(tree.effort_limits).all()
    limits = finite_torque_limits(tree)
    p = np.random.default_rng(1).uniform(-3, 3, (500, 6))
    gravity = tree.inverse_dynamics(p, np.zeros_like(p), np.zeros_like(p))
    assert np.all(limits >= np.abs(gravity).max(axis=0))
    assert np.all(limits <= 1e4)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"look_ahead": [[1.0], [1.0, 2.0]]}, r"look_ahead: expected numbers \(L,\), got"),
        ({"look_ahead": "soon"}, r"look_ahead: expected numbers \(L,\), got 'soon'"),
        ({"look_ahead": [[0.1, 0.2]]}, r"look_ahead: expected shape \(2,\), got \(1, 2\)"),
        ({"reference": True}, "reference: expected a Reference, a seed of at least 0, or 'random', got True"),
        ({"reference": False}, "reference: expected a Reference, a seed of at least 0, or 'random', got False"),
    ],
)
def test_times_and_seeds_that_are_none_are_refused(measured: Mechanism, given: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        TrackingEnv(measured, **given)
