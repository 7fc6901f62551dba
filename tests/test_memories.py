"""Memories in one array are what they are apart: the same parts by the same names, whatever is done with them."""

from __future__ import annotations

import copy
import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest

from adaptctl.control.pytree import leaves, like, packed_state, paths


class Nothing(NamedTuple):
    pass


class Inner(NamedTuple):
    one: Any
    nothing: Any
    two: Any

    @property
    def length(self) -> int:
        """A property of the memory's own."""
        return len(self.one) + len(self.two)


class Outer(NamedTuple):
    first: Any
    of: Any
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


ARMS: list[tuple[int, ...]] = [(), (5,), (2, 3)]


def sized(memory: tuple[Any, ...], arms: tuple[int, ...]) -> tuple[Any, ...]:
    """The same with columns (..., n), n their number in the memory."""
    rng = np.random.default_rng(0)
    return like(memory, (rng.normal(size=(*arms, n)) for n in leaves(memory)))


def in_one(memory: tuple[Any, ...], arms: tuple[int, ...]) -> Any:
    array = np.concatenate([*leaves(memory), np.zeros((*arms, 0))], axis=-1)
    return packed_state(memory)._of(array)


def same(one: Any, other: Any) -> bool:
    """Whether two memories have the same kinds of parts and the same numbers, in the same order."""
    if not isinstance(one, tuple):
        return np.array_equal(one, other)
    return isinstance(one, type(other)) and len(one) == len(other) and all(map(same, one, other))


@pytest.mark.parametrize("arms", ARMS)
@pytest.mark.parametrize("memory", MEMORIES)
def test_a_memory_in_one_array_has_the_same_parts(memory: tuple[Any, ...], arms: tuple[int, ...]) -> None:
    apart = sized(memory, arms)
    together = in_one(apart, arms)
    assert same(together, apart)
    assert list(paths(together)) == list(paths(apart))
    for name in getattr(apart, "_fields", ()):
        assert same(getattr(together, name), getattr(apart, name))
    assert packed_state(apart) is packed_state(together) or not together  # one type a layout


@pytest.mark.parametrize("memory", MEMORIES)
def test_copies_and_other_processes_get_the_same(memory: tuple[Any, ...]) -> None:
    apart = sized(memory, ())
    together = in_one(apart, ())
    for other in (copy.copy(together), copy.deepcopy(together), pickle.loads(pickle.dumps(together))):
        assert same(other, apart)
        for leaf, own in zip(leaves(other), leaves(together), strict=True):
            assert not np.shares_memory(leaf, own)


def test_what_is_made_of_it_is_an_ordinary_memory() -> None:
    apart = sized(MEMORIES[3], (4,))
    together = in_one(apart, (4,))
    replaced = together._replace(last=0.0)
    assert type(replaced) is Outer
    assert replaced.last == 0.0
    assert same(replaced._replace(last=apart.last), apart)  # type: ignore[attr-defined]
    assert type(like(together, leaves(apart))) is Outer
    np.testing.assert_array_equal(together.of.one, apart.of.one)  # type: ignore[attr-defined]
    assert together.of.length == 8
    first, *_ = together
    assert np.shares_memory(first, together.first)
    assert together[-1] == Nothing()
    assert repr(together) == repr(apart)
    assert together == together
    assert together != apart
