"""References of many arms are evaluated for many control periods at once, whatever is asked of them each time."""

from __future__ import annotations

import numpy as np
import pytest

from adaptctl.arrays import Array
from adaptctl.control.controller import ReferencePoint
from adaptctl.simulation.references import ReferencesOfMany, SignalsAhead

PERIOD, STEPS = 1e-3, 5_000


class Counted:
    """A reference of two joints that counts its evaluations."""

    def __init__(self, rate: float) -> None:
        self.rate, self.calls = rate, 0

    def __call__(self, time: Array) -> ReferencePoint:
        self.calls += 1
        angle = self.rate * time
        rows = (np.sin(angle), self.rate * np.cos(angle), -(self.rate**2) * np.sin(angle))
        return ReferencePoint(*(np.stack((row, 2.0 * row), axis=-1) for row in rows))


@pytest.mark.parametrize("count", [1, 7, 3_000])
def test_parts_are_those_of_one_evaluation_and_few_are_made(count: int) -> None:
    each = [Counted(1.0), Counted(2.0)]
    references = ReferencesOfMany.of(each, 2)
    whole = references.signals(PERIOD * np.arange(STEPS))
    ahead = SignalsAhead(references, PERIOD, STEPS)
    before = each[0].calls
    for first in range(0, STEPS, count):
        asked = min(count, STEPS - first)
        for name, values in ahead.part(first, asked).items():
            np.testing.assert_array_equal(values, whole[name][first : first + asked])
    assert each[0].calls - before <= 7
