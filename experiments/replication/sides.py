"""Two arms on one path in closed loop: their runs, and the figures of these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from adaptctl.arrays import Array
from adaptctl.dynamics import equation_costs
from adaptctl.errors import InputError
from adaptctl.experiments.tip_path import ArmWithTip
from adaptctl.recording import Setting
from adaptctl.recording.comparison import BEGINNING, SETTLED, Comparison, ControllerRun
from adaptctl.recording.drawing import GOAL, INK, RUNS, Drawing, sheet, thinned
from adaptctl.recording.judgement import judged
from adaptctl.recording.result import Verdict
from adaptctl.recording.skeleton import Skeleton, skeleton, with_tip

SAMPLES = 3000
"""At most as many samples are drawn."""
VIEWS = ((1, 2, "from the front"), (0, 2, "from the side"), (0, 1, "from above"))
COLORS = (RUNS[0], RUNS[3])
DASHED = (0, (4, 3))


@dataclass(frozen=True, eq=False)
class Side:
    """Simulated runs of one of two `arm`s that are compared: `comparison` has the runs; `desired` and `tips` map each
    run's name to the tip's desired and actual positions in the world, (T, 3) in m at T samples."""

    arm: ArmWithTip
    comparison: Comparison
    desired: Mapping[str, Array]
    tips: Mapping[str, Array]

    @property
    def subject(self) -> ControllerRun:
        """Run of the controller that adapts the independent parameters."""
        return self.comparison.subject

    @property
    def full(self) -> ControllerRun | None:
        """Run of the controller that adapts all parameters; None where it was not run."""
        return next((run for run in self.comparison.runs if run.name == "adaptive-full"), None)

    @property
    def joints(self) -> int:
        """Number of the arm's joints, with those that are cut to make a tree of its loops."""
        loops = self.comparison.mechanism.description.loops
        return len(self.comparison.mechanism.links) + (len(loops.closures) if loops else 0)

    @property
    def regressor(self) -> dict[str, int]:
        """Counts of floating-point operations of the Slotine-Li regressor, on the "reduced" parameters and in "full";
        closing loops is not counted."""
        mechanism, columns = self.comparison.mechanism, self.comparison.basis.columns
        return {"reduced": equation_costs(mechanism, columns).regressor, "full": equation_costs(mechanism).regressor}

    @property
    def skeleton(self) -> Skeleton:
        """Skeleton of the arm with its tip."""
        names = [link.name for link in self.comparison.mechanism.links]
        return with_tip(skeleton(self.comparison.mechanism), names.index(self.arm.link), np.array(self.arm.tip))

    def tip_errors(self, run: ControllerRun) -> Array:
        """Distances (T,) of the tip from its path, m, at the T samples of a `run`. Raises `KeyError` for another."""
        return np.asarray(np.linalg.norm(self.tips[run.name] - self.desired[run.name], axis=-1))

    @staticmethod
    def flops(run: ControllerRun | None) -> int:
        """Count of floating-point operations of a tick of a `run`, 0 where it was not counted."""
        return run.cost.flops or 0 if run is not None and run.cost else 0

    def first(self, run: ControllerRun | None) -> float | None:
        """RMS distance of the tip from its path, m, over the first second of a `run`; None for a shorter one."""
        return None if run is None or run.first_rms_error is None else self._rms(run, 0.0, BEGINNING)

    def final(self, run: ControllerRun | None) -> float | None:
        """RMS distance of the tip from its path, m, over the last two seconds of a `run`; None for a shorter one."""
        return None if run is None or run.final_rms_error is None else self._rms(run, run.duration - SETTLED, np.inf)

    def _rms(self, run: ControllerRun, start: float, stop: float) -> float | None:
        inside = (run.rollout.time >= start) & (run.rollout.time < stop)
        return float(np.sqrt(np.mean(self.tip_errors(run)[inside] ** 2))) if inside.any() else None


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Outcome of a comparison of arms on one task: a `Side` for each, in order; the experiment's name, `title`,
    `settings`, `seed` and `duration` (s); and `complete`, False where it was interrupted, `sides` being those begun.
    Raises `InputError` at construction for no sides."""

    experiment: str
    title: str
    sides: tuple[Side, ...]
    settings: tuple[Setting, ...]
    seed: int
    duration: float
    complete: bool = True

    def __post_init__(self) -> None:
        if not self.sides:
            raise InputError(f"{self.experiment}: nothing was run, so there is nothing to show")

    @property
    def verdict(self) -> Verdict:
        """Verdict on the adaptive controllers of all arms together."""
        return Verdict.together(judged(side.comparison) for side in self.sides)


def of_arms(result: SideBySide) -> Iterator[Drawing]:
    """Iterator over the report's figures: operations (where they were counted), the tips' paths and errors, and the
    Lyapunov functions."""
    if all(side.subject.cost for side in result.sides):
        caption = "Floating-point operations on the independent parameters (full) and on all (pale)."
        yield Drawing("operations", caption, partial(_draw_operations, result))
    caption = (
        "The path that both tips are to follow (dashed), and where they went while learning, from the start off it."
    )
    yield Drawing("tip-path", caption, partial(_draw_paths, result))
    caption = (
        "Distance of the tip from where it should be (logarithmic scale): learning, and with adaptation off (dashed)."
    )
    yield Drawing("tip-error", caption, partial(_draw_errors, result))
    caption = "The Lyapunov function over its first value, along the adaptive runs. In theory it never rises."
    yield Drawing("lyapunov", caption, partial(_draw_lyapunov, result))


def _draw_operations(result: SideBySide) -> Figure:
    figure = sheet(2.7)
    panels = figure.subplots(1, 2)
    regressors = [(side.regressor["reduced"], side.regressor["full"]) for side in result.sides]
    ticks = [(side.flops(side.subject), side.flops(side.full)) for side in result.sides]
    for axes, title, counts in zip(panels, ("Slotine-Li regressor", "Adaptive tick"), (regressors, ticks), strict=True):
        for i, (reduced, full) in enumerate(counts):
            for place, value, alpha in ((2.4 * i, reduced, 1.0), (2.4 * i + 1.0, full, 0.4)):
                axes.barh(place, value, color=COLORS[i].hex, alpha=alpha, height=0.85)
                axes.text(value, place, f" {value:,}", va="center", size=8)
        axes.set_yticks([2.4 * i + 0.5 for i in range(len(counts))], [side.arm.label for side in result.sides])
        axes.invert_yaxis()
        axes.margins(x=0.18)
        axes.grid(visible=False, axis="y")
        axes.set_title(f"{title} [operations]")
    panels[1].set_yticklabels([])
    return figure


def _draw_paths(result: SideBySide) -> Figure:
    figure = sheet(3.4)
    path = result.sides[0].desired[result.sides[0].subject.name]
    goal = {"color": GOAL.faded(0.45, INK).hex, "linewidth": 1.2, "linestyle": DASHED, "label": "desired"}
    for axes, (across, up, view) in zip(figure.subplots(1, 3), VIEWS, strict=True):
        for side, color in zip(result.sides, COLORS, strict=False):
            tip = side.tips[side.subject.name]
            axes.plot(tip[:, across], tip[:, up], color=color.hex, linewidth=1.4, label=side.arm.label)
        axes.plot(path[:, across], path[:, up], **goal)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(xlabel=f"{'xyz'[across]} [m]", ylabel=f"{'xyz'[up]} [m]", title=view)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return figure


def _draw_errors(result: SideBySide) -> Figure:
    figure = sheet(3.6)
    axes = figure.subplots()
    for side, color in zip(result.sides, COLORS, strict=False):
        shown = ((side.subject, "learning", 1.8, "-"), (side.comparison.baseline, "adaptation off", 1.2, DASHED))
        for run, label, width, line in shown:
            if run is not None:
                every = thinned(len(run.rollout.time), SAMPLES)
                style = {
                    "color": color.hex,
                    "linewidth": width,
                    "linestyle": line,
                    "label": f"{side.arm.label}, {label}",
                }
                axes.semilogy(run.rollout.time[every], 1e3 * side.tip_errors(run)[every], **style)
    axes.set(xlabel="time [s]", ylabel="distance from the path [mm]")
    axes.set_xlim(0.0, max(side.subject.duration for side in result.sides))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def _draw_lyapunov(result: SideBySide) -> Figure:
    figure = sheet(2.6)
    axes = figure.subplots()
    for side, color in zip(result.sides, COLORS, strict=False):
        V = side.subject.lyapunov
        if V is not None and V[0] > 0.0:
            every = thinned(len(V), SAMPLES)
            time = side.subject.rollout.time[every]
            axes.plot(time, V[every] / V[0], color=color.hex, linewidth=2.0, label=side.arm.label)
    axes.set(xlabel="time [s]", ylabel="V / V(0)", ylim=(0.0, 1.05))
    axes.legend(loc="lower left")
    return figure
