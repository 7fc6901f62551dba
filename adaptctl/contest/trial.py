"""Trial of a law before its runs, so that one that raises, never ends or knows too much is a row with its reason."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from adaptctl.arrays import Array
from adaptctl.compilation.routine import trace
from adaptctl.contest.known import Knowledge, Known
from adaptctl.contest.laws import Entrant
from adaptctl.control import Controller, ReferencePoint
from adaptctl.control.pytree import checked_step, leaves, like, validate_step
from adaptctl.errors import AdaptctlError, InputError
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column
from adaptctl.tuning.verification import scaled_links

TIME_LIMIT = 60.0
"""s in which a law must be made and traced"""
MAX_OPERATIONS = 2_000_000
"""floating-point operations of a control step, which compile in minutes"""
OTHER_LINKS, STEPS = 0.5, 3
"""error of the links, and control steps, by which it is seen whether a law uses them"""
FIELDS = ("p", "v", "reference_p", "reference_v", "reference_a")
Value = TypeVar("Value")


class TimeExceededError(AdaptctlError):
    """Error of a law that is not ready within the time limit."""


def in_time(call: Callable[[], Value], limit: float) -> Value:
    """Result of a call in a thread of its own; `TimeExceededError` where it does not end."""
    results: list[Value] = []
    errors: list[BaseException] = []

    def run() -> None:
        try:
            results.append(call())
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(limit)
    if thread.is_alive():
        number = ctypes.c_ulong(thread.ident or 0)
        ctypes.pythonapi.PyThreadState_SetAsyncExc(number, ctypes.py_object(TimeExceededError))
        raise TimeExceededError(f"too slow: not ready within {limit:g} s")
    if errors:
        raise errors[0]
    return results[0]


def tried(entrant: Entrant, known: Known, limit: float = TIME_LIMIT) -> int:
    """Operations of a law's control step. Raises whatever the law does, and `InputError` if it is not as it must be."""
    return in_time(lambda: _tried(entrant, known), limit)


def _tried(entrant: Entrant, known: Known) -> int:
    law = entrant.make(known)
    if law.dof != known.dof:
        raise InputError(f"is for {law.dof} joints, but the arm has {known.dof}")
    if entrant.knows is Knowledge.LIMITS and not _alike(law, entrant.make(_other(known))):
        raise InputError("needs the parameters of the arm's links, which a law that knows limits may not have")
    count = operations(law)
    if count > MAX_OPERATIONS:
        raise InputError(
            f"too slow: {count:,} operations in a control step, and at most {MAX_OPERATIONS:,} are allowed"
        )
    return count


def _other(known: Known) -> Known:
    """Same arm with other links: what a law makes of it must be the same, if it knows only limits."""
    mechanism = known.mechanism.with_parameters(scaled_links(known.mechanism, OTHER_LINKS, 1))
    model = ReducedModel(mechanism, known.model.basis)
    return Known(known.scene._replace(mechanism=mechanism, model=model), known.knows, mechanism.inertial_parameters)


def _alike(one: Controller[Any], other: Controller[Any]) -> bool:
    return np.array_equal(_torques(one), _torques(other), equal_nan=True)


def _torques(law: Controller[Any]) -> Array:
    """Torques (steps, r) of a law in Python along made-up measurements."""
    rng = np.random.default_rng(0)
    memory: Any = law.init(*0.1 * rng.standard_normal((2, law.dof)))
    state, found = like(memory, (Column(part.tolist()) for part in leaves(memory))), []
    for _ in range(STEPS):
        p, v, *point = (Column(row) for row in (0.1 * rng.standard_normal((5, law.dof))).tolist())
        torque, state = validate_step(law, checked_step(law, p, v, ReferencePoint(*point), state))
        found.append([float(x) for x in torque])
    return np.array(found)


def operations(law: Controller[Any]) -> int:
    """Floating-point operations of a control step."""
    memory: Any = law.init(np.zeros(law.dof), np.zeros(law.dof))
    sizes = dict.fromkeys(FIELDS, law.dof) | {f"memory_{k}": len(part) for k, part in enumerate(leaves(memory))}

    def step(p: Column, v: Column, **rest: Column) -> Any:
        point = ReferencePoint(*(rest.pop(name) for name in FIELDS[2:]))
        torque, after = validate_step(law, checked_step(law, p, v, point, like(memory, rest.values())))
        return (torque, *leaves(after))

    return trace(step, sizes, name=type(law).__name__).operations.flops
