"""Figure of builds: how far each law's torques are from Python's, with which numbers, by which compiler."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from adaptctl.experiments.exported_builds import Build

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def build_grid(builds: Sequence[Build]) -> Figure:
    """Matplotlib figure of compiled `builds` of exported control laws as a grid, a row for each law, a column for each
    compiler and kind of number (double or float). A blue square marks a build that reproduces the torques recorded from
    Python, an orange one a build that does not, with the largest difference of torques, N m (N if prismatic), written
    beside it. Nothing is checked."""
    from adaptctl.recording.drawing import run_color, sheet

    laws = list(dict.fromkeys(build.law for build in builds))
    kinds = list(dict.fromkeys((build.compiler, build.scalar) for build in builds))
    figure = sheet(0.8 + 0.34 * len(laws))
    axes = figure.subplots()
    for build in builds:
        x, y = kinds.index((build.compiler, build.scalar)), laws.index(build.law)
        axes.plot(x, y, "s", color=run_color(0 if build.passed else 1).hex, markersize=11)
        axes.text(x + 0.05 * len(kinds), y, _said(build), va="center", size=8.0)
    axes.set_xticks(range(len(kinds)), [f"{compiler}, {scalar}" for compiler, scalar in kinds])
    axes.set_yticks(range(len(laws)), laws)
    axes.set_xlim(-0.3, len(kinds) - 0.3)
    axes.set_ylim(len(laws) - 0.5, -0.5)
    axes.xaxis.tick_top()
    axes.grid(visible=False)
    return figure


def _said(build: Build) -> str:
    from adaptctl.recording.wording import scientific

    off = "" if build.difference is None else f"{scientific(build.difference, 2)} N m off"
    return off if build.passed else f"differs{f', {off}' if off else ''}"
