"""Bound of an estimate, beyond which the memory starts anew."""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import Any

from adaptctl.control.adaptation.doubt import CONTACT, MODEL, RESTARTED, YOUTH
from adaptctl.control.adaptation.guarded_memory import GuardedMemory
from adaptctl.control.pytree import either
from adaptctl.scalars import Column, where


def bounded(
    bound: Any, scale: Column, after: Column, memory: GuardedMemory, before: Any
) -> tuple[Column, GuardedMemory]:
    """Estimate and memory, or the prior and no memory if the estimate is farther away, in units of a scale (k,).

    The mark, of which the decision before tells, lasts while the memory is young.
    """
    away = ((x - y) / unit for x, y, unit in zip(after, memory.prior, scale, strict=True))
    beyond = reduce(add, (x * x for x in away)) > bound * bound
    watch, stored = memory.watch, memory.stored
    marked = where(before > CONTACT, where(watch.age[0] < YOUTH, RESTARTED, MODEL), MODEL)
    decision = where(beyond, RESTARTED, where(watch.decision[0] > MODEL, watch.decision[0], marked))

    def none(values: Column) -> Column:
        return Column(where(beyond, 0.0, x) for x in values)

    trusted = either(beyond, memory.prior, watch.trusted)
    emptied = {name: none(getattr(watch, name)) for name in ("noise", "doubt", "age", "alarm", "announced")}
    passed = watch._replace(trusted=trusted, decision=Column((decision,)), **emptied)
    kept = stored._replace(valid=none(stored.valid))
    return either(beyond, memory.prior, after), memory._replace(watch=passed, stored=kept)
