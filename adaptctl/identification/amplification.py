"""Amplification of errors in the torques by two estimators: a result with a headline, facts and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from adaptctl.arrays import Array
from adaptctl.recording.drawing import MUTED, Drawing, run_color, sheet
from adaptctl.recording.page import SHEU_WALKER, Report, Section, Table
from adaptctl.recording.result import Fact, Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class TorqueCase(NamedTuple):
    """Relative errors of two estimators of a robot's parameters, no units, for one kind of torques that they are fitted
    to, described by `torques`. They are root mean square errors over all joints, divided by the root mean square of the
    torques of a model that stands for the truth. `off` is the error of the fitted torques against the model's, over the
    whole log. `momentum` and `energy` are the errors, against the model's, of the torques that the two estimators
    predict for the last part of a log: filtered dynamics (the equations of motion behind a low-pass filter) and energy
    differences (work and energy over windows of time). Nothing is checked at construction."""

    torques: str
    off: float
    momentum: float
    energy: float


class Curves(NamedTuple):
    """Torques of r joints, named `joints`, on the last part of a log, at n times `time` (n,), s; each (n, r), N m (N if
    prismatic). They are `measured`, and predicted by two estimators fitted to the measured torques of the first part:
    filtered dynamics (`momentum`) and energy differences (`energy`). Nothing is checked at construction."""

    joints: tuple[str, ...]
    time: Array
    measured: Array
    momentum: Array
    energy: Array


@dataclass(frozen=True, eq=False)
class Amplification:
    """Comparison, by an experiment, of two estimators of a robot's parameters by the errors of the torques that they
    predict, given the errors of the torques that they learn from. The estimators are filtered dynamics (the equations
    of motion behind a low-pass filter) and energy differences (one equation of work and energy over each window of
    time, `window` s long).

    `experiment` is its name and `title` the report's; `measured` has a `TorqueCase` for each kind of torques, the exact
    ones first, the measured ones last; `curves` are torques over time; `seed` is that of the random numbers, `complete`
    False where it was interrupted. Nothing is checked at construction.
    """

    experiment: str
    title: str
    window: float
    measured: tuple[TorqueCase, ...]
    curves: Curves
    seed: int
    complete: bool = True

    def headline(self) -> str:
        """The finding in a sentence or two, as text: the relative errors of the torques that energy differences
        predict, fitted to exact and to measured torques, and of those that filtered dynamics predicts, fitted to
        measured ones. Errors are root mean squares over that of the true torques. Raises `IndexError` where there are
        no cases, `ZeroDivisionError` where the error of filtered dynamics in the last case is zero."""
        last, exact = self.measured[-1], self.measured[0]
        return (
            f"From exact torques, energy differences predict to {exact.energy:.2%}; from measured ones to "
            f"{last.energy:.0%}, where filtered dynamics is {last.momentum:.1%} off: one scalar equation a window "
            f"amplifies what torques are off by {last.energy / last.momentum:.0f} times as much."
        )

    def facts(self) -> Iterator[Fact]:
        """Facts for the report, a `Fact` for each kind of torques that the estimators are fitted to (exact, noisy or
        measured), in the order of this result's `measured`. `question` says what these torques are; `answer` has in
        percent the errors of the torques then predicted by filtered dynamics (the equations of motion behind a low-pass
        filter) and by energy differences (work and energy over windows of time), root mean squares over that of the
        torques of the model that stands for the truth. Nothing is raised."""
        for entry in self.measured:
            yield Fact(entry.torques, f"filtered dynamics {entry.momentum:.2%}, energy differences {entry.energy:.2%}")

    def write(self, folder: Path, progress: Progress) -> None:
        """Write the result into a `folder`: summary.json, report.html, recording.rrd and the PNG file of a figure in
        the subfolder `figures`, all or none. `progress(what, share)` is called with what is being written and the
        fraction done, 0 to 1. Raises `FileError` where a file cannot be written, and for errors that are NaN or
        infinite."""
        content = {
            "schema": "adaptctl/energy-differences/1",
            "experiment": self.experiment,
            "window": self.window,
            "torques": [entry._asdict() for entry in self.measured],
        }
        self.report().write(folder, content, record=self._record, progress=progress)

    def report(self) -> Report:
        """The report of both estimators' errors: a table and a figure."""
        told = (
            "Both estimators learn from the first part of one motion and predict its last part. The torques are those "
            "of a fitted model, with more and more added to them, up to what the log measured."
        )
        rows = [(e.torques, f"{e.off:.2%}", f"{e.momentum:.2%}", f"{e.energy:.2%}") for e in self.measured]
        table = Table(("torques", "off by", "filtered dynamics", "energy differences"), rows, align="lrrr")
        caption = "Error of predicted torques on the log's last part, of both estimators."
        drawing = Drawing("amplification", caption, self._draw)
        section = Section("What torques that are off make of either estimate", (told, table, drawing))
        outcome, facts = self.headline(), tuple(self.facts())
        source = f"Method: {SHEU_WALKER}."
        return Report(
            self.experiment, self.title, outcome, facts, (section,), "", self.seed, self.complete, source=source
        )

    def _record(self, path: Path, figures: Mapping[str, Path]) -> None:
        """Torques over time, a joint a view."""
        import rerun.blueprint as rrb

        from adaptctl.recording import views
        from adaptctl.recording.scene import entity
        from adaptctl.recording.stream import Style, log_markdown, log_series, saved_stream

        curves = self.curves
        start, end = float(curves.time[0]), float(curves.time[-1])
        torques = [
            views.curves(entity(name), f"{name}: torque [N m]", end, room=views.LONG, start=start)
            for name in curves.joints
        ]
        summary = views.text("summary", "Summary")
        layout = views.tabs(
            rrb.Vertical(summary, rrb.Grid(*torques, grid_columns=2), row_shares=[1, 8], name="Torques")
        )
        with saved_stream(path, self, curves.energy.tobytes(), layout) as recording:
            log_markdown(recording, "summary", self.headline())
            for j, name in enumerate(curves.joints):
                values = np.stack([curves.measured[:, j], curves.momentum[:, j], curves.energy[:, j]], axis=-1)
                labels = ("measured", "filtered dynamics", "energy differences")
                style = Style(labels, [MUTED, run_color(0), run_color(1)])
                log_series(recording, entity(name), curves.time, values, style)

    def _draw(self) -> Figure:
        figure = sheet(3.0)
        ax: Any = figure.subplots()
        place = np.arange(len(self.measured))
        both = (
            ("filtered dynamics", [e.momentum for e in self.measured]),
            (
                "energy differences",
                [e.energy for e in self.measured],
            ),
        )
        for i, (label, values) in enumerate(both):
            ax.barh(place + 0.38 * i, np.maximum(values, 1e-5), 0.36, color=run_color(i).hex, label=label)
        ax.set_yticks(place + 0.19, [e.torques for e in self.measured])
        ax.set_xscale("log")
        ax.invert_yaxis()
        ax.set_xlabel("error over the torques")
        ax.legend(loc="lower right")
        return figure
