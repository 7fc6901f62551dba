"""Figure of builds: which law, with which numbers, by which compiler, repeats what Python did."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class BuildLike(Protocol):
    """A build that was run."""

    @property
    def law(self) -> str:
        """Name of the law."""

    @property
    def scalar(self) -> str:
        """Kind of number."""

    @property
    def compiler(self) -> str:
        """Name of the compiler."""

    @property
    def passed(self) -> bool:
        """True where it repeats the recorded ticks."""


def build_grid(builds: Sequence[BuildLike]) -> Figure:
    """Figure with a row a law and a column a compiler and kind of number: blue where a build agrees."""
    from adaptctl.recording.drawing import sheet
    from adaptctl.recording.palette import run_color

    laws = list(dict.fromkeys(build.law for build in builds))
    kinds = list(dict.fromkeys((build.compiler, build.scalar) for build in builds))
    figure = sheet(0.8 + 0.34 * len(laws))
    axes = figure.subplots()
    for build in builds:
        x, y = kinds.index((build.compiler, build.scalar)), laws.index(build.law)
        axes.plot(x, y, "s", color=run_color(0 if build.passed else 1).hex, markersize=11)
        axes.text(x + 0.14, y, "agrees" if build.passed else "differs", va="center", size=8.0)
    axes.set_xticks(range(len(kinds)), [f"{compiler}, {scalar}" for compiler, scalar in kinds])
    axes.set_yticks(range(len(laws)), laws)
    axes.set_xlim(-0.3, len(kinds) - 0.3)
    axes.set_ylim(len(laws) - 0.5, -0.5)
    axes.xaxis.tick_top()
    axes.grid(visible=False)
    return figure
