"""Measurements that are not finite, that jump, or of an arm that ran away: no law puts out what is not finite."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from every_law import LAWS, guarded

from adaptctl.arrays import Array
from adaptctl.control import Controller, ReferencePoint, SafetyFilter
from adaptctl.errors import NonFiniteError

TORQUE = 50.0  # N m


def torques(law: Controller[Any], seed: int) -> list[Array]:
    """Torques (r,) for measurements of any size, some not finite, and ordinary ones between; none where refused."""
    rng, r, m = np.random.default_rng(seed), law.dof, law.reference_size
    rest = np.zeros(r)
    reference, state, found = ReferencePoint(*np.full((3, m), 0.1)), law.init(rest, rest), []
    for k in range(12):
        p, v = (10.0 ** rng.uniform(-2, 300, (2, 1)) * rng.normal(size=(2, r))) if k % 2 else (rest, rest)
        if k % 4 == 3:
            p[rng.integers(r)] = rng.choice([np.nan, np.inf, -np.inf])
        try:
            torque, state = law.step(state, p, v, reference)
        except NonFiniteError:
            continue
        found.append(torque)
    return found


@pytest.mark.parametrize("name", LAWS)
def test_a_torque_is_finite_or_refused(name: str) -> None:
    found = torques(LAWS[name], seed=1)
    assert found
    assert np.isfinite(found).all()


@pytest.mark.nightly
@pytest.mark.parametrize("name", [name for name, law in LAWS.items() if not isinstance(law, SafetyFilter)])
def test_a_guarded_torque_is_finite_and_limited(name: str) -> None:
    """Every tick has one."""
    found = torques(guarded(LAWS[name], TORQUE, stop_damping=2.0, control_period=1e-3), seed=2)
    assert len(found) == 12
    assert np.abs(found).max() <= TORQUE
