"""Verdict on a controller: what went wrong with it, and what of that was expected."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any


class Failure(Enum):
    """Kinds of a controller's failure, the worst first: STOPPED, the environment ended the run, an error having passed
    its bound; DIVERGED, it ended with errors that no tracking has; SATURATED, torques were at their limits for seconds;
    NO_BETTER, the same controller with adaptation off ends with as small an error; DIFFERS, exported code does not
    repeat what Python did."""

    STOPPED = "stopped"
    """the environment ended the run, an error having passed its bound"""
    DIVERGED = "diverged"
    """the run ended with errors that no tracking has"""
    SATURATED = "saturated"
    """torques were at their limits for seconds"""
    NO_BETTER = "no better"
    """the same controller with adaptation off ends with as small an error"""
    DIFFERS = "differs"
    """exported code does not repeat what Python did"""


@dataclass(frozen=True)
class Fault:
    """A controller's failure in a run: its kind, a sentence about it, and why the experiment expected it, None where it
    did not."""

    failure: Failure
    sentence: str
    """a sentence"""
    expected: str | None = None
    """why the experiment expects it; None where it does not"""


@dataclass(frozen=True)
class Verdict:
    """The verdict on the controllers that an experiment is about: their faults, none where they did what was asked."""

    faults: tuple[Fault, ...] = ()

    @classmethod
    def of(cls, found: Iterable[tuple[Failure, str]], expected: Mapping[Failure, str] | None = None) -> Verdict:
        """The verdict of failures found, with a sentence each; `expected` has why some of them are expected, None where
        none is."""
        reasons = expected or {}
        return cls(tuple(Fault(failure, sentence, reasons.get(failure)) for failure, sentence in found))

    @classmethod
    def together(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """One verdict of several, for an experiment with several subjects: the faults of all of them."""
        return cls(tuple(fault for verdict in verdicts for fault in verdict.faults))

    @property
    def passed(self) -> bool:
        """True where there is no fault, or none but expected ones."""
        return all(fault.expected is not None for fault in self.faults)

    def before(self, answer: str) -> str:
        """The text of an experiment's answer with its faults: the unexpected ones before it, the expected ones after
        it."""
        failed = [fault.sentence for fault in self.faults if fault.expected is None]
        expected = [f"As expected ({fault.expected}): {fault.sentence}" for fault in self.faults if fault.expected]
        return " ".join([*(["Failed:", *failed] if failed else []), answer, *expected])

    def as_builtins(self) -> dict[str, Any]:
        """The verdict in JSON's types: `passed`, a bool, and `faults`, a list of mappings with `failure`, `sentence`
        and `expected`."""
        faults = [
            {"failure": fault.failure.value, "sentence": fault.sentence, "expected": fault.expected}
            for fault in self.faults
        ]
        return {"passed": self.passed, "faults": faults}
