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

    `kept` has the zero-based indices of the numbers to be remembered; `sources` (m,) has for every number its constant,
    a float, or the index, an integer, of its equal among those kept. Made by `MotionMemory.of`; nothing is checked.
    """

    kept: tuple[int, ...]
    sources: tuple[float | int, ...]

    @classmethod
    def of(cls, numbers: Callable[..., Column], sizes: Mapping[str, int]) -> MotionMemory:
        """The `MotionMemory` of a mechanism, found by tracing `numbers` once: a callable that returns the m numbers of
        a motion, a `Column` (m,), from Columns whose names and lengths are `sizes`. Raises what the callable
        raises."""
        kept: list[int] = []
        places: dict[Any, int] = {}
        sources: list[float | int] = []
        for i, x in enumerate(trace(numbers, sizes, name="motion").outputs):
            if not isinstance(x, float) and x not in places:
                places[x] = len(kept)
                kept.append(i)
            sources.append(x if isinstance(x, float) else places[x])
        return cls(tuple(kept), tuple(sources))

    def chosen(self, numbers: Column) -> Column:
        """The numbers to be remembered, a `Column`, of all m `numbers` (m,) of a motion. Raises `IndexError` where one
        of them is missing."""
        return Column(numbers[i] for i in self.kept)

    def numbers(self, remembered: Column) -> Column:
        """All m numbers of a motion, a `Column` (m,), from those `remembered`. Raises `IndexError` for too few."""
        return Column(x if isinstance(x, float) else remembered[x] for x in self.sources)
