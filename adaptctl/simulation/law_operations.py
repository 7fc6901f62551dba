"""Operations of a control law, counted where a closed loop is traced: to trace the law alone takes as long again."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from adaptctl.compilation.routine import Layout, Routine
from adaptctl.control import Controller
from adaptctl.scalars import Structure


@lru_cache(maxsize=64)
def _counted(law: Structure) -> list[int]:
    """Floating-point operations of a law, none before it is traced in a loop."""
    return []


def count(controller: Controller[Any], computed: Iterable[Any]) -> None:
    """Count what is computed in a trace for a law's torque and next state."""
    values = tuple(computed)
    routine = Routine("law", (), values, Layout(None, ((len(values),),)))
    _counted(controller.structure)[:] = [routine.operations.flops]


def law_flops(controller: Controller[Any]) -> int | None:
    """Floating-point operations of a control step; None if it is not compiled."""
    if counted := _counted(controller.structure):
        return counted[0]
    return None if controller.kernel is None else controller.kernel.operations.flops
