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
    """Abstract base class of measurements, which only a sweep runs and which make no recording: settings, and a class
    method from many of them to their outcomes.

    A subclass is a frozen dataclass. It gives `name`, a class variable, the name on the command line; its settings,
    fields made by `setting(default, meaning, low=..., high=...)` of `adaptctl.experiments.experiment`, besides `seed`
    (0 by default), which it inherits; and the class method `outcomes(chosen)`, which returns a list of one `RunOutcome`
    for each of the instances in `chosen`, in their order: `RunOutcome("done", reason, rms_error, ...)`, "diverged"
    likewise, or `RunOutcome.failed(error)` in place of an error. A sweep finds it by its entry in `MEASUREMENTS`, a
    mapping from names to the names of module and class.

    Raises `InputError` at construction for a setting of another type than its default or out of its bounds,
    `NonFiniteError` for NaN or infinity.
    """

    @classmethod
    @abstractmethod
    def outcomes(cls, chosen: Sequence[Self]) -> list[RunOutcome]:
        """List of the `RunOutcome` of each of the measurements `chosen`, in their order, which an implementation must
        return. It should raise nothing for a measurement that fails, whose outcome is "failed", with the reason."""


def kind_of(name: str) -> type[CheckedSettings]:
    """Class of the measurement or experiment called `name`, a dataclass of its settings, such as "gain-stability" or
    "puma560-adaptive"; its module is imported here. Raises `NotFoundError`, with the experiments' names, for an unknown
    name."""
    if name not in MEASUREMENTS:
        return find(name)
    module, kind = MEASUREMENTS[name]
    found: type[SweepMeasurement] = getattr(import_module(module), kind)
    return found
