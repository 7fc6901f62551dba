"""Positions whose closed configuration is known: nothing is closed anew, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl import load
from adaptctl.dynamics import Mechanism
from adaptctl.dynamics.closed_positions import ClosedPositions
from adaptctl.scalars import Column, column


@pytest.fixture(scope="module")
def arm() -> Mechanism:
    return load("semi_direct_drive")


def test_the_known_configuration_is_the_one_that_closing_finds(arm: Mechanism) -> None:
    equations, rng = arm.equations, np.random.default_rng(0)
    middle = np.array([0.0, -1.57, -3.14])
    for p in middle + rng.uniform(-0.3, 0.3, (20, 3)):
        q = equations.projected(column(arm.configuration(p)))
        positions = Column(q[i] for i in arm.description.primary)
        known = equations.closed(ClosedPositions(positions, q), Column.zeros(5))
        assert known is q
        np.testing.assert_allclose(equations.closed(positions, q).of, q.of, rtol=0.0, atol=1e-14)


def test_arithmetic_forgets_the_configuration(arm: Mechanism) -> None:
    q = column(arm.configuration([0.1, -1.5, -3.0]))
    positions = ClosedPositions(Column(q[i] for i in arm.description.primary), q)
    moved = positions + Column((0.1, 0.0, 0.02))
    assert type(moved) is Column
    assert arm.equations.closed(moved, q).of[0] == moved[0]


def test_a_tree_needs_no_configuration() -> None:
    equations = load("puma560_measured").equations
    p = ClosedPositions(Column.zeros(6), Column.zeros(6))
    assert equations.closed(p, Column.zeros(6)) is p
