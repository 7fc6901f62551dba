"""A long routine in pieces, each a function of its own.

LLVM's time to give out registers grows with the square of a function's length: 7 s for 35,000 operations. What one
piece computes and a later one needs passes through memory, where most of so many numbers would be anyway.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from typing import NamedTuple

from adaptctl.compilation.graph import Expression, Op

LONGEST = 6000
"""Expressions in a routine that is left whole."""

PIECE = 1500
"""Expressions in a piece of a longer one, about."""

_TRUTHS = (Op.LESS, Op.LESS_EQUAL)


class Piece(NamedTuple):
    """Piece of a long routine (traced function), compiled as a function of its own. `expressions` are computed in their
    order; `kept` are the positions in memory, shared by all pieces, of those that later pieces need; and `found` the
    positions there of what earlier pieces computed and this one needs. Both are dicts from an expression's index to its
    position, an index in that memory. Nothing is checked."""

    expressions: Sequence[Expression]
    kept: dict[int, int]
    found: dict[int, int]


def pieces(body: Sequence[Expression], given: Container[int] = ()) -> list[Piece]:
    """Pieces, a list of `Piece` in order, that a routine's (traced function's) expressions, `body`, are compiled in.
    There is one where there are at most 6000 expressions, else one for about every 1500, since LLVM's time grows with
    the square of a function's length. `given` has the indices of expressions that are in memory already and pass
    between no pieces, none by default. Comparisons are made again in each piece that uses them, for memory holds
    numbers alone. Nothing is checked."""
    whole, *others = _parts(body)
    if not others:
        return [Piece(whole, {}, {})]
    parts = [_with_truths(part) for part in (whole, *others)]
    homes = {x.index: k for k, part in reversed(list(enumerate(parts))) for x in part}
    used = [_operands(x for x in part if x.index not in given) for part in parts]
    needed = [{y.index for y in ys if y.index not in given and homes[y.index] < k} for k, ys in enumerate(used)]
    places = _places(homes, needed)
    made = []
    for k, part in enumerate(parts):
        kept = {x.index: places[x.index] for x in part if x.index in places and homes[x.index] == k}
        made.append(Piece(part, kept, {i: places[i] for i in needed[k]}))
    return made


def _parts(body: Sequence[Expression]) -> Iterator[Sequence[Expression]]:
    """Runs of expressions; the results of a call stay with it."""
    first, length = 0, LONGEST if len(body) <= LONGEST else PIECE
    while first == 0 or first < len(body):
        last = first + length
        while last < len(body) and body[last].op is Op.RESULT:
            last += 1
        yield body[first:last]
        first = last


def _with_truths(part: Sequence[Expression]) -> Sequence[Expression]:
    own = set(part)
    elsewhere = {y for x in part for y in x.operands if isinstance(y, Expression) and y.op in _TRUTHS} - own
    return sorted((*part, *elsewhere), key=lambda x: x.index) if elsewhere else part


def _operands(part: Iterable[Expression]) -> set[Expression]:
    """Operands of a piece that are computed anywhere: neither inputs nor calls."""
    used = (y for x in part for y in x.operands if isinstance(y, Expression))
    return {y for y in used if y.op not in (Op.INPUT, Op.CALL, *_TRUTHS)}


def _places(homes: dict[int, int], needed: Sequence[set[int]]) -> dict[int, int]:
    """Index in memory of every value that passes between pieces; an index is used again after its value's last use.

    In an order of their own, so that the same routine is the same text, and is compiled once for all processes.
    """
    last = {i: k for k, wanted in enumerate(needed) for i in sorted(wanted)}
    places: dict[int, int] = {}
    free: list[int] = []
    count = 0
    for k in range(len(needed)):
        free += [places[i] for i, end in last.items() if end == k - 1]
        for i in (i for i in last if homes[i] == k):
            if not free:
                free, count = [count], count + 1
            places[i] = free.pop()
    return places
