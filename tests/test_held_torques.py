"""Torques that are held: stable up to a sampling ratio of 2, and of 1 where they come a period late."""

from __future__ import annotations

import numpy as np
import pytest
from sampled_loops import arm, loop, reduced, swinging

from adaptctl.control import SlotineLi
from adaptctl.dynamics import Mechanism

ARMS = ["puma560_measured", "semi_direct_drive"]


class Unchecked(SlotineLi):
    """The law with whatever damping."""

    def _check_sample_time(self) -> None:
        pass


def growth(mechanism: Mechanism, name: str, sampled_gain: float, late: int = 0) -> float:
    """How many times larger s is after 0.15 s, at rest, with T_c lambda_max(M^-1 K) as given."""
    reference = swinging(mechanism, amplitude=0.0)
    M = mechanism.mass_matrix(reference.center)
    largest = np.linalg.eigvals(np.linalg.solve(M, np.diag(np.diag(M)))).real.max()
    damping = np.diag(M) * sampled_gain / (1e-3 * largest)
    law = Unchecked(reduced(name), 0.1, damping, initial=reduced(name).fundamental_parameters)
    s = np.abs(loop(law, mechanism, reference, 0.15, off=1e-4, late=late).s).max(axis=1)
    return float(s[-10:].max() / s[0])


@pytest.mark.parametrize("name", ARMS)
def test_a_hold_is_stable_up_to_two(name: str) -> None:
    assert growth(arm(name), name, 1.9) < 1e-3
    assert growth(arm(name), name, 2.0) < 3.0
    assert growth(arm(name), name, 2.1) > 1e3


@pytest.mark.parametrize("name", ARMS)
def test_a_hold_one_period_late_is_stable_up_to_one(name: str) -> None:
    """z^2 - z + g = 0: |z|^2 = g."""
    assert growth(arm(name), name, 0.9, late=1) < 1e-2
    assert growth(arm(name), name, 1.0, late=1) < 3.0
    assert growth(arm(name), name, 1.1, late=1) > 300.0
