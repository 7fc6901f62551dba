"""A tick on memories does what one on their leaves does, wherever the leaves are."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from adaptctl.control import ReferencePoint
from adaptctl.control.controller import leaves, like, on_memories


class Nothing(NamedTuple):
    pass


class Inner(NamedTuple):
    one: Any
    nothing: Any
    two: Any


class Outer(NamedTuple):
    first: Any
    inner: Any
    last: Any
    nothing: Any


MEMORIES = [
    Nothing(),
    Outer(1, 2, 3, 4),
    Outer(1, 2, Nothing(), Nothing()),
    Outer(1, Inner(2, Nothing(), 3), 4, Nothing()),
    Outer(Nothing(), 1, 2, 3),
    Outer(Inner(Inner(1, 2, 3), Nothing(), Nothing()), Nothing(), Inner(4, 5, Outer(6, 7, 8, 9)), 10),
]


def tick(*given: int) -> tuple[int, ...]:
    """A torque, and every leaf as it is but a hundred larger."""
    p, v, reference_p, reference_v, reference_a, *memory = given
    return p + 2 * v + 3 * reference_p + 4 * reference_v + 5 * reference_a, *(x + 100 for x in memory)


@pytest.mark.parametrize("memory", MEMORIES)
def test_leaves_are_taken_and_put_back_in_their_places(memory: tuple[Any, ...]) -> None:
    step: Any = on_memories(tick, memory)  # type: ignore[arg-type]  # numbers in place of arrays
    state = like(memory, range(20, 40))
    torque, after = step(state, 1, 10, ReferencePoint(100, 1000, 10000))
    assert torque == 1 + 20 + 300 + 4000 + 50000
    expected = like(memory, (x + 100 for x in leaves(state)))
    assert after == expected
    assert type(after) is type(memory)
    assert [type(part) for part in after] == [type(part) for part in expected]
