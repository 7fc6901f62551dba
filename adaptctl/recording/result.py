"""Results of experiments: the outcome in words, and the function that writes the folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from adaptctl.recording.fact import Fact
from adaptctl.recording.folder import Progress as Progress
from adaptctl.recording.folder import silent as silent
from adaptctl.recording.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Result:
    """Result of a finished experiment, as the command line prints and saves it.

    `complete` is False where the experiment was interrupted: the result then holds what was computed. `headline` is the
    outcome in a sentence or two; `facts` are the questions that a person asks first, with their answers; `verdict` has
    the failures of the controllers that the experiment is about, by which the command's exit code is decided.
    `write(folder, progress)` writes recording, report and figures into an existing folder, and calls `progress(what,
    share)` with what is being written and the fraction done, 0 to 1. `failed` is True where the experiment itself
    counts its controller as failed; False, the default, for most experiments, whose failures are in `verdict` alone.
    Nothing is checked at construction.
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
    """writes recording, report, figures and all into an existing folder, every file whole or not at all"""
    failed: bool = False
    """True where its subject should have succeeded and did not: it was stopped, or learned nothing"""
