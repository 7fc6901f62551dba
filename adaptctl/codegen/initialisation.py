"""The memory before the first tick, as code: what begins alike everywhere, and what begins with the arm's position."""

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

ASIDE = 0.02
"""rad or m from home, where it is seen what depends on positions"""


@dataclass(frozen=True)
class Walk:
    """Routines and data by which exported code closes a mechanism's kinematic loops, in small steps from the home
    configuration to the initial positions of the r primary (independent) joints.

    `step`, a traced `Routine` of p (r,) and q (n,), returns the closed configuration (n,) of the spanning tree's n
    joints, rad (m if prismatic), at the primary joints' positions p, from one nearby, q. `regular`, a traced `Routine`
    of q (n,), returns 1 where the loops at q are closed and a lower bound of the smallest singular value of their
    Jacobian with respect to the dependent joints is at least 0.05 of that at the reference configuration, else 0.
    `home` (n,) is the home configuration, `primary` has the indices of the primary joints among the n, `looped` those,
    among the r, that move a loop; indices count from 0. Nothing is checked.
    """

    step: Routine
    regular: Routine
    """q (n,) -> 1 where loops are closed and away from singularities beyond doubt, else 0"""
    home: Array
    primary: tuple[int, ...]
    looped: tuple[int, ...]


@dataclass(frozen=True)
class Start:
    """Rules by which exported code makes a controller's initial internal state from the configuration q (n,) of the
    spanning tree's n joints, rad (m if prismatic), at rest. `configurations` has the zero-based indices of the state's
    fields that begin as q itself; `computed` those of the fields that `more`, a traced `Routine` of q, computes, None
    where there are none; `walk` is the `Walk` that closes the mechanism's loops, None for a tree. Fields in neither
    have the same initial values at every q. Nothing is checked."""

    configurations: tuple[int, ...]
    computed: tuple[int, ...]
    more: Routine | None
    walk: Walk | None


def start_of(interface: Interface, open_by: float) -> Start:
    """The `Start`, rules for making the initial internal state, of the controller of an `interface`. It is found by
    comparing the initial state at the home configuration with that at one up to 0.02 rad (m if prismatic) per joint
    away. `open_by` is the closure residual, m or rad, below which kinematic loops count as closed. Raises `InputError`
    where a field depends on the configuration, is not the configuration itself, and no adaptation law computes it;
    `TraceError` where what computes it cannot be traced."""
    law, mechanism = interface.controller, interface.mechanism
    p = law.neutral_configuration + ASIDE * np.linspace(0.5, 1.0, law.dof)
    aside = interface.memory_of(law.initial_state(p, np.zeros(law.dof)))
    moved = [k for k, (a, b) in enumerate(zip(interface.started, aside, strict=True)) if not np.array_equal(a, b)]
    q = None if mechanism is None else mechanism.configuration(p)
    configurations = tuple(k for k in moved if np.array_equal(aside[k], p if q is None else q))
    computed = tuple(k for k in moved if k not in configurations)
    more = _computed(interface, computed) if computed else None
    walk = _walk(mechanism, open_by) if mechanism is not None and mechanism.continuation is not None else None
    return Start(configurations, computed, more, walk)


def _computed(interface: Interface, fields: tuple[int, ...]) -> Routine:
    """The start of the adaptation law's memory over scalars."""
    law: Any = interface.innermost
    names = [interface.memory[k].name for k in fields]
    if not isinstance(law, AdaptiveController) or law.adaptation_law is None:
        raise InputError(
            f"{type(law).__name__}: its memory's {', '.join(names)} begins with positions in an unknown way"
        )
    adaptation, sizes = law.adaptation_law, [interface.memory[k].size for k in fields]
    initial, rest = np.array(law.initial), Column.zeros(law.dof)

    def started(q: Column) -> tuple[Column, ...]:
        memory: Any = adaptation.initial_state(law.model, initial, q, rest, law.control_period)  # type: ignore[arg-type]  # traced
        return tuple(part for part in leaves(memory) if isinstance(part, Column))

    routine = trace(started, {"q": law.model.mechanism.equations.joints}, name="started")
    if list(routine.layout.sizes) != sizes:
        raise InputError(f"{type(adaptation).__name__}: its memory's {', '.join(names)} begins in an unknown way")
    return routine


def _walk(mechanism: Mechanism, open_by: float) -> Walk:
    continuation: Any = mechanism.continuation
    equations, primary = continuation.equations, tuple(continuation.primary)

    def step(p: Column, q: Column) -> Column:
        ahead = equations.rates(q, p - Column(q[i] for i in primary))
        return equations.closed(p, q + ahead)

    def regular(q: Column) -> Any:
        return continuation.surely_regular(q, open_by)

    home = np.asarray(continuation.reference, dtype=np.float64)
    looped = tuple(k for k, moves in enumerate(equations.closing.looped) if moves)
    closed = trace(step, {"p": len(primary), "q": equations.joints}, name="closed")
    return Walk(closed, trace(regular, {"q": equations.joints}, name="regular"), home, primary, looped)
