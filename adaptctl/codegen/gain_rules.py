"""Rules for gains in exported code."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from adaptctl.arrays import Array
from adaptctl.codegen.interface import Field, short_names
from adaptctl.control import Controller, SafetyFilter, SlotineLi, Workspace, sampling_ratio
from adaptctl.errors import AdaptctlError, GainError

LARGEST_FACTOR = 1e4
"""of a gain, beyond which it has no bound"""
HALVINGS = 6
BOUND_SHRINKING = 0.9
"""of a bound that another position refuses"""


@dataclass(frozen=True)
class GainRule:
    """Rule by which exported code checks a gain (an array)."""

    field: Field
    positive: bool
    signed: bool
    infinite: bool
    most: Array | None
    bounds: bool


def gain_rules(controller: Controller[Any], fields: tuple[Field, ...]) -> tuple[GainRule, ...]:
    """Rules for a controller's gains, in order."""
    return tuple(_rule(controller, field) for field in fields)


def _rule(controller: Controller[Any], field: Field) -> GainRule:
    names = list(controller.numbers)
    name = names[short_names(names).index(field.name)]
    values = controller.numbers[name]
    return GainRule(
        field,
        positive=not _allowed(controller, name, np.where(values > 0.0, 0.0, values)) and bool(np.all(values > 0.0)),
        signed=bool(np.any(values < 0.0)) or _allowed(controller, name, -values),
        infinite=bool(np.isinf(values).any()),
        most=_most(controller, name, values),
        bounds=name.split(".")[-1] == "estimate_bounds",
    )


def _allowed(controller: Controller[Any], name: str, values: Array) -> bool:
    try:
        controller.tuned({name: values})
    except (AdaptctlError, ValueError, ArithmeticError):
        return False
    return True


def _carried(controller: Controller[Any], name: str, values: Array) -> bool:
    try:
        controller.tuned({name: values})
    except GainError:
        return False
    except (AdaptctlError, ValueError, ArithmeticError):
        return True
    return True


def _most(controller: Controller[Any], name: str, values: Array) -> Array | None:
    """Greatest multiples of gains that the control period allows, or None."""
    narrow = _at_its_worst(controller)
    if not np.isfinite(values).all():
        return None
    low, high = 1.0, LARGEST_FACTOR
    if _carried(narrow, name, high * values):
        if _carried(controller, name, high * values):
            return None
        narrow = controller
    for _ in range(HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if _carried(narrow, name, middle * values) else (low, middle)
    while low > 1.0 and not _carried(controller, name, low * values):
        low = max(BOUND_SHRINKING * low, 1.0)
    return np.asarray(low * values)


def _at_its_worst(controller: Controller[Any]) -> Controller[Any]:
    """Controller with its workspace narrowed to the one position where its sampling ratio is greatest."""
    if isinstance(controller, SafetyFilter):
        return replace(controller, inner=_at_its_worst(controller.inner))
    if not isinstance(controller, SlotineLi):
        return controller
    mechanism = controller.model.mechanism
    found = sampling_ratio(mechanism, controller.damping, controller.control_period, workspace=controller.workspace)
    p = found.p[None]
    return replace(controller, workspace=Workspace(mechanism, p, p, p))
