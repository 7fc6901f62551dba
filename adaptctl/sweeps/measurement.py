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
    """Base class of measurements in sweeps: settings, and a function from many of them to their outcomes."""

    @classmethod
    @abstractmethod
    def outcomes(cls, chosen: Sequence[Self]) -> list[RunOutcome]:
        """The outcome of each measurement. Raises nothing for what is wrong with one of them: its outcome says it."""


def kind_of(name: str) -> type[CheckedSettings]:
    """Class of the measurement or experiment of that name. Raises NotFoundError with the experiments' names."""
    if name not in MEASUREMENTS:
        return find(name)
    module, kind = MEASUREMENTS[name]
    found: type[SweepMeasurement] = getattr(import_module(module), kind)
    return found
