"""Bounds of an update, and of an estimate, beyond which the memory starts anew."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from operator import add
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from adaptctl.arrays import Array, frozen, numbers
from adaptctl.control.adaptation.doubt import CONTACT, MODEL, RESTARTED, YOUTH
from adaptctl.control.adaptation.guarded_memory import GuardedMemory
from adaptctl.control.pytree import either
from adaptctl.errors import InputError
from adaptctl.scalars import Column, absolute, maximum, where


def checked(law: str, bound: float, torque_step: ArrayLike) -> Array:
    """Read-only steps () or (r,). Raises `InputError` unless these and the bound are positive."""
    if not bound > 0.0:
        raise InputError(f"{law}: bound: expected a positive number, got {bound}")
    steps = numbers(torque_step, f"{law}: torque_step")
    if not np.all(steps > 0.0):
        raise InputError(f"{law}: torque_step: expected positive numbers, got {steps.tolist()}")
    return frozen(steps)


def stepped(before: Column, after: Column, rows: Sequence[Column], most: Column) -> Column:
    """Estimate after an update, less of it where that changes a torque, of rows (r, k), by more than so much."""
    change = after - before
    excess = reduce(maximum, (absolute(row @ change) / largest for row, largest in zip(rows, most, strict=True)))
    return either(excess > 1.0, before + (1.0 / maximum(excess, 1.0)) * change, after)


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
