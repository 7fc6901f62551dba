"""Measurements: numbers that only a sweep is worth, not a recording."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Self

from adaptctl.experiments import find
from adaptctl.experiments.experiment import CheckedSettings
from adaptctl.sweeps.outcome import RunOutcome

MEASUREMENTS = {
    "gain-stability": ("adaptctl.sweeps.gain_stability", "GainStability"),
    "rank-certificate": ("adaptctl.sweeps.rank_certificate", "RankCertificate"),
}
"""Modules and classes by name: what is needed to choose one without importing it."""


@dataclass(frozen=True)
class SweepMeasurement(CheckedSettings, ABC):
    """Abstract base class of measurements, which only a sweep runs: a frozen dataclass of settings with a function,
    `outcomes`, from many such objects to their outcomes. A subclass gives `name`, the text by which a sweep finds it,
    further settings as fields made by `setting` (`seed`, that of all random numbers, is one already) and `outcomes`.
    Raises `InputError` at construction for a setting of another type than its default or out of its bounds,
    `NonFiniteError` for NaN or infinity."""

    @classmethod
    @abstractmethod
    def outcomes(cls, chosen: Sequence[Self]) -> list[RunOutcome]:
        """The outcomes of the measurements `chosen`, a `RunOutcome` (status, reason, errors) for each, in their order,
        which an implementation must return. It should raise nothing for what is wrong with one of them, whose outcome
        is "failed" then, with the reason."""


def kind_of(name: str) -> type[CheckedSettings]:
    """Class of the settings of the measurement or experiment of a `name`, such as "gain-stability" or
    "puma560-adaptive"; its module is imported here. Raises `NotFoundError`, with the experiments' names, for another
    name."""
    if name not in MEASUREMENTS:
        return find(name)
    module, kind = MEASUREMENTS[name]
    found: type[SweepMeasurement] = getattr(import_module(module), kind)
    return found
