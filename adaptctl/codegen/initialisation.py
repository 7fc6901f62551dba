"""Initial state of exported code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.codegen.interface import Interface
from adaptctl.compilation.routine import Routine, trace
from adaptctl.control.adaptive import AdaptiveController
from adaptctl.control.pytree import leaves
from adaptctl.dynamics import Mechanism
from adaptctl.errors import InputError
from adaptctl.scalars import Column

PROBE_DISTANCE = 0.02
"""rad or m from home"""


@dataclass(frozen=True)
class Walk:
    """Routines that close kinematic loops in small steps from home."""

    step: Routine
    regular: Routine
    """q (n,) to 1 where loops are certainly closed and regular, else 0"""
    home: Array
    primary: tuple[int, ...]
    looped: tuple[int, ...]


@dataclass(frozen=True)
class Start:
    """Rules for the initial internal state."""

    configurations: tuple[int, ...]
    computed: tuple[int, ...]
    more: Routine | None
    walk: Walk | None


def start_of(interface: Interface, open_by: float) -> Start:
    """`Start` of the controller of an `interface`."""
    law, mechanism = interface.controller, interface.mechanism
    p = law.neutral_configuration + PROBE_DISTANCE * np.linspace(0.5, 1.0, law.dof)
    aside = interface.memory_of(law.initial_state(p, np.zeros(law.dof)))
    moved = [k for k, (a, b) in enumerate(zip(interface.started, aside, strict=True)) if not np.array_equal(a, b)]
    q = None if mechanism is None else mechanism.configuration(p)
    configurations = tuple(k for k in moved if np.array_equal(aside[k], p if q is None else q))
    computed = tuple(k for k in moved if k not in configurations)
    more = _computed(interface, computed) if computed else None
    walk = _walk(mechanism, open_by) if mechanism is not None and mechanism.continuation is not None else None
    return Start(configurations, computed, more, walk)


def _computed(interface: Interface, fields: tuple[int, ...]) -> Routine:
    law: Any = interface.innermost
    names = [interface.memory[k].name for k in fields]
    if not isinstance(law, AdaptiveController) or law.adaptation_law is None:
        raise InputError(
            f"{type(law).__name__}: the initial state {', '.join(names)} depends on the position in an unsupported way"
        )
    adaptation, sizes = law.adaptation_law, [interface.memory[k].size for k in fields]
    initial, rest = np.array(law.initial), Column.zeros(law.dof)

    def started(q: Column) -> tuple[Column, ...]:
        memory: Any = adaptation.initial_state(law.model, initial, q, rest, law.control_period)  # type: ignore[arg-type]  # traced
        return tuple(part for part in leaves(memory) if isinstance(part, Column))

    routine = trace(started, {"q": law.model.mechanism.equations.num_joints}, name="started")
    if list(routine.layout.sizes) != sizes:
        raise InputError(f"{type(adaptation).__name__}: the initial state {', '.join(names)} is unsupported")
    return routine


def _walk(mechanism: Mechanism, open_by: float) -> Walk:
    continuation: Any = mechanism.continuation
    equations, primary = continuation.equations, tuple(continuation.primary)

    def step(p: Column, q: Column) -> Column:
        ahead = equations.joint_velocities(q, p - Column(q[i] for i in primary))
        return equations.closed(p, q + ahead)

    def regular(q: Column) -> Any:
        return continuation.surely_regular(q, open_by)

    home = np.asarray(continuation.reference, dtype=np.float64)
    looped = tuple(k for k, moves in enumerate(equations.closing.looped) if moves)
    closed = trace(step, {"p": len(primary), "q": equations.num_joints}, name="closed")
    return Walk(closed, trace(regular, {"q": equations.num_joints}, name="regular"), home, primary, looped)
