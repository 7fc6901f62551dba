"""Cases that `make test` leaves to `make test-nightly`: more of a kind of which it has some."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

nightly = pytest.mark.nightly


def mostly_at_night(cases: Iterable[Any], *gate: Any) -> list[Any]:
    """The parameters `cases`, of which only those in `gate` are in `make test`; a tuple has one for each argument."""
    every = list(cases)
    assert all(one in every for one in gate), f"{gate} are not all in {every}"
    return [one if one in gate else at_night(one) for one in every]


def turn_by_turn(first: Iterable[Any], second: Iterable[Any]) -> list[Any]:
    """Pairs of each of `first` with each of `second`; of the former each once in `make test`, the latter in turn."""
    ones, others = list(first), list(second)
    return [
        (one, other) if k == i % len(others) else at_night((one, other))
        for i, one in enumerate(ones)
        for k, other in enumerate(others)
    ]


def at_night(case: Any) -> Any:
    """A parameter, or a tuple of one for each argument, that is not in `make test`."""
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=nightly)
