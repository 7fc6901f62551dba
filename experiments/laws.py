"""Adaptation laws and control laws side by side on one arm, from one rough model, under what real plants have."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from adaptctl.dynamics import Mechanism
from adaptctl.experiments.contest import ADAPTATION_OFF, Contender, Outcome, Told
from adaptctl.experiments.disturbed_arm import LABELS, DisturbedArm
from adaptctl.experiments.laws_controllers import controller
from adaptctl.identifiability import FundamentalBasis, ReducedModel


@dataclass(frozen=True, kw_only=True)
class Laws(DisturbedArm):
    """Experiment that compares adaptation laws and control laws on one arm, from one rough model and with the same
    gain, under a disturbance."""

    name: ClassVar[str] = "laws"
    title: ClassVar[str] = "{robot}: adaptation laws and control laws side by side"

    def contenders(self, mechanism: Mechanism, basis: FundamentalBasis) -> list[Contender]:
        """Controllers to compare, those of `laws` in their order, then Slotine and Li's law with adaptation off, all
        from the rough model; behind guards where motors are weak. Raises `InputError` for a basis of another
        geometry."""
        model, knows = ReducedModel(mechanism, basis), f"links within {100 * self.parameter_error:.0f} %"
        names = (*self.laws, ADAPTATION_OFF)
        return [Contender(name, LABELS[name], knows, partial(controller, self, name, model)) for name in names]

    def told(self, outcome: Outcome, basis: FundamentalBasis) -> Told:
        """Findings, sentences and figures on the `outcome`: parameter errors and memories of all laws, and what the
        disturbances ask."""
        from adaptctl.experiments.laws_outcome import told

        return told(self, outcome, basis)
