"""The numbers to be remembered of a motion: those that are neither constants of the mechanism nor equal to others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from adaptctl.compilation import trace
from adaptctl.scalars import Column


class MotionMemory(NamedTuple):
    """The choice of numbers to be remembered among the m from which a mechanism's motion can be rebuilt
    (`Motion.numbers`). Those left out are constants of the mechanism, such as zeros of links that move in a plane, or
    equal to one that is kept.

    `kept` has the zero-based indices of the numbers to be remembered; `known` maps the index of each number that is a
    constant to it; `same` (m,) has for every number the index, among those kept, of its equal, 0 for constants. Made by
    `MotionMemory.of`; nothing is checked.
    """

    kept: tuple[int, ...]
    known: Mapping[int, float]
    same: tuple[int, ...]

    @classmethod
    def of(cls, numbers: Callable[..., Column], sizes: Mapping[str, int]) -> MotionMemory:
        """The `MotionMemory` of a mechanism, found by tracing `numbers` once: a callable that returns the m numbers of
        a motion, a `Column` (m,), from Columns whose names and lengths are `sizes`. Raises what the callable
        raises."""
        found = trace(numbers, sizes, name="motion").outputs
        known = {i: float(x) for i, x in enumerate(found) if isinstance(x, float)}
        first: dict[Any, int] = {}
        for i, x in enumerate(found):
            if i not in known:
                first.setdefault(x, i)
        place = {x: k for k, x in enumerate(first)}
        return cls(tuple(first.values()), known, tuple(0 if i in known else place[x] for i, x in enumerate(found)))

    def of_motion(self, numbers: Column) -> Column:
        """The numbers to be remembered, a `Column`, of all m `numbers` (m,) of a motion. Raises `IndexError` for too
        few."""
        return Column(numbers[i] for i in self.kept)

    def numbers(self, remembered: Column) -> Column:
        """All m numbers of a motion, a `Column` (m,), from those `remembered`. Raises `IndexError` for too few."""
        return Column(self.known[i] if i in self.known else remembered[k] for i, k in enumerate(self.same))
