"""Results that one condition puts back to what they were: stored as they are computed, and copied back in the end.

A guard that stops an arm keeps all of the law's memory as it was. Chosen number by number, every result would wait for
the condition, on the stack; stored at once, none does, and a copy does the rest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.llvm import Piece
from adaptctl.compilation.routine import Routine, numbered

Place = tuple[int, int]
Before = Callable[[int, int], Place | None]
"""The argument's number that a result's number takes the place of, if it does of any."""


class PutBack:
    """Results of a `piece` of a `routine` that a condition can put back to an earlier value. (A routine is a traced
    function; a piece is the whole of it or, where it is long, one of several functions that it is cut into.) Such a
    result is a choice between a new value and the argument's scalar that the result replaces. The piece can store new
    values as they are computed, and copy the earlier ones back at its end where the condition holds.

    `before(j, k)` is a callable that returns the pair (i, l) of the argument's scalar, scalar l of argument i, that
    scalar k of the result's part j replaces, None where it replaces none; all indices count from 0. The attribute
    `conditions` maps each comparison to a list of pairs ((j, k), (i, l)): where it holds, the argument's scalar is
    copied to the result's. The attribute `piece` is the piece without these choices. Nothing is checked.
    """

    def __init__(self, routine: Routine, piece: Piece, before: Before) -> None:
        uses = Counter(y for x in routine.body for y in x.operands if isinstance(y, Expression))
        uses.update(y for y in routine.outputs if isinstance(y, Expression))
        own = set(piece.expressions)
        self._choices: set[Expression] = set()
        self.conditions: dict[Expression, list[tuple[Place, Place]]] = {}
        for place, x in zip(numbered(routine.layout.sizes), routine.outputs, strict=True):
            given = before(*place)
            if isinstance(x, Expression) and x in own and uses[x] == 1 and given is not None and _puts_back(x, given):
                self._choices.add(x)
                self.conditions.setdefault(x.operands[0], []).append((place, given))
        left = [x for x in piece.expressions if x not in self._choices]
        self.piece = Piece(left, piece.kept, piece.found)

    def stored(self, x: Expression | float) -> Expression | float:
        """The value to store at first for the result `x`, an expression or a constant: for a choice between an earlier
        value and a new one, the new one, over which the earlier one may be copied at the end; `x` itself for any other.
        Nothing is raised."""
        if isinstance(x, Expression) and x in self._choices:
            kept: Expression | float = x.operands[2]
            return kept
        return x


def _puts_back(x: Expression, given: Place) -> bool:
    if x.op is not Op.SELECT:
        return False
    kept = x.operands[1]
    return isinstance(kept, Expression) and kept.op is Op.INPUT and tuple(kept.detail) == given
