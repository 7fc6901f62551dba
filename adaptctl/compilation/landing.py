"""Results of calls that are written where the caller's own results go, so that they are never copied."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.routine import Routine, numbered


class Landings(NamedTuple):
    """
    Places among a routine's results where calls write directly.

    `calls` has (part, index) of the caller's results by (call's index, part of its results), `places` the same for each
    expression that is such a result.
    """

    calls: dict[tuple[int, int], tuple[int, int]]
    places: dict[int, tuple[int, int]]


NOWHERE = Landings({}, {})
"""Calls that write into memory of their own."""


def landings(routine: Routine) -> Landings:
    """Parts of calls' results that are, whole and in order, among a routine's results."""
    found, at = Landings({}, {}), numbered(routine.layout.sizes)
    for first, x in enumerate(routine.outputs):
        if isinstance(x, Expression) and x.op is Op.RESULT and x.detail[1] == 0:
            key, size = (x.operands[0].index, x.detail[0]), x.operands[0].detail.layout.sizes[x.detail[0]]
            run, places = routine.outputs[first : first + size], at[first : first + size]
            if key not in found.calls and len(run) == size and places[0][0] == places[-1][0] and _follow(run, x):
                found.calls[key] = at[first]
                found.places.update(zip((y.index for y in run if isinstance(y, Expression)), places, strict=True))
    return found


def _follow(run: Sequence[Any], first: Expression) -> bool:
    """True if all of one part of a call's results follow each other."""
    call, part = first.operands[0], first.detail[0]
    return all(
        isinstance(x, Expression) and x.op is Op.RESULT and x.operands[0] is call and x.detail == (part, k)
        for k, x in enumerate(run)
    )
