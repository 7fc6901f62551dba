"""Loop closure in single precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.dynamics.mechanism import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column, column

MAX_CLOSURE_GAP = 1e-5
"""m or rad of closure residual allowed"""
TESTED_RANGE = 0.3
"""rad or m about the home configuration, for the test"""
TESTED_POSITIONS = 24
"""Closed configurations in which it is tried."""


def validate_single_precision(mechanism: Mechanism, argument: str) -> None:
    """Raise `InputError` if float32 leaves loops open by more than 1e-5 m or rad."""
    continuation: Any = mechanism.continuation
    if continuation is None:
        return
    worst = 0.0
    for q, p in _nearby(mechanism):
        guess = Column(np.float32(x) for x in q.tolist())
        closed = mechanism.equations.closed(Column(np.float32(x) for x in p.tolist()), guess)
        gaps = continuation.equations.residual(column(np.array([float(x) for x in closed])))
        worst = max(worst, *(abs(float(gap)) for gap in gaps))
    if not worst <= MAX_CLOSURE_GAP:
        raise InputError(
            f"{argument}: in single precision the loops of {mechanism.name} stay open by {worst:.2g} m or rad, above "
            f"the limit of {MAX_CLOSURE_GAP:g}; use double"
        )


def _nearby(mechanism: Mechanism) -> list[tuple[Array, Array]]:
    rng = np.random.default_rng(0)
    away = rng.uniform(-TESTED_RANGE, TESTED_RANGE, (TESTED_POSITIONS, mechanism.dof))
    p = mechanism.neutral_configuration + away
    continuation: Any = mechanism.continuation
    p = p[continuation.reachable(p)]
    p = np.concatenate([mechanism.neutral_configuration[None], p])
    return list(zip(mechanism.configuration(p), p + 0.005, strict=True))
