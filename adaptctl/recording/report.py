"""Report of a comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from adaptctl.description.inertia import PARAMETERS
from adaptctl.folders import made_folder
from adaptctl.recording.colors import run_color
from adaptctl.recording.comparison import Comparison, Finding, Setting
from adaptctl.recording.controller_run import StepCost
from adaptctl.recording.drawing import write_figures
from adaptctl.recording.figures import drawings
from adaptctl.recording.judgement import (
    facts,
    final_error,
    first_error,
    joint_errors,
    judged,
    on_truth,
    outcome,
    outcome_words,
)
from adaptctl.recording.page import (
    SHEU_WALKER,
    Cell,
    Fragment,
    Lines,
    Note,
    Part,
    Report,
    Section,
    Table,
    TableLayout,
    files_section,
    settings_section,
)
from adaptctl.recording.result import TRACE, Progress, Result, silent
from adaptctl.recording.summary import sealed, summary
from adaptctl.recording.wording import headline, number, parameter_unit, typeset

SOURCE = (
    f"Method: {SHEU_WALKER}; J.-J. E. Slotine and W. Li, On the Adaptive Control of Robot Manipulators, International "
    "Journal of Robotics Research 6(3), 1987."
)
COSTS = "Floating-point operations of the compiled law."
TIMES = (
    "Times are measured on this machine. A native time is the mean of a loop over many states, including copies. "
    "A called time is that of one control step called from Python."
)


def shown(comparison: Comparison) -> Result:
    """
    Return the result of a comparison, for the command line to print and write.

    Parameters
    ----------
    comparison : Comparison
        Runs to report.

    Returns
    -------
    Result
        Headline, facts and verdict of the comparison. Its function `write` calls `write_artifacts` without figures as
        files, which its function `figures` writes.

    Examples
    --------
    >>> from adaptctl.recording import compared_runs, shown
    >>> shown(compared_runs(arm, {"adaptive": run})).verdict.passed
    True
    """
    return Result(
        complete=comparison.complete,
        headline=headline(outcome_words(comparison), comparison.complete),
        facts=tuple(facts(comparison, by_joint=True)),
        verdict=judged(comparison),
        write=lambda folder, progress: write_artifacts(folder, comparison, progress, figures=False),
        figures=lambda folder: write_figures(made_folder(folder), report(comparison).drawings),
    )


def write_artifacts(
    folder: str | Path, comparison: Comparison, progress: Progress = silent, *, figures: bool = True
) -> Path:
    """
    Write recording, summary, trace, report and figures of a comparison, all or none.

    Parameters
    ----------
    folder : str or pathlib.Path
        Folder, which is made where it is missing: recording.rrd, summary.json, trace.parquet, report.html, figures.
    comparison : Comparison
        Runs to write.
    progress : callable, optional
        Function of the file's name and the fraction done, 0 to 1, called before each file.
    figures : bool, default True
        Also writes the report's figures as PNG files, by Matplotlib. Without these the report has them as SVG, which
        takes a twentieth of the time.

    Returns
    -------
    pathlib.Path
        Folder with the files. Numbers of a run that overflowed are null, and its recording ends before them.

    Raises
    ------
    FileError
        If a file cannot be written.
    InputError
        If the basis is another mechanism's (`NonFiniteError` for a run whose first positions are not finite).

    Examples
    --------
    >>> from adaptctl.recording import compared_runs, write_artifacts
    >>> _ = (tmp / "file").write_text("")
    >>> write_artifacts(tmp / "file" / "run", compared_runs(arm, {"adaptive": run}))  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    adaptctl.errors.FileError: ...
    """
    from adaptctl.recording.rerun_recording import write_recording
    from adaptctl.recording.trace import write_trace

    def record(path: Path, files: Mapping[str, Path]) -> None:
        write_recording(path, comparison)

    how: dict[str, Any] = {"tables": {TRACE: partial(write_trace, comparison=comparison)}, "record": record}
    content = sealed(summary(comparison))
    return report(comparison, figures).write(folder, content, progress=progress, figures=figures, **how)


def report(comparison: Comparison, figures: bool = True) -> Report:
    """Report of a comparison: outcome, facts, tables, figures (as files too), settings."""
    return Report(
        experiment=comparison.experiment,
        title=comparison.title,
        outcome=outcome_words(comparison),
        facts=tuple(facts(comparison)),
        sections=tuple(_sections(comparison, figures)),
        about=f"seed {comparison.seed}",
        seed=comparison.seed,
        complete=comparison.complete,
        source=SOURCE,
    )


def _sections(comparison: Comparison, figures: bool) -> Iterator[Section]:
    figure = drawings(comparison)
    label = comparison.subject.label
    yield Section("Experiment", tuple(_run_parts(comparison)))
    if not isinstance(comparison.live, str):
        yield Section("", (Fragment(comparison.live.html(comparison.live.label or label)),))
    elif comparison.live:
        yield Section("", (Note(f"This report has no live simulation: {comparison.live}."),))
    yield Section("Cost of a control step", tuple(_costs(comparison)))
    yield Section(
        "Stability and effort", [figure[name] for name in ("lyapunov", "contact-force", "torque") if name in figure]
    )
    if "parameters" in figure:
        yield Section("Parameter estimates", (on_truth(comparison), figure["parameters"], _parameters(comparison)))
    yield Section("Base parameters", tuple(_matter(comparison)))
    settings = [setting for setting in comparison.settings if not _is_note(setting)]
    yield settings_section(settings, *_robot_notes(comparison))
    yield files_section(
        "The moving arm, with all curves.",
        "The numbers of this report, as JSON.",
        {TRACE: "All control periods of the adaptive run, with units."},
        figures=figures,
    )


def _is_note(setting: Setting) -> bool:
    """True for a remark among the settings, which is shown with the results."""
    return setting.name.startswith("note ")


def _run_parts(comparison: Comparison) -> Iterator[Part]:
    figure = drawings(comparison)
    yield comparison.purpose
    yield from (Note(one.value, head="Note.", warning=True) for one in comparison.settings if _is_note(one))
    yield from comparison.more_drawings
    rows = [
        (
            run.prior_knowledge or "–",
            first_error(comparison, run),
            final_error(comparison, run),
            f"{comparison.limited_steps(run)}",
            outcome(run),
        )
        for run in comparison.runs
    ]
    heads = "initial model", "RMS error, first second", "RMS error, last 2 s", "steps at a torque limit", "outcome"
    yield _of_runs(comparison, heads, rows, "llrrrl")
    yield Table(
        (f"joint ({comparison.subject.label})", "RMS error, first second", "RMS error, last 2 s"),
        joint_errors(comparison),
        align="lrr",
    )
    if (columns := _measured(comparison)) is not None:
        yield columns
    names = [run.name for run in comparison.runs]
    if others := [finding for finding in comparison.findings if finding.name.partition(".")[2] not in names]:
        found = [(f.meaning, number(f.value), typeset(f.unit)) for f in others]
        yield Table(("also measured", "value", "unit"), found, align="lr")
    yield figure["tracking-error"]
    yield figure["joint-errors"]


def _of_runs(
    comparison: Comparison, heads: Sequence[str], rows: Sequence[Sequence[str]], align: str, note: str = ""
) -> Table:
    colors = (run_color(comparison.color_indices[run.name]).hex for run in comparison.runs)
    labels = [Cell(run.label, swatch=color) for run, color in zip(comparison.runs, colors, strict=True)]
    cells: list[tuple[str | Cell, ...]] = [(label, *row) for label, row in zip(labels, rows, strict=True)]
    return Table(("controller", *heads), cells, align=align, layout=TableLayout.ROWS, marked=(0,), note=note)


def _costs(comparison: Comparison) -> Iterator[Part]:
    costs = [run.cost or StepCost() for run in comparison.runs]
    columns = {
        "operations": [f"{cost.flops:,}" if cost.flops is not None else "–" for cost in costs],
        "native": [f"{1e9 * cost.native:,.0f} ns" if cost.native else "–" for cost in costs],
        "called": [f"{1e6 * cost.called:.1f} µs" if cost.called else "–" for cost in costs],
    }
    shown = {name: cells for name, cells in columns.items() if name == "operations" or set(cells) != {"–"}}
    yield f"{COSTS} {TIMES}" if len(shown) > 1 else COSTS
    yield _of_runs(comparison, tuple(shown), list(zip(*shown.values(), strict=True)), "l" + "r" * len(shown))


def _parameters(comparison: Comparison) -> Table:
    columns = comparison.model.names, comparison.true_parameters, comparison.subject.rollout.estimate[-1]
    rows = [
        (name, typeset(parameter_unit(name, comparison.mechanism)), _fixed(true), _fixed(est), _fixed(est - true))
        for name, true, est in zip(*columns, strict=True)
    ]
    heads = ("parameter", "unit", "true", "estimate", "difference")
    return Table(heads, rows, align="csrrr", layout=TableLayout.HALVES)


def _fixed(value: float) -> str:
    return "–" if np.isnan(value) else f"{value + 0.0:+.4f}".replace("-", "−")


def _matter(comparison: Comparison) -> Iterator[Part]:
    mechanism, space, kept = comparison.mechanism, comparison.space, set(comparison.basis.names)
    friction = len(mechanism.parameter_names) - len(space.parameter_names)
    more = (
        f" Its {friction} friction parameters do not change the energy, so that all of them are kept."
        if friction
        else ""
    )
    yield (
        f"The energy of {mechanism.name} depends on {space.rank} combinations of its {len(space.parameter_names)} "
        "inertial parameters. They are found from energies, without accelerations. As many base parameters are kept, "
        f"and the others are regrouped into them.{more}"
    )
    yield drawings(comparison)["spectrum"]
    rows: list[tuple[str | bool, ...]] = [
        (link.name, *(f"{link.name}.{kind}" in kept for kind in PARAMETERS)) for link in mechanism.links
    ]
    yield Table(("kept", *PARAMETERS), rows, layout=TableLayout.GRID, marks=("kept", "left out or regrouped"))
    yield Note(
        "Regrouping relations; a star marks a base parameter, the right-hand side has the link parameters regrouped "
        "into it (SI units)."
    )
    yield Lines([str(equation) for equation in comparison.basis.equations()])


def _robot_notes(comparison: Comparison) -> Iterator[Note]:
    description = comparison.mechanism.description
    if description.source:
        yield Note(description.source, head=f"{comparison.mechanism.name}.")
    if wrong := description.inconsistent_links:
        yield Note(
            f"The inertial parameters of {', '.join(wrong)} are not physically consistent. They are those of the "
            "robot's description."
        )


def _measured(comparison: Comparison) -> Table | None:
    names = [run.name for run in comparison.runs]
    columns: dict[str, dict[str, Finding]] = {}
    for finding in comparison.findings:
        what, _, owner = finding.name.partition(".")
        if owner in names:
            columns.setdefault(what, {})[owner] = finding
    if not columns:
        return None
    firsts = {what: next(iter(found.values())) for what, found in columns.items()}
    units = {what: "" if one.unit == "1" else f" [{typeset(one.unit)}]" for what, one in firsts.items()}
    heads = [what.replace("_", " ") + unit for what, unit in units.items()]
    meanings = (one.meaning.partition(": ")[2] for one in firsts.values())
    told = " ".join(f"{head}: {meaning}." for head, meaning in zip(heads, meanings, strict=True))
    rows = [[number(of[name].value) if name in of else "–" for of in columns.values()] for name in names]
    return _of_runs(comparison, heads, rows, "l" + "r" * len(heads), told)
