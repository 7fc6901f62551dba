"""Report of a comparison of finished experiments, with figures of one over the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from adaptctl.recording.compared_folders import ComparedFolders
from adaptctl.recording.drawing import Drawing, run_style, sheet, thinned
from adaptctl.recording.figures import AVERAGING_TIME, MAX_DRAWN_SAMPLES, small_multiples
from adaptctl.recording.finished_trace import FinishedTrace, read_traces
from adaptctl.recording.moving_average import moving_rms
from adaptctl.recording.page import Part, Report, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PER_JOINT = {"error": "Tracking error of each joint", "applied": "Torque of each joint", "estimate": "Estimates"}
"""Captions of what is drawn joint by joint, or parameter by parameter, by the columns' names in a trace."""
DRAWN = MAX_DRAWN_SAMPLES // 3
"""samples of a small panel's curve"""
MAX_PANELS = 60


def write_compared(folder: str | Path, compared: ComparedFolders) -> Path:
    """
    Write report.html and comparison.json of compared experiments, both or none.

    Parameters
    ----------
    folder : str or Path
        Folder to write, which is made where it is missing.
    compared : ComparedFolders
        Comparison, whose folders still have their traces.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileError
        If a trace cannot be read, or a file cannot be written.
    """
    traces = read_traces(compared.folders)
    sections = [Section("Settings", (_settings(compared),)), Section("Errors", (_errors(compared), *drawings(traces)))]
    title = f"Comparison of {len(traces)} experiments"
    report = Report("comparison", title, _outcome(compared), sections=sections)
    content = compared.as_builtins()
    return report.write(folder, content, name="comparison.json", record=lambda *_: None, figures=False)


def _outcome(compared: ComparedFolders) -> str:
    differing = ", ".join(one.name for one in compared.differences)
    return f"They differ in {differing}." if differing else "All settings are the same."


def _settings(compared: ComparedFolders) -> Part:
    rows = [(one.name, *one.values) for one in compared.differences]
    return Table(("setting", *compared.folders), rows) if rows else "All settings are the same."


def _errors(compared: ComparedFolders) -> Table:
    rows = [(one.name, *one.words) for one in compared.errors]
    note = "RMS errors of the last 2 s in mrad (mm), and in brackets over that of the first folder."
    return Table(("controller", *compared.folders), rows, note=note, align="l" + "r" * len(compared.folders))


def drawings(traces: Sequence[FinishedTrace]) -> Iterator[Drawing]:
    """Figures of traces over each other; joint by joint where all have the same joints."""
    runs = ", ".join(dict.fromkeys(trace.entry("run") for trace in traces))
    caption = f"RMS error of all joints, averaged over {AVERAGING_TIME:g} s, of the controller {runs}."
    yield Drawing("tracking-error", caption, partial(_tracking_error, traces), plain=True)
    for kind, caption in PER_JOINT.items():
        names = traces[0].names(kind)
        if 0 < len(names) <= MAX_PANELS and all(trace.names(kind) == names for trace in traces):
            yield Drawing(kind, f"{caption}.", partial(_each, traces, [f"{kind}.{name}" for name in names]), plain=True)


def _tracking_error(traces: Sequence[FinishedTrace]) -> Figure:
    """Figure of the root mean square errors of the first runs."""
    figure = sheet(4.2)
    axes = figure.subplots()
    for i, trace in enumerate(traces):
        time, every = trace.time, thinned(len(trace.time), MAX_DRAWN_SAMPLES)
        values = 1e3 * moving_rms(trace.columns("error"), AVERAGING_TIME, trace.sample_time)
        axes.semilogy(time[every], values[every], **run_style(i), linewidth=1.8, label=trace.folder)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("RMS tracking error [mrad or mm]")
    axes.set_xlim(0.0, max(trace.time[-1] for trace in traces))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def _each(traces: Sequence[FinishedTrace], names: Sequence[str]) -> Figure:
    """Figure with a panel for each of some columns, and a curve for each trace."""
    figure, panels = small_multiples(len(names), columns=3, height=1.75, bottom=0.48)
    for axes, name in zip(panels, names, strict=True):
        kind, _, of = name.partition(".")
        scale, prefix = (1e3, "m") if kind == "error" else (1.0, "")
        for i, trace in enumerate(traces):
            every = thinned(len(trace.time), DRAWN)
            axes.plot(trace.time[every], scale * trace.column(name)[every], **run_style(i), linewidth=1.2)
        axes.set_title(f"{of} [{prefix}{traces[0].unit(name)}]")
        axes.set_xlim(0.0, max(trace.time[-1] for trace in traces))
    figure.supxlabel("time [s]", size=9)
    return figure
