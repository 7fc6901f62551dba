"""Verdict on a controller: what went wrong with it, and what of that was expected."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any


class Failure(Enum):
    """Enumeration of the kinds of a controller's failure in an experiment; the value is a word for it, such as
    "diverged". STOPPED: the environment ended the run early, a joint's position error having passed its bound, or the
    mechanism having come near a singularity of its kinematic loops or broken a condition that its file states.
    DIVERGED: a position error was 1 rad (1 m if prismatic) or more in the run's last 2 s. SATURATED: a torque was at
    its limit for over 2 s in all. NO_BETTER: the RMS position error over the last 2 s is not below 0.9 times that with
    adaptation off. DIFFERS: a build of exported code does not compile, or does not repeat Python's torques within its
    tolerance."""

    STOPPED = "stopped"
    """the environment ended the run, an error having passed its bound"""
    DIVERGED = "diverged"
    """the run ended with errors of 1 rad (1 m) or more"""
    SATURATED = "saturated"
    """torques were at their limits for seconds"""
    NO_BETTER = "no better"
    """the same controller with adaptation off ends with as small an error"""
    DIFFERS = "differs"
    """exported code does not repeat what Python did"""


@dataclass(frozen=True)
class Fault:
    """A failure of a controller in a run: `failure`, its kind, and `sentence`, a description of it for readers.
    `expected` is the reason why the experiment expects it, so that it does not count against the controller, None, the
    default, where it does not. Nothing is checked at construction."""

    failure: Failure
    sentence: str
    """a sentence"""
    expected: str | None = None
    """why the experiment expects it; None where it does not"""


@dataclass(frozen=True)
class Verdict:
    """Verdict on the controllers that an experiment is about: `faults`, their failures in the order found, empty, the
    default, where they did what was asked. Nothing is checked at construction."""

    faults: tuple[Fault, ...] = ()

    @classmethod
    def of(cls, found: Iterable[tuple[Failure, str]], expected: Mapping[Failure, str] | None = None) -> Verdict:
        """The verdict with a `Fault` (a failure of a controller) for each pair of `found`, a kind of failure and a
        sentence about it, in their order. `expected` maps kinds of failure to the reason why the experiment expects
        them, None, the default, for none; a kind that is not in it counts against the controller. Nothing is
        checked."""
        reasons = expected or {}
        return cls(tuple(Fault(failure, sentence, reasons.get(failure)) for failure, sentence in found))

    @classmethod
    def together(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """One verdict made of several, for an experiment about several controllers: the faults (failures) of all of
        them, in their order. Nothing is checked."""
        return cls(tuple(fault for verdict in verdicts for fault in verdict.faults))

    @property
    def passed(self) -> bool:
        """True where the verdict has no faults (failures of a controller), or only such as the experiment expects."""
        return all(fault.expected is not None for fault in self.faults)

    def before(self, answer: str) -> str:
        """The text `answer`, an experiment's result in words, together with sentences on the verdict's faults. Before
        it stand "Failed:" and the unexpected ones; after it each expected one, as "As expected (reason): ...", or
        without the brackets where the reason is empty. Without faults it is the answer alone. Nothing is raised."""
        failed = [fault.sentence for fault in self.faults if fault.expected is None]
        reasons = [(fault, f" ({fault.expected})" if fault.expected else "") for fault in self.faults]
        expected = [f"As expected{why}: {fault.sentence}" for fault, why in reasons if fault.expected is not None]
        return " ".join([*(["Failed:", *failed] if failed else []), answer, *expected])

    def as_builtins(self) -> dict[str, Any]:
        """The verdict in JSON's types: `passed`, a bool, and `faults`, a list of mappings with `failure`, a value of
        `Failure` such as "diverged", `sentence`, a text, and `expected`, the reason or None. Nothing is raised."""
        faults = [
            {"failure": fault.failure.value, "sentence": fault.sentence, "expected": fault.expected}
            for fault in self.faults
        ]
        return {"passed": self.passed, "faults": faults}
