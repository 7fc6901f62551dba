"""Report of a comparison: one HTML page with text, tables and the figures inside."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptctl.codegen.live_arm import LiveArm
from adaptctl.description.inertia import PARAMETERS
from adaptctl.files import write_text
from adaptctl.recording.comparison import Comparison, ControllerRun, Finding
from adaptctl.recording.figures import drawings
from adaptctl.recording.page import embedded, rendered
from adaptctl.recording.palette import joint_color, run_color
from adaptctl.recording.trace import parameter_unit
from adaptctl.recording.units import typeset
from adaptctl.recording.wording import (
    CONVERGENCE,
    INCOMPLETE,
    TRUTH_UNKNOWN,
    facts,
    final_error,
    first_error,
    number,
    outcome,
    outcome_words,
)


def write_report(path: str | Path, comparison: Comparison, figures: Mapping[str, Path]) -> None:
    """Write the report of a `comparison` of runs to the file `path`, whole or not at all: one HTML page that needs no
    other file. `figures` maps names of the comparison's drawings to PNG files, which go into the page; a drawing
    without a file is left out. Raises `FileError` where the page cannot be written, `OSError` where a PNG file cannot
    be read, `InputError` for parameter estimates with the basis of another mechanism."""
    write_text(path, report(comparison, figures))


def report(comparison: Comparison, figures: Mapping[str, Path]) -> str:
    """HTML, as text, of the report of a comparison of runs: outcome, tables of runs and parameters, figures, settings.
    `figures` maps names of the comparison's drawings to PNG files, which go into the page; a drawing without a file is
    left out. Raises `OSError` where a PNG file cannot be read, `InputError` for parameter estimates with the basis of
    another mechanism."""
    names = [run.name for run in comparison.runs]
    others = [finding for finding in comparison.findings if _owner(finding) not in names]
    return rendered(
        "report.html",
        comparison=comparison,
        verdict=outcome_words(comparison),
        incomplete=INCOMPLETE,
        convergence=CONVERGENCE if comparison.truth_known else TRUTH_UNKNOWN,
        facts=list(facts(comparison)),
        runs=[_run_row(run, comparison) for run in comparison.runs],
        measured=measured(comparison),
        findings=[(f.meaning, number(f.value), typeset(f.unit)) for f in others],
        parameters=list(_parameter_rows(comparison)),
        friction=len(comparison.mechanism.parameter_names) - len(comparison.space.parameter_names),
        kinds=PARAMETERS,
        grid=_grid(comparison),
        equations=[str(equation) for equation in comparison.basis.equations()],
        robot_source=comparison.mechanism.description.source,
        inconsistent=comparison.mechanism.description.inconsistent_links,
        figures=embedded(drawings(comparison), figures),
        live=live_content(comparison.live, comparison.runs[0].label),
        no_live=comparison.live if isinstance(comparison.live, str) else "",
    )


def live_content(live: LiveArm | str, label: str) -> dict[str, Any] | None:
    """Content, a dict in JSON's types, of a report's live arm, a simulated arm that runs in the page as WebAssembly;
    None where `live` is a text, the reason why there is none. It has `binary`, the module in base64; `facts`, those of
    `live`: indices of numbers in the module's memory, names of joints, initial values and geometry; `label`, the name
    of the run that it repeats; and `colors`, one a joint, such as "#2d7deb". Nothing is raised."""
    if isinstance(live, str):
        return None
    binary = base64.b64encode(live.binary).decode("ascii")
    colors = [joint_color(j).hex for j in range(len(live.facts["joints"]))]
    return {"binary": binary, "facts": live.facts, "label": label, "colors": colors}


class Measured(NamedTuple):
    """Column of a report's table of runs, of a quantity that was measured of the runs besides their errors. `heading`
    is its name with the unit in brackets, `meaning` is in words, and `values` are numbers as texts, one a run, a dash
    for a run without it. Nothing is checked at construction."""

    heading: str
    meaning: str
    values: list[str]
    """one a run, a dash where it was not measured"""


def measured(comparison: Comparison) -> list[Measured]:
    """Columns, a list of `Measured`, of a report's table of runs, made from the comparison's findings about single
    runs: findings named "what.run", such as "peak_speed.adaptive", make one column for each "what". Each has a text for
    every run of the comparison, in their order, a dash for one without the finding. The list is empty where there are
    no such findings. Nothing is raised."""
    names = [run.name for run in comparison.runs]
    columns: dict[str, dict[str, Finding]] = {}
    for finding in comparison.findings:
        if (owner := _owner(finding)) in names:
            columns.setdefault(finding.name.removesuffix(f".{owner}"), {})[owner] = finding
    return [_column(what, found, names) for what, found in columns.items()]


def _column(what: str, found: Mapping[str, Finding], names: list[str]) -> Measured:
    first = next(iter(found.values()))
    unit = "" if first.unit == "1" else f" [{typeset(first.unit)}]"
    values = [number(found[name].value) if name in found else "–" for name in names]
    return Measured(what.replace("_", " ") + unit, first.meaning.partition(": ")[2], values)


def _owner(finding: Finding) -> str:
    return finding.name.partition(".")[2]


def _run_row(run: ControllerRun, comparison: Comparison) -> dict[str, Any]:
    cost = run.cost
    return {
        "color": run_color(comparison.color_places[run.name]).hex,
        "label": run.label,
        "knows": run.knows,
        "first": first_error(comparison, run),
        "final": final_error(comparison, run),
        "clipped": comparison.limited_steps(run),
        "called": f"{1e6 * cost.called:.1f} µs" if cost else "–",
        "native": f"{1e9 * cost.native:,.0f} ns" if cost and cost.native else "–",
        "flops": f"{cost.flops:,}" if cost and cost.flops is not None else "–",
        "outcome": outcome(run),
    }


def _parameter_rows(comparison: Comparison) -> list[tuple[str, str, str, str, str]]:
    final = comparison.subject.rollout.estimate[-1]
    if not len(final):
        return []
    rows = zip(comparison.model.names, comparison.true_parameters, final, strict=True)
    return [
        (name, typeset(parameter_unit(name, comparison.mechanism)), _fixed(true), _fixed(est), _fixed(est - true))
        for name, true, est in rows
    ]


def _fixed(value: float) -> str:
    return "–" if np.isnan(value) else f"{value + 0.0:+.4f}".replace("-", "−")


def _grid(comparison: Comparison) -> list[tuple[str, list[bool]]]:
    """Name of each link, and which of its ten parameters are kept."""
    kept = set(comparison.basis.names)
    names = [link.name for link in comparison.mechanism.links]
    return [(name, [f"{name}.{kind}" in kept for kind in PARAMETERS]) for name in names]
