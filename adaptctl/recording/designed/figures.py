"""Figures of a study of a design."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from adaptctl.arrays import Array
from adaptctl.design import DesignStudy, DesignTask
from adaptctl.recording.designed.picture import arm_figure
from adaptctl.recording.drawing import Drawing, sheet
from adaptctl.recording.palette import run_color
from adaptctl.recording.skeleton import skeleton


def drawings(study: DesignStudy) -> Iterator[Drawing]:
    """Figures of a design `study`, each a `Drawing` with name, caption and drawing function, in the order of the
    report. They are the arm coloured by the relative change of the motion's energy by a point mass at each position,
    these changes on every link, the joints' torques, and energy errors by number of essential components (combinations
    of parameters). Nothing is drawn, nor raised, before a drawing's function is called."""
    mass, mechanism = study.body.mass, study.task.mechanism
    yield Drawing(
        "arm",
        f"The arm, coloured by what a point of {mass:g} kg does to the energy that its motion carries: blue where it "
        "balances the arm, red where it costs. Yellow: the counterweights.",
        partial(arm_figure, study, skeleton(mechanism), mechanism.home),
    )
    yield Drawing(
        "links",
        f"What {mass:g} kg costs at the cheapest place of every link's bounds, at its centre of mass, and at the "
        "dearest place.",
        partial(links_figure, study),
    )
    yield Drawing(
        "torques",
        "Root mean square torques over the task, without the counterweights and with them.",
        partial(torques_figure, study),
    )
    yield Drawing(
        "components",
        "Energy error when only the first components are kept (equation 23), without the counterweights and with them. "
        f"Dashed: {study.percent:g} %.",
        partial(components_figure, study),
    )


def links_figure(study: DesignStudy) -> Figure:
    """Figure (Matplotlib) of the changes, in percent, of the energy of a design study's motion by a point with the mass
    of the study's body on every link: at the link's centre of mass, and at the two positions, among those that the
    study allows on the link, where the energy becomes least and greatest. Energy is its root mean square about its mean
    over the task's states. Nothing is checked."""
    figure = sheet(0.55 + 0.5 * len(study.links))
    axes = figure.subplots()
    place = np.arange(len(study.links))
    values = ([c.least for c in study.links], [c.at_center for c in study.links], [c.most for c in study.links])
    for i, (label, each) in enumerate(zip(("cheapest", "centre of mass", "dearest"), values, strict=True)):
        axes.barh(place + 0.27 * (i - 1), 100.0 * np.array(each), 0.25, color=run_color((0, 4, 1)[i]).hex, label=label)
    axes.set_yticks(place, [cost.link for cost in study.links])
    axes.invert_yaxis()
    axes.set_xlabel("change of the energy carried [%]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure


def torques_figure(study: DesignStudy) -> Figure:
    """Figure (Matplotlib) of the root mean square torque of every joint over the states of a design study's task, N m
    (N if prismatic), friction left out, without the counterweights and with them. Nothing is checked."""
    figure = sheet(2.8)
    axes = figure.subplots()
    names = [joint.name for joint in study.task.mechanism.primary_joints]
    for i, (label, task) in enumerate(_two(study)):
        axes.bar(np.arange(len(names)) + 0.38 * i, task.torques(), 0.36, color=run_color(1 - i).hex, label=label)
    axes.set_xticks(np.arange(len(names)) + 0.19, names)
    axes.set_ylabel("RMS torque [N m, N]")
    axes.legend(loc="upper right")
    return figure


def components_figure(study: DesignStudy) -> Figure:
    """Figure (Matplotlib) of a design study's energy errors, in percent, on a logarithmic scale, by the number of
    essential components that are kept, without the counterweights and with them. Essential components are combinations
    of inertial parameters, those that make most of the energy first. Raises `RankError` where the mechanism's rank, its
    number of base parameters, cannot be certified."""
    figure = sheet(2.8)
    axes = figure.subplots()
    for i, (label, task) in enumerate(_two(study)):
        errors = percent_errors(task)
        shown = errors > 1e-8
        axes.semilogy(np.arange(len(errors))[shown], errors[shown], "o-", ms=3, color=run_color(1 - i).hex, label=label)
    axes.axhline(study.percent, linestyle=(0, (4, 3)), color=run_color(4).hex)
    axes.set_xlabel("components")
    axes.set_ylabel("energy error [%]")
    axes.legend(loc="upper right")
    return figure


def percent_errors(task: DesignTask) -> Array:
    """Energy errors (k + 1,), in percent, when 0, 1, ... k of the k essential components are kept, those that make most
    of the energy first. The energy that they are a percentage of is its root mean square about its mean over the task's
    states; errors are NaN where it is zero. Essential components are combinations of inertial parameters, the right
    singular vectors of the matrix of energies about their mean, with a row for each state and a column for each
    parameter (Sheu and Walker 1991, equation 23). Raises `RankError` where the mechanism's rank k cannot be certified.
    """
    squares = np.sort(np.square(task.matrix("components") @ task.parameters))
    tails = np.append(np.cumsum(squares)[::-1], 0.0)
    return np.asarray(100.0 * np.sqrt(tails / tails[0]))


def _two(study: DesignStudy) -> tuple[tuple[str, DesignTask], tuple[str, DesignTask]]:
    return ("as described", study.task), ("with counterweights", study.counterweights.balanced)
