"""Ringing is heard in whichever joint it is, after as long as it must last, and told from what only resembles it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from adaptctl.arrays import Array
from adaptctl.control.ringing import MIN_PERIODS, Ringing, ringing
from adaptctl.scalars import Column


def heard(s: Array) -> list[tuple[float, float]]:
    """Alarm and brake after each row of a sliding variable (T, r)."""
    state, told = Ringing(*map(Column, Ringing.zero(s.shape[1]))), []
    for row in s:
        state = state.updated(Column(row.tolist()))
        told.append((float(state.alarm), float(state.brake)))
    return told


@pytest.mark.parametrize("joint", range(3))
def test_one_joint_that_rings_is_enough_whichever_it_is(joint: int) -> None:
    """The first product of two ticks is of the second: from there on it must last."""
    s = np.full((MIN_PERIODS + 2, 3), 2.0)
    s[1::2, joint] = -2.0
    told = heard(s)
    assert told[MIN_PERIODS - 1 :] == [(0.0, 0.0), (1.0, 1.0), (1.0, 1.0)]
    assert not np.any(told[:MIN_PERIODS])


@pytest.mark.parametrize(("kept", "alarm", "brake"), [(0, 1.0, 1.0), (3, 1.0, 0.0), (6, 0.0, 0.0)])
def test_the_share_of_ticks_with_another_sign_decides(kept: int, alarm: float, brake: float) -> None:
    """Of twenty ticks this many keep the sign: rho is about -1 with none, -0.7 with three and -0.4 with six."""
    flips = np.tile([1.0] * kept + [-1.0] * (20 - kept), 40)
    assert heard(np.cumprod(flips)[:, None])[-1] == (alarm, brake)


def test_a_joint_that_hardly_moves_does_not_ring() -> None:
    assert not np.any(heard(1e-3 * np.cumprod(np.full(200, -1.0))[:, None]))


@pytest.mark.parametrize("share", [0.55, 0.85, 0.99])
def test_what_is_heard_are_25_periods_of_a_correlation_over_a_hundred(share: float) -> None:
    """By SciPy's filter of first order: means over about a hundred periods, below -0.5 for the alarm and -0.9 for the
    brake; s of 0.01 rad/s counts half."""
    flips = np.where(np.random.default_rng(7).random((400, 2)) < share, -1.0, 1.0)
    s = np.cumprod(flips, axis=0) * [0.3, 0.01]
    last = np.concatenate([np.zeros((1, 2)), s[:-1]])
    product, square = (lfilter([0.01], [1.0, -0.99], x, axis=0) for x in (s * last, last * last))
    expected = product / (square + 0.01**2)
    np.testing.assert_allclose(ringing(s), expected, rtol=1e-9, atol=1e-12)
    told = []
    for bound in (-0.5, -0.9):
        below = np.concatenate([np.zeros(24), expected.min(axis=1) < bound])
        told.append(np.lib.stride_tricks.sliding_window_view(below, 25).all(axis=1))
    np.testing.assert_array_equal(heard(s), np.transpose(told).astype(float))
    assert (told[0].any(), told[1].any()) == (share > 0.7, share > 0.9)
