"""Results of experiments: the outcome in words, and the function that writes the folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from adaptctl.recording.fact import Fact
from adaptctl.recording.verdict import Verdict

Progress: TypeAlias = Callable[[str, float], object]
"""Called with what is being done, and the share of it (0 to 1) that is done."""


def silent(what: str, share: float) -> None:
    """Do nothing: a `progress` callback for those who want none shown."""


@dataclass(frozen=True, eq=False)
class Result:
    """Result of a finished experiment, as the command line prints and saves it.

    `complete` is False when it was interrupted: what was computed is kept. `headline` is the outcome in a sentence or
    two; `facts` are the questions that a person asks first, with their answers; `verdict`, whether its controllers did
    what was asked, which decides the command's exit code; `write(folder, progress)` writes recording, report and
    figures into a folder that is there; `failed`, True where its subject should have succeeded and did not, False
    unless given, as by most experiments: `verdict.passed` tells of all. Nothing is checked at construction.
    """

    complete: bool
    """False when it was interrupted: what was computed is kept"""
    headline: str
    """the outcome in a sentence or two"""
    facts: tuple[Fact, ...]
    """questions that a person asks first, and the answers"""
    verdict: Verdict
    """whether the controllers that it is about did what was asked"""
    write: Callable[[Path, Progress], object]
    """writes recording, report, figures and all into a folder that is ready, every file whole or not at all"""
    failed: bool = False
    """True where its subject should have succeeded and did not: it was stopped, or learned nothing"""
