"""Gains: what bandwidths mean, and what a held torque can carry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_trees import random_chain

from adaptctl.control import Gains, PriorRanges, sampled_gain, typical_inertia
from adaptctl.control.gains.sampling_ratio import validate_sampling_ratio
from adaptctl.control.gains.workspace import sampled_configurations
from adaptctl.dynamics import Mechanism, load
from adaptctl.errors import GainError, InputError


def pendulum() -> Mechanism:
    """One link about a horizontal axis: its mass matrix is a constant."""
    return random_chain(3, 1)


def held_loop_radius(inertia: float, damping: float, period: float) -> float:
    """The pole of v' = -K v / M under a torque held over the period."""
    return abs(1.0 - period * damping / inertia)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.01, 10.0))
def test_sampled_gain_is_two_at_the_limit_of_stability(ratio: float) -> None:
    mechanism = pendulum()
    inertia = float(typical_inertia(mechanism)[0])
    damping = ratio * inertia / 1e-3
    gain = sampled_gain(mechanism, damping, 1e-3)
    assert gain == pytest.approx(ratio, rel=1e-9)
    assert (held_loop_radius(inertia, damping, 1e-3) < 1.0) == (gain < 2.0)


def test_sampled_gain_is_above_all_that_random_configurations_show() -> None:
    puma, damping = load("puma560_measured"), np.array([9.0, 15.0, 7.0, 0.2, 0.1, 0.005])
    matrices = puma.mass_matrix(sampled_configurations(puma, 3000, seed=1))
    largest = max(np.linalg.eigvals(np.linalg.solve(m, np.diag(damping))).real.max() for m in matrices)
    assert 1e-3 * largest <= sampled_gain(puma, damping, 1e-3) < 1.2e-3 * largest


def test_gains_grow_with_bandwidth_and_inertia() -> None:
    puma = load("puma560_measured")
    gains = Gains.from_bandwidth(puma, 5.0)
    np.testing.assert_allclose(gains.damping, 5.0 * typical_inertia(puma))
    np.testing.assert_allclose(Gains.from_bandwidth(puma, 10.0, damping_scale=3.0).damping, 6.0 * gains.damping)


def test_configurations_stay_within_the_limits() -> None:
    puma = load("puma560_measured")
    p = sampled_configurations(puma)
    for i, link in enumerate(puma.links):
        assert link.joint.limits.lower <= p[:, i].min() < p[:, i].max() <= link.joint.limits.upper


def test_kinds_of_parameters_have_their_own_range() -> None:
    ranges = PriorRanges(mass=7.0, first_moment=3.0, inertia=0.5)
    np.testing.assert_array_equal(ranges.for_parameters(("a.m", "a.mc_x", "b.c.I_xy")), [7.0, 3.0, 0.5])


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_ranges_must_be_positive(bad: float) -> None:
    with pytest.raises(InputError, match="prior range of inertia"):
        PriorRanges(inertia=bad)


def test_a_massless_mechanism_can_be_given_no_gains() -> None:
    nothing = pendulum().with_parameters(np.zeros(10))
    with pytest.raises(InputError, match="positive inertia"):
        Gains.from_bandwidth(nothing, 5.0)
    with pytest.raises(GainError, match="not positive definite"):
        validate_sampling_ratio(nothing, 1.0, 1e-3)
