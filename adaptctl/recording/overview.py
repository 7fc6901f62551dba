"""Texts of a comparison's recording, in Markdown."""

from __future__ import annotations

from adaptctl.recording.comparison import Comparison, ControllerRun, Leading
from adaptctl.recording.fact import Fact
from adaptctl.recording.wording import (
    CONVERGENCE,
    INCOMPLETE,
    TRUTH_UNKNOWN,
    error,
    facts,
    final_error,
    first_error,
    outcome,
    outcome_words,
)


def summary_markdown(comparison: Comparison) -> str:
    """Summary of a `comparison` of runs as Markdown text: its outcome in words, a table of facts, and a table with a
    row for each run, with its tracking errors and how it ended. Raises `ValueError` for a first run of another number
    of joints than there are torque limits."""
    warning = "" if comparison.complete else f"**{INCOMPLETE}**\n\n"
    leading = comparison.leading
    heads = ["controller", "knows", *(["first second", "last 2 s"] if leading is None else _heads(leading)), "outcome"]
    runs = "\n".join(f"| {' | '.join(_cells(comparison, run))} |" for run in comparison.runs)
    return f"""{warning}{outcome_words(comparison)}

{_paired(list(facts(comparison)))}

| {" | ".join(heads)} |
|{"---|" * len(heads)}
{runs}

{CONVERGENCE if comparison.truth_known else TRUTH_UNKNOWN}
"""


def _heads(leading: Leading) -> list[str]:
    """Heads of the errors' columns where joints' errors are not what the experiment is about."""
    return [f"{leading.meaning}, last 2 s", "joints, first second", "joints, last 2 s"]


def _cells(comparison: Comparison, run: ControllerRun) -> list[str]:
    """Row of a run."""
    leading = comparison.leading
    first = [] if leading is None else [error(leading.final_rms(run), leading.unit)]
    joints = [first_error(comparison, run), final_error(comparison, run)]
    return [run.label, run.knows or "–", *first, *joints, outcome(run)]


def _paired(answers: list[Fact]) -> str:
    """Table with two questions and answers a row."""
    cells = [f"{question} | **{answer}**" for question, answer, _ in answers]
    cells += [" | "] * (len(cells) % 2)
    head, *rows = [f"| {left} | {right} |" for left, right in zip(cells[::2], cells[1::2], strict=True)]
    return "\n".join([head, "|---|---|---|---|", *rows])


def equations_markdown(comparison: Comparison) -> str:
    """Regrouping equations of a comparison's fundamental (base) parameters as Markdown text, SI units. The heading has
    the rank, the number of independent inertial parameters, and the number of all; below it is one equation for each
    parameter that is kept, with the multiples of dependent parameters that are added to it. Nothing is raised."""
    certificate = f"rank {comparison.space.rank} of {len(comparison.space.parameter_names)}"
    equations = "\n".join(f"    {equation}" for equation in comparison.basis.equations())
    return f"""# Independent parameters: {certificate}

Found from energies alone. A star marks a parameter into which others are regrouped; what is not named here
changes no torque by itself.

{equations}
"""
