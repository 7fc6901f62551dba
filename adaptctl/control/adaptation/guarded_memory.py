"""Internal state of guarded learning."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.control.adaptation import late_torques, steady_weight, two_stage_filter
from adaptctl.control.adaptation.doubt import Watch
from adaptctl.control.adaptation.external_torque import ExternalTorque
from adaptctl.control.adaptation.law import NoMemory
from adaptctl.control.adaptation.payload_test import PayloadSums
from adaptctl.control.adaptation.steady_weight import FilteredWeight
from adaptctl.control.adaptation.stored import Stored
from adaptctl.control.adaptation.symmetric import joined
from adaptctl.control.adaptation.two_stage_filter import FilteredTwice
from adaptctl.errors import validate_kind
from adaptctl.identifiability import ReducedModel
from adaptctl.scalars import Column


class GuardedMemory(NamedTuple):
    """Internal state of `GuardedLearning`."""

    stored: Stored
    filtered: FilteredTwice
    watch: Watch
    sums: PayloadSums
    weight: FilteredWeight
    touch: Any = NoMemory()
    sent: Any = NoMemory()
    prior: Any = NoMemory()

    @property
    def logged_state(self) -> Any:
        """Decision (1,): 0 model, 1 unknown, 2 payload, 3 contact, 4 restarted; external torques and levels (r,)."""
        parts = (self.watch.decision, *self.touch[:2])
        if isinstance(parts[0], Column):
            return joined(parts)
        return np.concatenate(parts, axis=-1)

    @classmethod
    def empty(
        cls, model: ReducedModel, initial: Array, at: tuple[Array, Array], cutoff: float, control_period: float,
        observer: ExternalTorque | None, delay: int,
    ) -> GuardedMemory:  # fmt: skip
        """Empty memory, and torque filters of zero at positions (..., n) and velocities (..., r)."""
        k, r = len(model.columns), model.mechanism.dof
        nothing, none, rest, one = np.zeros(k * (k + 1) // 2), np.zeros(k), np.zeros(r), np.zeros(1)
        return cls(
            Stored(nothing, none, nothing, none, np.ones(2)),
            two_stage_filter.start(model, *at, cutoff, control_period),
            Watch(np.array(initial), rest, rest, rest, one, one, one, one),
            PayloadSums.zero(model),
            steady_weight.start(model),
            NoMemory() if observer is None else observer.start(model, *at, control_period),
            late_torques.start(delay, r),
            np.array(initial),
        )


def memory_of(given: object) -> GuardedMemory:
    """State that was given. Raises `InputError` where it is that of a controller, or another one."""
    validate_kind(given, GuardedMemory, "guarded learning: memory", "as the law_state of a controller's state is one")
    return given  # type: ignore[return-value]  # as was just asked
