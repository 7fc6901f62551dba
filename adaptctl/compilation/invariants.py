"""Loop-invariant code: expressions that are the same in all steps of a loop, computed before the first."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import islice
from typing import Any, NamedTuple

from adaptctl.compilation.graph import Expression, Op
from adaptctl.compilation.routine import Layout, Routine

_IN_EACH_STEP = (Op.CALL, Op.RESULT, Op.LESS, Op.LESS_EQUAL)
"""Calls, and comparisons, which memory cannot hold."""


class Invariants(NamedTuple):
    """Loop invariants of a step's routine (its traced function): expressions that are computed once, before the first
    step, since they depend on held arguments alone, those that are the same in all steps.

    `computed` is the set of all these; `stored` lists the expressions that are contiguous in memory for the steps to
    read: those of `computed` that a step uses or returns, and held inputs that a call takes with them; `places` maps
    the index of a single expression to its index there; `groups` maps the indices of those that a call takes as one
    argument, a tuple, to the index there of the first of them. Made by `Invariants.of`; nothing is checked.
    """

    computed: frozenset[Expression]
    stored: list[Expression]
    places: dict[int, int]
    groups: dict[tuple[int, ...], int]

    @classmethod
    def of(cls, routine: Routine, held: Collection[int]) -> Invariants:
        """Loop invariants, an `Invariants`, of a step's `routine` (its traced function), whose arguments of the indices
        `held`, from 0, are the same in all steps. They are the expressions that depend on these arguments alone, except
        calls, comparisons and all that needs these, which is computed in each step. Nothing is raised."""
        same = _same(routine.body, held)
        found = cls(frozenset(x for x in same if x.op is not Op.INPUT), [], {}, {})
        later = [x for x in routine.body if x not in found.computed]
        calls = [group for x in later if x.op is Op.CALL for group in arguments(x)]
        for group in calls:
            if found._any(group) and all(x in same for x in group):
                found._store_together(group)
        for values in (*calls, *(x.operands for x in later if x.op is not Op.CALL), routine.outputs):
            for x in values:
                if found._any((x,)) and x.index not in found.places:
                    found._store((x,))
        return found

    def before(self, routine: Routine) -> Routine:
        """Routine (traced function) that computes, once before the first step, the scalars that are the same in all
        steps. Its only result is (s,), s the length of the field `stored`; it takes all arguments of the step's
        `routine`, of which it uses the held ones alone. Nothing is checked."""
        values: tuple[Any, ...] = tuple(self.stored)
        return Routine(f"{routine.name} before", routine.inputs, values, Layout(None, ((len(values),),)))

    def left(self, routine: Routine) -> list[Expression]:
        """Expressions of the step's `routine` (its traced function) that are still computed in each step, operands
        before what uses them. They are all but the invariants; of these only such as are results of the step remain, to
        be copied. Nothing is checked."""
        results = {x for x in routine.outputs if isinstance(x, Expression)}
        return [x for x in routine.body if x not in self.computed or x in results]

    def _any(self, values: Sequence[Any]) -> bool:
        return any(isinstance(x, Expression) and x in self.computed for x in values)

    def _store_together(self, group: Sequence[Expression]) -> None:
        key = tuple(x.index for x in group)
        first = self.places.get(key[0], -1)
        if any(self.places.get(i) != first + k for k, i in enumerate(key)) and key not in self.groups:
            self.groups[key] = len(self.stored)
            self._store(group)

    def _store(self, values: Sequence[Expression]) -> None:
        for x in values:
            if x in self.computed:
                self.places.setdefault(x.index, len(self.stored))
            self.stored.append(x)


NONE = Invariants(frozenset(), [], {}, {})


def arguments(call: Expression) -> Iterator[list[Any]]:
    """Iterator over the arguments of a `call`, an expression of a call of a `Routine` (traced function): for each
    argument of the routine a list of the operands, expressions and floats, that make it up. Raises `AttributeError` for
    an expression of another kind."""
    rest = iter(call.operands)
    return (list(islice(rest, size)) for size in call.detail.inputs)


def _same(body: Sequence[Expression], held: Collection[int]) -> set[Expression]:
    """The expressions that depend on arguments of these numbers alone, the arguments' own among them."""
    same: set[Expression] = set()
    for x in body:
        if x.op is Op.INPUT:
            stays = x.detail[0] in held
        else:
            stays = x.op not in _IN_EACH_STEP and all(y in same for y in x.operands if isinstance(y, Expression))
        if stays:
            same.add(x)
    return same
